"""`gaitd schema`: the JSON Schema of a message; needs no running service."""

import json
from typing import Annotated

import typer
from gaitd_client import wire
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import JsonOption


def _names() -> list[str]:
    return list(wire.MESSAGES)


def command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="of a message, such as estimate; without it the names are listed",
            autocompletion=_names,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the JSON Schema of a message on Zenoh."""
    if name is None:
        print(json.dumps(list(wire.MESSAGES)) if as_json else "\n".join(wire.MESSAGES))
        return
    by_name = wire.MESSAGES | {wire.schema_name(kind): kind for kind in wire.MESSAGES.values()}
    if name not in by_name:
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of {', '.join(wire.MESSAGES)}")
    print(json.dumps(wire.schema(by_name[name]), indent=2, ensure_ascii=False))
