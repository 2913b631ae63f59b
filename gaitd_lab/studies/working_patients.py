"""What happens to patients who work: each patient at each cadence on each law of friction.

The shipped configuration in lock-step (`lockstep.py`), its observer beside the plant's truth. On a
plant with bristles the robot file has the same bristles, as `gaitd calibrate` finds them. The
controls are machines that must stop: their observer is wrong, or the patient has a real spasm. With
two legs each leg has its patient, who varies by a seed of its own.
"""

import math
import multiprocessing
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from gaitd_names import Cause, Mode, RequestKind
from numpy.typing import NDArray

from analysis.accuracy import moving
from analysis.calibration.bristles import with_bristles
from daemon.config.bundle import Settings
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from daemon.ipc.record import CycleRecord, ModeRequest
from daemon.preflight.load import load
from drives.cia402.profile import DriveDescription
from gaitd_lab.lockstep import LockstepSession, RefusedError
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.patients import (
    BEGIN_S,
    DT_S,
    Late,
    Model,
    Patient,
    Spasm,
    clonic,
    of_ability,
    trembling,
    weak,
)
from gaitd_lab.proven_signs import proven_signs
from gaitd_lab.studies.report import Table
from gaitd_lab.trials import of_axes
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from observer.filter.status import Validity
from sim_drives.build import Machine
from sim_drives.plant.settings import FrictionLaw
from sim_drives.plant.truth import TruthLog, TruthRow
from sim_drives.settings import PlantFile

Values = NDArray[np.float64]

CADENCES_HZ: Final = (0.25, 0.3, 0.35, 0.4, 0.5)
FRICTIONS: Final = (FrictionLaw.PAPER, FrictionLaw.LUGRE)
CONTROL_HZ: Final = 0.25
BRING_UP_S: Final = 30.0
TURN_S: Final = 0.5
GLITCH_S: Final = 0.1
GLITCH_COUNTS: Final = 100
WRONG_KG: Final = 130.0
JITTER_US: Final = 1000.0
COARSE: Final = 8
SPASM_AT_S: Final = 6.0
MODELS: Final[Mapping[str, Callable[[], Model]]] = {
    "half": lambda: of_ability(0.5),
    "all": lambda: of_ability(1.0),
    "1.4": lambda: of_ability(1.4),
    "late": lambda: Late(of_ability(1.0)),
    "weak phase": lambda: weak(of_ability(1.0)),
    "tremor": lambda: trembling,
    "clonus": lambda: clonic,
}
PASSIVE: Final = "passive"
CONTROLS: Final = ("spasm", "wrong leg", "glitches", "unknown jitter", "coarse encoder")
"""Cells whose stop must come; the patient gives half of the need, but for the spasm.

With two legs the last one has the spasm or the glitches.
"""
NAMES: Final = (PASSIVE, *MODELS, *CONTROLS)
HEAD: Final = (
    "patient",
    "cadence",
    "friction",
    "stops",
    "valid",
    "longest BAD",
    "hip: error",
    "3 sigma",
    "sigma",
    "slide: error",
    "3 sigma",
    "sigma",
)


@dataclass(frozen=True, slots=True)
class Cell:
    """A patient, or a control, on a machine."""

    patient: str
    cadence_hz: float
    law: FrictionLaw
    seed: int


class AxisFigures(NamedTuple):
    """One axis in motion with a valid estimate, rms in N·m or N; NaN without such a sample."""

    patient_si: float
    error_si: float
    sigma_si: float
    covered_ratio: float
    """Share of samples within 3 sigma."""


NOTHING: Final = AxisFigures(*4 * (math.nan,))


@dataclass(frozen=True, slots=True)
class Played:
    """What happened to one leg in one cell."""

    cell: Cell
    leg: str
    """Empty on a machine with one leg."""
    cause: str
    """Cause of the stop; empty if it walked to the end."""
    stopped_s: float
    """Time of gait until the stop, or until the end."""
    valid_ratio: float
    """Share of the gait's time in which neither axis was BAD."""
    bad_longest_s: float
    hip: AxisFigures
    slide: AxisFigures

    @property
    def stride(self) -> int:
        """Number of the stride in which it stopped, from 1."""
        return 1 + int(self.stopped_s * self.cell.cadence_hz)


def cells(
    seeds: int, names: Collection[str] = NAMES, cadences_hz: Sequence[float] = CADENCES_HZ
) -> list[Cell]:
    """Return the cells of these patients and controls, which have a cadence of their own."""
    draws = range(1, seeds + 1)
    patients = [name for name in (PASSIVE, *MODELS) if name in names]
    controls = [name for name in CONTROLS if name in names]
    return [
        *(Cell(*one) for one in product(patients, cadences_hz, FRICTIONS, draws)),
        *(Cell(*one) for one in product(controls, (CONTROL_HZ,), (FrictionLaw.PAPER,), draws)),
    ]


