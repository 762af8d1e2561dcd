#!/usr/bin/env bash
# Sets delam_fem up, checks style and types, and runs all tests with branch coverage, which must reach
# the limit in pyproject.toml. Arguments go to pytest instead: "scripts/test.sh tests/case/test_gap.py".
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/mypy
(($#)) || set -- --cov --cov-report=term-missing:skip-covered
exec .venv/bin/python -m pytest "$@"
