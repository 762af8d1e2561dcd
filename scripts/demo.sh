#!/usr/bin/env bash
# Sets delam_fem up, then runs the preset `paper` at 3.25 Hz and writes figures, fields and report.
# Usage: scripts/demo.sh [FOLDER]    (default: runs/demo in this project)
set -euo pipefail

root=$(cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.." && pwd)
"$root/scripts/setup.sh"
source "$root/scripts/clean_environment.sh"
exec "$root/.venv/bin/delam-fem" run paper --set excitation.frequency=3.25 -o "${1:-$root/runs/demo}"
