"""`gaitd drive NAME dump|compare|store|restore`: one drive's objects and stored parameters.

dump and compare only read, one object at a time and paced, and may run beside a service. store and
restore are refused while another master or SDO client uses the bus, or while the drive has power.
Exit codes: 0 done, or equal; 1 different, or refused; 2 usage or configuration; 3 the drive does
not answer, or is another one.
"""

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gaitd.station import EXIT_DRIVE, Options, opened, place_of, shown

if TYPE_CHECKING:
    from daemon.config.bundle import Settings
    from drives.bringup.plan import DrivePlan
    from drives.canopen.bus import Bus, Clock
    from drives.canopen.sniffer import BusSniffer

COMMAND_LINE: Final = "command line"
LISTEN_NS: Final = 500_000_000
"""Time to listen for another master or SDO client before anything is read or written."""


class Action(StrEnum):
    """Subcommand of `gaitd drive`."""

    DUMP = "dump"
    COMPARE = "compare"
    STORE = "store"
    RESTORE = "restore"


READING: Final = (Action.DUMP, Action.COMPARE)
KEEPING: Final = (Action.STORE, Action.RESTORE)
BELONGS: Final = {
    "--output": ("output", (Action.DUMP,)),
    "--with": ("against", (Action.COMPARE,)),
    "--eds": ("eds", (Action.COMPARE,)),
    "--all": ("everything", (Action.COMPARE,)),
    "--json": ("json", READING),
    "--yes": ("yes", KEEPING),
    "--reset": ("reset", (Action.RESTORE,)),
}
"""Field of `Options` and permitted actions for each option."""


def command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="right/hip, or a node id")],
    action: Annotated[Action, typer.Argument(help="what to do with it", show_choices=True)],
    config: Annotated[Path, typer.Option("--config", help="trainer file", dir_okay=False)],
    output: Annotated[
        Path | None, typer.Option("--output", help="dump: to a DCF, which compare can read")
    ] = None,
    against: Annotated[
        Path | None, typer.Option("--with", help="compare: with an earlier dump")
    ] = None,
    eds: Annotated[bool, typer.Option("--eds", help="compare: with the EDS's defaults")] = False,
    everything: Annotated[bool, typer.Option("--all", help="compare: what is equal too")] = False,
    json: Annotated[bool, typer.Option("--json", help="dump, compare: one JSON object")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="store, restore: do not ask")] = False,
    reset: Annotated[
        bool, typer.Option("--reset", help="restore: NMT reset node, so that it acts now")
    ] = False,
) -> None:
    """Dump or compare one drive's objects, or let the drive store or restore its parameters.

    compare without --eds and --with compares with the values that bring-up would write or check.
    """
    from daemon.preflight.load import read_all
    from drives.errors import BringUpRefused, BusError, DriveSilent

    options = Options(output, against, eds, everything, json, yes, reset)
    refuse_foreign(options, action)
    settings = read_all(config)
    plan = plan_of(name, settings)
    try:
        with opened(place_of(settings)) as (bus, clock):
            code = _act(action, plan, options, bus, clock, settings)
    except (BringUpRefused, BusError, DriveSilent) as error:
        print(error, file=sys.stderr)
        raise typer.Exit(EXIT_DRIVE) from error
    raise typer.Exit(code)


def refuse_foreign(options: Options, action: Action) -> None:
    """Refuse an option that does not belong to the action.

    Raises:
        ConfigError: one was given to another action, or --eds together with --with.
    """
    from daemon.config.strict import ConfigError

    for option, (field, actions) in BELONGS.items():
        value = getattr(options, field)
        if value and action not in actions:
            raise ConfigError(COMMAND_LINE, option, value, f"only for {' and '.join(actions)}")
    if options.eds and options.against is not None:
        raise ConfigError(COMMAND_LINE, "--eds", True, "not together with --with")


def plan_of(name: str, settings: "Settings") -> "DrivePlan":
    """Return the plan of the drive with this name or node id.

    Raises:
        ConfigError: no drive has that name or node id; the text lists the known ones.
    """
    from daemon.config.drive_plan import cycle_settings, drive_limits
    from daemon.config.strict import ConfigError
    from drives.bringup.plan import plan

    hip, slide = drive_limits(settings.limits)
    cycle = cycle_settings(settings.trainer.cycle)
    for leg in settings.legs:
        for drive, limits in ((leg.hip, hip), (leg.slide, slide)):
            if name in (drive.name, str(drive.node_id)):
                return plan(drive, limits, cycle)
    known = ", ".join(f"{drive.name} (node {drive.node_id})" for drive in settings.drives)
    raise ConfigError(COMMAND_LINE, "NAME", name, f"a drive of {settings.file.path}: {known}")


def _act(
    action: Action,
    plan: "DrivePlan",
    options: Options,
    bus: "Bus",
    clock: "Clock",
    settings: "Settings",
) -> int:
    from drives.canopen.sniffer import BusSniffer, WitnessedBus
    from drives.errors import BootFailure, DriveSilent, SdoTimeout
    from drives.service.scan import listen
    from gaitd.drive_keeping import keep
    from gaitd.drive_reading import compare, dump, refuse_company

    witness = BusSniffer()
    heard = WitnessedBus(bus, clock, witness)
    shown(listen(heard, clock, LISTEN_NS))
    if action in KEEPING:
        master_node_id = settings.trainer.cycle.master_node_id
        return keep(action.name, plan, options, heard, clock, witness, master_node_id)
    refuse_company(plan, witness)
    act = dump if action is Action.DUMP else compare
    try:
        return act(plan, options, heard, clock)
    except SdoTimeout as error:
        name = plan.description.name
        raise DriveSilent(name, BootFailure.NO_ANSWER, _silence(plan, witness)) from error


def _silence(plan: "DrivePlan", witness: "BusSniffer") -> str:
    from drives.signals import NmtState

    node_id = plan.description.node_id
    if witness.node(node_id).watch.state is NmtState.STOPPED:
        return f"node {node_id} is stopped: no SDO in this state; it answers after power-on"
    return f"no answer from node {node_id}; `gaitd scan` says who is there"
