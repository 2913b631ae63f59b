"""The plan of one leg as the core sees it: where it is, where it is wanted, how it brakes."""

from daemon.core.motion import trajectory
from daemon.core.motion.hand_guiding import ReleasePlay, release_reference
from daemon.core.motion.self_test import SelfTestPlay, self_test_reference
from daemon.core.motion.trajectory import ExcitePlay, GaitPlay, Hold, TorquePlay
from daemon.core.state import Core, Leg
from daemon.ipc.record import Stage


def reference_of(core: Core, leg: Leg) -> trajectory.Reference | None:
    """Where the leg's plan wants it in this cycle; None without a plan."""
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
    """Hip angle in rad and slide position in m by the raw encoders."""
    hip, slide = leg.axes
    return hip.joint.position_si, slide.joint.position_si


def speeds(leg: Leg) -> tuple[float, float]:
    """Of hip and slide by the raw encoders: rad/s, m/s."""
    hip, slide = leg.axes
    return hip.joint.velocity_si, slide.joint.velocity_si


def present(leg: Leg) -> tuple[float, float]:
    """Where guidance is now, so that the next plan begins without a step."""
    if leg.reference is not None and leg.reference.guided:
        return leg.reference.position
    return measured(leg)


def hold_from(leg: Leg) -> Hold:
    """Brake from where guidance is, or from where the leg is if little or nothing guides it.

    What was guided softly may be far from its reference, and full stiffness is not to fetch it.
    """
    fully = leg.stiffness_ratio * leg.spasm_ratio == 1.0
    if leg.reference is not None and leg.reference.guided and fully:
        return hold_at(leg, leg.reference.position, leg.reference.velocity)
    return brake(leg)


def brake(leg: Leg) -> Hold:
    """Brake from where the leg is: a stop does not first catch up with a reference."""
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
    """Whether the scenario that plays has an artificial disturbance, now or later."""
    plan = leg.plan
    return isinstance(plan, ExcitePlay) and bool(plan.artificial) and plan.stage == Stage.PLAYING
