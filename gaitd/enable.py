"""`gaitd enable`: send one request to a running service."""

import typer

from gaitd.remote import (
    ConfigOption,
    EndpointOption,
    JsonOption,
    TrainerOption,
    find_target,
    request,
)


def command(
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Let a running service enable its drives; it then holds the pose."""
    target = find_target(config, endpoint, trainer)
    raise typer.Exit(request(target, "enable", {}, as_json=as_json))
