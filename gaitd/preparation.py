"""`gaitd commission`, `reference` and `self-test`: what a machine needs before it is used.

Each plays a procedure of `gaitd/commissioning` with a running service and the operator.
Exit codes as in `remote.py`; 1 also if the axis was not homed or does not move as it should, if the
self-test failed, if the operator did not do a step of it in time, or if an acceptance has found
something wrong or was not completed.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec
import typer
from gaitd_client import ClientError, Mode, Target
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from analysis.acceptance.record import (
    AcceptanceRecord,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    read,
)
from analysis.acceptance.words import finding_texts, reason_text
from gaitd.command_line import (
    CommandError,
    JsonOption,
    errors_in_one_line,
    failure,
    full_name,
    json_text,
)
from gaitd.commissioning.plans import Gait, one_axis
from gaitd.commissioning.plans import self_test as self_test_plan
from gaitd.commissioning.procedure import may_move
from gaitd.commissioning.remote_service import RemoteService
from gaitd.commissioning.run import Operator, Run
from gaitd.completion import axes
from gaitd.language import texts
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    client_of,
    complete,
    find_target,
    report_reply,
    report_silence,
)

GAIT_CADENCE_HZ: Final = 0.25
AxisName = Annotated[
    str,
    typer.Argument(
        metavar="AXIS",
        help="LEG/AXIS, for example right/hip, or hip if unique",
        autocompletion=axes,
    ),
]


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
    run = _played(target, "reference", Mode.REFERENCE, axis, as_json=as_json)
    known = {"axis": run.tasks[0].axis, "homed": run.has_passed(FindingCode.OWN_JUDGEMENT)}
    raise typer.Exit(_result("reference", run, known, as_json=as_json))


def commission(
    axis: Annotated[
        str | None,
        typer.Argument(
            metavar="[AXIS]",
            help="LEG/AXIS, for example right/hip, or hip if unique; not with --report",
            autocompletion=axes,
        ),
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
        operator = Operator(agreed=yes, witnessed=witnessed)
        if not (yes or sys.stdin.isatty()):
            allowed = "to be given where there is no terminal for the confirmations"
            raise ConfigError(COMMAND_LINE, "--yes", MISSING, allowed)
        gait = Gait(cadence, amplitude)
        raise typer.Exit(_report(target, config, gait, report, operator, as_json=as_json))
    _refuse("--yes", yes, "only with --report", refused=yes)
    if axis is None:
        raise ConfigError(COMMAND_LINE, "AXIS", MISSING, "LEG/AXIS, or --report FOLDER for all")
    mode = Mode.COMMISSION
    run = _played(target, "commission", mode, axis, witnessed=witnessed, as_json=as_json)
    known = {
        "axis": run.tasks[0].axis,
        "moves_with_its_torque": run.has_passed(FindingCode.OWN_JUDGEMENT),
        "witnessed": run.has_passed(FindingCode.DIRECTION),
    }
    raise typer.Exit(_result("commission", run, known, as_json=as_json))


def _refuse(option: str, value: object, allowed: str, *, refused: bool) -> None:
    if refused:
        raise ConfigError(COMMAND_LINE, option, value, allowed)


def _report(
    target: Target,
    config: Path,
    gait: Gait,
    folder: Path,
    operator: Operator,
    *,
    as_json: bool,
) -> int:
    """Write the acceptance records; returns the exit code."""
    from daemon.core.exercises.gait import CADENCE_MIN_HZ
    from daemon.preflight.load import load
    from gaitd.commissioning.report import accept, record_path

    settings = load(config)
    if settings.robot.patient is not None:
        allowed = "a robot file without [patient]: axes are accepted in the empty machine"
        raise ConfigError(config, "robot", settings.trainer.robot, allowed)
    most_hz = settings.trainer.gait.cadence_max_hz
    wrong = not CADENCE_MIN_HZ <= gait.cadence_hz <= most_hz
    _refuse("--cadence", gait.cadence_hz, f"{CADENCE_MIN_HZ:g} to {most_hz:g}", refused=wrong)
    wrong = not 0 < gait.amplitude_ratio <= 1
    _refuse("--amplitude", gait.amplitude_ratio, "more than 0, at most 1", refused=wrong)
    try:
        with errors_in_one_line():
            blocked = accept(target, settings, operator, gait, folder)
    except ClientError as error:
        return report_silence("commission", str(error), as_json=as_json)
    paths = [record_path(folder, drive.name) for drive in settings.drives]
    records = {path: read(path) for path in paths}
    if as_json:
        results = [
            {
                "drive": record.drive,
                "verdict": record.judgement,
                "blocked": blocked,
                **{word: record.count(word) for word in Judgement},
                "files": [str(path), str(path.with_suffix(".html"))],
            }
            for path, record in records.items()
        ]
        print(json_text(msgspec.to_builtins(results)))
    else:
        for path, record in records.items():
            _print_record(record, path)
        if blocked is not None:
            print(f"{texts().text('record.not_complete')}: {_told(blocked)}")
    failed = any(one.judgement is Judgement.FAILED for one in records.values())
    return ExitCode.FAILED if failed or blocked else ExitCode.DONE


def _print_record(record: AcceptanceRecord, path: Path) -> None:
    said = texts()
    words = {one: said.text(f"judgement.{one}") for one in Judgement}
    counts = ", ".join(f"{record.count(one)} {word}" for one, word in words.items())
    print(f"{said.subject(record.drive)}: {counts}: {path.with_suffix('.html')}")
    for finding in record.findings:
        if finding.judgement is Judgement.FAILED:
            asked, measured, allowed = finding_texts(said, finding)
            line = f"{asked}: {measured}; {said.text('record.allowed')}: {allowed}"
            print(f"  {words[Judgement.FAILED].upper()} {line}")


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
    run = _played(target, "self-test", Mode.SELF_TEST, "", as_json=as_json)
    code = _result("self-test", run, {"passed": run.is_good}, as_json=as_json)
    if not as_json:
        print(texts().text(f"self_test.{'passed' if code == ExitCode.DONE else 'not_passed'}"))
    raise typer.Exit(code)


# --- one run --------------------------------------------------------------------------------------


def _played(
    target: Target,
    command: str,
    mode: Mode,
    axis: str,
    *,
    witnessed: bool = False,
    as_json: bool,
) -> Run:
    """Play the procedure of one axis, or the daily self-test, with a running service.

    Raises:
        Exit: the service does not answer.
    """
    operator = Operator(agreed=as_json, witnessed=witnessed)
    run: Run | None = None
    try:
        with client_of(target, command) as trainer:
            if mode is Mode.SELF_TEST:
                tasks = self_test_plan()
            else:
                known = () if "/" in axis else trainer.configuration().drive_names
                tasks = one_axis(mode, full_name(axis, known, "AXIS"))
            run = Run(tasks, RemoteService(trainer), operator)
            run.play()
    except ClientError as error:
        moves = "" if run is None else may_move(run.tasks, run.state)
        moving = f"; {moves} may be moving: look at it before you go on" if moves else ""
        code = report_silence(command, f"{error}{moving}", as_json=as_json)
        raise typer.Exit(code) from error
    return run


def _result(command: str, run: Run, known: Mapping[str, object], *, as_json: bool) -> int:
    """Print the findings of a run and its end; returns the exit code."""
    why, reply = run.why, run.reply
    if why is not None and why.code is ReasonCode.REFUSED and reply is not None:
        return report_reply(reply, as_json=as_json, known=known)
    is_late = why is not None and why.code is ReasonCode.NOT_IN_TIME and bool(run.tasks[0].axis)
    code = ExitCode.DONE if run.is_good else ExitCode.UNAVAILABLE if is_late else ExitCode.FAILED
    if as_json:
        error = CommandError("not passed" if why is None else why.code, code)
        document = {
            **known,
            "findings": msgspec.to_builtins(run.findings),
            "reason": msgspec.to_builtins(why),
            **({} if code == ExitCode.DONE else failure(error, command)),
        }
        print(json_text(document))
        return code
    for finding in run.findings:
        if finding.reason is None:
            print(finding_texts(texts(), finding)[1])
    if why is not None:
        print(_told(why))
    return code


def _told(reason: Reason) -> str:
    return complete(reason_text(texts(), reason))
