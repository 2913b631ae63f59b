"""How right the patient and the work of strides are in gait, over several seeds of all noise.

On the plant with bristles the observer runs twice over each walk: with eq. (11), as in the robot
file, and with the bristles that `gaitd calibrate` finds on the empty machine.
"""

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import stride_figure
from analysis.calibration.session import calibrate
from analysis.recording import Recording, RecordingError
from analysis.replay import Source, filter_setup, setup_for
from daemon.config.settings import Robot
from gaitd_lab.excitation import EmptyMachine, NotPlayedError
from gaitd_lab.studies import wrong_file
from gaitd_lab.studies.experiment.measures import covered, rms
from gaitd_lab.studies.report import Cell, Report, Table, measured, of_leg
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Situation, Trials
from observer.filter.states import PATIENT, VELOCITY
from observer.filter.status import Validity
from observer.offline import batch, smooth_batch
from observer.offline.batch import Columns
from observer.strides import Stride, strides_of
from sim_drives.plant.settings import FrictionLaw

GAIT_S: Final = 30.0
DRAWN_S: Final = 60.0
STEADY: Final = 2
"""The first stride begins with the approach, and is not counted."""
LAWS: Final = {FrictionLaw.PAPER: "the observer's own friction law", FrictionLaw.LUGRE: "bristles"}
CALIBRATED: Final = ", calibrated"
EMPTY_RUNS: Final = ("friction_hip", "friction_slide")
"""Scenarios of the empty machine to calibrate from."""
CADENCES_HZ: Final = (0.25, 0.5)
ACTIVE: Final = "active"
PASSIVE: Final = "passive"
HEAD: Final = ("plant", "cadence", "patient", "hip", "slide")

Values = NDArray[np.float64]
Figures = dict[str, tuple[float | None, float | None]]
"""Values of hip and slide by name."""
UNITS: Final = {
    "filter, rms error": ("N·m", "N"),
    "smoother, rms error": ("N·m", "N"),
    "filter, samples within 3 sigma": ("%", "%"),
    "smoother, samples within 3 sigma": ("%", "%"),
    "work of a stride with the motion, true": ("J", "J"),
    "work of a stride with the motion, error": ("%", "%"),
    "work of a stride with the motion, estimated": ("J", "J"),
}


class Case(NamedTuple):
    """A situation, once for each seed."""

    situation: Situation
    figures: list[Figures]
    observer: str = ""
    """What is not the robot file's in the observer."""
    leg: str = ""


def study(config: Path, seeds: int, begin: Callable[[str], Callable[[float], None]]) -> Report:
    """Walk with every plant and cadence, and compare with the truth.

    Raises:
        TrialError: the service refused the gait.
        NotPlayedError: it refused a scenario of the empty machine, or stopped in it.
        RecordingError: no bristles can be calibrated.
    """
    draws = range(1, seeds + 1)
    tables = *_tables(cases(config, draws, begin)), wrong_file.table(config, draws, begin)
    figures = _figures(config, begin("picture"))
    return Report("strides", "The patient's effort and work in gait", tables, figures)


def cases(
    config: Path, seeds: Sequence[int], begin: Callable[[str], Callable[[float], None]]
) -> list[Case]:
    """Walk with every plant and cadence, the patient active and passive.

    Raises:
        TrialError: the service refused the gait.
        NotPlayedError: it refused a scenario of the empty machine, or stopped in it.
        RecordingError: no bristles can be calibrated.
    """
    machines = [Trials(config, seed=seed) for seed in seeds]
    bristled = _bristled(config, machines[0].robot, begin)
    found: list[Case] = []
    for law, cadence_hz, programme in product(LAWS, CADENCES_HZ, (ACTIVE, PASSIVE)):
        situation = Situation(law, cadence_hz, programme)
        told = begin(situation.name)
        walks = [trials.gait_of_legs(situation, GAIT_S, told) for trials in machines]
        for leg in machines[0].legs:
            own = [walk[leg] for walk in walks]
            found.append(Case(situation, [measure(one, one.robot) for one in own], leg=leg))
            if law is FrictionLaw.LUGRE:
                figures = [measure(one, bristled) for one in own]
                found.append(Case(situation, figures, CALIBRATED, leg))
    return sorted(found, key=lambda case: (list(LAWS).index(case.situation.law), case.observer))


