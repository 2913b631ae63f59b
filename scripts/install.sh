#!/usr/bin/env bash
# Installs gaitd on a machine, and removes it. For Debian 12 or newer, as root:
#
#   install.sh install      environment and files; leaves the service stopped, and disabled as it was
#   install.sh files        the files alone, for an environment that is at $PREFIX already
#   install.sh display      the pages of clients/display, into the environment of `install`; also after an upgrade
#   install.sh display-files   their files alone
#   install.sh assist       the reference controller, clients/assist, in the same way
#   install.sh assist-files    its files alone
#   install.sh record       the recorder, clients/record, in the same way
#   install.sh record-files    its files alone
#   install.sh uninstall    removes all but configuration and state
#   install.sh purge        these, too, and the users
#
# DESTDIR=/somewhere stages the files for a package and leaves the running system unchanged.
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

DESTDIR=${DESTDIR:-}
PYTHON=${PYTHON:-/usr/bin/python3}
PREFIX=/opt/gaitd
UNITS=/usr/lib/systemd/system
NETWORK=/usr/lib/systemd/network
DOCUMENTS=/usr/share/doc/gaitd
BASH_COMPLETION=/usr/share/bash-completion/completions/gaitd
ZSH_COMPLETION=/usr/share/zsh/vendor-completions/_gaitd
MANUAL=/usr/share/man/man1
PARTS=(gaitd.target gaitd-core.service gaitd-gateway.service)
PAGES=(gaitd-patient.service gaitd-therapist.service)
CLIENTS=("${PAGES[@]}" gaitd-assist.service gaitd-record.service)
NO_CAN=10-gaitd-no-can.conf
WAIT=$UNITS/sys-subsystem-net-devices-can0.device.d

say() { printf 'install: %s\n' "$*"; }
refuse() { say "$*" >&2; exit 1; }
put() { install -D -m "${3:-644}" "$1" "$DESTDIR$2"; }
live() { [ -z "$DESTDIR" ]; }
running() { live && [ -d /run/systemd/system ]; }

idle() {
    # The files of a running service must not change, and no patient may be in the machine. The clients use them, too.
    ! live || sh deb/preinst upgrade
}

version() { "$PYTHON" -c 'import tomllib; print(tomllib.load(open("pyproject.toml", "rb"))["project"]["version"])'; }

environment() {
    # Beside the old one, which is removed after the link is changed: one is always complete.
    local target base
    "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || refuse "$PYTHON is older than 3.11"
    "$PYTHON" -c 'import ensurepip, venv' 2> /dev/null || refuse "$PYTHON has no venv: apt-get install python3-venv"
    base=$("$PYTHON" -c 'import sys; print(sys.base_prefix)')
    case "$base/" in /root[/]* | /home[/]*) refuse "$PYTHON lies in $base, which the service may not see: PYTHON=/usr/bin/python3" ;; esac
    target="$PREFIX-$(version)-$(date -u -d "@${SOURCE_DATE_EPOCH:-$(date +%s)}" +%Y%m%d%H%M%S)"
    say "making $target, with all pinned dependencies"
    "$PYTHON" -m venv "$DESTDIR$target"
    "$DESTDIR$target/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/run.txt
    "$DESTDIR$target/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation ./clients/python .
    ln -sfn "$(basename "$target")" "$DESTDIR$PREFIX.new"
    mv -T "$DESTDIR$PREFIX.new" "$DESTDIR$PREFIX"
    relocate
}

relocate() {
    # Staged for another path: pip has written the present one into the scripts.
    local target=$DESTDIR$PREFIX
    live || { grep -rlIZF "$DESTDIR/" "$target/bin/" "$target/pyvenv.cfg" || true; } | xargs -0 --no-run-if-empty sed -i "s#$DESTDIR/#/#g"
}

