"""Standard deviation of a torque sample about the mean torque over its cycle.

In torque mode the target is constant between two SYNCs, so the sample at its end is the mean. In
position mode the drive's loops change the current each millisecond. The target's speed steps at
every SYNC (60C2h: a line to each target): a stiff velocity loop accelerates the joint soon after
the SYNC, a soft one evenly. A sample at the end of the cycle can miss all or nothing of that
effort. The drive's loop is not known, so half of the inertia's effort is the standard deviation.
The error keeps its sign as long as the acceleration does: it is not white noise.
"""

from typing import Final

import numpy as np

from daemon.core.state import Axis, Leg
from drives.cia402.torque import TorqueSampling
from observer.mechanism.mechanism import mass_matrix

MISSED_RATIO: Final = 0.5
"""Standard deviation divided by the effort of inertia. The virtual drives miss 0.3 of it."""


def effort_std(leg: Leg) -> tuple[float, float]:
    """Standard deviation of this cycle's efforts about their means over the cycle: N·m, N."""
    hip, slide = leg.axes
    acceleration = _missed_si(hip), _missed_si(slide)
    pose_known = (
        leg.placed.singularity_ratio > 0 and hip.sensed.referenced and slide.sensed.referenced
    )
    if acceleration == (0.0, 0.0) or not pose_known:
        return 0.0, 0.0  # no acceleration was sent, or the pose is not known
    pose = np.array((hip.sensed.joint.position_si, slide.sensed.joint.position_si))
    hip_nm, slide_n = mass_matrix(leg.parameters, pose) @ np.array(acceleration)
    return MISSED_RATIO * abs(float(hip_nm)), MISSED_RATIO * abs(float(slide_n))


def _missed_si(axis: Axis) -> float:
    """The acceleration sent whose effort the sample can miss; 0 for a drive that filters it."""
    return 0.0 if axis.torque_sampling is TorqueSampling.FILTERED else axis.sent.acceleration_si