def _bristled(config: Path, robot: Robot, begin: Callable[[str], Callable[[float], None]]) -> Robot:
    """Return the robot with the bristles of the plant, calibrated on its empty machine."""
    machine = EmptyMachine(config, FrictionLaw.LUGRE)
    sources: list[Source] = []
    for scenario in EMPTY_RUNS:
        played = machine.play(scenario, machine.longest_s(scenario), begin(f"{scenario}, bristles"))
        if played.trouble:
            raise NotPlayedError(f"{scenario}: {played.trouble}")
        run = played.run
        recorded = Recording(scenario, run.time_s, run.measured, run.exerted)
        sources.append(Source(recorded, None, "", None))
    progress = begin("calibrating bristles")
    made = calibrate(sources, machine.settings.robot, progress=lambda _, share: progress(share))
    if why := made.refused or made.needless or made.why_eq_11:
        raise RecordingError(why)
    replace = msgspec.structs.replace
    found = made.robot.observer
    tuning = replace(robot.observer, integrator=found.integrator, substeps=found.substeps)
    return replace(robot, friction=made.robot.friction, observer=tuning)


def measure(trial: Trial, robot: Robot) -> Figures:
    """Compare filter, smoother and strides of an observer's robot file with a trial's truth."""
    made = trial.recording
    columns = Columns(made.time_s, made.position, made.effort)
    setup = filter_setup(robot)
    filtered, smooth = batch.run(setup, columns), smooth_batch.run_smoothed(setup, columns)
    strides = strides_of(smooth, columns)[STEADY - 1 :]
    first = strides[0][0] if strides else len(made.time_s)
    rows = np.arange(len(made.time_s)) >= first
    true = trial.truth[:, PATIENT]
    figures: Figures = {}
    for name, one in (("filter", filtered), ("smoother", smooth)):
        error = np.where(one.validity == Validity.OK, one.state[:, PATIENT] - true, np.nan)
        judged = error[rows & trial.judged], one.std[rows & trial.judged][:, PATIENT]
        figures[f"{name}, rms error"] = rms(judged[0][:, 0]), rms(judged[0][:, 1])
        hip, slide = (_within_percent(judged[0][:, axis], judged[1][:, axis]) for axis in range(2))
        figures[f"{name}, samples within 3 sigma"] = hip, slide
    if strides:
        power = np.maximum(true * trial.truth[:, VELOCITY], 0.0)
        figures |= _works(strides, power, np.diff(made.time_s, append=made.time_s[-1:]))
    return figures


def _within_percent(error: Values, std: Values) -> float | None:
    share = covered(error[np.isfinite(error)], std[np.isfinite(error)])
    return None if share is None else 100.0 * share


def _figures(config: Path, progress: Callable[[float], None]) -> dict[str, Figure]:
    """Draw the strides of an active patient on the machine of a trainer file, with its own seed."""
    walks = Trials(config).gait_of_legs(Situation(programme=ACTIVE), DRAWN_S, progress)
    figures: dict[str, Figure] = {}
    for leg, walk in walks.items():
        made = walk.recording
        columns = Columns(made.time_s, made.position, made.effort)
        smooth = smooth_batch.run_smoothed(setup_for(walk.robot), columns)
        name = f"{leg}_{ACTIVE}" if len(walks) > 1 else ACTIVE
        figures[name] = stride_figure.draw(strides_of(smooth, columns), made.time_s, smooth)
    return figures


def _works(strides: Sequence[tuple[int, Stride]], power: Values, steps_s: Values) -> Figures:
    estimated = np.mean(
        [(one.hip.work_positive_j, one.slide.work_positive_j) for _, one in strides], axis=0
    )
    true = np.mean(
        [
            (power * steps_s[:, None])[row : row + one.sample_count].sum(axis=0)
            for row, one in strides
        ],
        axis=0,
    )
    names = list(UNITS)[4:]
    if not np.all(true > 0.0):
        return {names[2]: tuple(estimated.tolist())}
    return {
        names[0]: tuple(true.tolist()),
        names[1]: tuple((100 * (estimated / true - 1)).tolist()),
    }


def _tables(found: Sequence[Case]) -> list[Table]:
    """Return a table of each leg."""
    legs = list(dict.fromkeys(case.leg for case in found))
    return [
        Table(
            f"Filter, smoother and strides beside the truth{of_leg(leg, legs)}",
            HEAD,
            _rows([case for case in found if case.leg == leg]),
        )
        for leg in legs
    ]


def _rows(found: Sequence[Case]) -> list[tuple[Cell, ...]]:
    """Return all figures, a row each: plant, cadence, patient and figure, hip, slide."""
    rows: list[tuple[Cell, ...]] = []
    for case in found:
        law, cadence_hz, programme, *_ = case.situation
        for name, units in UNITS.items():
            pairs = [figures[name] for figures in case.figures if name in figures]
            if pairs:
                hip, slide = (
                    measured((pair[axis] for pair in pairs), units[axis]) for axis in range(2)
                )
                words = f"{cadence_hz:g} Hz", f"{programme}: {name}"
                rows.append((LAWS[law] + case.observer, *words, hip, slide))
    return rows
