"""How right the patient and the work of strides are in gait, over several seeds of all noise."""

from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis import stride_figure
from analysis.experiment import rms
from analysis.replay import setup_for
from analysis.spread import in_words, spread
from analysis.trial import Trial
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
    "work of a stride with the motion, true": ("J", "J"),
    "work of a stride with the motion, error": ("%", "%"),
    "work of a stride with the motion, estimated": ("J", "J"),
}


class Case(NamedTuple):
    """A situation, once for each seed."""

    situation: Situation
    figures: list[Figures]


def cases(
    config: Path, seeds: Sequence[int], begin: Callable[[str], Callable[[float], None]]
) -> list[Case]:
    """Walk with every plant and cadence, the patient active and passive.

    Raises:
        TrialError: the service refused the gait.
    """
    machines = [Trials(config, seed=seed) for seed in seeds]
    found: list[Case] = []
    for law, cadence_hz, programme in product(LAWS, CADENCES_HZ, (ACTIVE, PASSIVE)):
        situation = Situation(law, cadence_hz, programme)
        figures = [
            measure(trials.gait(situation, GAIT_S, begin(situation.name))) for trials in machines
        ]
        found.append(Case(situation, figures))
    return found


def measure(trial: Trial) -> Figures:
    """Compare filter, smoother and strides of a trial with the truth."""
    made = trial.recording
    columns = Columns(made.time_s, made.position, made.effort)
    setup = setup_for(trial.robot)
    filtered, smooth = batch.run(setup, columns), smooth_batch.run_smoothed(setup, columns)
    strides = strides_of(smooth, columns)[STEADY - 1 :]
    first = strides[0][0] if strides else len(made.time_s)
    rows = np.arange(len(made.time_s)) >= first
    true = trial.truth[:, PATIENT]
    errors = (
        np.where(one.validity == Validity.OK, one.state[:, PATIENT] - true, np.nan)
        for one in (filtered, smooth)
    )
    figures: Figures = {
        name: (rms(error[rows & trial.judged, 0]), rms(error[rows & trial.judged, 1]))
        for name, error in zip(UNITS, errors, strict=False)
    }
    if strides:
        power = np.maximum(true * trial.truth[:, VELOCITY], 0.0)
        figures |= _works(strides, power, np.diff(made.time_s, append=made.time_s[-1:]))
    return figures


def draw(config: Path, path: Path, progress: Callable[[float], None]) -> None:
    """Draw the strides of an active patient on the machine of a trainer file, with its own seed.

    Raises:
        TrialError: the service refused the gait.
        OSError: the file cannot be written.
    """
    walk = Trials(config).gait(Situation(programme=ACTIVE), DRAWN_S, progress)
    made = walk.recording
    columns = Columns(made.time_s, made.position, made.effort)
    smooth = smooth_batch.run_smoothed(setup_for(walk.robot), columns)
    stride_figure.draw(strides_of(smooth, columns), made.time_s, smooth, path)


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
    names = list(UNITS)[2:]
    if not np.all(true > 0.0):
        return {names[2]: tuple(estimated.tolist())}
    return {
        names[0]: tuple(true.tolist()),
        names[1]: tuple((100 * (estimated / true - 1)).tolist()),
    }


def table(found: Sequence[Case]) -> list[tuple[str, ...]]:
    """Format all figures, a row each: plant, cadence, patient and figure, hip, slide."""
    rows: list[tuple[str, ...]] = []
    for case in found:
        law, cadence_hz = case.situation.law, case.situation.cadence_hz
        programme = case.situation.programme
        for name, units in UNITS.items():
            pairs = [figures[name] for figures in case.figures if name in figures]
            if pairs:
                hip, slide = (
                    in_words(spread(pair[axis] for pair in pairs), units[axis]) for axis in range(2)
                )
                rows.append((LAWS[law], f"{cadence_hz:g} Hz", f"{programme}: {name}", hip, slide))
    return rows