files() {
    local name
    for name in "${PARTS[@]}"; do
        put "systemd/$name" "$UNITS/$name"
    done
    # Every other service is denied the CAN bus; the units of gaitd have a file of that name of their own.
    put systemd/drop-ins/no-can.conf "$UNITS/service.d/$NO_CAN"
    put systemd/drop-ins/may-can.conf "$UNITS/gaitd-core.service.d/$NO_CAN"
    put systemd/drop-ins/bus-can0.conf "$UNITS/gaitd-core.service.d/20-gaitd-bus.conf"
    put systemd/drop-ins/can0-wait.conf "$WAIT/10-gaitd-wait.conf"
    for name in systemd/network/80-gaitd-can0.*; do
        put "$name" "$NETWORK/$(basename "$name")"
    done
    # For development, to be copied by hand: a virtual bus, or the simulated one, and virtual drives.
    for name in systemd/examples/*; do
        put "$name" "$DOCUMENTS/examples/$(basename "$name")"
    done
    put systemd/gaitd.sysusers /usr/lib/sysusers.d/gaitd.conf
    put systemd/gaitd.tmpfiles /usr/lib/tmpfiles.d/gaitd.conf
    # What the pages link to; the pictures of a study are beside its numbers where it was run.
    for name in README.md CHANGELOG.md LICENSE docs/*.md docs/*.png docs/*.svg docs/pictures/*.png \
        docs/evidence/*.md docs/evidence/experiment_*.png; do
        put "$name" "$DOCUMENTS/$name"
    done
    install -d "$DESTDIR/usr/bin"
    ln -sfn "$PREFIX/bin/gaitd" "$DESTDIR/usr/bin/gaitd"
    configuration
    from_commands
    ! live || sh deb/postinst configure
}

from_commands() {
    # Completion of the shells, and manual pages: what the environment itself says of its commands.
    local python=$DESTDIR$PREFIX/bin/python
    [ -x "$python" ] || return 0
    install -d "$DESTDIR$(dirname "$BASH_COMPLETION")" "$DESTDIR$(dirname "$ZSH_COMPLETION")"
    _GAITD_COMPLETE=source_bash "$python" "$DESTDIR$PREFIX/bin/gaitd" > "$DESTDIR$BASH_COMPLETION"
    _GAITD_COMPLETE=source_zsh "$python" "$DESTDIR$PREFIX/bin/gaitd" > "$DESTDIR$ZSH_COMPLETION"
    "$python" scripts/man_pages.py "$DESTDIR$MANUAL"
}

configuration() {
    # Existing files stay, edited or not; a file of this version that differs is added as FILE.dist.
    local file target
    while IFS= read -r file; do
        target="/etc/gaitd/${file#configs/}"
        if [ -e "$DESTDIR$target" ] && ! cmp -s "$file" "$DESTDIR$target"; then
            put "$file" "$target.dist" 640
            say "$target is kept; this version's is beside it as .dist"
        else
            [ -e "$DESTDIR$target" ] || put "$file" "$target" 640
            rm -f "$DESTDIR$target.dist"
        fi
    done < <(find configs -type f | sort)
    find "$DESTDIR/etc/gaitd" -type d -exec chmod 755 {} +
}

same_version() {
    # Pinned for the version of this clone: another one would get other libraries under its service.
    local installed
    [ -x "$DESTDIR$PREFIX/bin/python" ] || refuse "there is no $PREFIX: \`make install\` first"
    installed=$("$DESTDIR$PREFIX/bin/python" -c 'from importlib.metadata import version; print(version("gaitd"))')
    [ "$installed" = "$(version)" ] || refuse "$PREFIX has gaitd $installed, this clone is $(version): \`make install\` from this clone first"
}

display_environment() {
    same_version
    say "adding the pages to $PREFIX, with all pinned dependencies"
    "$DESTDIR$PREFIX/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/display.txt
    "$DESTDIR$PREFIX/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation ./clients/session ./clients/display
    relocate
}

display_files() {
    # An existing file stays, edited or not.
    local name
    for name in "${PAGES[@]}"; do
        put "systemd/$name" "$UNITS/$name"
    done
    put systemd/gaitd-display.sysusers /usr/lib/sysusers.d/gaitd-display.conf
    for name in patient therapist; do
        [ -e "$DESTDIR/etc/gaitd-display/$name.toml" ] || put "clients/display/configs/$name.toml" "/etc/gaitd-display/$name.toml" 640
    done
    from_commands
    ! live || sh deb/postinst client
}

assist_environment() {
    # It needs what the service needs, and no more.
    same_version
    say "adding the reference controller to $PREFIX"
    "$DESTDIR$PREFIX/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation ./clients/assist
    relocate
}

assist_files() {
    # An existing file stays, edited or not; a new one has its log where the unit may write.
    local file=/etc/gaitd-assist/assist.toml
    put systemd/gaitd-assist.service "$UNITS/gaitd-assist.service"
    put systemd/gaitd-assist.sysusers /usr/lib/sysusers.d/gaitd-assist.conf
    if [ ! -e "$DESTDIR$file" ]; then
        put clients/assist/configs/assist.toml "$file" 640
        sed -i 's#^log = "#log = "/var/lib/gaitd-assist/#' "$DESTDIR$file"
    fi
    from_commands
    ! live || sh deb/postinst client
}

record_environment() {
    same_version
    say "adding the recorder to $PREFIX, with all pinned dependencies"
    "$DESTDIR$PREFIX/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/record.txt
    "$DESTDIR$PREFIX/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation ./clients/record
    relocate
}

record_files() {
    # An existing file stays, edited or not.
    local file=/etc/gaitd-record/record.env
    put systemd/gaitd-record.service "$UNITS/gaitd-record.service"
    put systemd/gaitd-record.sysusers /usr/lib/sysusers.d/gaitd-record.conf
    [ -e "$DESTDIR$file" ] || put clients/record/configs/record.env "$file" 640
    from_commands
    ! live || sh deb/postinst client
}

uninstall() {
    local name
    if running; then
        # The core first: it brings both axes to rest.
        # One by one: with one that is not installed in the list systemctl would stop none.
        for name in "${PARTS[@]}" "${CLIENTS[@]}"; do
            systemctl disable --quiet --now "$name" 2> /dev/null || true
            systemctl reset-failed "$name" 2> /dev/null || true
        done
    fi
    for name in "${PARTS[@]}" "${CLIENTS[@]}"; do
        rm -f "$DESTDIR$UNITS/$name"
    done
    rm -f "$DESTDIR$UNITS/gaitd-core.service.d"/{$NO_CAN,20-gaitd-bus.conf} \
        "$DESTDIR$UNITS/service.d/$NO_CAN" "$DESTDIR$WAIT/10-gaitd-wait.conf" \
        "$DESTDIR$NETWORK"/80-gaitd-can0.{link,network} \
        "$DESTDIR"/usr/lib/{sysusers,tmpfiles}.d/gaitd.conf "$DESTDIR"/usr/lib/sysusers.d/gaitd-{display,assist,record}.conf \
        "$DESTDIR/usr/bin/gaitd" "$DESTDIR$BASH_COMPLETION" "$DESTDIR$ZSH_COMPLETION" "$DESTDIR$MANUAL"/gaitd{,-*}.1
    for name in "$UNITS"/{gaitd-core.service.d,service.d} "$WAIT"; do
        rmdir --ignore-fail-on-non-empty "$DESTDIR$name" 2> /dev/null || true
    done
    rm -rf "$DESTDIR$DOCUMENTS" "$DESTDIR$PREFIX" "$DESTDIR$PREFIX"-* "$DESTDIR/run/gaitd" "$DESTDIR/var/cache/gaitd"
    ! running || systemctl daemon-reload
    say "gone; /etc/gaitd, /etc/gaitd-display, /etc/gaitd-assist, /etc/gaitd-record, /var/lib/gaitd, the log in /var/lib/gaitd-assist,"
    say "the recordings in /var/lib/gaitd-record and the history of sessions in /var/lib/gaitd-patient are kept (\`make purge\` removes them)"
}

purge() {
    uninstall
    DPKG_ROOT=$DESTDIR sh deb/postrm purge
    say "configuration, state, recordings, the history of sessions, credentials and users are gone, too"
}

usage() { sed -n '2,15p' "${BASH_SOURCE[0]}" | sed 's/^# \{0,1\}//'; exit 2; }

case "${1:-}" in install | files | display | display-files | assist | assist-files | record | record-files | uninstall | purge) ;; *) usage ;; esac
! live || [ "$(id -u)" -eq 0 ] || refuse "needs root (or DESTDIR=/somewhere to stage a package)"
! live || ! dpkg-query --search "$PREFIX" > /dev/null 2>&1 || refuse "the Debian package gaitd is installed: \`apt-get remove gaitd\` first"
case "$1" in
    install)
        idle
        environment
        files
        say "done; nothing was started or enabled. Next: edit /etc/gaitd/trainer.toml, then"
        say "\`gaitd check --config /etc/gaitd/trainer.toml\`, \`gaitd doctor\`, \`systemctl enable --now gaitd.target\`"
        [ ! -e "$DESTDIR$UNITS/${PAGES[0]}" ] || say "the pages are not in the new environment: \`make install-display\` again, before they are started"
        [ ! -e "$DESTDIR$UNITS/gaitd-assist.service" ] || say "the reference controller is not in the new environment: \`make install-assist\` again, before it is started"
        [ ! -e "$DESTDIR$UNITS/gaitd-record.service" ] || say "the recorder is not in the new environment: \`make install-record\` again, before it is started"
        ;;
    files) idle; files ;;
    display)
        idle
        display_environment
        display_files
        say "done; nothing was started or enabled. Next: docs/display.md"
        ;;
    display-files) idle; display_files ;;
    assist)
        idle
        assist_environment
        assist_files
        say "done; nothing was started or enabled. Next: docs/assist.md"
        ;;
    assist-files) idle; assist_files ;;
    record)
        idle
        record_environment
        record_files
        say "done; nothing was started or enabled. Next: docs/recording.md"
        ;;
    record-files) idle; record_files ;;
    uninstall) uninstall ;;
    purge) purge ;;
esac
