"""Opens the gateway's Zenoh session, with the reason for each setting.

Measured with eclipse-zenoh 1.10: by default a peer scouts by multicast and listens on all
interfaces, notices a hung peer after 10 s, and a put may wait for a slow subscriber. A hundred
connections that say nothing keep new clients out for 10 s.
"""

import secrets
import tempfile
from collections.abc import Sequence
from typing import Any, Final

import zenoh
from gaitd_client.connection import config_of

from daemon.keys.folder import AUTHORITY, GATEWAY, Keys
from daemon.zenoh_io.access import access_control

LEASE_MS: Final = 1000
"""Time after which a hung peer is dropped; a subscriber notices a hung gateway as fast."""
ACCEPT_MS: Final = 3000
"""Time for the handshake of a new link, as long as a client tries it."""
PENDING_MAX: Final = 512
"""New links whose handshake is not over; with more, others wait. The service has 1024 descriptors
(`LimitNOFILE`)."""


def session_settings(listen: Sequence[str], trainer: str, keys: Keys | None) -> dict[str, Any]:
    """Keys of Zenoh's configuration and their values."""
    return {
        "mode": "peer",
        "listen/endpoints": list(listen),
        # A port that is in use is reported to the operator at the start.
        "listen/exit_on_failure": True,
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "adminspace/enabled": False,
        # Without it any client could publish, answer and receive setpoints as the gateway does.
        "access_control": access_control(trainer, None if keys is None else keys.register.clients),
        "timestamping/enabled": True,
        "transport/unicast/accept_timeout": ACCEPT_MS,
        "transport/unicast/accept_pending": PENDING_MAX,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        # Never wait for a subscriber: what cannot be queued is dropped at once.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        # Payloads are small, and a receiver that is descheduled loses shared buffers silently.
        "transport/shared_memory/enabled": False,
        **({} if keys is None else {"transport/link/tls": _tls(keys)}),
    }


def _tls(keys: Keys) -> dict[str, Any]:
    """A client without a certificate of the authority is refused on TLS."""
    return {
        "root_ca_certificate": str(keys.certificate(AUTHORITY).resolve()),
        "enable_mtls": True,
        "listen_certificate": str(keys.certificate(GATEWAY).resolve()),
        "listen_private_key": str(keys.key(GATEWAY).resolve()),
        # A certificate that expires ends no session: it may be that of a training.
        "close_link_on_expiration": False,
    }


def open_session(listen: Sequence[str], trainer: str, keys: Keys | None) -> zenoh.Session:
    """Open the session; it must be closed explicitly, or the process hangs at exit.

    Args:
        listen: its endpoints.
        trainer: TRAINER of the only keys that are allowed.
        keys: clients that may connect; None: every client that reaches an endpoint.

    Raises:
        zenoh.ZError: an endpoint cannot be listened on: in use, no such address, no directory.
    """
    settings = session_settings(listen, trainer, keys)
    if keys is None:
        return zenoh.open(config_of(settings))
    # Zenoh reads its dictionary of users when it opens; the file is readable by its owner alone.
    with tempfile.NamedTemporaryFile("w", prefix="gaitd-", encoding="ascii") as file:
        # Without any entry Zenoh would ask for no password.
        file.write(f"{GATEWAY}:{secrets.token_urlsafe()}\n")
        file.writelines(f"{one.name}:{one.password}\n" for one in keys.register.clients)
        file.flush()
        settings["transport/auth/usrpwd"] = {"dictionary_file": file.name}
        return zenoh.open(config_of(settings))
