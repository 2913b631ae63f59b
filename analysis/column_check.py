"""Swapped columns and wrong signs of a recording: an effort that no patient explains as well.

The observer attributes to the patient whatever the mechanism does not explain. A wrong sign of an
effort makes a patient of twice the machine's own effort, who pushes with every motion; swapped
columns make one of many times the friction. Where the patient of a recording is that large, the
recording is estimated again with each arrangement of ARRANGEMENTS: one that leaves a third of the
patient or less explains it better. A patient who does more than 1.5 times what the motion needs
looks like a wrong sign, so the report says both.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from analysis.replay import Source, estimate
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from observer.filter.status import Validity
from observer.offline.batch import BatchEstimates

SUSPICIOUS_LEVELS: Final = 1.0
"""Median effort of the patient, in Coulomb levels of its axis, above which others are tried."""
BETTER_RATIO: Final = 1.0 / 3.0
"""Share of the patient that an arrangement may leave."""
LEVELS_MAX: Final = 10.0
"""Levels of a recording in which an axis is BAD in most rows."""
SAMPLES_MIN: Final = 100
"""Valid samples of an axis without which nothing is known of it: a second."""
TRIED_ROWS: Final = 60_000
"""Rows that are estimated again at most: ten minutes, a third of a second."""


class Arrangement(NamedTuple):
    """Another reading of the columns."""

    words: str
    positions: tuple[int, int] = (0, 1)
    """Columns that hip angle and slide position are taken from."""
    efforts: tuple[int, int] = (0, 1)
    signs: tuple[float, float] = (1.0, 1.0)
    """Signs of the efforts, after their columns were exchanged."""


ARRANGEMENTS: Final = (
    Arrangement("hip_torque_nm with the other sign", signs=(-1.0, 1.0)),
    Arrangement("slide_force_n with the other sign", signs=(1.0, -1.0)),
    Arrangement("hip_torque_nm and slide_force_n with the other sign", signs=(-1.0, -1.0)),
    Arrangement("hip_torque_nm and slide_force_n swapped", efforts=(1, 0)),
    Arrangement("hip_angle_rad and slide_position_m swapped", positions=(1, 0)),
    Arrangement("the columns of hip and slide swapped", positions=(1, 0), efforts=(1, 0)),
)


class Suspicion(NamedTuple):
    """An arrangement that explains a recording better than its own."""

    arrangement: Arrangement
    coulomb_ratio: float
    """Median patient of the recording, of the axis with more, in Coulomb levels."""
    arranged_ratio: float
    """The same with the arrangement."""


def suspicion(source: Source, robot: Robot, estimates: BatchEstimates) -> Suspicion | None:
    """Return the arrangement that explains a recording best, if its own does not.

    Args:
        source: the recording.
        robot: as estimated with.
        estimates: of all its rows.
    """
    levels = _levels(estimates, robot)
    if not levels >= SUSPICIOUS_LEVELS:
        return None
    part = _first_rows(source)
    found = [
        Suspicion(one, levels, _levels(estimate(arranged(part, one), robot), robot))
        for one in ARRANGEMENTS
    ]
    better = [one for one in found if one.arranged_ratio <= BETTER_RATIO * levels]
    return min(better, key=lambda one: one.arranged_ratio, default=None)


def arranged(source: Source, arrangement: Arrangement) -> Source:
    """Read the columns of a source in another way."""
    made = source.recording
    position = np.ascontiguousarray(made.position[:, arrangement.positions])
    effort = made.effort[:, arrangement.efforts] * np.array(arrangement.signs)
    return source._replace(recording=replace(made, position=position, effort=effort))


def _first_rows(source: Source) -> Source:
    made, bits, rows = source.recording, source.caller_bits, slice(TRIED_ROWS)
    part = replace(
        made, time_s=made.time_s[rows], position=made.position[rows], effort=made.effort[rows]
    )
    return source._replace(recording=part, caller_bits=None if bits is None else bits[rows])


def _levels(estimates: BatchEstimates, robot: Robot) -> float:
    """Median effort of the patient in Coulomb levels, of the axis with more; NaN if none moves."""
    if np.mean(estimates.validity == Validity.BAD) > 0.5:
        return LEVELS_MAX
    levels: list[float] = []
    for axis, law in enumerate(friction_parameters(robot)):
        valid = estimates.validity[:, axis] == Validity.OK
        if np.count_nonzero(valid) >= SAMPLES_MIN:
            median = np.median(np.abs(estimates.state[valid, 6 + axis]))
            levels.append(float(median) / law.coulomb)
    return max(levels, default=np.nan)
