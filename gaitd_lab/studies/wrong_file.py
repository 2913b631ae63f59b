"""The patient where the robot file differs from the machine, without a baseline and with one.

The machine stays as it is, and the observer gets a file with other numbers. So one walk with a
passive patient, from which the baseline comes, and one with an active patient do for all rows of a
rigid machine. A machine whose transmission gives way walks on its own, with the file of a rigid one
and with one that says so.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from analysis.replay import filter_setup, setup_for
from daemon.config.robot import frictional
from daemon.config.settings import HipTransmission as RobotHipTransmission
from daemon.config.settings import Robot
from daemon.config.settings import SlideTransmission as RobotSlideTransmission
from daemon.config.settings import Transmission as RobotTransmission
from gaitd_lab.studies.experiment.measures import rms
from gaitd_lab.studies.report import Cell, Table, measured
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials
from observer.baseline import baseline_of, known
from observer.filter.leg_observer import Setup
from observer.filter.states import PATIENT
from observer.filter.status import Validity
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from sim_drives.plant.settings import HipTransmission, Transmission

MINUTE_S: Final = 60.0
WALK_S: Final = 30.0
SETTLED_S: Final = 5.0
CADENCES_HZ: Final = (0.25, 0.35)
"""The baseline is that of the first one."""
SIGMAS: Final = 3.0
UNITS: Final = ("N·m", "N")
DAMPING_NM_S_PER_RAD: Final = 5.0
"""A twentieth of critical, of an elastic hip drive."""

Values = NDArray[np.float64]


class File(NamedTuple):
    """What the observer takes for true of the machine."""

    robot: Robot
    offset_nm: float = 0.0
    """Added to the torque that the hip's drive shows."""


def heavier(robot: Robot, ratio: float) -> Robot:
    """The file of a patient who weighs more."""
    if robot.patient is None:
        raise ValueError("the robot file has no patient")
    return replace(robot, patient=replace(robot.patient, mass_kg=ratio * robot.patient.mass_kg))


def stiffer_hip(robot: Robot, ratio: float) -> Robot:
    """The file of a machine with a stiffer spring at the hip."""
    springs = robot.springs
    stiffness = ratio * springs.hip.stiffness_nm_per_rad
    hip = replace(springs.hip, stiffness_nm_per_rad=stiffness)
    return replace(robot, springs=replace(springs, hip=hip))


def more_friction(robot: Robot, ratio: float) -> Robot:
    """The file of a machine with more friction at both axes."""
    hip, slide = robot.friction.hip, robot.friction.slide
    hip = replace(hip, stribeck_nm=ratio * hip.stribeck_nm, coulomb_nm=ratio * hip.coulomb_nm)
    slide = replace(slide, stribeck_n=ratio * slide.stribeck_n, coulomb_n=ratio * slide.coulomb_n)
    return replace(robot, friction=replace(robot.friction, hip=hip, slide=slide))


def reclined(robot: Robot, by_deg: float) -> Robot:
    """The file of a trunk that reclines more."""
    geometry = robot.geometry
    return replace(robot, geometry=replace(geometry, recline_deg=geometry.recline_deg + by_deg))


def a_little_of_all(robot: Robot) -> File:
    """The file of a machine that differs by 4 % leg, 6 % friction, 2 mm, 0.3 degrees, 0.3 N m."""
    changed = reclined(more_friction(heavier(robot, 1.04), 1.06), 0.3)
    geometry = changed.geometry
    moved = replace(geometry, rail_y_m=geometry.rail_y_m + 0.002)
    return File(stiffer_hip(replace(changed, geometry=moved), 1.01), 0.3)


FILES: Final[Mapping[str, Callable[[Robot], File]]] = {
    "nothing": File,
    "leg 15 % heavier": lambda robot: File(heavier(robot, 1.15)),
    "leg 15 % lighter": lambda robot: File(heavier(robot, 0.85)),
    "hip spring 10 % stiffer": lambda robot: File(stiffer_hip(robot, 1.1)),
    "friction 20 % more": lambda robot: File(more_friction(robot, 1.2)),
    "torque offset 1 N·m": lambda robot: File(robot, 1.0),
    "recline 1°": lambda robot: File(reclined(robot, 1.0)),
    "everything a little": a_little_of_all,
}


class Machine(NamedTuple):
    """A machine whose transmission gives way, which the file does not say."""

    transmission: Transmission
    file: RobotTransmission
    """What a file that is right says of it."""


def soft_hip(stiffness_nm_per_rad: float, backlash_rad: float) -> Machine:
    """A machine with this transmission at the hip and a rigid one at the slide."""
    return Machine(
        Transmission(
            hip=HipTransmission(
                stiffness_nm_per_rad=stiffness_nm_per_rad,
                damping_nm_s_per_rad=DAMPING_NM_S_PER_RAD,
                backlash_rad=backlash_rad,
            )
        ),
        RobotTransmission(
            hip=RobotHipTransmission(
                stiffness_nm_per_rad=stiffness_nm_per_rad, backlash_rad=backlash_rad
            ),
            slide=RobotSlideTransmission(stiffness_n_per_m=0.0, backlash_m=0.0),
        ),
    )


