#!/usr/bin/env bash
# Sets delam_fem up on Debian: installs dolfinx and related packages with apt, and all other packages
# from PyPI in .venv. The script can be repeated; it does nothing if nothing has changed meanwhile.
# Usage: scripts/setup.sh [test]    ("test" adds what the tests and the documentation site need)
set -euo pipefail

ROOT=$(cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.." && pwd)
VENV=$ROOT/.venv
EXTRA='' # or "test", an extra in pyproject.toml
PYTHON=/usr/bin/python3 # sees the distribution's dolfinx, for any PATH
PACKAGES=(
    python3-dolfinx python3-petsc4py python3-slepc4py python3-mpi4py python3-meshio python3-gmsh
    python3-numpy
    python3-venv
    libopenblas0-serial        # factors of solids take a third of the time of the reference BLAS
    ca-certificates            # pip downloads
    openmpi-bin                # mpirun
    libegl1 libgl1-mesa-dri    # pictures without a display
)
LISTS_AGE=1440 # minutes after which apt's package lists are fetched anew

say() { printf 'setup: %s\n' "$*"; }

die() {
    printf 'setup: %s\n' "$@" >&2
    exit 1
}

# Prints the codename of the Debian release that the file $1 (os-release) describes. Testing and
# unstable have the same name in this file; both give "sid".
debian_codename() {
    local id='' name=''
    if [[ -r $1 ]]; then
        id=$(. "$1" && printf '%s' "${ID:-}")
        name=$(. "$1" && [[ ${PRETTY_NAME:-} != */sid* ]] && printf '%s' "${VERSION_CODENAME:-}") || true
    fi
    if [[ $id != debian ]]; then
        die "expected Debian 12, 13 or sid, found ${id:-no os-release}. On other systems install dolfinx with" \
            "conda:  conda create -n delam -c conda-forge fenics-dolfinx petsc4py mpi4py meshio python-gmsh" \
            "        conda activate delam && pip install -e '$ROOT[test]'" \
            "docker: docker run -it -v '$ROOT':/delam_fem -w /delam_fem dolfinx/dolfinx:stable" \
            "        pip install -e '.[test]'    # in the container"
    fi
    printf '%s\n' "${name:-sid}"
}

# Prints the Debian packages that are not installed yet.
missing_packages() {
    local package
    for package in "${PACKAGES[@]}"; do
        [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] ||
            printf '%s\n' "$package"
    done
}

# Runs a command as root, or ends with the command that an administrator must run.
as_root() {
    if [[ $(id -u) == 0 ]]; then
        "$@"
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || { [[ -t 0 ]] && sudo -v; }; }; then
        sudo "$@"
    else
        die "Debian packages are missing, and this user is neither root nor allowed to use sudo." \
            "Ask an administrator to run the following command, then run this script again:" \
            "  apt-get update && apt-get install -y --no-install-recommends $(missing_packages | tr '\n' ' ')"
    fi
}

apt_get() {
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -o DPkg::Lock::Timeout=600 "$@" 9<&-
}

lists_are_fresh() {
    [[ -n $(find /var/lib/apt/lists -maxdepth 1 -name '*_Packages*' -mmin "-$LISTS_AGE" -print -quit 2>/dev/null) ]]
}

