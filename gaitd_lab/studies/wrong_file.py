"""The patient where the robot file differs from the machine, without a baseline and with one.

The machine stays as it is, and the observer gets a file with other numbers. So one walk with a
passive patient, from which the baseline comes, and one with an active patient do for all rows of a
rigid machine. A machine whose transmission gives way walks on its own, with the file of a rigid one
and with one that says so; so does one whose friction has fallen since its baseline.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from analysis.replay import filter_setup, setup_for
from daemon.config.robot import (
    considered,
    friction_over_position,
    friction_parameters,
    frictional,
    leg_parameters,
    observer_tuning,
)
from daemon.config.settings import HipTransmission, Robot, SlideTransmission, Transmission
from gaitd_lab.studies.experiment.measures import rms
from gaitd_lab.studies.report import Cell, Table, measured, of_leg
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials
from observer.baseline import Baseline, NotPassiveError, Since, baseline_of, known
from observer.filter.considered import (
    DRIVES,
    LEG_COUNT,
    NOTHING_KNOWN,
    OTHER_FRICTION,
    SLIDE_FRICTION,
    SLOPES,
    Drives,
    Known,
    Slopes,
    Variant,
    table_of,
)
from observer.filter.leg_observer import Setup, setup_of, with_baseline
from observer.filter.states import FRICTION, PATIENT
from observer.filter.status import Validity
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from sim_drives.plant.settings import HipElasticity, PlantTransmission

MINUTE_S: Final = 60.0
WALK_S: Final = 30.0
SETTLED_S: Final = 5.0
SEEN_S: Final = 12.0
"""Three strides of the minute. They show what a filter keeps when it begins anew: whether the
hip's transmission is stiff."""
CADENCES_HZ: Final = (0.25, 0.35)
"""The baseline is that of the first one."""
SIGMAS: Final = 3.0
UNITS: Final = ("N·m", "N")
SLOPE_SI: Final = 0.45
"""1/rad or 1/m: friction rises by 15 % from the middle of the gait to its end."""
FALLS_RATIO: Final = 0.25
FALLS_S: Final = 600.0
AGES_S: Final = (60.0, 180.0, 300.0, 420.0, 540.0)
"""The middle of each piece of `FALLS_S`, for which a walk stands: friction is constant in it."""
DRAWS: Final = 200
DRAWN_SEED: Final = 44

Values = NDArray[np.float64]
T = TypeVar("T")


class File(NamedTuple):
    """What the observer takes for true of the machine."""

    robot: Robot
    offset_nm: float = 0.0
    """Added to the torque that the hip's drive shows."""
    drawn: Values | None = None
    """How far each parameter of [uncertainty] is off, in its standard deviations; None: none is.

    Parameters that act together are added up: the physics is that of `considered`, to first order.
    """


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


def rising_friction(robot: Robot, slope_si: float) -> Robot:
    """The file of a machine whose friction rises along both axes."""
    over = robot.friction_over_position
    hip, slide = (
        replace(over.hip, slope_per_rad=slope_si),
        replace(over.slide, slope_per_m=slope_si),
    )
    return replace(robot, friction_over_position=replace(over, hip=hip, slide=slide))


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
    "friction 15 % over position": lambda robot: File(rising_friction(robot, SLOPE_SI)),
    "torque offset 1 N·m": lambda robot: File(robot, 1.0),
    "recline 1°": lambda robot: File(reclined(robot, 1.0)),
    "everything a little": a_little_of_all,
}


def drawn(number: int) -> Callable[[Robot], File]:
    """The file of a machine that is drawn from what [uncertainty] states."""

    def made(robot: Robot) -> File:
        rng = np.random.default_rng((DRAWN_SEED, number))
        return File(robot, drawn=rng.normal(size=len(considered(robot))))

    return made


class Machine(NamedTuple):
    """A machine whose transmission gives way, which the file does not say."""

    transmission: PlantTransmission
    file: Transmission
    """What a file that is right says of it."""


