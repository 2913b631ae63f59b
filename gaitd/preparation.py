"""`gaitd commission`, `reference` and `self-test`: what a machine needs before it is used.

Each requests a mode of a running service, prints the progress, and ends with the mode.
Exit codes as in `remote.py`; 1 also if the axis was not homed or does not move as it should, if the
self-test failed, if the operator did not do a step of it in time, or if an acceptance has found
something wrong or was not completed.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from gaitd_client import ClientError, Outcome, Target, Trainer, wire
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from analysis.acceptance.record import Judgement
from daemon.ipc.report import EventCode
from daemon.wire.names import name_of
from gaitd.command_line import JsonOption, errors_in_one_line, json_text
from gaitd.operator_texts import (
    HOMING_MAX_S,
    MOTIONS,
    PRESS,
    STEP_MAX_S,
    prompt,
)
from gaitd.remote import (
    EXIT_DONE,
    EXIT_NO_ANSWER,
    EXIT_REFUSED,
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    client_of,
    find_target,
    report_reply,
    report_silence,
    request,
)

GAIT_CADENCE_HZ: Final = 0.25
AxisName = Annotated[str, typer.Argument(metavar="AXIS", help="LEG/AXIS, for example right/hip")]
Print = Callable[[str], None]

SETTLED_POLLS: Final = 2
"""Polls in a calm mode before the end counts: between bring-ups the service passes `ready`."""
SETTLED_MODES: Final = frozenset({"ready", "fault"})
HOMING_POLL_S: Final = 0.25
POLL_S: Final = 0.5
AGAIN: Final = "then `gaitd self-test` again: the inputs that were seen to act need not act again"


class NoRecordsError(ClientError):
    """The service answers, but it has no records of the core."""


class AxisResult(NamedTuple):
    """How the mode of one axis has ended."""

    good: bool
    text: str
    """Event text of the service about the axis; if the axis stopped before its end, the reason."""

    @property
    def exit_code(self) -> int:
        """0 for success, else 1."""
        return EXIT_DONE if self.good else EXIT_REFUSED


# --- one axis of the empty machine ----------------------------------------------------------------


def reference(
    axis: AxisName,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Home one axis by its drive: slowly and with limited torque, in the empty machine.

    The service needs the configuration of the empty machine, and the hand switch held.
    """
    target = find_target(config, endpoint, trainer, credentials)
    result = run_axis(target, "reference", axis, EventCode.HOMED, as_json=as_json)
    print(json.dumps({"axis": axis, "homed": result.good}) if as_json else result.text)
    raise typer.Exit(result.exit_code)


