"""A client of a running service: one query, or a session that is opened with the same settings."""

import json
from typing import Any, Final, NamedTuple, TypeVar

import msgspec
import zenoh
from gaitd_client import wire

from daemon.ipc.decoding import Decoder
from daemon.keys.credentials import Credentials
from daemon.zenoh_io.session import config_of

Message = TypeVar("Message")

CONNECT_TIMEOUT_MS: Final = 1000
ANSWER_TIMEOUT_S: Final = 10.0
"""Longer than the gateway lets any request wait."""


class Target(NamedTuple):
    """Address of a service: its endpoints, and the TRAINER of its keys."""

    endpoints: tuple[str, ...]
    trainer: str
    credentials: Credentials | None = None
    """None: for a service without keys."""

    def control(self, name: str) -> str:
        """Return the key of control/NAME, with the client's name if it has one and it acts."""
        key = wire.key(self.trainer, wire.CONTROL, name)
        if self.credentials is None or name in wire.READING:
            return key
        return f"{key}/{self.credentials.file.name}"


class Answer(NamedTuple):
    """A reply as JSON text, or the reason why there is none."""

    text: str | None
    trouble: str = ""

    def decode(self, kind: type[Message]) -> Message | None:
        """Return the reply as a message of this kind; None if there is none."""
        if self.text is None:
            return None
        return Decoder(msgspec.json.Decoder(kind).decode).decode(self.text.encode())


def client_settings(target: Target) -> dict[str, Any]:
    """Keys of Zenoh's configuration for a client that sends one query and disconnects."""
    return {
        "mode": "client",
        "connect/endpoints": list(target.endpoints),
        "connect/timeout_ms": CONNECT_TIMEOUT_MS,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": 1000,
        "transport/shared_memory/enabled": False,
        **(target.credentials.settings() if target.credentials else {}),
    }


def open_client(target: Target) -> zenoh.Session:
    """Open a session with a service.

    Raises:
        zenoh.ZError: no service listens on the endpoints, or it refuses the credentials.
    """
    zenoh.init_log_from_env_or("off")
    return zenoh.open(config_of(client_settings(target)))


def json_text(reply: zenoh.Reply) -> str | None:
    """Return the service's answer; None for Zenoh's own timeout, an error that is not JSON."""
    sample = reply.ok or reply.err
    is_json = sample is not None and str(sample.encoding).startswith("application/json")
    return sample.payload.to_string() if sample is not None and is_json else None


def query(target: Target, name: str, payload: dict[str, Any]) -> Answer:
    """Query control/NAME of a service once."""
    key, where = target.control(name), " or ".join(target.endpoints)
    try:
        session = open_client(target)
    except zenoh.ZError:
        return Answer(None, f"no service listens on {where}, or it does not accept these keys")
    with session:
        for reply in session.get(key, payload=json.dumps(payload), timeout=ANSWER_TIMEOUT_S):
            if (text := json_text(reply)) is not None:
                return Answer(text)
    role = "" if target.credentials is None else ", or the role may not request it"
    return Answer(None, f"no answer to {key} on {where}: another trainer, or it hangs{role}")
