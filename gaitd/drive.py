"""`gaitd drive NAME dump|compare|store|restore`: one drive's objects and stored parameters.

dump and compare only read, one object at a time and paced, and may run beside a service. store and
restore are refused while another master or SDO client uses the bus, or while the drive has power.
Exit codes: 0 done, or equal; 1 different, or refused; 2 usage or configuration; 3 the drive does
not answer, or is another one.
"""

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from daemon.system.bus_choice import bus_of, opened
from drives.bringup.configurator import Configurator
from drives.canopen.sniffer import BusSniffer, SniffedBus
from drives.errors import (
    BootFailure,
    BringUpRefused,
    BusError,
    DescriptionError,
    DriveSilent,
    SdoTimeout,
)
from drives.service import compare, dump, parameters
from drives.service.eds import load_eds
from drives.service.object_texts import ObjectWords
from drives.service.parameters import Command
from drives.service.scan import listen
from gaitd.command_line import CommandError, ConfigFile, JsonOption, full_name, with_config
from gaitd.completion import axes
from gaitd.terminal import run_with_progress, show

if TYPE_CHECKING:
    from drives.bringup.plan import DrivePlan
    from drives.canopen.bus import Clock
    from drives.canopen.data_sheet import DataSheet

LISTEN_NS: Final = 500_000_000
"""Time to listen for another master or SDO client before anything is read or written."""
RECHECK_NS: Final = 300_000_000
"""Time to listen again after the operator has confirmed: a service may have started meanwhile."""

CONSEQUENCE: Final = {
    Command.STORE: "overwrites what it has stored with what it holds now (1010h:01)",
    Command.RESTORE: "gives up what it has stored for its maker's defaults (1011h:01): motor data "
    "and limits, too",
}
DONE: Final = {
    Command.STORE: "stored",
    Command.RESTORE: "will take its maker's defaults at the next power-on or NMT reset node",
}


class Action(StrEnum):
    """Subcommand of `gaitd drive`."""

    DUMP = "dump"
    COMPARE = "compare"
    STORE = "store"
    RESTORE = "restore"


class Options(NamedTuple):
    """Options of the command line besides the action."""

    output: Path | None
    against: Path | None
    eds: bool
    everything: bool
    json: bool
    yes: bool
    reset: bool


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


class Drive(NamedTuple):
    """The drive of the command line, and its bus."""

    plan: "DrivePlan"
    bus: SniffedBus
    clock: "Clock"
    sniffer: BusSniffer
    port: Configurator

    @property
    def title(self) -> str:
        """Name and node id."""
        return f"{self.plan.description.name} (node {self.plan.description.node_id})"

    @property
    def sheet(self) -> "DataSheet":
        """Objects of its EDS.

        Raises:
            ConfigError: the EDS cannot be used.
        """
        try:
            return load_eds(self.plan.description.eds, self.plan.description.node_id)
        except DescriptionError as error:
            raise _unusable(error) from error


