"""The trials of the ablation: recorded situations and their durations."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from daemon.config.settings import Robot
from gaitd_lab.studies.ablation.choices import friction_levels
from gaitd_lab.studies.ablation.errors import SEED, disturbed
from gaitd_lab.studies.ablation.questions import BASIS, OTHER_PLANTS, REST
from gaitd_lab.trial import Trial
from gaitd_lab.trials import Progress, Situation, Trials, balanced
from sim_drives.plant.settings import FrictionLaw

GAIT_S: Final = 30.0
EXCITE_S: Final = 25.0
REST_S: Final = 60.0
QUICK_S: Final = 8.0
QUICK_REST_S: Final = 15.0
CADENCES_HZ: Final = (0.25, 0.5)
ACTIVE: Final = "active"
WALKS: Final = ("passive", ACTIVE)
QUICK_BASIS: Final = "paper, 0.5 Hz, active"

Job = Callable[[Progress], Trial]


class Planned(NamedTuple):
    """A trial to record."""

    title: str
    record: Job
    is_basis: bool = False
    """True if distorted copies of the trial are made."""


def planned(config: Path, *, quick: bool, seed: int | None = None) -> list[Planned]:
    """Return the trials that the ablation records.

    Args:
        config: trainer file with a plant.
        quick: three short trials on the matched plant instead of all.
        seed: of all noise; None: plant.toml's.
    """
    trials = Trials(config, seed=seed)
    if quick:
        return [
            *(_walk(trials, Situation(cadence_hz=0.5, programme=name), QUICK_S) for name in WALKS),
            Planned(REST, partial(trials.rest, QUICK_REST_S)),
        ]
    gaits = product(FrictionLaw, CADENCES_HZ, WALKS)
    return [
        *(_walk(trials, Situation(*one), GAIT_S) for one in gaits),
        Planned("scenario paper", partial(trials.excite, "paper", EXCITE_S)),
        Planned(REST, partial(trials.rest, REST_S)),
        *_others(config, trials, seed),
    ]


def record(
    plan: Sequence[Planned], progress: Callable[[str], Progress], seed: int = SEED
) -> Iterator[Trial]:
    """Record the trials of a plan in sequence, and the distorted copies of its basis.

    Args:
        plan: result of `planned`.
        progress: receives the title of a trial, and returns a callback for its progress.
        seed: of the distortions.
    """
    for one in plan:
        trial = one.record(progress(one.title))
        yield trial
        if one.is_basis:
            yield from disturbed(trial, seed)


def _walk(trials: Trials, situation: Situation, duration_s: float) -> Planned:
    name = situation.name
    basis = BASIS if duration_s == GAIT_S else QUICK_BASIS
    return Planned(name, partial(trials.gait, situation, duration_s), name == basis)


def _others(config: Path, trials: Trials, seed: int | None) -> Iterator[Planned]:
    """Trials with other plants and patients, whose robot file is right."""
    robots = (
        friction_levels(0.5)(trials.robot),
        friction_levels(2.0)(trials.robot),
        _weighing(trials, 50.0),
        _weighing(trials, 110.0),
    )
    for name, robot in zip(OTHER_PLANTS, robots, strict=True):
        yield Planned(name, _active_walk(name, Trials(config, robot, seed=seed)))


def _active_walk(name: str, trials: Trials) -> Job:
    return lambda progress: trials.gait(Situation(programme=ACTIVE), GAIT_S, progress).named(name)


def _weighing(trials: Trials, mass_kg: float) -> Robot:
    """Return a robot with another patient, carried by springs set for that patient."""
    robot = trials.robot
    if robot.patient is None:
        return robot
    patient = msgspec.structs.replace(robot.patient, mass_kg=mass_kg)
    return balanced(msgspec.structs.replace(robot, patient=patient), trials.start_pose)
