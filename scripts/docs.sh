#!/usr/bin/env bash
# Makes the documentation site in docs/_build: open docs/_build/index.html. Arguments go to
# sphinx-build. Warnings are errors; nothing is fetched.
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
scripts/setup.sh test
source scripts/clean_environment.sh
exec .venv/bin/python -m sphinx -W --keep-going -q -b html "$@" docs docs/_build
