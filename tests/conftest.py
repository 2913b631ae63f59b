"""The rigs of the tests: used where they are there, said in one line where not, required by CI.

A rig is a real part that not every machine has: SocketCAN (natively, or in a virtual machine) and
systemd as PID 1. Tests that need one carry its marker and take its fixture; `--rigs=required`
makes its lack a failure. Each runs one bash script in its own small world, with the project at
its usual path, read-only, and one folder to write to.
"""

import os
import shutil
import socket
import subprocess
import sys
from abc import ABC, abstractmethod
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import settings

PROJECT = Path(__file__).resolve().parent.parent
BIN = PROJECT / ".venv" / "bin"
# How long an example takes says something about the machine, and nothing about the project.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
PATH = f"{BIN}:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class Finished(NamedTuple):
    """What a script left."""

    exit_code: int
    output: str
    """Of the script, both streams; of the rig itself if the script never came to an end."""


class Rig(ABC):
    """One kind of small world that runs a bash script."""

    @abstractmethod
    def lacks(self) -> str | None:
        """What this machine lacks for it; None if nothing."""

    @abstractmethod
    def command(self, script: Path, folder: Path) -> list[str]:
        """The command that runs the script with the folder writable."""

    def run(self, script: str, folder: Path, timeout_s: float = 600) -> Finished:
        """Run bash lines in `folder`, which is theirs to write to."""
        inner, outer = folder / "script", folder / "outer"
        inner.write_text(f"set -eu\nexport PATH={PATH}\n{script}\n")
        outer.write_text(
            f"#!/bin/bash\ncd {folder}\nbash {inner} > {folder}/log 2>&1 < /dev/null\n"
            f"echo $? > {folder}/exit\n"
        )
        outer.chmod(0o755)
        ran = subprocess.run(
            self.command(outer, folder),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            env={"PATH": PATH, "HOME": str(folder)},
            check=False,
        )
        if not (folder / "exit").exists():
            return Finished(-1, ran.stdout + ran.stderr)
        return Finished(int((folder / "exit").read_text()), (folder / "log").read_text())


class SocketCan(Rig):
    """A network namespace with SocketCAN: natively, or in a virtual machine whose kernel has it.

    In the virtual machine the clock counts instructions, so timing is independent of the host.
    """

    def native(self) -> bool:
        try:
            socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        except OSError:
            return False
        return True

    def lacks(self) -> str | None:
        if self.native():
            return None if shutil.which("unshare") else "unshare is missing"
        if not (BIN / "vng").exists():
            return "no SocketCAN in this kernel, and no virtme-ng"
        if not shutil.which("qemu-system-x86_64", path=PATH):
            return "no SocketCAN in this kernel, and no qemu-system-x86_64"
        return None if self.kernel() else "no SocketCAN in this kernel, and none in /boot that has"

    def kernel(self) -> Path | None:
        for kernel in sorted(Path("/boot").glob("vmlinuz-*"), reverse=True):
            modules = Path("/lib/modules") / kernel.name.removeprefix("vmlinuz-")
            if any(modules.glob("kernel/drivers/net/can/vcan.ko*")):
                return kernel
        return None

    def command(self, script: Path, folder: Path) -> list[str]:
        if self.native():
            return ["unshare", "--net", "--map-root-user", str(script)]
        return [
            *(str(BIN / "vng"), "-r", str(self.kernel()), "--disable-kvm", "--user", "root"),
            *("--cpus", "1", "--memory", "2G", "--verbose"),
            *(f"--rodir={PROJECT}", f"--rwdir={folder}"),
            *("--qemu-opts=-icount shift=0,sleep=off", "--exec", str(script)),
        ]


class Systemd(Rig):
    """A container with systemd as PID 1: /usr is this machine's, /etc, /var and /run are fresh."""

    def lacks(self) -> str | None:
        if not shutil.which("systemd-nspawn", path=PATH):
            return "no systemd-nspawn"
        return None if os.geteuid() == 0 else "systemd-nspawn, but not root"

    def command(self, script: Path, folder: Path) -> list[str]:
        base = Path(sys.base_prefix)
        outside = [] if base.is_relative_to("/usr") else [f"--bind-ro={base}"]
        return [
            *("systemd-nspawn", "-D", "/", "--volatile=yes", "--register=no", "--keep-unit"),
            *(f"--bind-ro={PROJECT}", f"--bind={folder}", *outside, "--boot"),
            *("systemd.firstboot=off", "systemd.mask=systemd-firstboot.service"),
            *(f"systemd.run={script}", "systemd.run_success_action=poweroff"),
            "systemd.run_failure_action=poweroff",
        ]


RIGS: dict[str, Rig] = {"rig_vcan": SocketCan(), "rig_systemd": Systemd()}
LACKS = pytest.StashKey[dict[str, str | None]]()


def pytest_addoption(parser):
    parser.addoption(
        "--rigs",
        choices=["present", "required", "none"],
        default="present",
        help="use the rigs that are there (default), fail where one is missing, or use none",
    )
    parser.addoption(
        "--write-traces",
        action="store_true",
        help="write the golden traces of sessions anew (`make golden`)",
    )
    parser.addoption(
        "--write-process-faults",
        action="store_true",
        help="write docs/process_faults.md anew from what tests/service measure",
    )
    parser.addoption(
        "--fuzz-minutes",
        type=float,
        help="let the CAN fuzz run for so many minutes each, instead of some seconds",
    )


def pytest_configure(config):
    config.stash[LACKS] = {
        marker: "left out by --rigs=none" if config.option.rigs == "none" else rig.lacks()
        for marker, rig in RIGS.items()
    }


def pytest_runtest_setup(item):
    for marker, lack in item.config.stash[LACKS].items():
        if lack and item.get_closest_marker(marker):
            if item.config.option.rigs == "required":
                pytest.fail(f"{marker} is required, but: {lack}", pytrace=False)
            pytest.skip(f"{marker}: {lack}")


def pytest_terminal_summary(terminalreporter, config):
    lacks = {marker: lack for marker, lack in config.stash[LACKS].items() if lack}
    if lacks:
        said = "; ".join(f"{marker}: {lack}" for marker, lack in lacks.items())
        terminalreporter.write_line(f"rigs not used: {said} (`make rigs` installs them)")


@pytest.fixture(scope="session")
def vcan_rig():
    """A world with SocketCAN."""
    return RIGS["rig_vcan"]


@pytest.fixture
def systemd_rig():
    """A world with systemd as PID 1."""
    return RIGS["rig_systemd"]