def soft_hip(stiffness_nm_per_rad: float, damping: float, backlash_rad: float) -> Machine:
    """A machine with this transmission at the hip and a rigid one at the slide."""
    return Machine(
        PlantTransmission(
            hip=HipElasticity(
                stiffness_nm_per_rad=stiffness_nm_per_rad,
                damping_nm_s_per_rad=damping,
                backlash_rad=backlash_rad,
            )
        ),
        Transmission(
            hip=HipTransmission(
                stiffness_nm_per_rad=stiffness_nm_per_rad, backlash_rad=backlash_rad
            ),
            slide=SlideTransmission(stiffness_n_per_m=0.0, backlash_m=0.0),
        ),
    )


MACHINES: Final = {
    "an elastic hip drive, 800 N·m/rad": soft_hip(800.0, 5.0, 0.0),
    "a loose hip drive, 0.3°, 4000 N·m/rad": soft_hip(4000.0, 20.0, np.radians(0.3)),
}
RIGID: Final = PlantTransmission()


def table(
    config: Path, seeds: Sequence[int], begin: Callable[[str], Callable[[float], None]]
) -> Table:
    """Walk passively and actively, and estimate with each file.

    Raises:
        TrialError: the service refused the gait.
    """
    machines = [Trials(config, seed=seed) for seed in seeds]

    def walks(transmission: PlantTransmission, of: str) -> dict[str, _Walks]:
        """Walk with all legs; return the words for each leg, and its walks."""

        def walked(programme: str, cadence_hz: float, duration_s: float) -> list[dict[str, Trial]]:
            situation = Situation(
                cadence_hz=cadence_hz, programme=programme, transmission=transmission
            )
            told = begin(f"{of}, {programme}, {cadence_hz:g} Hz")
            return [trials.gait_of_legs(situation, duration_s, told) for trials in machines]

        legs = machines[0].legs
        passive = walked("passive", CADENCES_HZ[0], MINUTE_S)
        active = {cadence_hz: walked("active", cadence_hz, WALK_S) for cadence_hz in CADENCES_HZ}
        return {
            of_leg(leg, legs): _Walks(
                [one[leg] for one in passive],
                {cadence_hz: [one[leg] for one in made] for cadence_hz, made in active.items()},
            )
            for leg in legs
        }

    rows: list[tuple[Cell, ...]] = []
    rigid = walks(RIGID, "rigid")
    draws = [drawn(number) for number in range(DRAWS)]
    for leg, own in rigid.items():
        for name, changed in FILES.items():
            rows += _rows(name + leg, own, [changed], _same, begin)
        rows += _rows(f"{DRAWS} draws from [uncertainty]{leg}", own, draws, _same, begin)
    rows += _falling_rows(config, seeds, rigid, begin)
    for name, machine in MACHINES.items():
        for leg, own in walks(machine.transmission, name).items():
            true = partial(replace, transmission=machine.file)
            rows += _rows(name + leg, own, [File], true, begin)
    head = ("file differs by", "cadence", "baseline", *_HEAD)
    return Table("A robot file that differs from the machine", head, rows)


class _Walks(NamedTuple):
    passive: Sequence[Trial]
    active: Mapping[float, Sequence[Trial]]
    """By cadence."""


def _same(robot: Robot) -> Robot:
    return robot


def _rows(
    name: str,
    walks: _Walks,
    changes: Sequence[Callable[[Robot], File]],
    true: Callable[[Robot], Robot],
    begin: Callable[[str], Callable[[float], None]],
) -> list[tuple[Cell, ...]]:
    """Rows of one kind of file: the spread over its files and trials.

    Of several files also all their samples as one.
    """
    files = [[changed(trial.robot) for changed in changes] for trial in walks.passive]
    exact = [[File(true(trial.robot))] for trial in walks.passive]
    bare = [[_setup(one) for one in some] for some in files]
    try:
        clean = [
            [
                _setup(one, known(_minute(one, passive), Since()))
                for one in _shown(some, begin(f"{name}, baseline"))
            ]
            for some, passive in zip(files, walks.passive, strict=True)
        ]
    except NotPassiveError:
        clean = None
    certain = [[filter_setup(one.robot) for one in some] for some in exact]
    rows: list[tuple[Cell, ...]] = []
    none = [None] * len(walks.passive)
    for cadence_hz, trials in walks.active.items():
        for how, made_from, setups, minutes in (
            ("without", files, bare, none),
            ("with", files, clean, walks.passive),
            ("the true file", exact, certain, none),
        ):
            if setups is None:
                rows.append((name, f"{cadence_hz:g} Hz", "refused", *("",) * len(_HEAD)))
                continue
            pairs = [
                (trial, *one, minute)
                for trial, some, theirs, minute in zip(
                    trials, made_from, setups, minutes, strict=True
                )
                for one in zip(some, theirs, strict=True)
            ]
            told = begin(f"{name}, {cadence_hz:g} Hz, {how}")
            found = [_errors(*pair) for pair in _shown(pairs, told)]
            rows.append((name, f"{cadence_hz:g} Hz", how, *_cells(found)))
            if len(found) > len(trials):
                all_name = f"all samples of {name}"
                rows.append((all_name, f"{cadence_hz:g} Hz", how, *_cells([_as_one(found)])))
    return rows


