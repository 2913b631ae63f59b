"""Shared part of the clients of a running service: its address, one request, and the exit codes.

Exit codes: 0 done; 1 refused, with the reason; 2 configuration or usage; 4 no answer, or the
service did not report the outcome of the request in time.
"""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple, TypeVar

import typer

if TYPE_CHECKING:
    import zenoh

    from daemon.keys.credentials import Credentials

Message = TypeVar("Message")

EXIT_DONE: Final = 0
EXIT_REFUSED: Final = 1
EXIT_NO_ANSWER: Final = 4

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
DEFAULT_TRAINER: Final = "trainer"
CONNECT_TIMEOUT_MS: Final = 1000
ANSWER_TIMEOUT_S: Final = 10.0
"""Longer than the gateway lets any request wait."""

ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", help="Trainer file of the service, with its endpoint and name."),
]
EndpointOption = Annotated[
    str | None,
    typer.Option(help=f"Zenoh endpoint of the service, without --config {DEFAULT_ENDPOINT}."),
]
TrainerOption = Annotated[
    str | None, typer.Option(help=f"Name in the keys, without --config {DEFAULT_TRAINER}.")
]
CredentialsOption = Annotated[
    Path | None,
    typer.Option(
        "--credentials",
        help="Folder of `gaitd keys issue`, for a service with keys; replaces --config,"
        " --endpoint and --trainer.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]


class Target(NamedTuple):
    """Address of a service: its endpoints, and the TRAINER of its keys."""

    endpoints: tuple[str, ...]
    trainer: str
    credentials: "Credentials | None" = None
    """None: for a service without keys."""


class Answer(NamedTuple):
    """A reply as JSON text, or the reason why there is none."""

    text: str | None
    trouble: str = ""

    def decode(self, kind: type[Message]) -> Message | None:
        """Return the reply as a message of this kind; None if there is none."""
        import msgspec

        return None if self.text is None else msgspec.json.decode(self.text, type=kind)


def find_target(
    config: Path | None, endpoint: str | None, trainer: str | None, credentials: Path | None = None
) -> Target:
    """Determine the service's address; values of the command line override those of the file.

    Raises:
        ConfigError: the trainer file or the folder of credentials cannot be used.
    """
    if credentials is not None:
        from daemon.keys.credentials import read_credentials

        found = read_credentials(credentials)
        return Target(found.file.endpoints, found.file.trainer, found)
    endpoints, name = (DEFAULT_ENDPOINT,), DEFAULT_TRAINER
    if config is not None:
        from daemon.config.trainer import load_trainer
        from daemon.zenoh_io.endpoints import to_connect

        zenoh = load_trainer(config).trainer.zenoh
        endpoints, name = tuple(map(to_connect, zenoh.listen)), zenoh.trainer
    return Target((endpoint,) if endpoint else endpoints, trainer or name)


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


def client_config(target: Target) -> "zenoh.Config":
    """Return Zenoh's configuration of a client."""
    import zenoh

    config = zenoh.Config()
    for key, value in client_settings(target).items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_client(target: Target) -> "zenoh.Session":
    """Open a session with a service.

    Raises:
        zenoh.ZError: no service listens on the endpoints, or it refuses the credentials.
    """
    import zenoh

    zenoh.init_log_from_env_or("off")
    return zenoh.open(client_config(target))


def selector(target: Target, name: str) -> str:
    """Return the key of control/NAME, with the client's name if it has one and the query acts."""
    from daemon import wire

    own = (
        ()
        if target.credentials is None or name in wire.READING
        else (target.credentials.file.name,)
    )
    return wire.key(target.trainer, wire.CONTROL, name, *own)


def json_text(reply: "zenoh.Reply") -> str | None:
    """Return the service's answer; None for Zenoh's own timeout, an error that is not JSON."""
    sample = reply.ok or reply.err
    is_json = sample is not None and str(sample.encoding).startswith("application/json")
    return sample.payload.to_string() if sample is not None and is_json else None


def query(target: Target, name: str, payload: dict[str, Any]) -> Answer:
    """Query control/NAME of a service once."""
    import zenoh

    key, where = selector(target, name), " or ".join(target.endpoints)
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


def request(
    target: Target, name: str, payload: dict[str, Any] | None = None, *, as_json: bool
) -> int:
    """Request enable, disable, stop, reset or mode; print the outcome.

    Returns: the exit code.
    """
    from daemon import wire

    answer = query(target, name, {"client": f"gaitd {name}", **(payload or {})})
    reply = answer.decode(wire.Reply)
    if reply is None:
        return report_silence(name, answer.trouble, as_json=as_json)
    mode = f" (mode {reply.mode})" if reply.mode else ""
    reason = f": {reply.reason}" if reply.reason else ""
    print(answer.text if as_json else f"{name} {reply.outcome}{reason}{mode}")
    return {"done": EXIT_DONE, "refused": EXIT_REFUSED}.get(reply.outcome, EXIT_NO_ANSWER)


def report_silence(name: str, trouble: str, *, as_json: bool) -> int:
    """Report that no service answered.

    Returns: the exit code.
    """
    if as_json:
        print(json.dumps({"request": name, "outcome": "unanswered", "reason": trouble}))
    else:
        print(f"{name}: {trouble}", file=sys.stderr)
    return EXIT_NO_ANSWER
