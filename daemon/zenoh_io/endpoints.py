"""Check of Zenoh endpoints: which of them a program on another machine could reach.

The service listens on loopback or on a Unix socket, unless `zenoh.listen_beyond_loopback` allows
more: then clients need keys, and links beyond this machine TLS. The form of an endpoint is checked
by `config/settings.py`.
"""

import ipaddress
from collections.abc import Sequence
from typing import Final

from gaitd_toml import MISSING, ConfigError

from daemon.config.trainer import TrainerFile

UNIX_SOCKET: Final = "unixsock-stream"

TLS: Final = "tls"
LOCAL_PROTOCOLS: Final = ("tcp", UNIX_SOCKET)
"""Protocols of clients that prove their name by a password alone."""

ALLOWED: Final = (
    "a Unix socket or a loopback address such as 127.0.0.1;"
    " anything else only with listen_beyond_loopback = true"
)

NEEDS_KEYS: Final = "a folder of `gaitd keys`: clients beyond this machine must show who they are"
NEEDS_TLS: Final = "with keys tls/, or tcp/ or unixsock-stream/ of this machine"
PORT_MAX: Final = 65_535
_EVERYWHERE: Final = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}


def is_local(endpoint: str) -> bool:
    """True if only programs on this machine can reach the endpoint."""
    return endpoint.startswith(f"{UNIX_SOCKET}/") or _is_loopback(_host_and_port(endpoint)[0])


def refused(listen: Sequence[str], *, beyond_loopback: bool) -> tuple[int, str] | None:
    """The first endpoint that is not allowed, with its index; None if all are allowed."""
    for index, endpoint in enumerate(listen):
        if not (beyond_loopback or is_local(endpoint)):
            return index, endpoint
    return None


def check(file: TrainerFile) -> TrainerFile:
    """Return the same file if all of its endpoints are allowed.

    Raises:
        ConfigError: an endpoint is reachable from other machines, and the file does not allow it;
            or it has a port that no machine has.
    """
    zenoh = file.trainer.zenoh
    for index, endpoint in enumerate(zenoh.listen):
        is_socket = endpoint.startswith(f"{UNIX_SOCKET}/")
        if not (is_socket or 1 <= int(_host_and_port(endpoint)[1]) <= PORT_MAX):
            allowed = f"a port from 1 to {PORT_MAX}"
            raise ConfigError(file.path, f"zenoh.listen[{index}]", endpoint, allowed)
    if zenoh.listen_beyond_loopback and zenoh.keys is None:
        raise ConfigError(file.path, "zenoh.keys", MISSING, NEEDS_KEYS)
    for index, endpoint in enumerate(zenoh.listen):
        by_tls = endpoint.startswith(f"{TLS}/")
        if by_tls and zenoh.keys is None:
            raise ConfigError(file.path, "zenoh.keys", MISSING, NEEDS_KEYS)
        by_these = (*LOCAL_PROTOCOLS, TLS) if is_local(endpoint) else (TLS,)
        if zenoh.keys is not None and endpoint.partition("/")[0] not in by_these:
            raise ConfigError(file.path, f"zenoh.listen[{index}]", endpoint, NEEDS_TLS)
    bad = refused(zenoh.listen, beyond_loopback=zenoh.listen_beyond_loopback)
    if bad is not None:
        raise ConfigError(file.path, f"zenoh.listen[{bad[0]}]", bad[1], ALLOWED)
    return file


def to_connect(endpoint: str) -> str:
    """The endpoint for a client on the same machine, for a server that listens on `endpoint`."""
    host, port = _host_and_port(endpoint)
    if endpoint.startswith(f"{UNIX_SOCKET}/") or host not in _EVERYWHERE:
        return endpoint
    return f"{endpoint.partition('/')[0]}/{_EVERYWHERE[host]}:{port}"


def _host_and_port(endpoint: str) -> tuple[str, str]:
    """Host and port without the metadata (`?`) and settings (`#`) that may follow the port."""
    address = endpoint.partition("/")[2].partition("?")[0].partition("#")[0]
    host, _, port = address.rpartition(":")
    return host, port


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.removeprefix("[").removesuffix("]")).is_loopback
    except ValueError:
        return False