def commission(
    axis: Annotated[
        str | None,
        typer.Argument(metavar="[AXIS]", help="LEG/AXIS, for example right/hip; not with --report"),
    ] = None,
    witnessed: Annotated[
        bool,
        typer.Option(
            "--witnessed",
            help="I watch, and will see it as described: do not ask. Needed with --json.",
        ),
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            help="Folder for an acceptance record of each drive, JSON and page: sign, units,"
            " self-test, stops in gait, settings. Needs --config, on the service's computer.",
            file_okay=False,
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="With --report: do not ask before each motion.")
    ] = False,
    cadence: Annotated[
        float, typer.Option(help="With --report: strides per second of the gait that is stopped.")
    ] = GAIT_CADENCE_HZ,
    amplitude: Annotated[
        float, typer.Option(help="With --report: its amplitude, 0 to 1 of the full gait.")
    ] = 1.0,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Push one axis forth and back with a small bounded torque, and prove the sign of its motion.

    For the empty machine with its springs turned down. The encoder must move with the torque, and
    the operator must see the joint move as described. Only then can the drives be enabled.

    With --report: all axes, and everything else that a first machine should show.
    """
    target = find_target(config, endpoint, trainer, credentials)
    if report is not None:
        _refuse("AXIS", axis, "not together with --report", refused=axis is not None)
        if config is None:
            raise ConfigError(COMMAND_LINE, "--config", MISSING, "needed with --report")
        gait = (cadence, amplitude)
        raise typer.Exit(
            _report(target, config, gait, report, yes=yes, witnessed=witnessed, as_json=as_json)
        )
    _refuse("--yes", yes, "only with --report", refused=yes)
    if axis is None:
        raise ConfigError(COMMAND_LINE, "AXIS", MISSING, "LEG/AXIS, or --report FOLDER for all")
    described = MOTIONS.get(axis.rpartition("/")[2], "it first goes forth, then back")
    if not as_json:
        print(f"Watch the machine: if all is right, {described}.")
    result = run_axis(target, "commission", axis, EventCode.SIGN_TESTED, as_json=as_json)
    seen = result.good and witnessed
    if not as_json:
        print(result.text)
        if result.good and not witnessed:
            seen = typer.confirm(f"Did you see that {described}?")
    known = {"axis": axis, "moves_with_its_torque": result.good, "witnessed": seen}
    if not seen:
        if as_json:
            print(json.dumps(known))
        raise typer.Exit(EXIT_REFUSED)
    noted = {"mode": "commission", "axis": axis, "witnessed": True}
    raise typer.Exit(request(target, "mode", as_json=as_json, known=known, **noted))


def _refuse(option: str, value: object, allowed: str, *, refused: bool) -> None:
    if refused:
        raise ConfigError(COMMAND_LINE, option, value, allowed)


def _report(
    target: Target,
    config: Path,
    gait: tuple[float, float],
    folder: Path,
    *,
    yes: bool,
    witnessed: bool,
    as_json: bool,
) -> int:
    """Write the acceptance records; returns the exit code."""
    from daemon.core.exercises.gait import CADENCE_MIN_HZ
    from daemon.preflight.load import load
    from gaitd.acceptance import Gait
    from gaitd.acceptance_service import TerminalOperator, run_acceptance

    if not (yes or sys.stdin.isatty()):
        allowed = "to be given where there is no terminal for the confirmations"
        raise ConfigError(COMMAND_LINE, "--yes", MISSING, allowed)
    operator = TerminalOperator(agreed=yes, witnessed=witnessed)
    settings = load(config)
    if settings.robot.patient is not None:
        allowed = "a robot file without [patient]: axes are accepted in the empty machine"
        raise ConfigError(config, "robot", settings.trainer.robot, allowed)
    cadence_hz, amplitude_ratio = gait
    most_hz = settings.trainer.gait.cadence_max_hz
    wrong = not CADENCE_MIN_HZ <= cadence_hz <= most_hz
    _refuse("--cadence", cadence_hz, f"{CADENCE_MIN_HZ:g} to {most_hz:g}", refused=wrong)
    wrong = not 0 < amplitude_ratio <= 1
    _refuse("--amplitude", amplitude_ratio, "more than 0, at most 1", refused=wrong)
    try:
        with errors_in_one_line():
            written = run_acceptance(target, settings, operator, Gait(*gait), folder)
    except ClientError as error:
        return report_silence("commission", str(error), as_json=as_json)
    results = [
        {
            "drive": one.record.drive,
            "verdict": one.record.judgement.value,
            "blocked": one.blocked,
            **{word.value: one.record.count(word) for word in Judgement},
            "files": [str(path) for path in one.files],
        }
        for one in written
    ]
    for one in [] if as_json else written:
        record = one.record
        counts = ", ".join(f"{record.count(word)} {word.value}" for word in Judgement)
        print(f"{record.drive}: {counts}: {one.files[1]}")
        for section in record.sections:
            for line in section.lines:
                if line.judgement is Judgement.FAILED:
                    print(f"  FAILED {line.asked}: {line.measured}; allowed: {line.allowed}")
    blocked = written[0].blocked
    if as_json:
        print(json_text(results))
    elif blocked:
        print(f"not complete: {blocked}")
    failed = any(one.record.judgement is Judgement.FAILED for one in written)
    return EXIT_REFUSED if failed or blocked else EXIT_DONE


def run_axis(target: Target, mode: str, axis: str, good: EventCode, *, as_json: bool) -> AxisResult:
    """Request the mode and wait for its end.

    Args:
        target: the service.
        mode: `reference` or `commission`.
        axis: LEG/AXIS.
        good: event of the service about the axis in case of success.
        as_json: print nothing but an error, as a JSON document.

    Raises:
        Exit: the service refused, does not answer, or the mode did not end in time.
    """

    def show(text: str) -> None:
        if not as_json:
            print(text, file=sys.stderr)

    before, settled, progress = None, 0, ""
    try:
        with client_of(target, mode) as trainer:
            before = _ids(trainer.status())
            reply = trainer.request("mode", mode=mode, axis=axis)
            if reply.outcome != Outcome.DONE or not as_json:  # the result is the only document
                code = report_reply(reply, as_json=as_json)
                if code != EXIT_DONE:
                    raise typer.Exit(code)
            for _ in range(round(HOMING_MAX_S / HOMING_POLL_S)):
                time.sleep(HOMING_POLL_S)
                status = _valid_status(trainer)
                progress = _show_progress(status, progress, show)
                settled = settled + 1 if status.safety.mode in SETTLED_MODES else 0
                if settled > SETTLED_POLLS:
                    return _axis_result(status, axis, good, before)
        report_silence(mode, f"{axis}: it did not end within {HOMING_MAX_S:g} s", as_json=as_json)
    except ClientError as error:
        moving = "" if before is None else f"; {axis} may be moving: look at it before you go on"
        report_silence(mode, f"{error}{moving}", as_json=as_json)
    raise typer.Exit(EXIT_NO_ANSWER)


def _axis_result(status: wire.Status, axis: str, good: EventCode, before: set[str]) -> AxisResult:
    ends = {name_of(good), name_of(EventCode.SINGLE_AXIS_FAILED)}
    for event in reversed(_new_events(status, before)):
        if event.subject == axis and event.code in ends:
            return AxisResult(event.code == name_of(good), event.text)
    verdict = status.safety.verdict
    why = f"{verdict.text}: {verdict.remedy}" if verdict and verdict.category != "none" else ""
    return AxisResult(False, f"{axis}: stopped before its end. {why}".strip())


# --- self-test ------------------------------------------------------------------------------------


def self_test(
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the daily test: hand switch, emergency stop, then each axis moves a little by itself."""
    target = find_target(config, endpoint, trainer, credentials)

    def show(text: str) -> None:
        print(text, file=sys.stderr if as_json else sys.stdout, flush=True)

    try:
        with client_of(target, "self-test") as service:
            passed, lines = run_self_test(service, show)
    except ClientError as error:
        report_silence("self-test", str(error), as_json=as_json)
        raise typer.Exit(EXIT_NO_ANSWER) from error
    if as_json:
        print(json.dumps({"passed": passed, "findings": lines}, ensure_ascii=False))
    else:
        print("The self-test is passed." if passed else "The self-test is NOT passed.")
    raise typer.Exit(EXIT_DONE if passed else EXIT_REFUSED)


