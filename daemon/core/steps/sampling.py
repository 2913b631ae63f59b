"""How far a torque sample may be from the torque that acted over its cycle.

In torque mode the target is constant between two SYNCs, so the sample at its end is the mean. In
position mode the drive's loops change the current each millisecond. Where the target's speed steps
at every SYNC (60C2h: a line to each target), a stiff velocity loop gives what accelerates the
joint soon after the SYNC, a soft one evenly; a sample taken at the end of the cycle has missed of
it anything between all and nothing. Nobody here knows the loop, so half of the inertia's effort is
the standard deviation. It leans to one side for as long as the acceleration does: no white noise.
"""

from typing import Final

import numpy as np

from daemon.core.state import Leg
from drives.cia402.torque import TorqueSampling
from observer.mechanism.mechanism import mass_matrix

MISSED_RATIO: Final = 0.5
"""Standard deviation over the effort of inertia. The virtual drives miss 0.3 of it."""


def effort_std(leg: Leg) -> tuple[float, float]:
    """Standard deviation of this cycle's efforts about their means over the cycle: N·m, N."""
    acceleration = [
        axis.acceleration_sent_si if axis.torque_sampling is not TorqueSampling.FILTERED else 0.0
        for axis in leg.axes
    ]
    placed = leg.singularity_ratio > 0 and all(axis.referenced for axis in leg.axes)
    if not any(acceleration) or not placed:
        return 0.0, 0.0  # of a pose that no leg can have nothing is known, and nothing is estimated
    pose = np.array([axis.joint.position_si for axis in leg.axes])
    hip_nm, slide_n = mass_matrix(leg.parameters, pose) @ np.array(acceleration)
    return MISSED_RATIO * abs(float(hip_nm)), MISSED_RATIO * abs(float(slide_n))
