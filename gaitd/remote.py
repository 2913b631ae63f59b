"""Shared part of the clients of a running service: its address, one request, and the exit codes.

Exit codes: 0 done; 1 refused, with the reason; 2 configuration or usage; 4 no answer, or the
service did not report the outcome of the request in time.
"""

import re
import sys
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final

import msgspec
import typer
from gaitd_client import (
    ClientError,
    CredentialsError,
    NoServiceError,
    Outcome,
    Reply,
    Stream,
    Target,
    Trainer,
    read_credentials,
)
from gaitd_client.connection import DEFAULT_ENDPOINT, DEFAULT_TRAINER
from gaitd_client.trainer import NOT_STOPPED, STOP
from gaitd_names import ExitCode
from gaitd_texts import Catalogue, Reader, catalogue
from gaitd_toml import ConfigError

from gaitd.command_line import CONFIG_VARIABLE, CommandError, failure, json_text, with_config
from gaitd.language import texts

EXAMPLE: Final = {"cadence_hz": 0.25, "amplitude_ratio": 1.0, "duration_s": 60.0}
"""What a command that is named has for what the request left out."""

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
TimeoutOption = Annotated[
    float | None,
    typer.Option(min=0.0, help="End after so many seconds, with exit code 5; without it never."),
]


@contextmanager
def closed_after(stream: Stream[Any], timeout_s: float | None) -> Generator[threading.Event]:
    """Close a stream after a time of the computer; the event that is yielded tells that it was.

    Args:
        stream: what waits for its messages then ends.
        timeout_s: None: never.
    """
    is_over = threading.Event()

    def close() -> None:
        is_over.set()
        stream.close()

    timer = threading.Timer(0.0 if timeout_s is None else timeout_s, close)
    timer.daemon = True
    if timeout_s is not None:
        timer.start()
    try:
        yield is_over
    finally:
        timer.cancel()


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
    **arguments: object,
) -> int:
    """Request enable, disable, stop, reset or mode; print the outcome.

    Args:
        target: the service.
        name: of the request.
        as_json: print one JSON document.
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
    return report_reply(reply, as_json=as_json, arguments=arguments)


def report_reply(
    reply: Reply,
    *,
    as_json: bool,
    known: Mapping[str, object] = MappingProxyType({}),
    arguments: Mapping[str, object] = MappingProxyType({}),
) -> int:
    """Print the outcome of a request, and after a refusal what to do.

    Args:
        reply: to the request.
        as_json: print one JSON document, with codes in place of sentences.
        known: printed in the same document.
        arguments: of the request, for the command that is named.

    Returns: the exit code.
    """
    # A later version of the service may send another outcome.
    codes: dict[str, int] = {Outcome.DONE: ExitCode.DONE, Outcome.REFUSED: ExitCode.FAILED}
    code = codes.get(reply.outcome, ExitCode.UNAVAILABLE)
    if as_json:
        document = {**known, **msgspec.to_builtins(reply)}
        if code != ExitCode.DONE:
            why = reply.refusal.code if reply.refusal else reply.outcome
            following = next_command(reply, catalogue(Reader.OPERATOR, "en"), arguments)
            document |= failure(CommandError(why, code, following=following), reply.request)
        print(json_text(document))
        return code
    said = texts()
    outcome = said.text(f"outcome.{reply.outcome}")
    mode = f" ({said.text(f'mode.{reply.mode}')})" if reply.mode else ""
    reason = f": {said.refusal(reply.refusal)}" if reply.refusal else ""
    mode = "" if reason.endswith(mode) else mode  # some refusals name it themselves
    print(f"{said.text(f'request.{reply.request}')}: {outcome}{reason}{mode}")
    if following := next_command(reply, said, arguments):
        print(f"{said.text('status.next')}: {following}")
    return code


def next_command(reply: Reply, said: Catalogue, arguments: Mapping[str, object]) -> str:
    """Return what to do after a refusal, with complete commands; empty for other outcomes."""
    if reply.outcome != Outcome.REFUSED:
        return ""
    refusal = reply.refusal
    if refusal is not None and said.has(f"next.{refusal.code}"):
        given = {name: value for name, value in arguments.items() if value}
        fields = {**EXAMPLE, **given, **refusal.values}
        lowest, highest = (refusal.values.get(name) for name in ("lowest", "highest"))
        if isinstance(lowest, float) and isinstance(highest, float):
            fields["suggested"] = min(max(EXAMPLE["cadence_hz"], lowest), highest)
        shown = {name: _as_typed(value) for name, value in fields.items()}
        shown |= {"axis": refusal.subject or "", "said": refusal.said}
        return complete(said.text(f"next.{refusal.code}", **shown))
    key = f"next.mode_{reply.mode}"
    return complete(said.text(key if said.has(key) else "next.other"))


def complete(text: str) -> str:
    """Return a text whose commands have the trainer file of this command line."""
    return re.sub("`(gaitd [^`]+)`", lambda found: f"`{with_config(found[1]) or found[1]}`", text)


def _as_typed(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def report_silence(name: str, trouble: str, *, as_json: bool) -> int:
    """Report that no service answered.

    Returns: the exit code.
    """
    if as_json:
        run = with_config("gaitd run") or "gaitd run --help"
        silent = CommandError(trouble, ExitCode.UNAVAILABLE, blame="service", following=run)
        known = {"request": name, "outcome": "unanswered", "reason": trouble}
        print(json_text(known | failure(silent, name)))
    else:
        print(f"{name}: {trouble}", file=sys.stderr)
    return ExitCode.UNAVAILABLE
