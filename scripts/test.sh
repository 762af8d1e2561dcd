#!/usr/bin/env bash
# Sets up, then checks style and types and runs all tests with the coverage of branches, which has to
# reach what pyproject.toml says. With arguments, which go to pytest, coverage is left out.
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/mypy
if (($#)); then
    exec .venv/bin/python -m pytest "$@"
fi
exec .venv/bin/python -m pytest --cov --cov-report=term
