"""`gaitd watch KEY`: the messages of one key of a running service, as JSON, one to a line.

Ends by Ctrl-C or after --count messages. Silence is reported on stderr. A service that does not
answer at the start has no such trainer, or none of it runs: that ends the command, too. Exit codes
as in `remote.py`.
"""

import sys
from collections.abc import Callable
from typing import Annotated, Any, Final

import typer
from gaitd_client import ClientError, NotValid, Stream, Trainer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import JsonLinesOption
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    as_json_text,
    client_of,
    find_target,
    report_silence,
)

OF_TRAINER: Final[dict[str, Callable[[Trainer], Stream[Any]]]] = {
    "safety": Trainer.safety,
    "health": Trainer.health,
    "events": Trainer.events,
}
OF_LEG: Final[dict[str, Callable[[Trainer, str], Stream[Any]]]] = {
    "estimate": Trainer.estimate,
    "activity": Trainer.activity,
    "friction": Trainer.friction,
    "stride": Trainer.stride,
    "controller": Trainer.controller,
}
ALLOWED: Final = (
    f"one of {', '.join(OF_TRAINER)}, LEG/{', LEG/'.join(OF_LEG)}, drives/LEG/AXIS;"
    " LEG is right or left, AXIS is hip or slide"
)


def command(
    key: Annotated[str, typer.Argument(help=f"below gaitd/TRAINER/: {ALLOWED}")],
    count: Annotated[
        int, typer.Option(min=0, help="End after so many messages; 0: at Ctrl-C.")
    ] = 0,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonLinesOption = False,
) -> None:
    """Print the messages of one key, one line of JSON each; with --json errors, too."""
    target = find_target(config, endpoint, trainer, credentials)
    try:
        with client_of(target, "watch") as service:
            stream = stream_of(service, key)
            service.status()  # a wrong trainer has no messages, without end
            _print(stream, count)
    except ClientError as error:
        raise typer.Exit(report_silence("watch", str(error), as_json=as_json)) from error
    except KeyboardInterrupt:
        return


def stream_of(service: Trainer, key: str) -> Stream[Any]:
    """Return the messages of a key.

    Raises:
        ConfigError: there is no such key.
    """
    first, _, rest = key.partition("/")
    try:
        if key in OF_TRAINER:
            return OF_TRAINER[key](service)
        if first == "drives":
            return service.drive(rest)
        return OF_LEG[rest](service, first)
    except (KeyError, ValueError) as error:
        raise ConfigError(COMMAND_LINE, "KEY", key, ALLOWED) from error


def _print(stream: Stream[Any], count: int) -> None:
    """Print messages until the count, and what is said in their place."""
    printed_count = 0
    for message in stream:
        if not isinstance(message, NotValid):
            print(as_json_text(message), flush=True)
            printed_count += 1
        else:
            print(f"not valid: {message.text}", file=sys.stderr, flush=True)
        if count and printed_count >= count:
            return
    raise typer.Exit(ExitCode.UNAVAILABLE)
