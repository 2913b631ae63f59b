"""The plant's friction: sliding laws, and true sticking of two coupled axes.

    PAPER           eq. (11) to (13) as they stand, with the observer's own kernels. It slips from
                    rest at `stribeck` and jerks where the static curve falls; below that it creeps
                    under a constant load F with v = transition * atanh(F / coulomb).
    PAPER_STICKING  eq. (11) and (12) while an axis slides. The static curve (13) is taken at no
                    less than its peak speed, because its rise from zero only stands for the jump of
                    a real dry contact. An axis whose velocity would change sign sticks if a
                    friction of at most `stribeck` holds it: velocity exactly zero, friction = load,
                    until the load exceeds `stribeck`; then it slides, starting from that friction.
    LUGRE           Canudas de Wit, Olsson, Astrom, Lischinsky, "A new model for control of systems
                    with friction", IEEE Trans. Autom. Control 40 (1995), eq. (2) to (5): bristles
                    that hold a resting axis elastically. Levels from the same parameters; the
                    Stribeck curve is the Gaussian one, not (13).

One step is solved at velocity level: M (v+ - v) = h (load - friction), where for a held axis v+ = 0
replaces a known friction, and for a led one v+ is given. The held axes are found iteratively: each
axis can be held once and released once in a step, so there are at most four changes and one last
solution.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import kernel
from observer.mechanism.friction import FrictionParameters, gate, static_friction
from sim_drives.plant.settings import FrictionLaw

Records = NDArray[np.void]

LAW_CODES: Final[dict[FrictionLaw, int]] = {
    FrictionLaw.PAPER: 0,
    FrictionLaw.PAPER_STICKING: 1,
    FrictionLaw.LUGRE: 2,
}
STICKING: Final = LAW_CODES[FrictionLaw.PAPER_STICKING]
LUGRE: Final = LAW_CODES[FrictionLaw.LUGRE]
TRIES: Final = 5

JOINT: Final = np.dtype(
    [
        ("position", "f8"),
        ("velocity", "f8"),
        ("acceleration", "f8"),
        ("memory", "f8"),  # F_d of (11), or the bristles' deflection
        ("stuck", "i8"),
        ("blocked", "i8"),  # rotor blocked externally
        ("led", "i8"),  # moved from outside (led.py), whatever the load
        ("led_position", "f8"),  # at the end of this step
        ("led_velocity", "f8"),
        ("patient", "f8"),
        ("friction", "f8"),  # mean of the last step
        ("contact", "f8"),  # end stops and a blocked rotor
        ("effort_impulse", "f8"),
        ("load", "f8"),  # all but friction, this step
        ("held", "i8"),
        ("slid", "i8"),  # broke away or passed through zero in this step
        ("next_velocity", "f8"),
        ("reaction", "f8"),
    ]
)
"""One joint of the plant; the fields from `load` on belong to one step's solution."""


class Bristles(NamedTuple):
    """LuGre's sigma_0 and sigma_1 of one axis: joint effort per rad or m, and per rad/s or m/s."""

    stiffness_si: float
    damping_si: float


@kernel
def stribeck_level(f: FrictionParameters, speed: float) -> float:
    """Return LuGre's g(v) without the viscous part: from `stribeck` at rest down to `coulomb`."""
    ratio = speed / f.peak
    return f.coulomb + (f.stribeck - f.coulomb) * math.exp(-ratio * ratio)


@kernel
def _paper_step(f: FrictionParameters, joint: np.void, target: float, step_s: float) -> float:
    """Eq. (11) over one step at constant velocity; returns the step's mean friction."""
    before = joint["memory"]
    rate = gate(f, joint["velocity"]) / f.time_constant_s  # eq. (12)
    joint["memory"] = target + (before - target) * math.exp(-rate * step_s)
    return 0.5 * (before + joint["memory"])


@kernel
def _lugre_step(f: FrictionParameters, bristles: Bristles, joint: np.void, step_s: float) -> float:
    """Advance the bristles one step at constant velocity, exactly; return the mean.

    The damping part uses the mean deflection rate, so it stays passive where sigma_0 |v| h / g > 1.
    """
    velocity = joint["velocity"]
    before = joint["memory"]
    level = stribeck_level(f, velocity)
    steady = math.copysign(level / bristles.stiffness_si, velocity)
    decay = math.exp(-bristles.stiffness_si * abs(velocity) / level * step_s)
    after = steady + (before - steady) * decay
    joint["memory"] = after
    elastic = bristles.stiffness_si * 0.5 * (before + after)
    return elastic + bristles.damping_si * (after - before) / step_s + f.viscous * velocity


