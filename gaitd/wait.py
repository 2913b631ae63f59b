"""`gaitd wait MODE`: wait until a running service is in a mode; for scripts.

A latched stop ends it, too: only a person resets one. While the service is silent it waits on. Exit
codes: 0 in the mode; 1 stopped; 2 usage; 4 no answer at the start; 5 the time of --timeout is over.
"""

import sys
from itertools import chain
from typing import Annotated, Final

import typer
from gaitd_client import ClientError, Mode, NotValid, Trainer
from gaitd_client.wire import Safety
from gaitd_names import ExitCode
from msgspec.structs import replace

from gaitd.command_line import CommandError, JsonOption, failure, json_text, with_config
from gaitd.language import texts
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TimeoutOption,
    TrainerOption,
    client_of,
    closed_after,
    find_target,
    report_silence,
)
from gaitd.status import safety_lines

KEPT: Final = 64
"""Messages that may wait, so that no mode is missed."""


def command(
    mode: Annotated[Mode, typer.Argument(help="Mode to wait for.", case_sensitive=False)],
    timeout: TimeoutOption = None,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Wait until a running service is in a mode, and print the state that ended the wait.

    A stop that must be reset ends it, too, with exit code 1.
    """
    target = find_target(config, endpoint, trainer, credentials)
    try:
        with client_of(target, "wait") as service:
            newest, code = _wait(service, mode, timeout)
    except ClientError as error:
        raise typer.Exit(report_silence("wait", str(error), as_json=as_json)) from error
    if as_json:
        cause = newest.verdict.cause if newest.verdict else None
        document: dict[str, object] = {"wanted": mode, "mode": newest.mode, "cause": cause}
        if code is not ExitCode.DONE:
            status = with_config("gaitd status")
            why = CommandError(f"not in mode {mode}", code, blame="service", following=status)
            document |= failure(why, "wait")
        print(json_text(document))
    else:
        out = sys.stdout if code is ExitCode.DONE else sys.stderr
        print(*safety_lines(newest, texts()), sep="\n", file=out)
    raise typer.Exit(code)


def _wait(service: Trainer, wanted: Mode, timeout_s: float | None) -> tuple[Safety, ExitCode]:
    """Return the state that ended the wait, and the exit code."""
    stream = service.safety(keep=KEPT)
    newest = service.status().safety
    with closed_after(stream, timeout_s) as is_over:
        for message in chain([newest], stream):
            if isinstance(message, NotValid):
                print(f"not valid: {message.text}", file=sys.stderr, flush=True)
                newest = replace(newest, valid=False, mode=None, verdict=None, progress=None)
                continue
            newest = message
            if newest.mode == wanted:
                return newest, ExitCode.DONE
            if newest.mode == Mode.FAULT:
                return newest, ExitCode.FAILED
    return newest, ExitCode.TIME_OVER if is_over.is_set() else ExitCode.UNAVAILABLE
