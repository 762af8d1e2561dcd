#!/usr/bin/env bash
# Sets delam_fem up, checks style, spelling and types, and runs all tests but slow and nightly ones on all cores.
# Arguments go to pytest instead: "scripts/test.sh tests/case/test_gap.py".
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh test
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/codespell
.venv/bin/mypy
(($#)) || set -- --numprocesses=auto --dist=worksteal
exec .venv/bin/python -m pytest "$@"