install_packages() {
    local missing
    mapfile -t missing < <(missing_packages)
    ((${#missing[@]})) || return 0
    say "installing from Debian: ${missing[*]}"
    lists_are_fresh || apt_get update || say "apt-get update failed; going on with the present package lists"
    apt_get install -y --no-install-recommends "${missing[@]}" ||
        { apt_get update && apt_get install -y --no-install-recommends "${missing[@]}"; } ||
        die "apt-get could not install: ${missing[*]}" \
            "See its message above; 'apt-cache policy python3-dolfinx' shows whether the sources have dolfinx."
}

# Prints the upstream version of the distribution's numpy, for which its dolfinx is compiled.
distribution_numpy() {
    dpkg-query -W -f '${Version}' python3-numpy | sed -E 's/^[0-9]+://; s/[+~-].*$//'
}

# Prints the constraints of release $1; adds the distribution's numpy if they do not set numpy.
constraints() {
    local file=$ROOT/scripts/constraints-$1.txt
    [[ ! -r $file ]] || cat "$file"
    grep -qs '^numpy==' "$file" || printf 'numpy==%s\n' "$(distribution_numpy)"
}

# Prints the file that says for which state the set-up (with extra $1, if given) was done.
stamp() { printf '%s\n' "$VENV/delam_fem-setup${1:+-$1}.sha256"; }

# Prints a checksum of everything that the set-up for release $1 depends on.
fingerprint() {
    {
        printf '%s\n' "$ROOT" "$1"
        cat "$ROOT/pyproject.toml" "$ROOT/scripts/setup.sh" "$ROOT/scripts/clean_environment.sh"
        constraints "$1"
        dpkg-query -W -f '${Package} ${Version} ${db:Status-Status}\n' "${PACKAGES[@]}" 2>/dev/null || true
    } | sha256sum
}

is_done() {
    local stamp
    stamp=$(stamp "$EXTRA")
    [[ -x $VENV/bin/delam-fem && -r $stamp && $(<"$stamp") == "$(fingerprint "$1")" ]]
}

# Succeeds if .venv was made in this place by this interpreter and sees the system's packages.
venv_is_usable() {
    local describe='import sys; print(sys.version, sys.base_prefix)'
    grep -qs '^include-system-site-packages = true' "$VENV/pyvenv.cfg" &&
        [[ $("$VENV/bin/python" -I -c "$describe" 2>/dev/null) == "$("$PYTHON" -I -c "$describe")" ]] &&
        [[ $("$VENV/bin/python" -I -c 'import sys; print(sys.prefix)') == "$VENV" ]] &&
        head -n 1 "$VENV/bin/pip" 2>/dev/null | grep -qF "$VENV/"
}

make_venv() {
    if ! venv_is_usable; then
        if [[ -e $VENV && ! -e $VENV/pyvenv.cfg && -n $(ls -A "$VENV") ]]; then
            die "$VENV exists, but is not a Python environment: move it away and run this script again"
        fi
        say "making $VENV"
        "$PYTHON" -m venv --clear --system-site-packages "$VENV"
    fi
    # Otherwise packages of 'pip install --user' would hide those of the distribution.
    local site
    site=$("$VENV/bin/python" -I -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    printf 'import site; site.ENABLE_USER_SITE = False\n' >"$site/no_user_site.pth"
}

install_python_packages() {
    local options=(--disable-pip-version-check --no-input --no-compile) # Python compiles what it imports
    [[ -t 1 ]] || options+=(--quiet)
    say "installing from PyPI${EXTRA:+, with what tests need} (some minutes)"
    constraints "$1" >"$VENV/constraints.txt"
    "$VENV/bin/python" -I -m pip install "${options[@]}" -c "$VENV/constraints.txt" -e "$ROOT${EXTRA:+[$EXTRA]}" ||
        die "pip could not install the Python packages; see its message above"
}

verify() {
    local expected=$1
    "$VENV/bin/python" -I - "$expected" <<'PYTHON' || die "the packages do not work together; remove $VENV and run this script again"
import sys

import numpy
import mpi4py
import petsc4py
from delam_fem.model import _dolfinx

if numpy.__version__ != sys.argv[1]:
    sys.exit(f"expected the distribution's numpy {sys.argv[1]}, found {numpy.__version__} in {numpy.__file__}")
print(
    f"setup: Python {sys.version.split()[0]}, dolfinx {_dolfinx.version}, "
    f"petsc4py {petsc4py.__version__}, mpi4py {mpi4py.__version__}, numpy {numpy.__version__}"
)
PYTHON
}

main() {
    local release extra
    EXTRA=${1:-}
    [[ -z $EXTRA || $EXTRA == test ]] || die "expected no argument or \"test\", given \"$EXTRA\""
    release=$(debian_codename /etc/os-release)
    # shellcheck source=scripts/clean_environment.sh
    source "$ROOT/scripts/clean_environment.sh"
    if is_done "$release"; then
        say "nothing to do"
        return
    fi
    exec 9<"$ROOT"
    flock -n 9 || { say "waiting for another set-up of this folder" && flock 9; }
    if is_done "$release"; then
        say "done by the other"
        return
    fi
    [[ -r $ROOT/scripts/constraints-$release.txt ]] ||
        say "Debian $release is untested with this version; going on, with only numpy fixed to the distribution's version"
    rm -f "$(stamp "$EXTRA")"
    install_packages
    make_venv
    install_python_packages "$release"
    verify "$(distribution_numpy)"
    for extra in "" "$EXTRA"; do
        fingerprint "$release" >"$(stamp "$extra").new"
        mv "$(stamp "$extra").new" "$(stamp "$extra")"
    done
    say "done: $VENV/bin/delam-fem"
}

if [[ ${BASH_SOURCE[0]} == "$0" ]]; then
    main "$@"
fi
