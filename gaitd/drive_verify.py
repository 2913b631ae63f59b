"""`gaitd drive verify NAME`: one drive on a bench, played against its profile.

The motor turns nothing. No service may run: this program is the master, and leaves its heartbeat
and its commands out to see what the drive does. Exit codes: 0 every fact passed or was not
measured; 1 one failed, or nothing was done; 2 usage or configuration; 3 bus or drive.
"""

import select
import sys
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
import typer
from gaitd_client.signals import interrupted_once
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from daemon.config.trainer import SIMULATED
from daemon.system.bus_choice import bus_of, opened
from drives.bringup.configurator import Configurator
from drives.bringup.plan import single_axis_plan
from drives.canopen.nmt import SyncProducer
from drives.canopen.sniffer import SniffedBus
from drives.errors import BusError, DrivePowered
from drives.service import parameters
from drives.service.scan import listen
from drives.verification import evidence
from drives.verification.bench import BenchLimits, Recorder
from drives.verification.evidence import Result
from drives.verification.stages import Options, Verification, verify
from gaitd.command_line import (
    CommandError,
    ConfigFile,
    JsonOption,
    full_name,
    json_on_stdout,
    with_config,
)
from gaitd.completion import axes
from gaitd.terminal import run_with_progress, show
from gaitd.verification_page import counts, html, row

if TYPE_CHECKING:
    from daemon.config.bundle import Settings
    from drives.bringup.plan import DrivePlan

LISTEN_NS: Final = 500_000_000
WARNING: Final = (
    "The motor will turn, stop suddenly and be left alone. Nothing may hang on it, and no one may "
    "touch it. Keep the emergency stop at hand."
)
POWERED: Final = (
    "the drive has NOT shown that its power is off: press the emergency stop, then find out why"
)
TURN: Final = (
    "Turn the motor by one turn, in the sense in which the axis is positive; then press Enter."
)
KEY: Final = Path("gaitd-verify.pem")


def command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="right/hip, hip if unique, or a node id", autocompletion=axes
        ),
    ],
    config: ConfigFile,
    output: Annotated[
        Path, typer.Option("--output", metavar="ZIP", help="evidence: a new file", dir_okay=False)
    ],
    key: Annotated[
        Path,
        typer.Option("--key", metavar="PEM", help="signs; made if it is not there", dir_okay=False),
    ] = KEY,
    inertia: Annotated[
        float | None,
        typer.Option(
            "--inertia",
            min=1e-6,
            help="of rotor and gear at the joint, kg m2 or kg: torque is then measured by it",
        ),
    ] = None,
    by_hand: Annotated[
        bool, typer.Option("--turn-by-hand", help="you turn the motor by one turn when asked")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="without confirmation")] = False,
    json: JsonOption = False,
) -> None:
    """Play what a drive must do on a bench, judge it, and write one signed file of evidence."""
    from daemon.preflight.load import read_all  # compiles the observer's kernels

    settings = read_all(config)
    name = full_name(name, [drive.name for drive in settings.drives], "NAME")
    _refuse_leg(settings)
    plan, limits = _plan(name, settings)
    files = _files(plan, settings)
    try:
        private = evidence.load_key(key)
    except (OSError, ValueError) as error:
        allowed = f"a file with an Ed25519 key, or none ({error})"
        raise ConfigError(COMMAND_LINE, "--key", key, allowed) from error
    with json_on_stdout(json) as write:
        _confirm(yes=yes)
        try:
            output.touch(exist_ok=False)
        except OSError as error:
            allowed = f"a file that is not there yet, and can be written ({error.strerror})"
            raise ConfigError(COMMAND_LINE, "--output", output, allowed) from error
        utc = f"{datetime.now(UTC):%Y-%m-%dT%H:%MZ}"
        hand = _Hand() if by_hand else None
        with ExitStack() as unfinished:
            unfinished.callback(output.unlink)
            try:
                found, recorder = _played(plan, limits, settings, Options(inertia, hand))
            except (BusError, DrivePowered, parameters.ParameterRefusedError) as error:
                scan = with_config("gaitd scan")
                raise CommandError(
                    str(error), ExitCode.DRIVE, blame=name, following=scan
                ) from error
            unfinished.pop_all()
        title = f"{name}: {plan.description.profile.family}"
        show(((title, ("fact", "found", "allowed", ""), tuple(map(row, found.facts))),))
        if found.refusal:
            print(found.refusal, file=sys.stderr)
        result = _result(plan, settings, found, utc)
        page = {"page.html": html(result).encode()}
        try:
            evidence.write(output, result, recorder.frames, files | page, private)
        except OSError as error:
            allowed = f"a file that can be written ({error.strerror})"
            raise ConfigError(COMMAND_LINE, "--output", output, allowed) from error
        print(f"{counts(found.facts)}; evidence: {output}")
        if not found.is_off:
            raise CommandError(POWERED, ExitCode.DRIVE, blame=name, following="")
        facts = msgspec.to_builtins(found.facts)
        write({"passed": found.passed, "facts": facts, "refusal": found.refusal, "file": output})
    raise typer.Exit(ExitCode.DONE if found.passed else ExitCode.FAILED)


