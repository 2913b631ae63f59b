"""Rigs: environments with features that this machine may lack, each running one bash script.

`vcan` is a network with SocketCAN: a namespace of this kernel if it has SocketCAN, otherwise a
virtual machine with a Debian kernel. `systemd` is a container with systemd as PID 1. Inside, this
machine's programs and the project have the same paths, read-only; one folder is writable.
`make rigs` installs what they need; each reports in one line what it lacks.
"""

import os
import shlex
import shutil
import socket
import subprocess
import sys
import sysconfig
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

PROGRAMS: Final = Path(sysconfig.get_path("scripts"))
"""Programs of the virtual environment that this process runs in."""
VNG: Final = PROGRAMS / "vng"
"""virtme-ng, which boots a kernel under QEMU with this file system as its root."""
PATH: Final = f"{PROGRAMS}:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
SOURCES: Final = Path(__file__).resolve().parents[2]
"""The folder of the project's packages: the project, or site-packages."""

HOST: Final = "/run/host"
"""Where the virtual machine has this machine's files, with a cache of what was looked up and read.

virtme-ng's 9p mounts have none: most of the time of an import was spent in `stat`. With it a file
that is changed here while the machine runs may be read cut off there.
"""
HOST_FILES: Final = (
    "-fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap"
    " -device virtio-9p-pci,fsdev=host,mount_tag=host"
)
MOUNT_HOST: Final = (
    f"mkdir {HOST}",
    "mount -t 9p -o ro,version=9p2000.L,trans=virtio,access=any,msize=524288,cache=loose "
    f"host {HOST}",
)


class Finished(NamedTuple):
    """The result of a script."""

    exit_code: int
    output: str
    """Output of the script, both streams; of the rig itself if the script did not complete."""


class Rig(ABC):
    """A kind of environment that runs a bash script."""

    set_up: str = ""
    """Bash lines that prepare a fresh environment."""

    @abstractmethod
    def lacks(self) -> str | None:
        """Return what this machine lacks for the rig; None if nothing."""

    @abstractmethod
    def command(self, script: Path, folder: Path, also: Sequence[Path] = ()) -> list[str]:
        """Return the command that runs the script.

        Args:
            script: the script.
            folder: a writable folder.
            also: more writable folders.
        """

    def run(self, script: str, folder: Path, timeout_s: float = 600) -> Finished:
        """Run bash lines in `folder`, which is writable."""
        ran = subprocess.run(
            self.command(prepare(script, folder), folder),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            env={"PATH": PATH, "HOME": str(folder)},
            check=False,
        )
        return finished(folder, ran.stdout + ran.stderr)


def prepare(script: str, folder: Path) -> Path:
    """Write bash lines into `folder`, wrapped so that their output and exit code are kept."""
    inner, outer = folder / "script", folder / "outer"
    inner.write_text(f"set -eu\nexport PATH={PATH}\n{script}\n")
    outer.write_text(
        f"#!/bin/bash\ncd {shlex.quote(str(folder))}\nbash ./script > log 2>&1 < /dev/null\n"
        "echo $? > exit\n"
    )
    outer.chmod(0o755)
    return outer


def finished(folder: Path, said_by_rig: str) -> Finished:
    """Return the result of a prepared script from its folder."""
    if not (folder / "exit").exists():
        return Finished(-1, said_by_rig)
    return Finished(int((folder / "exit").read_text()), (folder / "log").read_text())


