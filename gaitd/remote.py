"""Shared part of the clients of a running service: its address, one request, and the exit codes.

Exit codes: 0 done; 1 refused, with the reason; 2 configuration or usage; 4 no answer, or the
service did not report the outcome of the request in time.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final

import msgspec
import typer
from gaitd_client import (
    ClientError,
    CredentialsError,
    Mode,
    NoServiceError,
    Outcome,
    Reply,
    Target,
    Trainer,
    read_credentials,
)
from gaitd_client.connection import DEFAULT_ENDPOINT, DEFAULT_TRAINER
from gaitd_client.trainer import NOT_STOPPED, STOP
from gaitd_toml import ConfigError

from daemon.ipc.report import RefusalCode
from daemon.wire.names import name_of
from gaitd.command_line import CONFIG_VARIABLE, CommandError, failure, json_text, with_config

EXIT_DONE: Final = 0
EXIT_REFUSED: Final = 1
EXIT_NO_ANSWER: Final = 4

LOOK: Final = "`gaitd status` shows the state of the machine"
NEXT_BY_CODE: Final = {
    RefusalCode.INPUT_UNTESTED: "`gaitd self-test`",
    RefusalCode.SELF_TEST_DUE: "`gaitd self-test`",
    RefusalCode.NOT_REFERENCED: "`gaitd reference {subject}`, in the empty machine",
    RefusalCode.SIGN_NOT_PROVEN: "`gaitd commission {subject}`, in the empty machine",
    RefusalCode.PATIENT_CONFIGURED: (
        "`gaitd run` with a robot file without [patient], once the leg is out"
    ),
    RefusalCode.NO_PLAN: "`gaitd plan release`",
}
"""What to do after a refusal of the core, by its code."""
NEXT_IN_MODE: Final[dict[str, str]] = {
    Mode.OFF: "`gaitd status` shows what the service waits for",
    Mode.BRINGING_UP: "wait until `gaitd status` shows ready",
    Mode.STOPPING: "wait until `gaitd status` shows ready or fault",
    Mode.FAULT: "`gaitd status` shows the cause and its remedy; then `gaitd reset`",
    Mode.READY: "`gaitd enable`, with the hand switch held and the leg at rest",
    Mode.REFERENCE: "wait for its end, or `gaitd stop`",
    Mode.COMMISSION: "wait for its end, or `gaitd stop`",
}
"""What to do after any other refusal, by the mode."""

ConfigOption = Annotated[
    Path | None,
    typer.Option(
        "--config",
        envvar=CONFIG_VARIABLE,
        help="Trainer file of the service, with its endpoint and name.",
    ),
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


def find_target(
    config: Path | None, endpoint: str | None, trainer: str | None, credentials: Path | None = None
) -> Target:
    """Determine the service's address; values of the command line override those of the file.

    Raises:
        ConfigError: the trainer file or the folder of credentials cannot be used.
    """
    if credentials is not None:
        try:
            found = read_credentials(credentials)
        except CredentialsError as error:
            raise ConfigError(error.path, "", "", error.reason, following="") from error
        return Target(found.file.endpoints, found.file.trainer, found)
    endpoints, name = (DEFAULT_ENDPOINT,), DEFAULT_TRAINER
    if config is not None:
        from daemon.config.trainer import load_trainer
        from daemon.zenoh_io.endpoints import to_connect

        zenoh = load_trainer(config).trainer.zenoh
        endpoints, name = tuple(map(to_connect, zenoh.listen)), zenoh.trainer
    return Target((endpoint,) if endpoint else endpoints, trainer or name)


def client_of(target: Target, command: str) -> Trainer:
    """Return the client of a command, named after it in events."""
    return Trainer.of(target, client=f"gaitd {command}")


def as_json_text(message: msgspec.Struct) -> str:
    """Return a message as JSON, with the fields that this version knows."""
    return msgspec.json.encode(message).decode()


def request(
    target: Target,
    name: str,
    *,
    as_json: bool,
    known: Mapping[str, object] = MappingProxyType({}),
    **arguments: object,
) -> int:
    """Request enable, disable, stop, reset or mode; print the outcome.

    Args:
        target: the service.
        name: of the request.
        as_json: print one JSON document.
        known: printed in the same document.
        arguments: of the request.

    Returns: the exit code.
    """
    try:
        with client_of(target, name) as trainer:
            reply = trainer.request(name, **arguments)
    except NoServiceError as error:
        trouble = f"{NOT_STOPPED} ({error})" if name == STOP else str(error)
        return report_silence(name, trouble, as_json=as_json)
    except ClientError as error:
        return report_silence(name, str(error), as_json=as_json)
    return report_reply(reply, as_json=as_json, known=known)


def report_reply(
    reply: Reply, *, as_json: bool, known: Mapping[str, object] = MappingProxyType({})
) -> int:
    """Print the outcome of a request, and after a refusal the next command.

    Returns: the exit code.
    """
    mode = f" (mode {reply.mode})" if reply.mode else ""
    reason = f": {reply.reason}" if reply.reason else ""
    following = next_command(reply)
    then = f"\nnext: {following}" if following else ""
    text = f"{reply.request} {reply.outcome}{reason}{mode}{then}"
    # A later version of the service may send another outcome.
    codes: dict[str, int] = {Outcome.DONE: EXIT_DONE, Outcome.REFUSED: EXIT_REFUSED}
    code = codes.get(reply.outcome, EXIT_NO_ANSWER)
    if not as_json:
        print(text)
    elif code == EXIT_DONE:
        print(json_text({**known, **msgspec.to_builtins(reply)}))
    else:
        refused = CommandError(reply.reason, code, following=following)
        error = failure(refused, reply.request)
        print(json_text({**known, **msgspec.to_builtins(reply), **error}))
    return code


def next_command(reply: Reply) -> str:
    """Return what to do after a refusal; empty for every other outcome."""
    if reply.outcome != Outcome.REFUSED:
        return ""
    refusal = reply.refusal
    for code, text in NEXT_BY_CODE.items():
        if refusal is not None and refusal.code == name_of(code):
            return text.format(subject=refusal.subject)
    return NEXT_IN_MODE.get(reply.mode or "", LOOK)


def report_silence(name: str, trouble: str, *, as_json: bool) -> int:
    """Report that no service answered.

    Returns: the exit code.
    """
    if as_json:
        run = with_config("gaitd run") or "gaitd run --help"
        silent = CommandError(trouble, EXIT_NO_ANSWER, blame="service", following=run)
        known = {"request": name, "outcome": "unanswered", "reason": trouble}
        print(json_text(known | failure(silent, name)))
    else:
        print(f"{name}: {trouble}", file=sys.stderr)
    return EXIT_NO_ANSWER