def _played(
    plan: "DrivePlan", limits: BenchLimits, settings: "Settings", options: Options
) -> tuple[Verification, Recorder]:
    from daemon.config.drive_plan import cycle_settings
    from daemon.core.runtime import realtime
    from daemon.core.runtime.texts import event_text

    asked = settings.trainer.cycle
    cycle = cycle_settings(asked)
    with interrupted_once(), opened(bus_of(settings.file), is_master=True) as (bus, clock):
        if not clock.is_simulated:  # a cycle that is late ends the verification
            for refused in realtime.prepare(asked.realtime_priority, asked.realtime_cpus):
                print(event_text(refused), file=sys.stderr)
        recorder = Recorder(clock)
        observed = SniffedBus(bus, clock, recorder)
        run_with_progress(listen(observed, clock, LISTEN_NS))
        parameters.check_bus(recorder, asked.master_node_id)
        port = Configurator(observed, clock, sync=SyncProducer(cycle.sync_counter))
        steps = verify(plan, limits, cycle, options, bus=observed, clock=clock, port=port)
        with closing(steps):  # takes the power off before the bus is closed
            return run_with_progress(steps), recorder


def _plan(name: str, settings: "Settings") -> "tuple[DrivePlan, BenchLimits]":
    from daemon.config.drive_plan import cycle_settings, drive_limits, plan_of

    description = plan_of(name, settings).description
    hip, slide = drive_limits(settings.limits)
    limits = hip if description.name.endswith("/hip") else slide
    cycle = cycle_settings(settings.trainer.cycle)
    bench = BenchLimits(
        limits.velocity_max_si,
        limits.effort_max_si,
        limits.following_error_si,
        limits.quick_stop_deceleration_si_per_s2,
    )
    return single_axis_plan(description, limits, cycle, limits.effort_max_si), bench


def _refuse_leg(settings: "Settings") -> None:
    """Refuse the file of a machine with a leg: no person may be on what is played here."""
    robot, file = settings.robot, settings.file.robot
    for name, segment in (("thigh", robot.thigh), ("shank", robot.shank), ("shoe", robot.shoe)):
        if segment.mass_kg:
            allowed = "0: a bench turns nothing, as configs/robot_bench.toml"
            raise ConfigError(file, f"{name}.mass_kg", segment.mass_kg, allowed)
    if robot.patient is not None:
        raise ConfigError(file, "patient", "a table", "no patient: this is for a bench")


def _confirm(*, yes: bool) -> None:
    print(WARNING)
    if yes:
        return
    if not sys.stdin.isatty():
        allowed = "to be given where there is no terminal for the confirmation"
        raise ConfigError(COMMAND_LINE, "--yes", MISSING, allowed)
    if not typer.confirm("Begin?", default=False):
        print("nothing was done")
        raise typer.Exit(ExitCode.FAILED)


class _Hand:
    """Asks for a turn by hand, and waits for Enter while cycles go on."""

    def __init__(self) -> None:
        self._is_asked = False

    def __call__(self) -> bool:
        """True once Enter was pressed."""
        if not self._is_asked:
            self._is_asked = True
            print(TURN, flush=True)
        if not select.select([sys.stdin], [], [], 0)[0]:
            return False
        sys.stdin.readline()
        return True


def _result(plan: "DrivePlan", settings: "Settings", found: Verification, utc: str) -> Result:
    description = plan.description
    identity = description.axis.identity
    return Result(
        drive=description.name,
        node_id=description.node_id,
        profile=f"{description.profile.vendor} {description.profile.family}",
        identity=(
            identity.vendor_id or 0,
            identity.product_code or 0,
            identity.revision or 0,
            found.serial_number,
        ),
        gaitd_version=version("gaitd"),
        utc=utc,
        is_simulated=settings.trainer.bus.interface == SIMULATED,
        facts=found.facts,
        steps=found.steps,
        refusal=found.refusal,
        rows=found.rows,
    )


def _files(plan: "DrivePlan", settings: "Settings") -> dict[str, bytes]:
    """The files that describe the drive, read before it moves."""
    description = plan.description
    leg_name, _, joint = description.name.partition("/")
    leg = next(leg for leg in settings.trainer.leg if leg.name == leg_name)
    axis = settings.file.path.parent / (leg.hip if joint == "hip" else leg.slide)
    return {
        "axis.toml": axis.read_bytes(),
        "profile.toml": (axis.parent / description.axis.profile).read_bytes(),
        "drive.eds": Path(description.eds).read_bytes(),
    }
