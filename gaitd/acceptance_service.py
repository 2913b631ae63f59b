"""`gaitd commission --report` on a running service: requests, records, objects, operator, files.

Requests go over Zenoh; the raw values of each cycle come from the ring of the core, so it must run
on this computer; objects are read by SDO beside the service, while the drives have no power.
"""

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from signal import SIGHUP, SIGTERM, default_int_handler, signal
from tempfile import TemporaryFile
from typing import Final, NamedTuple

import typer
from gaitd_client import ClientError, NoServiceError, Outcome, Target, Trainer
from gaitd_toml import COMMAND_LINE, ConfigError

from analysis.acceptance import page
from analysis.acceptance.record import AcceptanceRecord, Judgement, Line, Section, read, write
from daemon.config.bundle import Settings
from daemon.config.drive_plan import plan_of
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RING_NAME, RingError, RingReader
from daemon.system.bus_choice import bus_of, opened
from drives.bringup.configurator import Configurator
from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
from drives.canopen.objects import Object
from drives.canopen.sniffer import BusSniffer, SniffedBus
from drives.errors import BringUpRefused, BusError, DescriptionError, DriveSilent, SdoTimeout
from drives.service.compare import Compared, read_with_plan
from drives.service.dump import check_alone, read_objects, variable_at
from drives.service.eds import load_eds
from drives.service.scan import Progress, listen
from gaitd.acceptance import Acceptance, Answer, Gait
from gaitd.remote import client_of
from gaitd.terminal import run_with_progress

POLL_S: Final = 0.02
HANG_S: Final = 10.0
"""If no record comes for so much of the computer's time, the service is gone."""
RECORDS_KEPT: Final = 6000
"""One minute."""
LISTEN_NS: Final = 500_000_000
TRIES: Final = 10
"""Attempts to read a drive's objects while the service's bring-up reads them."""

NOTED: Final = (
    (Object.DEVICE_NAME, 0, "device name"),
    (Object.HARDWARE_VERSION, 0, "hardware version"),
    (Object.SOFTWARE_VERSION, 0, "firmware"),
    (Object.IDENTITY, 4, "serial number"),
)
"""What says which drive it was, where its EDS has it; an axis file may leave its serial number out.

The firmware of an EPOS4 is its revision, 1018h:03, which bring-up checks."""
COMMANDS: Final = frozenset(
    (Object.CONTROLWORD, Object.MODE, Object.TARGET_TORQUE, Object.TARGET_POSITION)
)
"""Objects that the service commands all the time."""
OPTION_CODES: Final = frozenset((0x1029, 0x6007, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E))
IDENTITY: Final = frozenset((0x1000, 0x1018, 0x6502))
FIXED: Final = frozenset(("Identity", "Torque base"))
"""Sections that bring-up only checks."""
PDOS: Final = range(0x1400, 0x1C00)
ROOM_BYTES: Final = 2_000_000
"""Much more than what the files of one drive take."""


# --- objects --------------------------------------------------------------------------------------


def object_sections(
    plan: DrivePlan, port: DrivePort, *, is_set_up: bool
) -> Generator[Progress, None, tuple[Section, ...]]:
    """Read what bring-up writes or checks, and which drive it is; each object is a line.

    Raises:
        SdoTimeout: several objects in a row were not answered.
        DescriptionError: its EDS cannot be used.
        BusError: the bus is down.
    """
    description = plan.description
    dictionary = load_eds(description.eds, description.node_id)
    noted = [one for one in NOTED if dictionary.get_variable(*one[:2]) is not None]
    texts = [variable_at(dictionary, index, sub, 32) for index, sub, _ in noted]
    entries = yield from read_objects(description.node_id, texts, port)
    named = [
        Line(f"{name} ({one.place})", one.trouble or str(one.value), "any", Judgement.NOTED)
        for (*_, name), one in zip(noted, entries, strict=True)
    ]
    compared = yield from read_with_plan(plan, dictionary, port)
    found = [one for one in compared if one.index not in COMMANDS]
    bases = {(base.ref.index, base.ref.sub) for base in description.torque_bases}
    groups = {"Identity": named, "Torque base": [], "Option codes read back": []}
    groups |= {"Limits and settings read back": [], "PDOs read back": []}
    for one in found:
        group = _group(one, bases)
        groups[group].append(_object_line(one, judged=is_set_up or group in FIXED))
    return tuple(Section(title, tuple(lines)) for title, lines in groups.items())