def run(
    config: Path, wanted: Sequence[Cell], duration_s: float, jobs: int
) -> Iterator[list[Played]]:
    """Play cells, `jobs` at a time; yields each leg of a cell when it is done.

    Raises:
        ConfigError: in a file, or between the files.
    """
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(wanted)), mp_context=spawn) as pool:
        running = [pool.submit(play_legs, config, cell, duration_s) for cell in wanted]
        try:
            for done in as_completed(running):
                yield done.result()
        finally:
            pool.shutdown(cancel_futures=True)


def play(config: Path, cell: Cell, duration_s: float) -> Played:
    """Play a cell, and return what happened to its first leg; see `play_legs`."""
    return play_legs(config, cell, duration_s)[0]


def play_legs(config: Path, cell: Cell, duration_s: float) -> list[Played]:
    """Walk for a time, or until the service stops; return what happened to each leg.

    Raises:
        ConfigError: in a file, or between the files.
    """
    settings, plant, robot = _machine_of(load(config), cell)
    truths = {leg.name: TruthLog(None) for leg in settings.legs}
    names = list(truths)
    machine = virtual_machine(settings.file, plant=plant, robot=robot, seed=cell.seed, truth=truths)
    gateway = Gateway()
    if cell.patient != PASSIVE:
        gateway = Gateway(_exerting(cell, settings, machine))
    session = LockstepSession(
        settings, machine, gateway=gateway, persistent=proven_signs(settings, machine)
    )
    gait = ModeRequest(
        Mode.GAIT, cadence_hz=cell.cadence_hz, amplitude_ratio=1.0, duration_s=duration_s + 60.0
    )
    try:
        session.enable().execute(RequestKind.MODE, gait)
    except RefusedError as error:
        refused = f"refused: {error}"
        return [
            Played(cell, _told(leg, names), refused, 0.0, 0.0, 0.0, NOTHING, NOTHING)
            for leg in names
        ]
    session.run_until(lambda record: record.gait_phase >= 0 or _has_stopped(record), BRING_UP_S)
    begun = len(session.records) - 1
    while not _has_stopped(session.record) and len(session.records) - begun < duration_s / DT_S:
        if cell.patient == "glitches":
            for axis in ("hip", "slide"):
                session.command(f"encoder_glitch {names[-1]}/{axis} - {GLITCH_COUNTS}")
            session.run(GLITCH_S)
        else:
            session.run(TURN_S)
    return [
        _played(cell, _told(leg, names), session, begun, place, truth.rows)
        for place, (leg, truth) in enumerate(truths.items())
    ]


def _told(leg: str, names: Sequence[str]) -> str:
    return leg if len(names) > 1 else ""


def _exerting(cell: Cell, settings: Settings, machine: Machine) -> Callable[[CycleRecord], None]:
    """Return what exerts the effort of the patient of each leg, which a record asks for."""
    names = [leg.name for leg in settings.legs]
    patients = [
        (
            machine.trainers[name],
            Patient(
                settings.robot,
                _model(cell.patient, is_last=name == names[-1]),
                cell.seed + place,
                place,
            ),
        )
        for place, name in enumerate(names)
    ]

    def exert(record: CycleRecord) -> None:
        for trainer, patient in patients:
            trainer.exert(*patient(record))

    return exert


def _model(name: str, *, is_last: bool) -> Model:
    if name == "spasm" and is_last:
        return Spasm(SPASM_AT_S)
    return of_ability(0.5) if name in CONTROLS else MODELS[name]()


def _machine_of(settings: Settings, cell: Cell) -> tuple[Settings, PlantFile, Robot | None]:
    """Return service, plant, and the plant's robot if it is not the service's."""
    change = msgspec.structs.replace
    _, plant = load_plant(settings.file)
    plant = change(plant, friction=change(plant.friction, law=cell.law))
    if cell.law is FrictionLaw.LUGRE:
        settings = replace(settings, robot=_with_bristles_of(plant, settings.robot))
    robot = None
    if cell.patient == "wrong leg" and settings.robot.patient is not None:
        robot = change(settings.robot, patient=change(settings.robot.patient, mass_kg=WRONG_KG))
    elif cell.patient == "unknown jitter":
        plant = change(plant, sensor=change(plant.sensor, latch_jitter_us=JITTER_US))
    elif cell.patient == "coarse encoder":
        settings, plant = _with_coarse_encoders(settings, plant)
    return settings, plant, robot


def _with_bristles_of(plant: PlantFile, robot: Robot) -> Robot:
    """Return the robot with the plant's bristles, and an integrator that can follow them."""
    change, keys = msgspec.structs.replace, msgspec.structs.asdict
    robot, _ = with_bristles(robot, range(2))
    hip = change(robot.friction.hip, **keys(plant.friction.hip))
    slide = change(robot.friction.slide, **keys(plant.friction.slide))
    return change(robot, friction=change(robot.friction, hip=hip, slide=slide))