class SocketCan(Rig):
    """A network namespace with SocketCAN: natively, or in a virtual machine whose kernel has it.

    In the virtual machine the clock counts instructions, so timing is independent of the host.
    """

    set_up = (
        "modprobe -a vcan can-raw can-bcm 2> /dev/null || true  # or they are there already\n"
        "ip link set lo up\n"
    )

    def native(self) -> bool:
        """True if this kernel has SocketCAN."""
        try:
            socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        except OSError:
            return False
        return True

    def lacks(self) -> str | None:
        """Return what this machine lacks for the rig; None if nothing."""
        if self.native():
            return None if shutil.which("unshare") else "unshare is missing"
        if not VNG.exists():
            return "no SocketCAN in this kernel, and no virtme-ng"
        if not shutil.which("qemu-system-x86_64", path=PATH):
            return "no SocketCAN in this kernel, and no qemu-system-x86_64"
        return None if self.kernel() else "no SocketCAN in this kernel, and none in /boot that has"

    def kernel(self) -> Path | None:
        """The newest kernel in /boot that has a vcan."""
        for kernel in sorted(Path("/boot").glob("vmlinuz-*"), reverse=True):
            modules = Path("/lib/modules") / kernel.name.removeprefix("vmlinuz-")
            if any(modules.glob("kernel/drivers/net/can/vcan.ko*")):
                return kernel
        return None

    def command(self, script: Path, folder: Path, also: Sequence[Path] = ()) -> list[str]:
        """The command that runs the script; see `Rig`."""
        if self.native():
            return ["unshare", "--net", "--map-root-user", str(script)]
        writable = (folder, *also)
        begin = folder / "begin"
        begin.write_text("\n".join(("set -e", *_mounts(writable), shlex.quote(str(script)), "")))
        return [
            *(str(VNG), "-r", str(self.kernel()), "--disable-kvm", "--user", "root"),
            *("--cpus", "1", "--memory", "2G", "--verbose"),
            *(f"--rwdir={shlex.quote(str(place))}" for place in writable),
            f"--qemu-opts=-icount shift=0,sleep=off {HOST_FILES}",
            # The words of --exec are in the kernel's command line, which is short.
            *("--exec", f"sh {shlex.quote(str(begin))}"),
        ]


def _mounts(writable: Sequence[Path]) -> Iterator[str]:
    """Yield lines that put this machine's folders in place, with the writable ones over them."""
    yield from MOUNT_HOST
    kept = [(f"/run/written{number}", str(place)) for number, place in enumerate(writable)]
    for aside, place in kept:
        yield shlex.join(("mkdir", aside))
        yield shlex.join(("mount", "--bind", place, aside))
    for folder in (Path("/usr"), *_read_from(writable)):
        if not any(folder.is_relative_to(one) for one in writable):
            yield shlex.join(("mkdir", "-p", str(folder)))
            yield shlex.join(("mount", "--bind", f"{HOST}{folder}", str(folder)))
    for aside, place in kept:
        yield shlex.join(("mount", "--bind", aside, place))


class Systemd(Rig):
    """A container with systemd as PID 1: /usr is this machine's, /etc, /var and /run are fresh."""

    def lacks(self) -> str | None:
        """Return what this machine lacks for the rig; None if nothing."""
        if not shutil.which("systemd-nspawn", path=PATH):
            return "no systemd-nspawn"
        return None if os.geteuid() == 0 else "systemd-nspawn, but not root"

    def command(self, script: Path, folder: Path, also: Sequence[Path] = ()) -> list[str]:
        """The command that runs the script; see `Rig`."""
        writable = (folder, *also)
        outside = [place for place in _read_from(writable) if not place.is_relative_to("/usr")]
        return [
            *("systemd-nspawn", "-D", "/", "--volatile=yes", "--register=no", "--keep-unit"),
            *(f"--bind-ro={place}" for place in outside),
            *(f"--bind={place}" for place in writable),
            "--boot",
            *("systemd.firstboot=off", "systemd.mask=systemd-firstboot.service"),
            *(f"systemd.run={script}", "systemd.run_success_action=poweroff"),
            "systemd.run_failure_action=poweroff",
        ]


def _read_from(writable: Sequence[Path]) -> list[Path]:
    """Return the folders that this Python reads from, without nested ones."""
    wanted = {SOURCES, Path(sys.prefix), Path(sys.base_prefix)}
    wanted |= {Path(name) for name in sys.path if Path(name).is_absolute() and Path(name).is_dir()}
    outer: list[Path] = []
    for place in sorted(wanted):
        if not any(place.is_relative_to(other) for other in (*outer, *writable)):
            outer.append(place)
    return outer


RIGS: Final[Mapping[str, Rig]] = MappingProxyType({"vcan": SocketCan(), "systemd": Systemd()})
