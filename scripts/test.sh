#!/usr/bin/env bash
# Sets up, checks style and types, and runs all tests with the coverage of branches, which has to reach
# what pyproject.toml says. Arguments go to pytest instead of that: "scripts/test.sh tests/test_gap.py".
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/mypy
(($#)) || set -- --cov --cov-report=term-missing:skip-covered
exec .venv/bin/python -m pytest "$@"
