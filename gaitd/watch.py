"""`gaitd watch KEY`: the messages of one key of a running service, as JSON, one to a line.

With --field only these fields are printed, in one line with tabs between them, for a shell: text as
it is, and nothing for a value that is not known. With --json as well they are an object.

It ends by Ctrl-C, after --count messages, or after --timeout. Silence is reported on stderr. A
service that does not answer at the start has no such trainer, or none of it runs: that ends the
command, too. Exit codes as in `remote.py`.
"""

import sys
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Annotated, Any, Final

import msgspec
import typer
from gaitd_client import ClientError, NotValid, Stream, Trainer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, ConfigError
from msgspec.inspect import DictType, Metadata, StructType, Type, UnionType, type_info

from gaitd.command_line import CommandError, JsonLinesOption, full_name, json_text, with_config
from gaitd.completion import axes
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TimeoutOption,
    TrainerOption,
    as_json_text,
    client_of,
    closed_after,
    find_target,
    report_silence,
)

Form = Callable[[msgspec.Struct], str]
"""Makes the line of a message."""

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


def _keys(context: typer.Context) -> list[str]:
    drives = [name for name in axes(context) if "/" in name]
    return _keys_of([name.partition("/")[0] for name in drives], drives)


def command(
    key: Annotated[
        str,
        typer.Argument(
            help=f"below gaitd/TRAINER/: {ALLOWED}; its end alone if unique", autocompletion=_keys
        ),
    ],
    count: Annotated[
        int, typer.Option(min=0, help="End after so many messages; 0: at Ctrl-C.")
    ] = 0,
    once: Annotated[bool, typer.Option("--once", help="The same as --count 1.")] = False,
    timeout: TimeoutOption = None,
    field: Annotated[
        list[str] | None,
        typer.Option(help="Print this field alone, such as hip.patient; more than once."),
    ] = None,
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
            stream = _stream(service, key)
            form = _form(stream.kind, field or [], as_json=as_json)
            service.status()  # a wrong trainer has no messages, without end
            with closed_after(stream, timeout) as is_over:
                if _print(stream, 1 if once else count, form):
                    return
            if not is_over.is_set():
                raise typer.Exit(ExitCode.UNAVAILABLE)
            status = with_config("gaitd status")
            text = f"watch: {key}: {timeout} s are over"
            raise CommandError(text, ExitCode.TIME_OVER, blame="--timeout", following=status)
    except ClientError as error:
        raise typer.Exit(report_silence("watch", str(error), as_json=as_json)) from error
    except KeyboardInterrupt:
        return


def _keys_of(legs: Iterable[str], drives: Iterable[str]) -> list[str]:
    of_legs = (f"{leg}/{name}" for leg in dict.fromkeys(legs) for name in OF_LEG)
    return [*OF_TRAINER, *of_legs, *(f"drives/{name}" for name in drives)]


def _stream(service: Trainer, key: str) -> Stream[Any]:
    """Return the messages of a key, of which the beginning may be left out where it is unique.

    Raises:
        ConfigError: there is no such key, or there are several.
    """
    try:
        return stream_of(service, key)
    except ConfigError:
        known = service.configuration()
        full = full_name(key, _keys_of(known.leg_names, known.drive_names), "KEY")
        return stream_of(service, full)


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


def _form(kind: type[msgspec.Struct], fields: list[str], *, as_json: bool) -> Form:
    """Return how a message is printed.

    Raises:
        ConfigError: it has no such field.
    """
    if not fields:
        return as_json_text
    known = _paths(type_info(kind))
    for field in fields:
        if not any(fnmatchcase(field, one) for one in known):
            near = get_close_matches(field, known, n=6, cutoff=0.4) or known
            raise ConfigError(COMMAND_LINE, "--field", field, f"one of {', '.join(near)}")

    def form(message: msgspec.Struct) -> str:
        told = msgspec.to_builtins(message)
        values = {field: _value(told, field) for field in fields}
        if as_json:
            return json_text(values)
        return "\t".join(
            one if isinstance(one, str) else "" if one is None else json_text(one)
            for one in values.values()
        )

    return form


def _value(told: Any, field: str) -> Any:  # noqa: ANN401 - decoded JSON
    """Return the value of a field; None also where what holds it is not known."""
    for name in field.split("."):
        told = told.get(name) if isinstance(told, dict) else None
    return told


def _paths(kind: Type, start: str = "") -> list[str]:
    """Return the names of a message's fields: those of a struct in it behind a dot, `*` for any."""
    match kind:
        case Metadata():
            return _paths(kind.type, start)
        case UnionType():
            return [path for part in kind.types for path in _paths(part, start)]
        case StructType():
            return [
                path
                for one in kind.fields
                for path in (start + one.name, *_paths(one.type, f"{start}{one.name}."))
            ]
        case DictType():
            return [f"{start}*"]
        case _:
            return []


def _print(stream: Stream[Any], count: int, form: Form) -> bool:
    """Print messages, and what is said in their place; False: the stream ended before the count."""
    printed_count = 0
    for message in stream:
        if not isinstance(message, NotValid):
            print(form(message), flush=True)
            printed_count += 1
        else:
            print(f"not valid: {message.text}", file=sys.stderr, flush=True)
        if count and printed_count >= count:
            return True
    return False
