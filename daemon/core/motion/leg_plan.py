"""Plan of one leg in the core's state: measured pose, reference, and braking."""

from daemon.core.motion import trajectory
from daemon.core.motion.hand_guiding import ReleasePlay, release_reference
from daemon.core.motion.self_test import SelfTestPlay, self_test_reference
from daemon.core.motion.trajectory import ExcitePlay, GaitPlay, Hold, TorquePlay
from daemon.core.state import Core, Leg
from daemon.ipc.record import Stage


def reference_of(core: Core, leg: Leg) -> trajectory.Reference | None:
    """The reference of the leg's plan in this cycle; None without a plan."""
    plan = leg.plan
    if isinstance(plan, Hold):
        return trajectory.hold_reference(plan)
    if isinstance(plan, GaitPlay):
        return trajectory.gait_reference(plan, core.config.period_s)
    if isinstance(plan, ExcitePlay):
        return trajectory.excite_reference(plan, measured(leg))
    if isinstance(plan, TorquePlay):
        return trajectory.torque_reference(measured(leg))
    if isinstance(plan, ReleasePlay):
        hip, slide = leg.axes
        return release_reference(plan, measured(leg), speeds(leg), (hip.limits, slide.limits))
    if isinstance(plan, SelfTestPlay):
        return self_test_reference(plan)
    return None


def measured(leg: Leg) -> tuple[float, float]:
    """Hip angle in rad and slide position in m from the raw encoders."""
    hip, slide = leg.axes
    return hip.joint.position_si, slide.joint.position_si


def speeds(leg: Leg) -> tuple[float, float]:
    """Hip speed in rad/s and slide speed in m/s from the raw encoders."""
    hip, slide = leg.axes
    return hip.joint.velocity_si, slide.joint.velocity_si


def present(leg: Leg) -> tuple[float, float]:
    """The present reference if guided, else the measured pose: the next plan starts here."""
    if leg.reference is not None and leg.reference.guided:
        return leg.reference.position
    return measured(leg)


def hold_from(leg: Leg) -> Hold:
    """Brake from the reference if fully guided, else from where the leg is.

    A softly guided leg may be far from its reference; full stiffness must not pull it there.
    """
    fully = leg.stiffness_ratio * leg.spasm_ratio == 1.0
    if leg.reference is not None and leg.reference.guided and fully:
        return hold_at(leg, leg.reference.position, leg.reference.velocity)
    return brake(leg)


def brake(leg: Leg) -> Hold:
    """Brake from where the leg is, so that a stop does not first move to a reference."""
    return hold_at(leg, measured(leg), speeds(leg))


def hold_at(leg: Leg, start: tuple[float, float], velocity: tuple[float, float]) -> Hold:
    """Brake from a position and a velocity with the deceleration of a quick stop."""
    hip, slide = leg.axes
    deceleration = (
        hip.limits.quick_stop_deceleration_si_per_s2,
        slide.limits.quick_stop_deceleration_si_per_s2,
    )
    return Hold(start, velocity, deceleration)


def artificial(leg: Leg) -> tuple[float, float]:
    """The artificial disturbance in force on this leg's observer: N·m, N."""
    plan = leg.plan
    return trajectory.artificial_disturbance(plan) if isinstance(plan, ExcitePlay) else (0.0, 0.0)


def is_artificial(leg: Leg) -> bool:
    """True if the playing scenario has an artificial disturbance, now or later."""
    plan = leg.plan
    return isinstance(plan, ExcitePlay) and bool(plan.artificial) and plan.stage == Stage.PLAYING
