"""Compile and load every kernel that the cycle calls, with the same argument types.

A first call takes up to seconds, so it must not happen between two SYNCs. Tables that would grow in
service are filled here, so that memory does not grow later.
"""

import numpy as np

from daemon.core.motion import gait_shape
from daemon.core.runtime.build import Built
from daemon.core.safety import inverse_dynamics, stopping_path
from observer.jit import settle
from observer.mechanism.friction import static_friction_of
from observer.mechanism.mechanism import mass_matrix, ratio_and_load, singularity_ratio

STEPS = 20


def warm_up(built: Built) -> None:
    """Call every kernel once on a core that is discarded afterwards."""
    period_s = built.core.config.period_s
    for leg in built.core.legs:
        angles = gait_shape.gait_angles(leg.shape, 0.0, 0.0)
        gait_shape.joints_of_angles(leg.parameters, angles)
        pose = gait_shape.joints_of_angles(leg.mechanism, angles)
        gait_shape.angles_of_joints(leg.parameters, pose)
        load = gait_shape.load_at(leg.parameters, pose)
        ratio_and_load(leg.mechanism, *pose)
        singularity_ratio(leg.parameters, np.array(pose))
        mass_matrix(leg.parameters, np.array(pose))
        stopping_path.least_ratio(
            leg.mechanism, pose, (0.0, 0.0), (1.0, 1.0), stopping_path.REACTION_S
        )
        stopping_path.gradient(leg.parameters, pose)
        inverse_dynamics.warm_up(leg.mechanism, leg.friction_laws)
        static_friction_of(leg.friction[0], 0.0)
        leg.observers.observer.reset(np.array(pose))
        for _ in range(STEPS):
            estimate = leg.observers.observer.step(
                np.array(pose),
                np.array(load),
                period_s,
                late=False,
                unreferenced=False,
                artificial=False,
            )
            leg.observers.smoother.add(estimate, load, period_s)
        leg.observers.strides.warm_up()
    settle()
