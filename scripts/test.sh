#!/usr/bin/env bash
# Sets delam_fem up, checks style, spelling and types, and runs all tests but slow and nightly ones on all cores.
# Arguments go to pytest instead: "scripts/test.sh tests/case/test_gap.py". "scripts/test.sh --changed" runs what
# scripts/changed_tests.py names: the tests that run changed lines, 2 minutes of them, to the first that fails.
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
if [[ ${1-} == --changed ]]; then
    source scripts/clean_environment.sh
    mapfile -t TESTS < <(.venv/bin/python scripts/changed_tests.py "${@:2}")
    ((${#TESTS[@]})) || exit 0
    exec .venv/bin/python -m pytest --exitfirst "${TESTS[@]}"
fi
scripts/setup.sh test
source scripts/clean_environment.sh
.venv/bin/ruff check .
.venv/bin/ruff format --check .
.venv/bin/codespell
.venv/bin/mypy
(($#)) || set -- --numprocesses=auto --dist=worksteal
exec .venv/bin/python -m pytest "$@"