def _falling_rows(
    config: Path,
    seeds: Sequence[int],
    rigid: Mapping[str, _Walks],
    begin: Callable[[str], Callable[[float], None]],
) -> list[tuple[Cell, ...]]:
    """Rows of friction that falls after the baseline, all samples of its fall as one."""
    name = f"friction falls by {100 * FALLS_RATIO:g} % in {FALLS_S / 60:g} minutes"
    try:
        minutes = {
            leg: [_minute(File(one.robot), one) for one in own.passive]
            for leg, own in rigid.items()
        }
    except NotPassiveError:
        return [(name, "", "refused", *("",) * len(_HEAD))]
    found: dict[tuple[str, float, str], list[_Errors]] = {}
    for cadence_hz, age_s, (number, seed) in product(CADENCES_HZ, AGES_S, enumerate(seeds)):
        file = File(next(iter(rigid.values())).passive[number].robot)
        fallen = more_friction(file.robot, 1.0 - FALLS_RATIO * age_s / FALLS_S)
        told = begin(f"{name}, after {age_s:g} s, {cadence_hz:g} Hz")
        situation = Situation(cadence_hz=cadence_hz, programme="active")
        walked = Trials(config, fallen, seed=seed).gait_of_legs(situation, WALK_S, told)
        for leg, trial in zip(rigid, walked.values(), strict=True):
            passive = rigid[leg].passive[number]
            of_minute = known(minutes[leg][number], Since(age_s))
            for how, errors in (
                ("without", _errors(trial, file, _setup(file))),
                ("with", _errors(trial, file, _setup(file, of_minute), passive)),
                ("the true file", _errors(trial, File(fallen), filter_setup(fallen))),
            ):
                found.setdefault((leg, cadence_hz, how), []).append(errors)
    return [
        (name + leg, f"{cadence_hz:g} Hz", how, *_cells([_as_one(errors)]))
        for (leg, cadence_hz, how), errors in found.items()
    ]


def _shown(every: Sequence[T], told: Callable[[float], None]) -> Iterator[T]:
    """Yield them all; tell before each how many are done, from 0 to 1."""
    for number, one in enumerate(every):
        told(number / len(every))
        yield one


_OF_AXIS: Final = "error", "sigma", "beyond 3 sigma", "friction beyond 3 sigma", "valid"
_HEAD: Final = tuple(f"{axis}: {what}" for axis in ("hip", "slide") for what in _OF_AXIS)


class _Errors(NamedTuple):
    """Errors of one walk and their sigmas where both axes are valid, (n, 2)."""

    patient: Values
    patient_std: Values
    friction: Values
    friction_std: Values
    valid: Values
    """1 where an axis that moves is valid and 0 where not, NaN where it rests; all rows, (m, 2)."""


def _columns(trial: Trial, file: File) -> Columns:
    made = trial.recording
    effort = made.effort + np.array([file.offset_nm, 0.0])
    if file.drawn is None:
        return Columns(made.time_s, made.position, effort)
    ratio, offset, shift = np.array(_off(file.robot, file.drawn).drives).reshape(3, 2)
    return Columns(made.time_s, made.position + shift, effort * ratio + offset)


def _off(robot: Robot, deviations: Values) -> Variant:
    """The physics of a robot file that is off."""
    own, steps = _steps(robot)
    return _variant_of(own + deviations @ steps)


def _steps(robot: Robot) -> tuple[Values, Values]:
    """The physics of a robot file, and what each of its parameters that is not sure adds to it."""
    own = Variant(leg_parameters(robot), *friction_parameters(robot))
    unsure = considered(robot)
    first, *rows = table_of(own, (own, *unsure))[: 1 + len(unsure), :OTHER_FRICTION]
    return first, np.array(rows) - first


