"""Opens the gateway's Zenoh session, with the reason for each setting.

Measured with eclipse-zenoh 1.10: by default a peer scouts by multicast and listens on all
interfaces, notices a hung peer after 10 s, and a put may wait for a slow subscriber.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec
import zenoh

from daemon.zenoh_io.access import access_control

LEASE_MS: Final = 1000
"""Time after which a hung peer is dropped; a subscriber notices a hung gateway as fast."""


def session_settings(listen: Sequence[str], trainer: str) -> dict[str, Any]:
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
        "access_control": access_control(trainer),
        "timestamping/enabled": True,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        # Never wait for a subscriber: what cannot be queued is dropped at once.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        # Payloads are small, and a receiver that is descheduled loses shared buffers silently.
        "transport/shared_memory/enabled": False,
    }


def open_session(listen: Sequence[str], trainer: str) -> zenoh.Session:
    """Open the session; it must be closed explicitly, or the process hangs at exit.

    Args:
        listen: its endpoints.
        trainer: TRAINER of the only keys that are allowed.

    Raises:
        zenoh.ZError: an endpoint cannot be listened on: in use, no such address, no directory.
    """
    return zenoh.open(config_of(session_settings(listen, trainer)))


def config_of(settings: Mapping[str, object]) -> zenoh.Config:
    """Return a Zenoh configuration with these keys."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, msgspec.json.encode(value).decode())
    return config
