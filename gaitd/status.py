"""`gaitd status`: the state of a running service on one screen."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

import typer
from gaitd_client import Cause, ClientError, wire
from gaitd_names import ExitCode
from gaitd_texts import HOLDING, Catalogue, situation_of

from gaitd.command_line import JsonOption
from gaitd.language import texts
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    as_json_text,
    client_of,
    complete,
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
    print(as_json_text(message) if as_json else "\n".join(lines(message, texts())))
    raise typer.Exit(ExitCode.DONE if message.safety.valid else ExitCode.UNAVAILABLE)


def lines(message: wire.Status, texts: Catalogue) -> Iterator[str]:
    """Format the screen, line by line."""
    drives = message.drives
    are_holding = bool(drives) and all(one.fresh and one.power_state in HOLDING for one in drives)
    yield from safety_lines(message.safety, texts, are_holding=are_holding)
    for drive in message.drives:
        yield _line(texts.subject(drive.name), ", ".join(_drive_words(drive, texts)))
    for leg in message.legs:
        patient = texts.text(
            "status.patient",
            hip=_number(leg.hip.patient, "N·m", 1),
            hip_validity=texts.text(f"validity.{leg.hip.validity}"),
            slide=_number(leg.slide.patient, "N", 0),
            slide_validity=texts.text(f"validity.{leg.slide.validity}"),
        )
        yield _line(texts.subject(leg.leg), patient)
    for event in message.events[-EVENT_COUNT:]:
        at = datetime.fromtimestamp(event.time_ns * 1e-9, UTC).astimezone()
        priority = texts.text(f"priority.{event.priority}")
        yield _line(f"{at:%H:%M:%S}", f"{priority:<8} {texts.event(event)}")


def _line(label: str, text: str) -> str:
    return f"{label:<18} {text}"


def _drive_words(drive: wire.DriveState, texts: Catalogue) -> Iterator[str]:
    unit, effort_unit = ("rad", "N·m") if drive.name.endswith("hip") else ("m", "N")
    yield texts.text(f"power_state.{drive.power_state}")
    yield _number(drive.position, unit, 3)
    yield _number(drive.effort, effort_unit, 1)
    yield _number(drive.temperature_degc, "°C", 0)
    troubles = {
        "not_referenced": not drive.referenced,
        "hand_switch_open": drive.hand_switch_closed is False,
        "sto_active": drive.sto_released is False,
    }
    yield from (texts.text(f"status.{name}") for name, is_so in troubles.items() if is_so)
    if drive.emergency_code is not None:
        yield texts.text("status.emcy", emcy_code=drive.emergency_code, said=drive.emergency_text)


def safety_lines(
    safety: wire.Safety, texts: Catalogue, *, are_holding: bool = False
) -> Iterator[str]:
    """Format mode, lease and stop, line by line; `are_holding`: every drive can hold the leg."""
    progress = texts.progress(safety.progress)
    label = texts.text("status.mode")
    if not safety.valid or safety.verdict is None:
        yield _line(label, progress or texts.text("status.no_records"))
        return
    stage = texts.text(f"stage.{safety.stage}") if safety.stage else ""
    words = (texts.text(f"mode.{safety.mode}"), stage, progress)
    yield _line(label, ", ".join(word for word in words if word))
    if safety.lease_holder is not None:
        held = texts.text("status.lease_held", client=safety.lease_holder)
        yield _line(texts.text("status.lease"), held)
    verdict = safety.verdict
    if verdict.cause != Cause.NONE:
        category = texts.text("status.stop", category=verdict.category)
        yield _line(category, texts.verdict(verdict))
        situation = situation_of(verdict.cause, are_holding=are_holding)
        remedy = complete(texts.remedy(verdict.cause, situation=situation))
        yield _line(texts.text("status.remedy"), remedy)


def _number(value: float | None, unit: str, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f} {unit}"