def _group(one: Compared, bases: set[tuple[int, int]]) -> str:
    if one.index in IDENTITY:
        return "Identity"
    if (one.index, one.sub) in bases:
        return "Torque base"
    if one.index in OPTION_CODES:
        return "Option codes read back"
    return "PDOs read back" if one.index in PDOS else "Limits and settings read back"


def _object_line(one: Compared, *, judged: bool) -> Line:
    asked = f"{one.place} {one.name}: {one.why}"
    if not judged:
        return Line(asked, one.found, f"{one.wanted}, after a bring-up", Judgement.NOTED)
    verdict = Judgement.PASSED if one.same else Judgement.FAILED
    return Line(asked, one.found, one.wanted, verdict)


def unread(why: str) -> tuple[Section, ...]:
    """The sections of a drive whose objects could not be read."""
    line = Line("identity, units, settings", why, "", Judgement.NOT_MEASURED)
    return (Section("Identity", (line,)),)


# --- the service ----------------------------------------------------------------------------------


class CoreRestartedError(ClientError):
    """The records go on with those of another core, which knows nothing of the steps before."""


class ServiceBench:
    """A running service on this computer."""

    def __init__(self, trainer: Trainer | None, settings: Settings) -> None:
        self._trainer, self._settings = trainer, settings
        self._records: deque[CycleRecord] = deque(maxlen=RECORDS_KEPT)
        self._ring: RingReader | None = None
        self._seq = 0

    def request(self, name: str, **arguments: object) -> Answer:
        """See `Bench`.

        Raises:
            ClientError: the service does not answer.
        """
        if self._trainer is None:
            return Answer("no service")
        reply = self._trainer.request(name, **arguments)
        self.newest()
        done = reply.outcome == Outcome.DONE
        return Answer("" if done else reply.reason or str(reply.outcome), reply.refusal)

    def until(self, reached: Callable[[CycleRecord], bool], within_s: float) -> CycleRecord | None:
        """See `Bench`; the time is that of the records."""
        heard, begun_ns = time.monotonic(), 0
        while time.monotonic() < heard + HANG_S:
            for record in self._new():
                heard, begun_ns = time.monotonic(), begun_ns or record.sync_mono_ns
                if reached(record):
                    return record
                if record.sync_mono_ns - begun_ns > within_s * 1e9:
                    return None
            time.sleep(POLL_S)
        return None

    def since(self, seq: int) -> Sequence[CycleRecord]:
        """See `Bench`."""
        return [record for record in self._records if record.seq > seq]

    def newest(self) -> CycleRecord | None:
        """See `Bench`."""
        for _ in self._new():
            pass
        return self._records[-1] if self._records else None

    def objects(self, drive: str, *, is_set_up: bool) -> tuple[Section, ...]:
        """See `Bench`."""
        why = ""
        for _ in range(TRIES):
            try:
                return self._read(plan_of(drive, self._settings), is_set_up)
            except (BringUpRefused, BusError, DriveSilent, SdoTimeout, DescriptionError) as error:
                why = str(error)
        return unread(why)

    def _read(self, plan: DrivePlan, is_set_up: bool) -> tuple[Section, ...]:
        with opened(bus_of(self._settings.file)) as (bus, clock):
            sniffer = BusSniffer()
            observed = SniffedBus(bus, clock, sniffer)
            run_with_progress(listen(observed, clock, LISTEN_NS))
            check_alone(plan, sniffer.node(plan.description.node_id))
            port = Configurator(observed, clock)
            return run_with_progress(object_sections(plan, port, is_set_up=is_set_up))

    def _new(self) -> Generator[CycleRecord]:
        """Records that have come since the last look.

        Raises:
            CoreRestartedError: they are those of another core.
        """
        path = self._settings.runtime / RING_NAME
        try:
            if self._ring is None or self._ring.inode != path.stat().st_ino:
                if self._records:
                    raise CoreRestartedError("the core was started anew: give the command again")
                self._ring = RingReader(path)
                self._seq = self._ring.newest_seq() - 1
            if self._ring.raw(self._seq) is None:  # not looked at for longer than the ring is
                self._seq = max(self._ring.newest_seq() - 1, 0)
            while (record := self._ring.read(self._seq + 1)) is not None:
                self._seq += 1
                self._records.append(record)
                yield record
        except (FileNotFoundError, RingError):
            return

    def foreign_files(self) -> str:
        """Why the files of this command are not those of the service; empty if they are."""
        self.newest()
        if self._ring is None:
            return ""
        running = set(self._ring.header.config_hashes.values())
        files = self._settings.hashes.items()
        changed = sorted(Path(name).name for name, digest in files if digest not in running)
        if not changed:
            return ""
        return f"the service runs with another {', '.join(changed)} than this: restart it"

    @property
    def boot_id(self) -> str:
        """Boot id of the core; empty if there is none."""
        return "" if self._ring is None else self._ring.header.core_boot_id


