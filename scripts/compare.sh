#!/usr/bin/env bash
# Compares the numbers of the working tree with those of another revision, and prints a report. It
# fails where a case moved that no message of the commits between them names.
# Usage: scripts/compare.sh [REVISION]    (default: HEAD~1)
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."
source scripts/clean_environment.sh
revision=${1:-HEAD~1}
status=0
report=$(.venv/bin/python tests/unchanged_numbers.py against "$revision") || status=$?
printf '## Numbers beside %s\n\n```\n%s\n```\n' "$revision" "$report"
((status)) || exit 0
messages=$(git log --format=%B "$revision"..HEAD)
unnamed=()
while read -r name; do
    grep -qiF -- "$name" <<<"$messages" || unnamed+=("$name")
done < <(sed -n 's/^\([^ :.]*\)[^ :]*: .*/\1/p' <<<"$report" | sort -u)
((${#unnamed[@]})) || exit 0
printf 'Moved, and named in no message: %s\n' "${unnamed[*]}"
exit 1
