#!/usr/bin/env bash
# Builds out/gaitd_VERSION_ARCHITECTURE.deb from the commit that is checked out, without root; `make deb` runs it.
#
# Version: on the tag vX.Y.Z it is X.Y.Z, which has to be the version in pyproject.toml. Before that tag it is
# X.Y.Z~N.gHASH and after it X.Y.Z+N.gHASH, of N commits: dpkg takes them for older and for newer.
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
umask 022
PYTHON=${PYTHON:-/usr/bin/python3}
LEVEL=${LEVEL:-10} # of zstd
export PYTHONDONTWRITEBYTECODE=1

say() { printf 'deb: %s\n' "$*"; }
refuse() { say "$*" >&2; exit 1; }

version() {
    local release tag
    release=$("$PYTHON" -c 'import tomllib; print(tomllib.load(open("pyproject.toml", "rb"))["project"]["version"])')
    if tag=$(git describe --tags --exact-match --match 'v*' 2> /dev/null); then
        [ "$tag" = "v$release" ] || refuse "the commit has the tag $tag, pyproject.toml the version $release"
        echo "$release"
    elif git merge-base --is-ancestor "v$release" HEAD 2> /dev/null; then
        echo "$release+$(git rev-list --count HEAD).g$(git rev-parse --short=10 HEAD)"
    else
        echo "$release~$(git rev-list --count HEAD).g$(git rev-parse --short=10 HEAD)"
    fi
}

stage() {
    # As `make install` and all `make install-...` from a fresh clone.
    local part environment
    for part in install display assist record; do
        DESTDIR=$root PYTHON=$PYTHON bash "$work/source/scripts/install.sh" $part
    done
    environment=$(readlink -f "$root/opt/gaitd")
    # pip notes the folder that it has installed from, and compiles for the staged path.
    find "$environment" -name direct_url.json -delete
    # Commands had the staged path in their first line when pip noted their hash and size.
    find "$environment" -name RECORD -exec sed -i -E '/direct_url\.json/d; s#^(\.\./\.\./\.\./bin/[^,]*),.*#\1,,#' {} +
    find "$environment" -name __pycache__ -exec rm -rf {} +
    "$environment/bin/python" -m compileall -q -j 0 --invalidation-mode unchecked-hash -s "$root" -p / "$environment"
    gzip -9n "$root"/usr/share/man/man1/*.1
    ! grep -rlF "$work" "$root" || refuse "the files above name the folder of this build"
}

control() {
    local python kib
    # Of files alone: what a directory takes depends on the names that it once had.
    kib=$(find "$root" -type f -printf '%s\n' | awk '{ sum += $1 } END { print int((sum + 1023) / 1024) }')
    mkdir "$root/DEBIAN"
    for script in preinst postinst prerm postrm; do
        install -m 755 "$work/source/deb/$script" "$root/DEBIAN/$script"
    done
    python=$("$PYTHON" -c 'import sys; print("python3 (>= 3.{0}~), python3 (<< 3.{1}~)".format(sys.version_info[1], sys.version_info[1] + 1))')
    sed -e "s/@VERSION@/$version/; s/@ARCHITECTURE@/$architecture/; s/@PYTHON@/$python/" \
        -e "s/@SIZE@/$kib/" "$work/source/deb/control" > "$root/DEBIAN/control"
    (cd "$root" && find etc -type f -printf '/%p\n' | sort > DEBIAN/conffiles)
    (cd "$root" && find usr opt -type f -print0 | sort -z | xargs -0 md5sum > DEBIAN/md5sums)
}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
root=$work/root
version=$(version)
architecture=$(dpkg --print-architecture)
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
[ -z "$(git status --porcelain)" ] || say "the package is of the last commit; what is not committed is not in it"
say "building $version for $architecture"
mkdir "$root" "$work/source"
git archive HEAD | tar -x -C "$work/source"
stage
control
mkdir -p out
file=out/gaitd_${version}_$architecture.deb
dpkg-deb --root-owner-group -Zzstd -z"$LEVEL" --build "$root" "$file" > /dev/null
say "$file, $(du -h "$file" | cut -f1)"