class TerminalOperator:
    """The person at the terminal; with `agreed` no confirmation is asked for."""

    def __init__(self, *, agreed: bool, witnessed: bool) -> None:
        self._agreed, self._witnessed = agreed, witnessed

    def tell(self, text: str) -> None:
        """See `Operator`."""
        print(text, file=sys.stderr, flush=True)

    def agrees(self, text: str) -> bool:
        """See `Operator`."""
        if self._agreed:
            self.tell(text)
            return True
        return typer.confirm(f"{text}\nGo on?", err=True)

    def acts(self, text: str) -> bool:
        """See `Operator`."""
        return not self._agreed and typer.confirm(f"{text}\nDone?", err=True)

    def saw(self, text: str) -> bool | None:
        """See `Operator`."""
        if self._witnessed:
            return True
        return None if self._agreed else typer.confirm(text, err=True)

    def number(self, text: str) -> float | None:
        """See `Operator`."""
        return None if self._agreed else typer.prompt(text, default=0.0, type=float, err=True)


# --- files ----------------------------------------------------------------------------------------


class Written(NamedTuple):
    """The record of one drive, and its files."""

    record: AcceptanceRecord
    files: tuple[Path, Path]
    blocked: str
    """Why not all steps were done; empty if they were."""


def run_acceptance(
    target: Target, settings: Settings, operator: TerminalOperator, gait: Gait, folder: Path
) -> list[Written]:
    """Do the whole procedure, and write a record and a page for each drive.

    They are written whatever ends the procedure.

    Raises:
        ClientError: the service does not answer, or its core was started anew.
        ConfigError: the folder has records already.
        OSError: a file cannot be written.
    """
    _prepare(folder, settings)
    for ending in (SIGTERM, SIGHUP):  # so that the machine is stopped if the terminal is gone, too
        signal(ending, default_int_handler)
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    with ExitStack() as connection:
        trainer, blocked = None, ""
        try:
            trainer = connection.enter_context(client_of(target, "commission"))
        except NoServiceError as error:  # its bring-up may have refused a drive: that can be read
            blocked = f"no service: {error}"
        bench = ServiceBench(trainer, settings)
        acceptance = Acceptance(settings, bench, operator, gait)
        try:
            acceptance.run(blocked or bench.foreign_files())
        finally:
            boot_id = "" if trainer is None else bench.boot_id
            written = write_records(acceptance, settings, utc, boot_id, folder)
            for one in written:
                operator.tell(f"written: {one.files[1]}")
    return written


def _prepare(folder: Path, settings: Settings) -> None:
    """Make the folder, and refuse one that cannot take the records, before anything moves.

    Raises:
        ConfigError: it has records already, which are kept.
        OSError: it cannot be written, or has no room.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for drive in settings.drives:
        path = _path(folder, drive.name)
        if path.exists():
            allowed = f"another folder: {path.name} is in this one, and is not replaced"
            raise ConfigError(COMMAND_LINE, "--report", folder, allowed)
    try:
        with TemporaryFile(dir=folder, buffering=0) as probe:
            os.posix_fallocate(probe.fileno(), 0, ROOM_BYTES * len(settings.drives))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from error


def _path(folder: Path, drive: str) -> Path:
    return folder / f"{drive.replace('/', '_')}.json"


def write_records(
    acceptance: Acceptance, settings: Settings, utc: str, boot_id: str, folder: Path
) -> list[Written]:
    """Write `LEG_AXIS.json` and `LEG_AXIS.html` of each drive; the page is made from the file."""
    written: list[Written] = []
    hashes = {Path(name).name: digest for name, digest in settings.hashes.items()}
    for drive in settings.drives:
        made = AcceptanceRecord(
            drive=drive.name,
            node_id=drive.node_id,
            utc=utc,
            gaitd_version=version("gaitd"),
            core_boot_id=boot_id,
            profile=Path(drive.axis.profile).name,
            profile_verified_on_hardware=drive.profile.verified_on_hardware,
            sha256=hashes,
            sections=tuple(acceptance.sections[drive.name]),
            stops=tuple(acceptance.stops[drive.name]),
        )
        path = _path(folder, drive.name)
        write(made, path)
        record = read(path)
        page.write(record, path.with_suffix(".html"))
        written.append(Written(record, (path, path.with_suffix(".html")), acceptance.blocked))
    return written