def _variant_of(row: Values) -> Variant:
    """The inverse of `table_of`, without its marks."""
    pieces = np.split(row, (LEG_COUNT, SLIDE_FRICTION, DRIVES, SLOPES))
    leg, hip, slide, drives, slopes = (piece.tolist() for piece in pieces)
    return Variant(
        LegParameters(*leg),
        FrictionParameters(*hip),
        FrictionParameters(*slide),
        Drives(*drives),
        Slopes(*slopes),
    )


def _setup(file: File, of_minute: Known = NOTHING_KNOWN) -> Setup:
    if file.drawn is None:
        return setup_for(file.robot, of_minute)
    off = _off(file.robot, file.drawn)
    own, steps = _steps(file.robot)
    place = own + file.drawn @ steps
    place[DRIVES:] = own[DRIVES:]  # what a variant shows otherwise is the change alone
    unsure = [_variant_of(place + step) for step in steps]
    hip, slide = friction_over_position(file.robot)
    over = (
        hip._replace(slope=hip.slope + off.slopes[0]),
        slide._replace(slope=slide.slope + off.slopes[1]),
    )
    tuning = observer_tuning(file.robot)._replace(friction_over_position=over)
    return with_baseline(setup_of(off.leg, off.hip, off.slide, tuning, unsure), of_minute)


def _minute(file: File, passive: Trial) -> Baseline:
    columns = _columns(passive, file)
    return baseline_of(run_smoothed(_setup(file), columns), columns, frictional(file.robot))


def _errors(trial: Trial, file: File, setup: Setup, minute: Trial | None = None) -> _Errors:
    """Estimate a walk with a file, and compare it with the truth.

    Args:
        trial: the walk.
        file: what the observer takes for true.
        setup: of this file.
        minute: of a baseline that is taken live, whose end the filter has seen; None: it begins
            with the walk.
    """
    columns = _columns(trial, file)
    found = run(setup, columns if minute is None else _after(_columns(minute, file), columns))
    state, std, validity = (
        rows[-len(columns.time_s) :] for rows in (found.state, found.std, found.validity)
    )
    judged = (columns.time_s - columns.time_s[0] > SETTLED_S) & trial.judged
    valid = validity == Validity.OK
    rows = judged & valid.all(axis=1)
    error, std = (state - trial.truth)[rows], std[rows]
    of_moving = np.where(trial.moving, valid.astype(float), np.nan)[judged]
    return _Errors(
        error[:, PATIENT], std[:, PATIENT], error[:, FRICTION], std[:, FRICTION], of_moving
    )


def _after(minute: Columns, walk: Columns) -> Columns:
    """A walk after the last SEEN_S of a minute, with a second without samples between them."""
    rows = minute.time_s > minute.time_s[-1] - SEEN_S
    seen_s = minute.time_s[rows]
    return Columns(
        np.concatenate((seen_s - seen_s[-1] + walk.time_s[0] - 1.0, walk.time_s)),
        np.concatenate((minute.position[rows], walk.position)),
        np.concatenate((minute.effort[rows], walk.effort)),
    )


def _as_one(found: Sequence[_Errors]) -> _Errors:
    """Join what was found with many files."""
    return _Errors(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _cells(found: Sequence[_Errors]) -> list[Cell]:
    cells: list[Cell] = []
    for axis, unit in enumerate(UNITS):
        cells.append(measured((rms(one.patient[:, axis]) for one in found), unit))
        cells.append(measured((rms(one.patient_std[:, axis]) for one in found), unit))
        patient = (_beyond(one.patient[:, axis], one.patient_std[:, axis]) for one in found)
        friction = (_beyond(one.friction[:, axis], one.friction_std[:, axis]) for one in found)
        cells += [measured(patient, "%"), measured(friction, "%")]
        valid = (float(100.0 * np.nanmean(one.valid[:, axis])) for one in found)
        cells.append(measured(valid, "%"))
    return cells


def _beyond(error: Values, std: Values) -> float:
    """Samples that are off by more than their sigma allows, %."""
    return float(100.0 * np.mean(np.abs(error) > SIGMAS * std))
