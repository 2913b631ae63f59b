"""Trials with the patient of a recorded effort, over several seeds."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from gaitd_lab.trial import Trial
from gaitd_lab.trials import Progress, Situation, Trials
from sim_drives.plant.settings import HipEffort, Programme, Recorded, SlideEffort

NAME: Final = "measured"
HIP_NM: Final = 10.0
"""Largest torque: a little more than that of the patient `active`."""
CADENCES_HZ: Final = (0.25, 0.5)
SEEDS: Final = 10
STRIDES: Final = 15
"""In a trial; the first two are not judged."""
DAY_S: Final = 86400.0
RISE_S: Final = 1.0


def patient(file: Path) -> Programme:
    """Return a patient who exerts the recorded hip torque while the leg walks."""
    effort = Recorded(
        at_s=0.0,
        until_s=DAY_S,
        rise_s=RISE_S,
        fall_s=RISE_S,
        hip=HipEffort(torque_nm=HIP_NM),
        slide=SlideEffort(force_n=0.0),
        file=str(file.absolute()),
    )
    return Programme(NAME, effort=(effort,))


def record(
    config: Path, file: Path, cadence_hz: float, stage: Callable[[str], Progress]
) -> Iterator[Trial]:
    """Record a gait for each seed.

    Raises:
        TrialError: the service refused it.
        ConfigError: the configuration, or the patient's file.
    """
    trials = Trials(config, programmes=(patient(file),))
    for seed in range(1, SEEDS + 1):
        situation = Situation(cadence_hz=cadence_hz, programme=NAME, seed=seed)
        yield trials.gait(situation, STRIDES / cadence_hz, stage(f"{situation.name}, seed {seed}"))
