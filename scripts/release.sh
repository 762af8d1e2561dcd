#!/usr/bin/env bash
# Makes a release candidate in dist/: checks versions and the changelog, runs the tests, builds wheel and
# sdist, installs both in clean environments, and says what a person does next. It uploads nothing.
# Usage: scripts/release.sh VERSION [--without-tests]
set -euo pipefail

cd -P -- "$(dirname -- "$(readlink -f -- "${BASH_SOURCE[0]}")")/.."

say() { printf 'release: %s\n' "$*"; }

die() {
    printf 'release: %s\n' "$@" >&2
    exit 1
}

version=${1:-}
[[ $version =~ ^[0-9]+\.[0-9]+\.[0-9]+((a|b|rc)[0-9]+)?$ ]] ||
    die "expected a version such as 0.1.0, given '$version'"
[[ -z $(git status --porcelain --untracked-files=no) ]] ||
    die "expected a tree without changes; commit them, or put them aside by 'git stash'"
grep -qx "version = \"$version\"" pyproject.toml ||
    die "pyproject.toml: expected version = \"$version\""
grep -qx "version: $version" CITATION.cff || die "CITATION.cff: expected version: $version"
grep -qF "version: \"$version\"" conda.recipe/recipe.yaml ||
    die "conda.recipe/recipe.yaml: expected version: \"$version\""
grep -q "^## \[$version\]" CHANGELOG.md || die "CHANGELOG.md: expected a heading '## [$version]'"
! sed -n '/^## \[Unreleased\]/,/^## \[[0-9]/p' CHANGELOG.md | grep -q '^- ' ||
    die "CHANGELOG.md: expected no line below [Unreleased]; move them below [$version]"

[[ ${2:-} == --without-tests ]] || scripts/test.sh
scripts/setup.sh test
source scripts/clean_environment.sh
rm -rf dist
.venv/bin/python -m build --outdir dist .

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for file in dist/*.whl dist/*.tar.gz; do
    say "installing $file in a clean environment"
    /usr/bin/python3 -m venv --clear "$folder/venv"
    "$folder/venv/bin/pip" install -q "$file"
    (cd "$folder" && venv/bin/delam-fem run default --overwrite --no-figures -o run \
        --set mesh.elements=4 --set time.steps_per_period=60 --set time.periods=3)
done
say "dist/ holds what is released:"
ls -l dist
say "then: write the date into the heading of $version in CHANGELOG.md, and commit it"
say "and:  git tag -a v$version -m 'delam_fem $version' && git push origin v$version"
say "and:  .venv/bin/python -m pip install twine && .venv/bin/python -m twine upload dist/*"
