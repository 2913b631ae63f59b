"""`gaitd reset`: send one request to a running service."""

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
    """Reset a latched stop once its cause is gone. No drive is enabled by it."""
    target = find_target(config, endpoint, trainer)
    raise typer.Exit(request(target, "reset", {}, as_json=as_json))
