"""`gaitd enable`, `disable`, `stop`, `reset`, `mode`, `mark`: one request to a running service."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import typer
from gaitd_client import Mode

from gaitd.command_line import JsonOption
from gaitd.completion import scenarios
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    find_target,
    request,
)


class Requested(StrEnum):
    """Modes of `gaitd mode`; `gaitd self-test`, `reference` and `commission` request the others."""

    HOLD = Mode.HOLD
    GAIT = Mode.GAIT
    TORQUE = Mode.TORQUE
    EXCITE = Mode.EXCITE
    HAND_GUIDING = Mode.HAND_GUIDING


def _command(name: str, documentation: str) -> Callable[..., None]:
    """Return the command of a request without arguments."""

    def command(
        config: ConfigOption = None,
        endpoint: EndpointOption = None,
        trainer: TrainerOption = None,
        credentials: CredentialsOption = None,
        as_json: JsonOption = False,
    ) -> None:
        raise typer.Exit(
            request(find_target(config, endpoint, trainer, credentials), name, as_json=as_json)
        )

    command.__doc__ = documentation
    return command


enable = _command("enable", "Let a running service enable its drives; it then holds the pose.")
disable = _command("disable", "Stop a running service in an orderly way and switch its drives off.")
stop = _command(
    "stop", "Stop now, in any mode of the service. This does not replace the emergency stop."
)
reset = _command("reset", "Reset a latched stop once its cause is gone. No drive is enabled by it.")


def mode(
    name: Annotated[
        Requested,
        typer.Argument(
            help="hold: keep the pose. gait: walk, announced 3 s ahead. torque: assist of the"
            " client that holds the lease, and nothing else. excite: a motion of the configuration,"
            " for calibration. hand_guiding: no stiffness; the leg is led by hand."
        ),
    ],
    cadence: Annotated[float, typer.Option(help="Strides per second, for gait.")] = 0.0,
    amplitude: Annotated[float, typer.Option(help="0 to 1 of the full gait, for gait.")] = 0.0,
    duration: Annotated[float, typer.Option(help="Seconds, for gait and excite.")] = 0.0,
    scenario: Annotated[
        str,
        typer.Option(help="Name in the configuration, for excite.", autocompletion=scenarios),
    ] = "",
    baseline: Annotated[
        bool,
        typer.Option(
            "--baseline",
            help="The patient is passive, for a gait of a minute; what is estimated meanwhile is"
            " taken off from then on.",
        ),
    ] = False,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Choose what the enabled leg does."""
    code = request(
        find_target(config, endpoint, trainer, credentials),
        "mode",
        as_json=as_json,
        mode=name,
        cadence_hz=cadence,
        amplitude_ratio=amplitude,
        duration_s=duration,
        scenario=scenario,
        baseline=baseline,
    )
    raise typer.Exit(code)


def mark(
    text: Annotated[str, typer.Argument(help="One line of at most 80 characters, without a name.")],
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a remark into events, recording and history, with the present time; for an operator."""
    target = find_target(config, endpoint, trainer, credentials)
    raise typer.Exit(request(target, "mark", as_json=as_json, text=text))
