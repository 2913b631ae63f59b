"""Build a machine from plant.toml: plants, drives and world wired together.

The caller reads the files. The mechanism is passed in as numbers, because only the service parses
robot files.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from sim_drives.canopen.dictionary import Entry, read_eds
from sim_drives.cia402.personality import commissioned, standard
from sim_drives.cia402.scaling import effort_per_a
from sim_drives.faults.script import FaultCommandError, help_text
from sim_drives.one_leg import Leg, Outsider
from sim_drives.plant.plant import Physics, PlantError, Trainer, UnknownProgrammeError
from sim_drives.plant.recorded import RecordedError, Values, read_strides
from sim_drives.plant.settings import Recorded
from sim_drives.plant.truth import TruthLog
from sim_drives.settings import DriveSettings, PlantFile
from sim_drives.world import NO_OUTSIDERS, World

PATIENT_COMMAND = "patient"


class MachineError(Exception):
    """Operator error: plant.toml cannot be built; `key` is empty if it concerns the whole file."""

    def __init__(self, key: str, value: object, allowed: str) -> None:
        super().__init__(f"{key} = {value}: {allowed}")
        self.key = key
        self.value = value
        self.allowed = allowed


@dataclass(frozen=True, slots=True)
class Machine:
    """A world, and its plants by leg name."""

    world: World
    trainers: Mapping[str, Trainer]
    record_truth: Callable[[int], None]
    """Add a row to each leg's truth, as every SYNC does; the argument is the SYNC number."""

    def command(self, line: str) -> str:
        """Execute a command line: a fault (`script.py`), `patient PROGRAMME`, or `help`.

        Raises:
            FaultCommandError: unknown command; the message lists the known ones.
        """
        words = line.split()
        if words == ["help"]:
            return f"{help_text()}\n{PATIENT_COMMAND} PROGRAMME: one of {self._programmes()}"
        if words[:1] != [PATIENT_COMMAND]:
            return self.world.command(line)
        if len(words) != 2:
            raise FaultCommandError(f"{line!r}: expected {PATIENT_COMMAND} PROGRAMME")
        return self._start_programme(words[1])

    def _start_programme(self, name: str) -> str:
        try:
            for trainer in self.trainers.values():
                trainer.patient(name)
        except UnknownProgrammeError as error:
            raise FaultCommandError(str(error)) from error
        return f"patient programme is {name}"

    def _programmes(self) -> str:
        names = {name for trainer in self.trainers.values() for name in trainer.programmes}
        return ", ".join(sorted(names))


def build_machine(
    plant: PlantFile,
    folder: Path,
    physics: Physics,
    *,
    seed: int | None = None,
    start_ns: int = 0,
    truth: Mapping[str, TruthLog] | None = None,
    outsiders: Mapping[str, Outsider] = NO_OUTSIDERS,
) -> Machine:
    """Build the machine, powered on and at rest in its start pose.

    Args:
        plant: plant.toml.
        folder: the folder of plant.toml; its paths are relative to it.
        physics: the machine of the plant's robot file.
        seed: seed of all random values; the file's own if None.
        start_ns: the world's first time.
        truth: receives the truth of each SYNC, by leg; legs may be missing.
        outsiders: drives, LEG/AXIS, that are not simulated here; their axes move as they say.

    Raises:
        MachineError: names the key of plant.toml, the value, and the allowed values.
    """
    chosen_seed = plant.seed if seed is None else seed
    recorded = _recorded(plant, folder)
    trainers: dict[str, Trainer] = {}
    legs: list[Leg] = []
    for number, (name, drives) in enumerate(plant.drives.items()):
        parts = [
            (drive, _entries(drive, folder, f"drives.{name}.{axis}"))
            for axis, drive in (("hip", drives.hip), ("slide", drives.slide))
        ]
        efforts = effort_per_a(drives.hip), effort_per_a(drives.slide)
        trainers[name] = _trainer(plant, physics, efforts, chosen_seed + number, start_ns, recorded)
        legs.append(Leg(name, trainers[name], *parts[0], *parts[1]))
    _check_node_ids(plant)
    logs = truth or {}

    def record(sync_count: int) -> None:
        for name, log in logs.items():
            log.record(sync_count, trainers[name].truth())

    try:
        world = World(
            legs,
            plant.fault,
            seed=chosen_seed,
            start_ns=start_ns,
            on_sync=record,
            outsiders=outsiders,
        )
    except FaultCommandError as error:
        raise MachineError("fault", f"{len(plant.fault)} tables", str(error)) from error
    return Machine(world, trainers, record)


