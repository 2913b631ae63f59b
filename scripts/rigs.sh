#!/usr/bin/env bash
# Installs the packages for the rigs: a kernel with SocketCAN under QEMU, a container with systemd as PID 1, Chromium.
# For Debian on amd64, as root; `make rigs` runs it. Running it again changes nothing.
set -Eeuo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
export DEBIAN_FRONTEND=noninteractive PATH="$PATH:/usr/sbin:/sbin"

PACKAGES=(
    qemu-system-x86 linux-image-amd64 busybox-static   # the virtual machine of rig_vcan, and its kernel
    can-utils kmod iproute2                            # vcan inside it: modprobe, ip, candump, cansend
    e2fsprogs                                          # the image of its disk: mkfs.ext4, e2fsck, debugfs
    systemd systemd-container                          # systemd-nspawn and the systemd of rig_systemd
    python3-venv                                       # the environments of the tests and of `make deb`
    chromium                                           # the pages of rig_browser
)

step="starting"
say() { printf 'rigs: %s\n' "$*"; }
refuse() { say "$*" >&2; exit 1; }
trap 'say "FAILED while $step" >&2' ERR

installed() { [ "$(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]; }

install_packages() {
    local missing=() package
    for package in "${PACKAGES[@]}"; do
        installed "$package" || missing+=("$package")
    done
    if [ ${#missing[@]} -eq 0 ]; then
        say "Debian packages are all there"
        return
    fi
    step="reading Debian's package lists"
    say "$step"
    apt-get update -qq < /dev/null
    step="installing Debian packages: ${missing[*]}"
    say "$step"
    apt-get install -y -qq --no-install-recommends "${missing[@]}" < /dev/null > /dev/null
}

install_python_packages() {
    step="making the virtual environment"
    make --quiet .venv/run.stamp
    step="installing requirements/rigs.txt into the virtual environment"
    say "$step"
    .venv/bin/uv pip install --quiet --python .venv/bin/python --require-hashes -r requirements/rigs.txt < /dev/null
}

check() {
    step="looking for a kernel in /boot"
    compgen -G '/boot/vmlinuz-*' > /dev/null || refuse "no kernel in /boot after installing linux-image-amd64"
    step="looking for the programs of the rigs"
    for program in chromium qemu-system-x86_64 busybox systemd-nspawn candump modprobe ip mkfs.ext4 .venv/bin/vng; do
        command -v "$program" > /dev/null || refuse "$program is still missing"
    done
}

[ "$(id -u)" -eq 0 ] || refuse "needs root: it installs Debian packages"
command -v apt-get > /dev/null || refuse "needs Debian: there is no apt-get here"
[ "$(dpkg --print-architecture)" = amd64 ] || refuse "needs amd64: the virtual machine's kernel is linux-image-amd64"

install_packages
install_python_packages
check
say "ready: kernel $(basename "$(compgen -G '/boot/vmlinuz-*' | sort -V | tail -n 1)"), $(.venv/bin/vng --version 2>/dev/null | head -n 1), $(systemd-nspawn --version | head -n 1)"