@kernel
def sliding_friction(
    law: int, f: FrictionParameters, bristles: Bristles, joint: np.void, step_s: float
) -> float:
    """Mean friction of an axis that is not held, over the coming step; its memory advances.

    Args:
        law: one of LAW_CODES.
        f: the axis's friction.
        bristles: the axis's bristles.
        joint: its JOINT record, whose memory is written.
        step_s: the step.
    """
    if law == LUGRE:
        return _lugre_step(f, bristles, joint, step_s)
    velocity = joint["velocity"]
    if law == STICKING and abs(velocity) < f.peak:
        return _paper_step(f, joint, math.copysign(f.stribeck, velocity), step_s)
    return _paper_step(f, joint, static_friction(f, velocity), step_s)  # eq. (11), (13)


@kernel
def _solve(joints: Records, m11: float, m12: float, m22: float, step_s: float) -> None:
    """Solve velocities after the step and held axes' reactions, for given `held` and `friction`."""
    a, b = joints[0], joints[1]
    push_a = a["load"] - a["friction"]
    push_b = b["load"] - b["friction"]
    # the effort that brings a held axis to rest within the step, a led one to its velocity
    end_a = a["led_velocity"] if a["led"] else 0.0
    end_b = b["led_velocity"] if b["led"] else 0.0
    rate_a = (end_a - a["velocity"]) / step_s
    rate_b = (end_b - b["velocity"]) / step_s
    if a["held"] == 0 and b["held"] == 0:
        determinant = m11 * m22 - m12 * m12
        rate_a = (m22 * push_a - m12 * push_b) / determinant
        rate_b = (m11 * push_b - m12 * push_a) / determinant
    elif a["held"] == 0:
        rate_a = (push_a - m12 * rate_b) / m11
    elif b["held"] == 0:
        rate_b = (push_b - m12 * rate_a) / m22
    a["next_velocity"] = end_a if a["held"] else a["velocity"] + step_s * rate_a
    b["next_velocity"] = end_b if b["held"] else b["velocity"] + step_s * rate_b
    a["reaction"] = a["load"] - m11 * rate_a - m12 * rate_b
    b["reaction"] = b["load"] - m12 * rate_a - m22 * rate_b


@kernel
def _reconsider(law: int, f: FrictionParameters, joint: np.void) -> bool:
    """Release an axis held beyond breakaway, hold one about to reverse; return if any changed."""
    if law != STICKING or joint["blocked"] or joint["led"]:
        return False
    if joint["held"] == 1 and abs(joint["reaction"]) > f.stribeck:
        joint["held"] = 0
        joint["slid"] = 1
        if joint["stuck"] == 1:
            joint["memory"] = math.copysign(f.stribeck, joint["reaction"])
            joint["friction"] = joint["memory"]
        return True
    turns = joint["velocity"] * joint["next_velocity"] < 0.0
    if joint["held"] == 0 and joint["slid"] == 0 and turns:
        joint["held"] = 1
        return True
    return False


@kernel
def _settle(law: int, joint: np.void) -> None:
    """Store a held axis's reaction: as friction where it sticks, else as contact."""
    if joint["blocked"] or joint["led"]:
        joint["contact"] += joint["friction"] - joint["reaction"]
    elif joint["held"]:
        joint["friction"] = joint["reaction"]
        joint["memory"] = joint["reaction"]
    joint["stuck"] = joint["held"] if law == STICKING and not joint["led"] else 0


@kernel
def slide_or_stick(
    law: int,
    frictions: tuple[FrictionParameters, FrictionParameters],
    bristles: tuple[Bristles, Bristles],
    joints: Records,
    mass: tuple[float, float, float],
    step_s: float,
) -> None:
    """Solve one step of both axes; writes next_velocity, friction, memory, stuck, contact.

    Args:
        law: one of LAW_CODES.
        frictions: friction of hip and slide.
        bristles: bristles of hip and slide.
        joints: JOINT records with `load` filled in.
        mass: M11, M12, M22.
        step_s: the step.
    """
    for axis in range(2):
        joint = joints[axis]
        joint["slid"] = 0
        joint["held"] = 1 if joint["stuck"] == 1 or joint["blocked"] or joint["led"] else 0
        if joint["held"] == 0:
            joint["friction"] = sliding_friction(
                law, frictions[axis], bristles[axis], joint, step_s
            )
    for _ in range(TRIES):
        _solve(joints, mass[0], mass[1], mass[2], step_s)
        changed = False
        for axis in range(2):
            changed = _reconsider(law, frictions[axis], joints[axis]) or changed
        if not changed:
            break
    for axis in range(2):
        _settle(law, joints[axis])