def _trainer(
    plant: PlantFile,
    physics: Physics,
    efforts: tuple[float, float],
    seed: int,
    start_ns: int,
    recorded: Mapping[str, Values],
) -> Trainer:
    try:
        return Trainer(plant, physics, efforts, seed, start_ns, recorded)
    except UnknownProgrammeError as error:
        raise MachineError("patient.start", plant.patient.start, str(error)) from error
    except PlantError as error:
        raise MachineError("", "", str(error)) from error


def _recorded(plant: PlantFile, folder: Path) -> dict[str, Values]:
    """Read the file of each recorded effort."""
    made: dict[str, Values] = {}
    for programme in plant.patient.programme:
        for effort in programme.effort:
            if not isinstance(effort, Recorded):
                continue
            key = f"patient.programme.{programme.name}.file"
            try:
                strides = read_strides(folder / effort.file)
            except OSError as error:
                allowed = f"a CSV of strides ({(error.strerror or 'cannot be read').lower()})"
                raise MachineError(key, effort.file, allowed) from error
            except RecordedError as error:
                raise MachineError(key, effort.file, str(error)) from error
            if effort.slide.force_n != 0.0 and not strides[:, :, 1].any():
                allowed = "a file with slide_force_n, because slide.force_n is not 0"
                raise MachineError(key, effort.file, allowed)
            made[effort.file] = strides
    return made


def _entries(drive: DriveSettings, folder: Path, key: str) -> tuple[Entry, ...]:
    _check_transmission(drive, key)
    path = folder / drive.eds
    try:
        entries = read_eds(path, drive.node_id)
    except OSError as error:
        allowed = f"an EDS file ({(error.strerror or 'cannot be read').lower()})"
        raise MachineError(f"{key}.eds", drive.eds, allowed) from error
    except ValueError as error:
        raise MachineError(f"{key}.eds", drive.eds, f"an EDS file ({error})") from error
    known = {entry.address: entry for entry in entries}
    for (index, sub), value in commissioned(drive).items():
        place, entry = f"{index:04X}h:{sub:02X}", known.get((index, sub))
        if entry is None and (index, sub) in standard(drive):
            continue
        if entry is None:
            allowed = f"one whose objects are in {drive.eds}, which has no {place}"
            raise MachineError(f"{key}.personality", f'"{drive.personality.value}"', allowed)
        try:
            entry.encode(value)
        except struct.error as error:
            allowed = f"motor data that {place} can hold; this would be {value} there ({error})"
            raise MachineError(f"{key}.current_limit_a", drive.current_limit_a, allowed) from error
    return entries


def _check_transmission(drive: DriveSettings, key: str) -> None:
    rotary = drive.lead_m is None and drive.offset_m is None and drive.offset_rad is not None
    linear = drive.lead_m is not None and drive.offset_m is not None and drive.offset_rad is None
    if not rotary and not linear:
        given = ", ".join(
            name
            for name in ("lead_m", "offset_m", "offset_rad")
            if getattr(drive, name) is not None
        )
        allowed = "`offset_rad` for a joint that turns, or `lead_m` and `offset_m` for a rail"
        raise MachineError(key, f"{{{given}}}", allowed)
    if drive.tpdo_delay_max_ms < drive.tpdo_delay_min_ms:
        least = f"at least tpdo_delay_min_ms = {drive.tpdo_delay_min_ms:g}"
        raise MachineError(f"{key}.tpdo_delay_max_ms", drive.tpdo_delay_max_ms, least)


def _check_node_ids(plant: PlantFile) -> None:
    known: dict[int, str] = {}
    for leg, drives in plant.drives.items():
        for axis, drive in (("hip", drives.hip), ("slide", drives.slide)):
            name = f"{leg}.{axis}"
            if drive.node_id in known:
                allowed = f"a unique node id; drives.{known[drive.node_id]} has this one"
                raise MachineError(f"drives.{name}.node_id", drive.node_id, allowed)
            known[drive.node_id] = name
