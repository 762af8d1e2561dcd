#!/usr/bin/env bash
# Tests the project on other Debian releases. For each release, debootstrap makes a fresh tree; there the
# script installs the project as its README says, runs all tests and a short demo, and removes the tree.
# Usage: scripts/test_versions.sh [--short] [bookworm|trixie|sid]…    (default: trixie sid, side by side)
# --short: tests of the folders that stand on dolfinx, PETSc, Numba and xarray, slow ones left out.
# Exit status: 0 if all passed; 1 if one failed; 77 if none failed, but one could not be tested.
# The script needs root (or sudo), about 5 GB in $TMPDIR for each release, and 30 minutes. If a release
# does not pass, its log stays in runs/versions.
set -euo pipefail

ROOT=$(cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.." && pwd)
DEFAULT_RELEASES=(trixie sid)
MIRROR=http://deb.debian.org/debian # used if the machine's own sources name none
PLACE=/opt/delam_fem                # folder of the project in a tree
DEBOOTSTRAP_SECONDS=900             # it takes half a minute; a dead connection would hang for hours
SETUP_SECONDS=1200                  # a few minutes
TESTS_MINUTES=15                    # about twenty side by side; on a slower machine the tests that are left are skipped
TESTS_SECONDS=3000
SHORT_MINUTES=5
SHORT_TESTS=(tests/test_versions.py tests/test_start.py tests/test_doctests.py
    tests/model tests/engines tests/simulation tests/verification tests/results)
NOT_TESTED=77
LEFT_OUT="left out are the tests marked 'once', which are the same on every release, and 'stored', whose texts are of one"

say() { printf 'test_versions: %s\n' "$*"; }

# -- within the namespaces of one tree ------------------------------------------------------------
# Everything that is mounted here disappears with the last process of the namespaces.

# Prints the address of the Debian archive in the apt configuration $1, in the old or the new format.
mirror() {
    local found
    found=$({ cat "$1"/sources.list "$1"/sources.list.d/*.{list,sources} 2>/dev/null || true; } |
        sed -nE 's#^(URIs:|deb( \[[^]]*\])?) *(https?://[^ ]*/debian)/?( .*)?$#\3#p' | sort -u)
    printf '%s\n' "${found%%$'\n'*}" | sed "s#^\$#$MIRROR#"
}

# Ends the test of this tree with a verdict, a reason and any further lines on stdin.
verdict() {
    { printf '%s\n' "$1: $2" && cat; } >"$RESULT"
    exit 0
}

# Copies to the tree the configuration that apt and pip of this machine need to reach their servers.
provide() {
    local tree=$1 file
    for file in /etc/hosts /etc/resolv.conf /etc/ssl/certs/ca-certificates.crt \
        /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf"; do
        if [[ -r $file ]]; then
            mkdir -p "$tree${file%/*}"
            cp -L "$file" "$tree$file"
        fi
    done
    mkdir -p "$tree/usr/local/share/ca-certificates"
    cp -rL /usr/local/share/ca-certificates/. "$tree/usr/local/share/ca-certificates" 2>/dev/null || true
    apt-config dump | grep '^Acquire::' >"$tree/etc/apt/apt.conf.d/90host" || true
    printf 'force-unsafe-io\n' >"$tree/etc/dpkg/dpkg.cfg.d/throwaway" # the tree need not survive a crash
}

# Runs a command in the project's folder of the tree; of this environment it sees only network settings.
within() {
    local tree=$1 name network=()
    shift
    for name in {http,https,ftp,no,all}_proxy {HTTP,HTTPS,FTP,NO,ALL}_PROXY \
        PIP_{INDEX_URL,EXTRA_INDEX_URL,TRUSTED_HOST,DEFAULT_TIMEOUT}; do
        [[ -z ${!name:-} ]] || network+=("$name=${!name}")
    done
    chroot "$tree" env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin "${network[@]}" \
        DEBIAN_FRONTEND=noninteractive sh -c 'cd "$0" && exec "$@"' "$PLACE" "$@" </dev/null
}

# Prints the command for the set-up in a code block of the README $1.
readme_setup() {
    awk '/^```/ { code = ($0 == "```bash") } code && $1 == "scripts/setup.sh" { print $1; found = 1; exit }
         END { exit !found }' "$1"
}

# Prints "Python …, dolfinx …, PETSc …, numpy …" of the tree.
versions() {
    within "$1" .venv/bin/python -c '
import platform, numpy
from petsc4py import PETSc
from delam_fem.model import _dolfinx
petsc = ".".join(map(str, PETSc.Sys.getVersion()))
print(f"Python {platform.python_version()}, dolfinx {_dolfinx.version}, PETSc {petsc}, numpy {numpy.__version__}")'
}

short_demo() {
    within "$1" .venv/bin/delam-fem run paper --set time.periods=20 -o /tmp/demo &&
        within "$1" sh -c 'cd /tmp/demo && grep -q "\"outcome\": \"completed\"" summary.json &&
            ls case.toml result.nc report.html figures/*.png fields/fields.pvd'
}

# Tests release $1 in folder $2 (shortly, if $3 is --short); the result goes to $2/result, the progress to
# file descriptor 3.
test_tree() {
    local release=$1 tree=$2/tree archive command found status=0 minutes=$TESTS_MINUTES tests=()
    local marked="not once and not stored and not nightly" left_out=$LEFT_OUT
    if [[ ${3-} == --short ]]; then
        minutes=$SHORT_MINUTES
        tests=("${SHORT_TESTS[@]}")
        marked="$marked and not slow"
        left_out="$LEFT_OUT; short: tests are those of ${SHORT_TESTS[*]}, without slow ones"
    fi
    RESULT=$2/result
    archive=$(mirror /etc/apt)
    say "$release: making a tree" >&3
    timeout "$DEBOOTSTRAP_SECONDS" debootstrap --variant=minbase "$release" "$tree" "$archive" ||
        verdict "not tested" "no tree from $archive; debootstrap's last words are in the log" </dev/null
    { mount -t proc proc "$tree/proc" && mount --rbind /sys "$tree/sys" && mount --rbind /dev "$tree/dev"; } ||
        verdict "not tested" "nothing can be mounted in the tree" </dev/null
    provide "$tree"
    mkdir -p "$tree$PLACE"
    tar -x -f "$2/../project.tar" -C "$tree$PLACE"
    within "$tree" apt-get -q update -o APT::Update::Error-Mode=any ||
        verdict "not tested" "apt-get in the tree cannot reach $archive" </dev/null
    command=$(readme_setup "$tree$PLACE/README.md") ||
        verdict failed "README.md has no line 'scripts/setup.sh' in a bash block" </dev/null
    say "$release: $command" >&3
    within "$tree" timeout "$SETUP_SECONDS" "$command" || verdict failed "$command" </dev/null
    say "$release: short demo" >&3
    short_demo "$tree" || verdict failed "$(versions "$tree"); the short demo failed" </dev/null
    say "$release: tests" >&3
    within "$tree" timeout "$SETUP_SECONDS" "$command" test || verdict failed "$command test" </dev/null
    # COLUMNS: a line of the result says why a test has failed
    within "$tree" timeout "$TESTS_SECONDS" env COLUMNS=300 .venv/bin/python -m pytest -q --numprocesses=auto --dist=worksteal \
        -p no:cacheprovider --minutes="$minutes" -m "$marked" "${tests[@]}" | tee "$2/pytest" || status=$?
    found="$(versions "$tree"); tests: $(tests_summary "$2/pytest" || printf 'no summary, exit status %s' "$status")"
    ((status)) && status=failed || status=passed
    verdict "$status" "$found" < <(
        grep -E '^(SKIPPED|FAILED|ERROR) ' "$2/pytest" || true
        printf '%s\n' "$left_out"
    )
}

# Prints pytest's last line with the numbers of passed, skipped and failed tests.
tests_summary() {
    grep -E '^[0-9]+ (passed|failed|skipped|error).* in [0-9.]+s' "$1" | tail -n 1
}

# -- outside --------------------------------------------------------------------------------------

# Prints why no tree can be made here, or nothing if it can. Installs debootstrap if it is missing.
obstacle() {
    if [[ $(id -u) != 0 ]]; then
        printf 'neither root nor a user whom sudo lets in without a password\n'
    elif ! command -v debootstrap >/dev/null && ! {
        apt-get -q install -y --no-install-recommends debootstrap ||
            { apt-get -q update && apt-get -q install -y --no-install-recommends debootstrap; }
    } >&2; then
        printf 'debootstrap is missing and apt-get could not install it\n'
    elif ! unshare --mount --pid --fork true 2>/dev/null; then
        printf 'this system does not let even root mount anything (a container without privileges?)\n'
    fi
}

# Removes everything, after the processes in the trees have ended.
clean_up() {
    local running
    running=$(jobs -pr)
    [[ -z $running ]] || say "ending what runs and removing the trees"
    {
        # --kill-child also kills all processes in the namespaces of each
        [[ -z $running ]] || xargs kill -KILL <<<"$running"
        wait
    } 2>/dev/null
    for _ in {1..50}; do
        rm -rf --one-file-system -- "$WORK" 2>/dev/null && return
        sleep 0.2
    done
    say "could not remove $WORK" >&2
}

# Packs the files that git tracks, in their present state, without ignored files.
pack_project() {
    cd -- "$ROOT"
    { git -c safe.directory="$ROOT" ls-files -z 2>/dev/null ||
        find . \( -name .venv -o -name runs -o -name __pycache__ \) -prune -o -type f -print0; } |
        while IFS= read -r -d '' file; do [[ ! -e $file ]] || printf '%s\0' "$file"; done |
        tar -c -f "$WORK/project.tar" --owner=0 --group=0 --null -T -
}

start() {
    local release=$1
    mkdir "$WORK/$release"
    unshare --mount --propagation private --pid --fork --kill-child -- \
        "${BASH_SOURCE[0]}" --within-namespaces "$release" "$WORK/$release" "$SHORT" 3>&1 >"$WORK/$release/log" 2>&1 &
}

# Prints the result of each release; fails as the header says.
report() {
    local release status=0 result
    for release in "$@"; do
        result=$WORK/$release/result
        [[ -s $result ]] || printf 'failed: ended without a result\n' >"$result"
        if [[ $(<"$result") != passed:* ]]; then
            mkdir -p "$ROOT/runs/versions"
            cp "$WORK/$release/log" "$ROOT/runs/versions/$release.log"
            printf '\n--- %s, end of runs/versions/%s.log:\n' "$release" "$release"
            tail -n 80 "$WORK/$release/log"
        fi
    done
    printf '\n'
    for release in "$@"; do
        result=$WORK/$release/result
        sed -e "1s/^/$release: /" -e "2,\$s/^/$release:   /" "$result"
        case $(<"$result") in
            passed:*) ;;
            "not tested:"*) ((status == 1)) || status=$NOT_TESTED ;;
            *) status=1 ;;
        esac
    done
    return "$status"
}

main() {
    local releases release why
    SHORT=''
    if [[ ${1-} == --short ]]; then
        SHORT=$1
        shift
    fi
    releases=("$@")
    ((${#releases[@]})) || releases=("${DEFAULT_RELEASES[@]}")
    for release in "${releases[@]}"; do
        if [[ ! -r $ROOT/scripts/constraints-$release.txt ]]; then
            say "expected a release that has scripts/constraints-RELEASE.txt, given $release" >&2
            exit 2
        fi
    done
    if [[ $(id -u) != 0 ]] && sudo -n true 2>/dev/null; then
        exec sudo -n --preserve-env=TMPDIR,http_proxy,https_proxy,no_proxy "$0" ${SHORT:+"$SHORT"} "${releases[@]}"
    fi
    why=$(obstacle)
    if [[ -n $why ]]; then
        printf '%s: not tested: '"$why"'\n' "${releases[@]}"
        exit "$NOT_TESTED"
    fi
    WORK=$(mktemp -d --tmpdir delam_fem-versions.XXXXXXXX)
    trap clean_up EXIT
    trap 'exit 129' HUP
    trap 'exit 130' INT
    trap 'exit 143' TERM
    pack_project
    say "${releases[*]}: this takes about ten minutes; see $WORK/*/log meanwhile"
    for release in "${releases[@]}"; do
        start "$release"
    done
    wait
    report "${releases[@]}"
}

if [[ ${BASH_SOURCE[0]} == "$0" ]]; then
    if [[ ${1:-} == --within-namespaces ]]; then
        test_tree "${@:2}"
    else
        main "$@"
    fi
fi
