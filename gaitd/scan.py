"""`gaitd scan`: list the stations on a bus, and compare them with the configured machine.

Read only: SDO uploads, one frame at a time and paced, and nothing else. It may run beside a
service. Exit codes: 0; 2 usage or configuration; 3 an expected drive is missing, is there twice or
is another one, or the bus does not work.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from gaitd_names import ExitCode
from gaitd_toml import COMMAND_LINE, MISSING, ConfigError

from daemon.config.shipped import configs_folder
from daemon.system.bus_choice import BusPlace, bus_of, opened
from gaitd.command_line import CONFIG_VARIABLE, CommandError, JsonOption
from gaitd.terminal import Table, run_with_progress, show

if TYPE_CHECKING:
    from drives.canopen.bus import Bus, Clock
    from drives.service.inventory import Finding, Inventory
    from drives.service.stations import Expected, ProfileFile, Station


def command(
    config: Annotated[
        Path | None,
        typer.Option(
            "--config",
            envvar=CONFIG_VARIABLE,
            help="trainer file: its bus, its drives",
            dir_okay=False,
        ),
    ] = None,
    interface: Annotated[
        str | None, typer.Option(help="without --config: python-can's word, e.g. socketcan")
    ] = None,
    channel: Annotated[str | None, typer.Option(help="without --config: e.g. can0")] = None,
    bitrate: Annotated[int | None, typer.Option(help="without --config: bit/s")] = None,
    json: JsonOption = False,
) -> None:
    """List the stations on the bus and compare them with the configuration. Writes no object."""
    from drives.errors import BusError

    place, expected = _wanted(config, interface, channel, bitrate)
    try:
        with opened(place) as (bus, clock):
            found = scan(bus, clock, place.bitrate_bit_per_s, expected)
            foreign_count = bus.foreign_count
    except BusError as error:
        blame = f"{place.interface} {place.channel}"
        raise CommandError(
            f"scan: {error}", ExitCode.DRIVE, blame=blame, following="gaitd doctor"
        ) from error
    if json:
        print(as_json(found, foreign_count))
    else:
        tables = sections(found, place, expected, foreign_count)
        show(table for table in tables if table[2])
    raise typer.Exit(ExitCode.DRIVE if found.is_wrong else 0)


def scan(bus: "Bus", clock: "Clock", bitrate_bit_per_s: int, expected: "Expected") -> "Inventory":
    """Survey an open bus, with progress on a terminal.

    Raises:
        BusError: the interface is down, or the controller is bus-off.
    """
    from drives.service.inventory import inventory_of
    from drives.service.scan import survey

    return inventory_of(run_with_progress(survey(bus, clock, bitrate_bit_per_s)), expected)


def _wanted(
    config: Path | None, interface: str | None, channel: str | None, bitrate: int | None
) -> "tuple[BusPlace, Expected]":
    from daemon.preflight.load import read_all
    from drives.service.stations import Expected

    named = {"--interface": interface, "--channel": channel, "--bitrate": bitrate}
    if config is not None:
        for option, value in named.items():
            if value is not None:
                raise ConfigError(COMMAND_LINE, option, value, "nothing: --config says it already")
        settings = read_all(config)
        master = settings.trainer.cycle.master_node_id
        return bus_of(settings.file), Expected(settings.drives, master, _profiles())
    if interface is None or channel is None or bitrate is None:
        missing = next(option for option, value in named.items() if value is None)
        allowed = "--config FILE, or all of --interface, --channel and --bitrate"
        raise ConfigError(COMMAND_LINE, missing, MISSING, allowed)
    if bitrate <= 0:
        raise ConfigError(COMMAND_LINE, "--bitrate", bitrate, "bit/s, for example 1000000")
    place = BusPlace(interface, channel, bitrate, COMMAND_LINE, "--channel")
    return place, Expected(profiles=_profiles())


def _profiles() -> "tuple[ProfileFile, ...]":
    """Drive profiles in configs/drives/profiles; none if there is no such folder."""
    from daemon.preflight.load import load_toml
    from drives.cia402.profile import DriveProfile
    from drives.service.stations import ProfileFile

    try:
        folder = configs_folder("--config", "drives/profiles") / "drives" / "profiles"
    except ConfigError:
        return ()
    files = ((file.stem, load_toml(file, DriveProfile)) for file in sorted(folder.glob("*.toml")))
    return tuple(ProfileFile(name, profile.vendor, profile.family) for name, profile in files)


# --- text -----------------------------------------------------------------------------------------


def sections(
    found: "Inventory", place: BusPlace, expected: "Expected", foreign_count: int
) -> tuple[Table, ...]:
    """Format the inventory as tables of text."""
    count = len(found.stations)
    where = f"{place.interface} {place.channel}"
    devices = "no node" if not count else f"{count} node{'s' if count > 1 else ''}"
    columns = ("node", "drive", "NMT", "device", "power state", "error", "profile")
    states = tuple(_state_row(station, expected) for station in found.stations)
    stations = (f"On {where}: {devices}", columns, states)
    columns = ("node", "vendor", "name", "product", "revision", "serial", "hardware", "software")
    rows = tuple(_identity_row(station) for station in found.stations if station.answers)
    findings = [_finding_line(finding) for finding in found.findings]
    if foreign_count:
        findings.append(f"{foreign_count} extended, remote or CAN FD frames: not CANopen")
    return (
        stations,
        ("Identity", columns, rows),
        ("Findings", ("",), tuple((line,) for line in findings or [_all_well(found, expected)])),
    )


def _all_well(found: "Inventory", expected: "Expected") -> str:
    if not found.stations:
        return "no node answers, sends a heartbeat or anything else"
    if not expected.drives:
        return "none"
    names = ", ".join(drive.name for drive in expected.drives)
    return f"none: {names} are there and are what their files describe"


def _state_row(station: "Station", expected: "Expected") -> tuple[str, ...]:
    unexpected = "(in no file)" if expected.drives else ""
    return (
        str(station.node_id),
        station.drive or unexpected,
        station.nmt_state if station.nmt_state != "unknown" else "not heard",
        _device(station),
        station.power_state or "-",
        _error(station),
        station.fitting_profile or "-",
    )


def _device(station: "Station") -> str:
    if station.profile_number is None:
        return "-" if not station.answers else "answers, without a type"
    return f"CiA {station.profile_number}" if station.profile_number else "no device profile"


def _error(station: "Station") -> str:
    if station.error_code:
        return f"{station.error_code:04X}h {station.error_text}"
    if station.error_register is None:
        return "-"
    return f"register {station.error_register:02X}h" if station.error_register else "none"


def _identity_row(station: "Station") -> tuple[str, ...]:
    vendor = "-" if station.vendor_id is None else f"{station.vendor_id:X}h"
    return (
        str(station.node_id),
        f"{station.vendor} ({vendor})" if station.vendor else vendor,
        station.device_name or "-",
        _hex(station.product_code),
        _hex(station.revision),
        "-" if station.serial is None else str(station.serial),
        station.hardware_version or "-",
        station.software_version or "-",
    )


def _hex(value: int | None) -> str:
    return "-" if value is None else f"{value:08X}h"


def _finding_line(finding: "Finding") -> str:
    from drives.service.inventory import WRONG

    mark = "WRONG: " if finding.kind in WRONG else ""
    node = "" if finding.node_id is None else f"node {finding.node_id}"
    owner = f"{finding.drive} ({node})" if finding.drive else node
    return f"{mark}{owner}{': ' if owner else ''}{finding.text}"


def as_json(found: "Inventory", foreign_count: int) -> str:
    """One JSON object: stations, findings with their kind as a name, and the verdict."""
    import msgspec

    from drives.service.inventory import WRONG

    findings: list[dict[str, Any]] = [
        {
            "kind": finding.kind.name.lower(),
            "wrong": finding.kind in WRONG,
            "node_id": finding.node_id,
            "drive": finding.drive,
            "text": finding.text,
        }
        for finding in found.findings
    ]
    table = {
        "stations": found.stations,
        "findings": findings,
        "foreign_frames_count": foreign_count,
        "wrong": found.is_wrong,
    }
    return msgspec.json.encode(table).decode()
