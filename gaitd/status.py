"""`gaitd status`: the state of a running service on one screen."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

import typer
from gaitd_client import ClientError, wire

from gaitd.command_line import JsonOption
from gaitd.remote import (
    EXIT_DONE,
    EXIT_NO_ANSWER,
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    as_json_text,
    client_of,
    find_target,
    report_silence,
)

EVENT_COUNT: Final = 6


def command(
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the state of a running service: mode, verdict, drives, legs, newest events."""
    try:
        with client_of(find_target(config, endpoint, trainer, credentials), "status") as service:
            message = service.status()
    except ClientError as error:
        raise typer.Exit(report_silence("status", str(error), as_json=as_json)) from error
    print(as_json_text(message) if as_json else "\n".join(lines(message)))
    raise typer.Exit(EXIT_DONE if message.safety.valid else EXIT_NO_ANSWER)


def lines(message: wire.Status) -> Iterator[str]:
    """Format the screen, line by line."""
    yield from _safety_lines(message)
    yield from map(_drive_line, message.drives)
    for leg in message.legs:
        yield (
            f"{leg.leg:<12} patient {_number(leg.hip_patient_nm, 'N·m', 1)} ({leg.hip_validity}),"
            f" {_number(leg.slide_patient_n, 'N', 0)} ({leg.slide_validity});"
            f" {', '.join(leg.status)}"
        )
    for event in message.events[-EVENT_COUNT:]:
        at = datetime.fromtimestamp(event.time_ns * 1e-9, UTC).astimezone()
        yield f"{at:%H:%M:%S}     {event.priority:<6} {event.text}"


def _drive_line(drive: wire.DriveState) -> str:
    unit, effort_unit = ("rad", "N·m") if drive.name.endswith("hip") else ("m", "N")
    words = [
        drive.power_state.replace("_", " "),
        _number(drive.position_si, unit, 3),
        _number(drive.effort_si, effort_unit, 1),
        _number(drive.temperature_degc, "°C", 0),
    ]
    troubles = {
        "not referenced": not drive.referenced,
        "hand switch open": drive.hand_switch_closed is False,
        "STO active": drive.sto_released is False,
        f"EMCY {drive.emergency_code} {drive.emergency_text}": drive.emergency_code is not None,
    }
    words += [text for text, there in troubles.items() if there]
    return f"{drive.name:<12} {', '.join(words)}"


def _safety_lines(message: wire.Status) -> Iterator[str]:
    safety = message.safety
    if not safety.valid or safety.verdict is None:
        why = safety.progress or "no records arrive from the core"
        yield f"mode         unknown: {why}"
        return
    yield f"mode         {safety.mode}: {safety.progress}"
    if safety.lease_holder is not None:
        yield f"lease        held by {safety.lease_holder}"
    verdict = safety.verdict
    if verdict.category != "none":
        where = f" ({verdict.drive})" if verdict.drive else ""
        detail = f": {verdict.detail}" if verdict.detail else ""
        yield f"stop {verdict.category}      {verdict.text}{where}{detail}"
        yield f"remedy       {verdict.remedy}"


def _number(value: float | None, unit: str, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"
