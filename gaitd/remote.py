"""Shared part of the clients of a running service: its address, one request, and the exit codes.

Exit codes: 0 done; 1 refused, with the reason; 2 configuration or usage; 4 no answer, or the
service did not report the outcome of the request in time.
"""

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from gaitd_client import wire

from daemon.zenoh_io.client import Target, query

EXIT_DONE: Final = 0
EXIT_REFUSED: Final = 1
EXIT_NO_ANSWER: Final = 4

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
DEFAULT_TRAINER: Final = "trainer"

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


def request(
    target: Target, name: str, payload: dict[str, Any] | None = None, *, as_json: bool
) -> int:
    """Request enable, disable, stop, reset or mode; print the outcome.

    Returns: the exit code.
    """
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
