#!/usr/bin/env bash
# Sets up, then checks style and types and runs the tests; arguments go to pytest, for example
# --cov for the coverage of branches, which then has to reach what pyproject.toml says.
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/mypy
exec .venv/bin/python -m pytest "$@"