def command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="right/hip, hip if unique, or a node id", autocompletion=axes
        ),
    ],
    action: Annotated[Action, typer.Argument(help="what to do with it", show_choices=True)],
    config: ConfigFile,
    output: Annotated[
        Path | None, typer.Option("--output", help="dump: to a DCF, which compare can read")
    ] = None,
    against: Annotated[
        Path | None, typer.Option("--with", help="compare: with an earlier dump")
    ] = None,
    eds: Annotated[bool, typer.Option("--eds", help="compare: with the EDS's defaults")] = False,
    everything: Annotated[bool, typer.Option("--all", help="compare: what is equal too")] = False,
    json: JsonOption = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="store, restore: without confirmation")
    ] = False,
    reset: Annotated[
        bool, typer.Option("--reset", help="restore: NMT reset node, so that it acts now")
    ] = False,
) -> None:
    """Dump or compare one drive's objects, or let the drive store or restore its parameters.

    compare without --eds and --with compares with the values that bring-up would write or check.
    """
    from daemon.config.drive_plan import plan_of
    from daemon.preflight.load import read_all

    options = Options(output, against, eds, everything, json, yes, reset)
    refuse_other_options(options, action)
    settings = read_all(config)
    name = full_name(name, [drive.name for drive in settings.drives], "NAME")
    plan = plan_of(name, settings)
    try:
        with opened(bus_of(settings.file)) as (bus, clock):
            sniffer = BusSniffer()
            observed = SniffedBus(bus, clock, sniffer)
            drive = Drive(plan, observed, clock, sniffer, Configurator(observed, clock))
            run_with_progress(listen(observed, clock, LISTEN_NS))
            if action in KEEPING:
                code = _store_or_restore(
                    drive, Command[action.name], options, settings.trainer.cycle.master_node_id
                )
            else:
                code = _read(drive, action, options)
    except (BringUpRefused, BusError, DriveSilent) as error:
        scan = with_config("gaitd scan")
        raise CommandError(str(error), ExitCode.DRIVE, blame=name, following=scan) from error
    raise typer.Exit(code)


def refuse_other_options(options: Options, action: Action) -> None:
    """Refuse an option that does not belong to the action.

    Raises:
        ConfigError: one was given to another action, or --eds together with --with.
    """
    for option, (field, actions) in BELONGS.items():
        value = getattr(options, field)
        if value and action not in actions:
            raise ConfigError(COMMAND_LINE, option, value, f"only for {' and '.join(actions)}")
    if options.eds and options.against is not None:
        raise ConfigError(COMMAND_LINE, "--eds", True, "not together with --with")


# --- dump and compare -----------------------------------------------------------------------------


def _read(drive: Drive, action: Action, options: Options) -> int:
    node = drive.sniffer.node(drive.plan.description.node_id)
    dump.check_alone(drive.plan, node)
    try:
        return (_dump if action is Action.DUMP else _compare)(drive, options)
    except SdoTimeout as error:
        name = drive.plan.description.name
        reason = dump.silence(drive.plan, node)
        raise DriveSilent(name, BootFailure.NO_ANSWER, reason) from error


def _dump(drive: Drive, options: Options) -> int:
    """Read all readable objects; print them, or write them to a file."""
    sheet, node_id = drive.sheet, drive.plan.description.node_id
    entries = run_with_progress(
        dump.read_objects(node_id, dump.readable(sheet), drive.port, as_filled=True)
    )
    words = ObjectWords(drive.plan)
    if options.output is not None:
        try:
            with options.output.open("w", encoding="utf-8") as file:
                dump.write_dcf(entries, sheet, node_id, file)
        except OSError as error:
            allowed = f"a file that can be written ({error.strerror})"
            raise ConfigError(COMMAND_LINE, "--output", options.output, allowed) from error
    if options.json:
        _print_json(drive, objects=[_entry_fields(entry, words) for entry in entries])
    elif options.output is not None:
        read_count = sum(entry.value is not None for entry in entries)
        print(f"{drive.title}: {read_count} of {len(entries)} objects in {options.output}")
    else:
        columns = ("object", "name", "value", "hex", "meaning")
        rows = tuple(_entry_row(entry, words) for entry in entries)
        show(((f"{drive.title}: {len(rows)} objects", columns, rows),))
    return 0


