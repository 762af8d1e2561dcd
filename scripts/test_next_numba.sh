#!/usr/bin/env bash
# Tries the newest Numba, releases to come included, where pyproject.toml has an upper bound: installs it over
# that of .venv (scripts/setup.sh test comes first), says both versions, and runs the tests of compiled code.
# The dependencies' bound is then exceeded on purpose; scripts/setup.sh test puts the tested version back.
# Usage: scripts/test_next_numba.sh [arguments of pytest]
set -euo pipefail

ROOT=$(cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.." && pwd)
PYTHON=$ROOT/.venv/bin/python
TESTS=(tests/system tests/contact tests/engines/compiled tests/verification/test_engines.py)

say() { printf 'next numba: %s\n' "$*"; }

version() { "$PYTHON" -c 'from importlib.metadata import version; print(version("numba"), "llvmlite", version("llvmlite"))'; }

cd "$ROOT"
before=$(version)
numpy=$("$PYTHON" -c 'import numpy; print(numpy.__version__)')
printf 'numpy==%s\n' "$numpy" >.venv/next-numba.txt # the distribution's, for which dolfinx is built
"$PYTHON" -m pip install --quiet --upgrade --pre -c .venv/next-numba.txt numba
after=$(version)
if [[ $before == "$after" ]]; then
    say "$before is the newest one for numpy $numpy"
    exit 0
fi
say "$before was tested, $after is tried"
# other kernels than those that were kept; what Numba takes away later is a warning, and an error here
NUMBA_CACHE_DIR=$(mktemp -d)
export NUMBA_CACHE_DIR
trap 'rm -rf -- "$NUMBA_CACHE_DIR"' EXIT
"$PYTHON" -m pytest -q -m "not nightly" "${TESTS[@]}" "$@"
say "$after passes these tests: raise the bound in pyproject.toml and conda.recipe/recipe.yaml"
