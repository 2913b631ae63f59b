"""`gaitd commission AXIS`: prove the sign of one axis by its encoder and by the operator's eyes."""

import json
from typing import Annotated, Final

import typer

from gaitd.one_axis import exit_code, prepare
from gaitd.remote import (
    EXIT_DONE,
    EXIT_REFUSED,
    ConfigOption,
    EndpointOption,
    JsonOption,
    TrainerOption,
    find_target,
    request,
)

MOTIONS: Final = {
    "hip": "the thigh is first raised towards the trunk (the hip bends), then lowered again",
    "slide": "the slide first moves so that the knee stretches, then comes back",
}
"""Motion of each joint in its positive direction and back, in the axes of robot.toml."""


def command(
    axis: Annotated[str, typer.Argument(help="LEG/AXIS, for example right/hip")],
    witnessed: Annotated[
        bool,
        typer.Option(
            "--witnessed",
            help="I watch, and will see it as described: do not ask. Needed with --json.",
        ),
    ] = False,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    as_json: JsonOption = False,
) -> None:
    """Push one axis forth and back with a small bounded torque, and prove the sign of its motion.

    For the empty machine with its springs turned down. The encoder must move with the torque, and
    the operator must see the joint move as described. Only then can the drives be enabled.
    """
    target = find_target(config, endpoint, trainer)
    described = MOTIONS.get(axis.rpartition("/")[2], "it first goes forth, then back")
    if not as_json:
        print(f"Watch the machine: if all is right, {described}.")
    ending = prepare(target, "commission", axis, "moves with its torque", as_json=as_json)
    if isinstance(ending, int):
        raise typer.Exit(ending)
    if not as_json:
        print(ending.text)
    asked = not (witnessed or as_json) and ending.good
    seen = ending.good and (
        witnessed or (asked and typer.confirm(f"Did you see that {described}?"))
    )
    if as_json:
        print(json.dumps({"axis": axis, "moves_with_its_torque": ending.good, "witnessed": seen}))
    if not seen:
        raise typer.Exit(EXIT_REFUSED if ending.good else exit_code(ending))
    payload = {"mode": "commission", "axis": axis, "witnessed": True}
    raise typer.Exit(request(target, "mode", payload, as_json=as_json) or EXIT_DONE)
