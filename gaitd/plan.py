"""`gaitd plan release|withdraw`: the limits within which a session may request a gait."""

from enum import StrEnum
from typing import Annotated

import typer

from gaitd.command_line import JsonOption
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    find_target,
    request,
)


class Action(StrEnum):
    """Subcommand of `gaitd plan`."""

    RELEASE = "release"
    WITHDRAW = "withdraw"


def command(
    action: Annotated[Action, typer.Argument(help="What to do.")],
    cadence: Annotated[float, typer.Option(help="Highest strides per second.")] = 0.0,
    amplitude: Annotated[float, typer.Option(help="Largest share of the full gait, 0 to 1.")] = 0.0,
    duration: Annotated[float, typer.Option(help="Longest gait in seconds.")] = 0.0,
    hip_assist: Annotated[
        float | None, typer.Option(help="Cap of a controller's assist at the hip, in N·m.")
    ] = None,
    slide_assist: Annotated[
        float | None, typer.Option(help="Cap of a controller's assist at the slide, in N.")
    ] = None,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Release the limits of a session's gait, or withdraw them; for an operator."""
    limits = {
        "cadence_max_hz": cadence,
        "amplitude_max_ratio": amplitude,
        "duration_max_s": duration,
        "hip": {"assist_max": hip_assist},
        "slide": {"assist_max": slide_assist},
    }
    target = find_target(config, endpoint, trainer, credentials)
    plan = limits if action is Action.RELEASE else None
    raise typer.Exit(request(target, "plan", as_json=as_json, plan=plan))
