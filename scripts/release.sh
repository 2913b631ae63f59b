#!/usr/bin/env bash
# Makes out/release of the commit that is checked out: wheel and sdist of each distribution, the Debian
# package, the SBOM, the licence, the changelog, and SHA256SUMS; `make release` runs it.
#
# Every file depends on the commit, the pinned packages and Python alone: made twice, the sums are equal.
# Debian: the package is for the Python of this machine (scripts/deb.sh).
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
umask 022
BIN=${BIN:-.venv/bin}
DISTRIBUTIONS=(clients/python . gaitd_lab clients/display clients/session clients/assist clients/record)

say() { printf 'release: %s\n' "$*"; }

[ -z "$(git status --porcelain)" ] || say "changes that are not committed are left out"
python=$(realpath "$BIN")/python
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/source" "$work/release"
git archive HEAD | tar -x -C "$work/source"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

for distribution in "${DISTRIBUTIONS[@]}"; do
    say "wheel and sdist of $distribution"
    (cd "$work/source/$distribution" && "$python" -m hatchling build -d "$work/release" > /dev/null)
done
make --no-print-directory sbom deb
cp out/sbom.json "$(ls -t out/gaitd_*.deb | head -1)" LICENSE CHANGELOG.md "$work/release"
(cd "$work/release" && sha256sum -- * > SHA256SUMS)
rm -rf out/release
mv "$work/release" out/release
say "out/release"
cat out/release/SHA256SUMS
