"""`gaitd disable`: send one request to a running service."""

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
    """Stop a running service in an orderly way and switch its drives off."""
    target = find_target(config, endpoint, trainer)
    raise typer.Exit(request(target, "disable", {}, as_json=as_json))
