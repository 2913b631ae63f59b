"""`gaitd reference AXIS`: home one axis of the empty machine through a running service."""

import json
from typing import Annotated

import typer

from gaitd.one_axis import exit_code, prepare
from gaitd.remote import ConfigOption, EndpointOption, JsonOption, TrainerOption, find_target


def command(
    axis: Annotated[str, typer.Argument(help="LEG/AXIS, for example right/hip")],
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Home one axis by its drive: slowly and with limited torque, in the empty machine.

    The service needs the configuration of the empty machine, and the hand switch held.
    """
    target = find_target(config, endpoint, trainer)
    ending = prepare(target, "reference", axis, "homed", as_json=as_json)
    if isinstance(ending, int):
        raise typer.Exit(ending)
    print(json.dumps({"axis": axis, "homed": ending.good}) if as_json else ending.text)
    raise typer.Exit(exit_code(ending))