def _compare(drive: Drive, options: Options) -> int:
    """Read the objects to be compared and print those that differ."""
    sheet, against = drive.sheet, "what bring-up expects"
    if options.eds:
        against, why = str(Path(drive.plan.description.eds)), "EDS default"
        compared = compare.read_with_values(
            drive.plan, sheet, drive.port, dump.defaults(sheet), why
        )
    elif options.against is not None:
        against, why = str(options.against), f"as in {options.against.name}"
        try:
            values = dump.read_dcf(against, drive.plan.description.node_id)
        except DescriptionError as error:
            raise _unusable(error) from error
        compared = compare.read_with_values(drive.plan, sheet, drive.port, values, why)
    else:
        compared = compare.read_with_plan(drive.plan, sheet, drive.port)
    found = sorted(run_with_progress(compared), key=lambda one: one.place)
    different = [one for one in found if not one.same]
    listed = found if options.everything else different
    if options.json:
        _print_json(drive, against=against, compared_count=len(found), objects=listed)
    else:
        title = f"{drive.title}: {len(different)} of {len(found)} objects differ from {against}"
        columns = ("object", "name", "wanted", "found", "why")
        rows = tuple((one.place, one.name, one.wanted, one.found, one.why) for one in listed)
        if rows:
            show(((title, columns, rows),))
        else:
            print(title)
    return ExitCode.FAILED if different else 0


def _unusable(error: DescriptionError) -> ConfigError:
    """Convert an unusable file into a configuration error, since the operator named the file."""
    return ConfigError(str(error.value), "", "", error.allowed, following="")


def _meaning(entry: dump.Entry, words: ObjectWords) -> str:
    if not isinstance(entry.value, int):
        return entry.trouble
    return words.text_of(entry.index, entry.sub, entry.value)


def _entry_row(entry: dump.Entry, words: ObjectWords) -> tuple[str, ...]:
    value = "-" if entry.value is None else str(entry.value)
    hexadecimal = ""
    if isinstance(entry.value, int) and entry.bits:
        hexadecimal = compare.in_hex(entry.value, entry.bits)
    return (entry.place, entry.name, value, hexadecimal, _meaning(entry, words))


def _entry_fields(entry: dump.Entry, words: ObjectWords) -> dict[str, Any]:
    return {
        "index": entry.index,
        "sub": entry.sub,
        "name": entry.name,
        "value": entry.value,
        "bits": entry.bits,
        "meaning": "" if entry.trouble else _meaning(entry, words),
        "trouble": entry.trouble,
    }


def _print_json(drive: Drive, **parts: object) -> None:
    import msgspec

    description = drive.plan.description
    head = {"drive": description.name, "node_id": description.node_id}
    print(msgspec.json.encode({**head, **parts}).decode())


# --- store and restore ----------------------------------------------------------------------------


def _store_or_restore(drive: Drive, keeping: Command, options: Options, master_node_id: int) -> int:
    """Check bus and drive, ask for confirmation, check both again, then store or restore."""
    try:
        parameters.check_bus(drive.sniffer, master_node_id)
        parameters.check_drive(drive.plan, keeping, drive.port)
        if not _confirmed(f"{drive.title}: {CONSEQUENCE[keeping]}.", options):
            print("nothing was done")
            return ExitCode.FAILED
        run_with_progress(listen(drive.bus, drive.clock, RECHECK_NS))
        parameters.check_bus(drive.sniffer, master_node_id)
        parameters.check_drive(drive.plan, keeping, drive.port)
        patient = Configurator(drive.bus, drive.clock, parameters.SDO_TIMEOUT_NS)
        parameters.execute(drive.plan, keeping, patient)
    except parameters.ParameterRefusedError as refused:
        print(f"{drive.title}: not done: {refused}", file=sys.stderr)
        return ExitCode.FAILED
    if options.reset:
        run_with_progress(parameters.reset_node(drive.plan, drive.port))
        print(f"{drive.title}: has its maker's defaults now, and is in pre-operational")
    else:
        print(f"{drive.title}: {DONE[keeping]}")
    return 0


def _confirmed(consequence: str, options: Options) -> bool:
    print(consequence)
    if options.yes:
        return True
    if not sys.stdin.isatty():
        allowed = "to be given where there is no terminal for the confirmation"
        raise ConfigError(COMMAND_LINE, "--yes", MISSING, allowed)
    return typer.confirm("Do it?", default=False)
