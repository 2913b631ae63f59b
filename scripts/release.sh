#!/usr/bin/env bash
# Makes out/release of the commit that is checked out: wheel and sdist of each distribution, the pinned
# packages of the demonstration, the Debian package, the SBOM, licence, changelog, notes on installation,
# and SHA256SUMS; `make release` runs it. It says how to tag, and pushes nothing.
#
# Every file depends on the commit, its tag, the pinned packages and Python alone: made twice, the sums are
# equal. Debian: the package is for the Python of this machine (scripts/deb.sh).
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
umask 022
BIN=${BIN:-.venv/bin}
DISTRIBUTIONS=(clients/python . gaitd_lab clients/display clients/session clients/assist clients/record)

say() { printf 'release: %s\n' "$*"; }

demonstration() {
    # A requirements file of pip: the wheels of this folder, and what they need, each with its hash.
    local wheel lock
    for lock in lab display; do
        grep -v '^ *#' "$work/source/requirements/$lock.txt"
    done | awk '/^[a-z]/ { is_new = !($1 in seen); seen[$1] = 1 } is_new'
    for wheel in gaitd{_client,,_lab,_session,_display,_assist}-"$version"-py3-none-any.whl; do
        printf './%s --hash=sha256:%s\n' "$wheel" "$(sha256sum "$work/release/$wheel" | cut -d' ' -f1)"
    done
}

[ -z "$(git status --porcelain)" ] || say "changes that are not committed are left out"
python=$(realpath "$BIN")/python
version=$("$python" -c 'import tomllib; print(tomllib.load(open("pyproject.toml", "rb"))["project"]["version"])')
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/source" "$work/release"
git archive HEAD | tar -x -C "$work/source"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

for distribution in "${DISTRIBUTIONS[@]}"; do
    say "wheel and sdist of $distribution"
    (cd "$work/source/$distribution" && "$python" -m hatchling build -d "$work/release" > "$work/said" 2>&1) || { cat "$work/said"; exit 1; }
done
demonstration > "$work/release/demo.txt"
make --no-print-directory sbom deb
cp out/sbom.json "$(ls -t out/gaitd_*.deb | head -1)" "$work/release"
cp "$work"/source/{LICENSE,CHANGELOG.md} "$work/release"
cp "$work/source/docs/release.md" "$work/release/INSTALL.md"
(cd "$work/release" && sha256sum -- * > SHA256SUMS)
rm -rf out/release
mv "$work/release" out/release
say "out/release"
cat out/release/SHA256SUMS
if [ "$(git describe --tags --exact-match --match 'v*' 2> /dev/null)" != "v$version" ]; then
    say "this commit has no tag, so the Debian package has the version of a commit. For a release:"
    say "git tag --annotate v$version --message 'gaitd $version' && make release && git push origin v$version"
fi