def _with_coarse_encoders(settings: Settings, plant: PlantFile) -> tuple[Settings, PlantFile]:
    """Divide the resolution of all encoders; the observer's measurement noise stays."""
    change = msgspec.structs.replace

    def coarse(drive: DriveDescription) -> DriveDescription:
        counts = drive.axis.transmission.counts_per_rev // COARSE
        transmission = change(drive.axis.transmission, counts_per_rev=counts)
        return replace(drive, axis=change(drive.axis, transmission=transmission))

    legs = tuple(
        replace(leg, hip=coarse(leg.hip), slide=coarse(leg.slide)) for leg in settings.legs
    )
    drives = {
        name: change(
            pair,
            hip=change(pair.hip, counts_per_rev=pair.hip.counts_per_rev // COARSE),
            slide=change(pair.slide, counts_per_rev=pair.slide.counts_per_rev // COARSE),
        )
        for name, pair in plant.drives.items()
    }
    return replace(settings, legs=legs), change(plant, drives=drives)


def _has_stopped(record: CycleRecord) -> bool:
    return record.mode != Mode.GAIT


def _played(
    cell: Cell,
    leg: str,
    session: LockstepSession,
    begun: int,
    place: int,
    rows: Sequence[TruthRow],
) -> Played:
    true = {row.sync_mono_ns: row for row in rows}
    records = [record for record in session.records[begun:] if record.sync_mono_ns in true]
    legs = [record.legs[place] for record in records]
    validity = of_axes(legs, "validity")
    bad = (validity == Validity.BAD).any(axis=1)
    pairs = np.array(
        [
            (
                (one.hip_velocity_rad_per_s, one.slide_velocity_m_per_s),
                (one.hip_patient_nm, one.slide_patient_n),
            )
            for one in (true[record.sync_mono_ns] for record in records)
        ]
    )
    judged = moving(pairs[:, 0], friction_parameters(session.settings.robot))
    judged &= validity == Validity.OK
    judged[: round(BEGIN_S / DT_S)] = False
    patient, std = of_axes(legs, "patient"), of_axes(legs, "patient_std")
    axes = [
        _figures(pairs[rows, 1, axis], patient[rows, axis], std[rows, axis])
        for axis, rows in enumerate(judged.T)
    ]
    verdict = session.record.verdict
    return Played(
        cell,
        leg,
        "" if verdict.cause is Cause.NONE else verdict.cause.name,
        len(records) * DT_S,
        1.0 - float(np.mean(bad)),
        _longest(bad) * DT_S,
        *axes,
    )


def _figures(true: Values, estimate: Values, sigma: Values) -> AxisFigures:
    if not len(true):
        return NOTHING
    error = estimate - true
    within = float(np.mean(np.abs(error) <= 3.0 * sigma))
    return AxisFigures(_rms(true), _rms(error), _rms(sigma), within)


def _rms(values: Values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _longest(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return int(max(edges[1::2] - edges[::2], default=0))


def table(title: str, results: Iterable[Played]) -> Table:
    """Return a row for each patient, cadence and friction: medians over seeds, worst BAD run."""
    groups: dict[tuple[str, float, FrictionLaw], list[Played]] = {}
    for one in results:
        patient = f"{one.cell.patient}, {one.leg} leg" if one.leg else one.cell.patient
        groups.setdefault((patient, one.cell.cadence_hz, one.cell.law), []).append(one)
    rows = [_row(*key, draws) for key, draws in groups.items()]
    return Table(title, HEAD, rows)


def _row(
    patient: str, cadence_hz: float, law: FrictionLaw, draws: Sequence[Played]
) -> tuple[str, ...]:
    def median(values: Iterable[float], digits: int) -> str:
        known = [value for value in values if np.isfinite(value)]
        return f"{np.median(known):.{digits}f}" if known else "–"

    figures: list[str] = []
    for axes, unit in (([one.hip for one in draws], "N·m"), ([one.slide for one in draws], "N")):
        error = median((axis.error_si for axis in axes), 2)
        true = np.median([axis.patient_si for axis in axes])
        share = f" ({100.0 * float(error) / true:.0f} %)" if error != "–" and true > 0.0 else ""
        covered = median((100.0 * axis.covered_ratio for axis in axes), 1)
        sigma = median((axis.sigma_si for axis in axes), 2)
        figures += [error if error == "–" else f"{error} {unit}{share}", covered, sigma]
    return (
        patient,
        f"{cadence_hz:g} Hz",
        law.value,
        _stops(draws),
        median((100.0 * one.valid_ratio for one in draws), 1),
        f"{max(one.bad_longest_s for one in draws):.2f} s",
        *figures,
    )


def _stops(draws: Sequence[Played]) -> str:
    """Format each cause with its count, and the range of its times in strides."""
    parts: list[str] = []
    for cause in dict.fromkeys(one.cause for one in draws if one.cause):
        strides = [one.stride for one in draws if one.cause == cause]
        low, high = min(strides), max(strides)
        stride = f"stride {low}" if low == high else f"strides {low} to {high}"
        parts.append(f"{cause} {len(strides)}/{len(draws)}, {stride}")
    return "; ".join(parts) or "none"