def run_self_test(trainer: Trainer, show: Print) -> tuple[bool, list[str]]:
    """Run all steps; return whether the test passed, and the service's event texts about it.

    The steps follow from the service's refusals: until the service has seen hand switch and
    emergency stop act, it refuses to enable and names the inputs that it has not seen. Enable is
    requested, but never reset: a latched stop is shown with its remedy, and the test ends.

    Raises:
        ClientError: the service does not answer.
    """
    reason = "" if _valid_status(trainer).safety.mode == "hold" else _enable(trainer, show)
    if reason:
        show(reason)
        return False, [reason]
    show("Now each axis moves a little, forth and back. Lie relaxed, and hold the hand switch.")
    before = _ids(_valid_status(trainer))
    reply = trainer.request("mode", mode="self_test")
    if reply.outcome != Outcome.DONE:
        show(f"refused: {reply.reason}")
        return False, [reply.reason]
    progress = ""
    for _ in range(round(STEP_MAX_S / POLL_S)):
        time.sleep(POLL_S)
        status = _valid_status(trainer)
        progress = _show_progress(status, progress, show)
        if status.safety.mode != "self_test":
            return _test_result(status, before, show)
    return False, []


def _enable(trainer: Trainer, show: Print) -> str:
    """Request enable until nothing is missing; prompt the operator for the missing steps.

    Returns: the reason why it is not enabled; empty if it is.
    """
    last_text = ""
    for _ in range(round(STEP_MAX_S / POLL_S)):
        safety = _valid_status(trainer).safety
        if safety.mode != "ready":
            # Another client's request, or a stop: an enable request now would be outside this test.
            stopped = stop_text(safety) or f"not possible in mode {safety.mode}"
            # Some drives report an emergency stop as a fault also without power.
            return f"{stopped}; {AGAIN}" if last_text == PRESS else stopped
        reply = trainer.request("enable")
        if reply.outcome == Outcome.DONE:
            return ""
        text = prompt(reply.reason, reply.refusal)
        if text != last_text:
            last_text = text
            show(text)
        time.sleep(POLL_S)
    return f"not done within {STEP_MAX_S:g} s"


def stop_text(safety: wire.Safety) -> str:
    """Text and remedy of the stop that is in force; empty if there is none."""
    verdict = safety.verdict
    if verdict is None or verdict.category == "none":
        return ""
    where = f"{verdict.drive}: " if verdict.drive else ""
    detail = f" ({verdict.detail})" if verdict.detail else ""
    return f"{where}{verdict.text}{detail}: {verdict.remedy}"


def _test_result(status: wire.Status, before: set[str], show: Print) -> tuple[bool, list[str]]:
    passed, failed = name_of(EventCode.SELF_TEST_PASSED), name_of(EventCode.SELF_TEST_FAILED)
    results = [one for one in _new_events(status, before) if one.code in {passed, failed}]
    lines = [one.text for one in results]
    for line in filter(None, (*lines, stop_text(status.safety))):
        show(line)
    return bool(results) and all(one.code == passed for one in results), lines


# --- both -----------------------------------------------------------------------------------------


def _show_progress(status: wire.Status, before: str, show: Print) -> str:
    """Show the progress if it has changed; return what is shown now."""
    progress = status.safety.progress or ""
    if progress != before:
        show(f"  {progress}")
    return progress


def _ids(status: wire.Status) -> set[str]:
    return {event.id for event in status.events}


def _new_events(status: wire.Status, before: set[str]) -> list[wire.Event]:
    return [event for event in status.events if event.id not in before]


def _valid_status(trainer: Trainer) -> wire.Status:
    status = trainer.status()
    if not status.safety.valid:
        raise NoRecordsError("no records arrive from the core; look at the machine")
    return status
