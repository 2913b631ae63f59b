"""Start of hand guiding and self-test, and the check for room before a self-test.

Gait and excitation begin in `requests.py`; the motion of all four over time is in
`trajectory.py`, `hand_guiding.py` and `self_test.py`.
"""

from itertools import accumulate
from typing import Final

import numpy as np

from daemon.core.motion import hand_guiding, leg_plan, self_test
from daemon.core.motion.hand_guiding import ReleasePlay
from daemon.core.motion.self_test import SelfTestPlay, Way
from daemon.core.motion.trajectory import Pair
from daemon.core.state import Core, Leg
from observer.mechanism.friction import static_friction_of
from observer.mechanism.mechanism import singularity_ratio

WAY_POINTS: Final = 20


def begin_hand_guiding(core: Core) -> None:
    """Begin hand guiding with every leg."""
    rules = core.config.hand_guiding
    for leg in core.legs:
        leg.plan = ReleasePlay(
            start=leg_plan.present(leg),
            leg=leg.parameters,
            guiding=hand_guiding.guiding_of(rules),
            stretched_stop_ratio=core.config.thresholds.singularity_stop_ratio,
            duration_s=rules.duration_max_s,
        )


def begin_self_test(core: Core) -> None:
    """Begin the self-test of each axis of each leg in turn.

    Requires that `refuse_self_test` returned an empty reason.
    """
    rules = core.config.self_test
    ways = [_ways(core, leg) for leg in core.legs]
    waits_s = accumulate((self_test.total_s(one) for one in ways), initial=0.0)
    for leg, its_ways, wait_s in zip(core.legs, ways, waits_s, strict=False):
        leg.plan = SelfTestPlay(
            start=leg_plan.present(leg),
            ways=its_ways,
            ratios=(rules.friction_min_ratio, rules.friction_max_ratio),
            wait_s=wait_s,
        )


def refuse_self_test(core: Core) -> str:
    """The reason why a self-test has no room at the present pose; empty if it has."""
    for leg in core.legs:
        start = leg_plan.present(leg)
        for index, axis in enumerate(leg.axes):
            if _direction(core, leg, start, index) == 0.0:
                return f"{axis.name} has no room to move a little: take the leg to another pose"
    return ""


def _ways(core: Core, leg: Leg) -> tuple[Way, Way]:
    start = leg_plan.present(leg)
    return _way(core, leg, start, 0), _way(core, leg, start, 1)


def _way(core: Core, leg: Leg, start: Pair, index: int) -> Way:
    rules = core.config.self_test
    speed_si = self_test.speeds(rules)[index]
    return Way(
        name=leg.axes[index].name,
        distance_si=_direction(core, leg, start, index) * self_test.distances(rules)[index],
        speed_si_per_s=speed_si,
        friction_si=static_friction_of(leg.friction[index], speed_si),
        load_tolerance_si=self_test.load_tolerances(rules)[index],
    )


def _direction(core: Core, leg: Leg, start: Pair, index: int) -> float:
    """Sign of the first direction with room for the whole way of one axis; 0 if there is none."""
    distance_si = self_test.distances(core.config.self_test)[index]
    for sign in (1.0, -1.0):
        parts = (sign * distance_si * k / WAY_POINTS for k in range(WAY_POINTS + 1))
        moved = (
            (start[0] + p, start[1]) if index == 0 else (start[0], start[1] + p) for p in parts
        )
        if all(_has_room(core, leg, pose) for pose in moved):
            return sign
    return 0.0


def _has_room(core: Core, leg: Leg, pose: Pair) -> bool:
    inside = all(
        axis.limits.position_min_si + axis.limits.soft_margin_si
        <= position_si
        <= axis.limits.position_max_si - axis.limits.soft_margin_si
        for axis, position_si in zip(leg.axes, pose, strict=True)
    )
    smallest = core.config.thresholds.singularity_stop_ratio
    return inside and float(singularity_ratio(leg.parameters, np.array(pose))) > smallest
