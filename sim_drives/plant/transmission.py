"""The transmission between a drive's shaft and its joint: rigid, or elastic and loose.

A drive turns a shaft, and its encoder sits there. Behind a rigid transmission the shaft moves with
the joint, and its inertia is part of the mechanism. Behind an elastic one it has its own motion:

    J theta'' = u - t,    t = k (w - b/2 sign w) + d w' where |w| > b/2, else 0,    w = theta - q

with the reflected inertia J, the effort u of the drive, stiffness k, damping d, backlash b, and the
joint at q. Only t reaches the joint, where friction and patient act. A contact pushes and does not
pull: the damper never turns its sign.

Positions, efforts and inertia are those at the joint, behind the gear.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel

Records = NDArray[np.void]

SHAFT: Final = np.dtype(
    [
        ("elastic", "i8"),  # 0: moves with the joint
        ("position", "f8"),
        ("velocity", "f8"),
        ("acceleration", "f8"),
        ("inertia", "f8"),
        ("stiffness", "f8"),
        ("damping", "f8"),
        ("half_gap", "f8"),
    ]
)
"""One drive's shaft, as seen at the joint."""


class Elasticity(NamedTuple):
    """A transmission that is not rigid, at the joint: N m or N, rad or m."""

    stiffness_si: float
    damping_si: float
    backlash_si: float
    inertia_si: float
    """Inertia of the shaft with rotor and gear: kg m^2 or kg. The mechanism has it as well."""


def shafts_of(pose: tuple[float, float], elastic: tuple[Elasticity | None, ...]) -> Records:
    """Two shafts at rest at a pose of the joints, without load; None: rigid."""
    shafts = np.zeros(2, SHAFT)
    shafts["position"] = pose
    for shaft, one in zip(shafts, elastic, strict=True):
        if one is not None:
            shaft["elastic"] = 1
            shaft["inertia"] = one.inertia_si
            shaft["stiffness"] = one.stiffness_si
            shaft["damping"] = one.damping_si
            shaft["half_gap"] = 0.5 * one.backlash_si
    return shafts


@kernel
def transmit(shaft: np.void, joint: np.void, effort: float, step_s: float) -> float:
    """Advance an elastic shaft's velocity by a step; return the effort that reaches the joint.

    Args:
        shaft: SHAFT record, half a step of position on; written.
        joint: JOINT record, half a step of position on.
        effort: the drive's, mean of the step.
        step_s: the step.
    """
    way = shaft["position"] - joint["position"]
    beyond = math.fabs(way) - shaft["half_gap"]
    reaching = 0.0
    if beyond > 0.0:
        speed = shaft["velocity"] - joint["velocity"]
        speed += 0.5 * step_s * (shaft["acceleration"] - joint["acceleration"])
        pressed = shaft["stiffness"] * beyond + shaft["damping"] * speed * math.copysign(1.0, way)
        reaching = math.copysign(max(pressed, 0.0), way)
    shaft["acceleration"] = (effort - reaching) / shaft["inertia"]
    shaft["velocity"] += step_s * shaft["acceleration"]
    return reaching


@kernel
def go_along(shaft: np.void, joint: np.void) -> None:
    """Move a rigid shaft with its joint."""
    shaft["position"] = joint["position"]
    shaft["velocity"] = joint["velocity"]
    shaft["acceleration"] = joint["acceleration"]
