"""`gaitd schema`: the JSON Schema of a message, or AsyncAPI of all; needs no running service."""

import json
from typing import Annotated

import typer
from gaitd_client import wire
from gaitd_client.wire.asyncapi import asyncapi
from gaitd_toml import COMMAND_LINE, ConfigError

from gaitd.command_line import JsonOption

ASYNCAPI = "asyncapi"


def _names() -> list[str]:
    return [*wire.MESSAGES, ASYNCAPI]


def command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="of a message, such as estimate, or asyncapi; without it the names are listed",
            autocompletion=_names,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the JSON Schema of a message on Zenoh, or an AsyncAPI document of all."""
    if name is None:
        print(json.dumps(_names()) if as_json else "\n".join(_names()))
        return
    if name == ASYNCAPI:
        print(json.dumps(asyncapi(), indent=2, ensure_ascii=False))
        return
    by_name = wire.MESSAGES | {wire.schema_name(kind): kind for kind in wire.MESSAGES.values()}
    if name not in by_name:
        raise ConfigError(COMMAND_LINE, "NAME", name, f"one of {', '.join(_names())}")
    print(json.dumps(wire.schema(by_name[name]), indent=2, ensure_ascii=False))
