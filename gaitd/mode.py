"""`gaitd mode NAME`: choose what the enabled leg does."""

from typing import Annotated, Any

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
    name: Annotated[str, typer.Argument(help="hold, gait, excite, hand_guiding or self_test")],
    cadence: Annotated[float, typer.Option(help="Strides per second, for gait.")] = 0.0,
    amplitude: Annotated[float, typer.Option(help="0 to 1 of the full gait, for gait.")] = 0.0,
    duration: Annotated[float, typer.Option(help="Seconds, for gait and excite.")] = 0.0,
    scenario: Annotated[str, typer.Option(help="Name in the configuration, for excite.")] = "",
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Choose the enabled leg's mode: hold, gait (announced 3 s ahead), excite, hand_guiding."""
    payload: dict[str, Any] = {
        "mode": name,
        "cadence_hz": cadence,
        "amplitude_ratio": amplitude,
        "duration_s": duration,
        "scenario": scenario,
    }
    target = find_target(config, endpoint, trainer)
    raise typer.Exit(request(target, "mode", payload, as_json=as_json))