MACHINES: Final = {
    "an elastic hip drive, 800 N·m/rad": soft_hip(800.0, 0.0),
    "a loose hip drive, 0.3°, 4000 N·m/rad": soft_hip(4000.0, np.radians(0.3)),
}
RIGID: Final = Transmission()


def table(
    config: Path, seeds: Sequence[int], begin: Callable[[str], Callable[[float], None]]
) -> Table:
    """Walk passively and actively, and estimate with each file.

    Raises:
        TrialError: the service refused the gait.
    """
    machines = [Trials(config, seed=seed) for seed in seeds]

    def walks(transmission: Transmission, of: str) -> _Walks:
        def walked(programme: str, cadence_hz: float, duration_s: float) -> list[Trial]:
            situation = Situation(
                cadence_hz=cadence_hz, programme=programme, transmission=transmission
            )
            told = begin(f"{of}, {programme}, {cadence_hz:g} Hz")
            return [trials.gait(situation, duration_s, told) for trials in machines]

        return _Walks(
            walked("passive", CADENCES_HZ[0], MINUTE_S),
            {cadence_hz: walked("active", cadence_hz, WALK_S) for cadence_hz in CADENCES_HZ},
        )

    rows: list[tuple[Cell, ...]] = []
    rigid = walks(RIGID, "rigid")
    for name, changed in FILES.items():
        rows += _rows(name, rigid, changed, lambda robot: robot)
    for name, machine in MACHINES.items():
        soft = walks(machine.transmission, name)
        rows += _rows(name, soft, File, partial(replace, transmission=machine.file))
    head = ("file differs by", "cadence", "baseline", *_HEAD)
    return Table("A robot file that differs from the machine", head, rows)


class _Walks(NamedTuple):
    passive: Sequence[Trial]
    active: Mapping[float, Sequence[Trial]]
    """By cadence."""


def _rows(
    name: str, walks: _Walks, changed: Callable[[Robot], File], true: Callable[[Robot], Robot]
) -> list[tuple[Cell, ...]]:
    files = [changed(trial.robot) for trial in walks.passive]
    exact = [File(true(trial.robot)) for trial in walks.passive]
    bare = [setup_for(file.robot) for file in files]
    clean = [_with_minute(*one) for one in zip(files, walks.passive, strict=True)]
    certain = [filter_setup(file.robot) for file in exact]
    rows: list[tuple[Cell, ...]] = []
    for cadence_hz, trials in walks.active.items():
        for how, made_from, setups in (
            ("without", files, bare),
            ("with", files, clean),
            ("the true file", exact, certain),
        ):
            found = [_errors(*one) for one in zip(trials, made_from, setups, strict=True)]
            rows.append((name, f"{cadence_hz:g} Hz", how, *_cells(found)))
    return rows


_HEAD: Final = tuple(
    f"{axis}: {what}" for axis in ("hip", "slide") for what in ("error", "sigma", "beyond 3 sigma")
)


def _columns(trial: Trial, file: File) -> Columns:
    made = trial.recording
    effort = made.effort + np.array([file.offset_nm, 0.0])
    return Columns(made.time_s, made.position, effort)


def _with_minute(file: File, passive: Trial) -> Setup:
    columns = _columns(passive, file)
    smooth = run_smoothed(setup_for(file.robot), columns)
    return setup_for(file.robot, known(baseline_of(smooth, columns, frictional(file.robot)), 0.0))


def _errors(trial: Trial, file: File, setup: Setup) -> tuple[Values, Values]:
    """Errors of the patient and their sigma where both axes are valid."""
    columns = _columns(trial, file)
    found = run(setup, columns)
    settled = columns.time_s - columns.time_s[0] > SETTLED_S
    rows = settled & trial.judged & (found.validity == Validity.OK).all(axis=1)
    error = found.state[rows][:, PATIENT] - trial.truth[rows][:, PATIENT]
    return error, found.std[rows][:, PATIENT]


def _cells(found: Sequence[tuple[Values, Values]]) -> list[Cell]:
    cells: list[Cell] = []
    for axis, unit in enumerate(UNITS):
        pairs = [(error[:, axis], std[:, axis]) for error, std in found]
        cells.append(measured((rms(error) for error, _ in pairs), unit))
        cells.append(measured((rms(std) for _, std in pairs), unit))
        beyond = (float(100.0 * np.mean(np.abs(error) > SIGMAS * std)) for error, std in pairs)
        cells.append(measured(beyond, "%"))
    return cells
