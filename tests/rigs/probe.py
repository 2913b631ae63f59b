"""What a process may do where it runs: opens sockets, files and pages, and says what became of it.

Runs in the sandbox of a unit in place of its program; one JSON object on stdout.
"""

import ctypes
import json
import mmap
import os
import socket
import sys
from pathlib import Path

FAMILIES = ("AF_CAN", "AF_INET", "AF_INET6", "AF_NETLINK", "AF_PACKET", "AF_UNIX")
FILES = (
    "/usr/probe",
    "/etc/gaitd/trainer.toml",
    "/run/user/probe",
    "/var/lib/gaitd/axes.json",
    "/var/lib/gaitd/requests.jsonl",
    "/var/lib/gaitd/probe",
    "/var/lib/gaitd/blackbox/probe",
    "/run/gaitd/records.ring",
    "/run/gaitd/probe",
    "/var/cache/gaitd/probe",
)
CLONE_NEWUSER = 0x10000000


def _socket(family: str) -> str:
    kind = socket.SOCK_RAW if family == "AF_CAN" else socket.SOCK_DGRAM
    try:
        socket.socket(getattr(socket, family), kind).close()
    except OSError as error:
        return os.strerror(error.errno or 0)
    return "granted"


def _written(name: str) -> str:
    path = Path(name)
    new = name.endswith("probe")
    try:
        with path.open("xb" if new else "r+b"):
            pass
        if new:
            path.unlink()
    except OSError as error:
        return os.strerror(error.errno or 0)
    return "granted"


def _replaced(name: str) -> str:
    try:
        Path(name).rename(name + ".stolen").rename(name)
    except OSError as error:
        return os.strerror(error.errno or 0)
    return "granted"


def _pages_to_run() -> str:
    try:
        mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC).close()
    except OSError as error:
        return os.strerror(error.errno or 0)
    return "granted"


def _call(name: str, *arguments: object) -> str:
    libc = ctypes.CDLL(None, use_errno=True)
    if getattr(libc, name)(*arguments) == 0:
        return "granted"
    return os.strerror(ctypes.get_errno())


STATUS = dict(
    line.split(":\t", 1)
    for line in Path("/proc/self/status").read_text().splitlines()
    if ":\t" in line
)
json.dump(
    {
        "sockets": {family: _socket(family) for family in FAMILIES},
        "files": {name: _written(name) for name in FILES},
        "notes_replaced": _replaced("/var/lib/gaitd/axes.json"),
        "log_replaced": _replaced("/var/lib/gaitd/requests.jsonl"),
        "pages_to_run": _pages_to_run(),
        "mount": _call("mount", b"none", b"/mnt", b"tmpfs", 0, None),
        "namespace": _call("unshare", CLONE_NEWUSER),
        "no_new_privileges": STATUS["NoNewPrivs"],
        "capabilities": STATUS["CapBnd"].strip("0"),
        "temporary": [path.name for path in Path("/tmp").iterdir()],
        "devices": sorted(path.name for path in Path("/dev").iterdir()),
        "uid": os.getuid(),
    },
    sys.stdout,
)
