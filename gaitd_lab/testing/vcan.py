"""A fresh SocketCAN interface of type vcan, if the kernel and the user's rights allow it."""

import contextlib
import shutil
import socket
import subprocess
from collections.abc import Generator
from typing import Final

NAMES_TRIED: Final = 64
SEARCHED: Final = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
"""A user's PATH may lack /sbin, where `ip` is."""


class VcanError(Exception):
    """Machine error: the reason why there can be no vcan here, in one line."""


@contextlib.contextmanager
def fresh_vcan() -> Generator[str]:
    """Create an unused interface that is up; its name is the first free from vcan0.

    Raises:
        VcanError: the kernel has none, or the user may not add one.
    """
    ip = _program()
    name = _add(ip)
    try:
        _run(ip, "link", "set", name, "up")
        yield name
    finally:
        _run(ip, "link", "delete", name)


def _program() -> str:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        raise VcanError(f"this kernel has no SocketCAN ({error.strerror})") from error
    ip = shutil.which("ip", path=SEARCHED)
    if ip is None:
        raise VcanError("the program `ip` is missing (iproute2)")
    return ip


def _add(ip: str) -> str:
    output = ""
    for number in range(NAMES_TRIED):
        name = f"vcan{number}"
        output = _try(ip, "link", "add", "dev", name, "type", "vcan")
        if not output:
            return name
        if "exists" not in output:
            break
    if "not permitted" in output:
        raise VcanError("adding an interface needs CAP_NET_ADMIN (be root)")
    raise VcanError(f"no interface of type vcan can be added (modprobe vcan): {output}")


def _run(ip: str, *words: str) -> None:
    output = _try(ip, *words)
    if output:
        raise VcanError(f"ip {' '.join(words)}: {output}")


def _try(ip: str, *words: str) -> str:
    """Run `ip`; return its error message, empty if there is none."""
    ran = subprocess.run([ip, *words], capture_output=True, text=True, check=False)
    return "" if ran.returncode == 0 else (ran.stderr or ran.stdout).strip() or "ip failed"
