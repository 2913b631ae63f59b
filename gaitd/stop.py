"""`gaitd stop`: send one request to a running service."""

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
    """Stop now, in any mode of the service. This does not replace the emergency stop."""
    target = find_target(config, endpoint, trainer)
    raise typer.Exit(request(target, "stop", {}, as_json=as_json))
