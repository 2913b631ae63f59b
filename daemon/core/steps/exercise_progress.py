"""Advance the plan of one leg by one cycle, and publish changes of its stage."""

from daemon.core.motion import hand_guiding, leg_plan, self_test, trajectory
from daemon.core.motion.hand_guiding import ReleasePlay
from daemon.core.motion.self_test import SelfTestPlay
from daemon.core.motion.trajectory import ExcitePlay, GaitPlay, Hold, TorquePlay
from daemon.core.state import Axis, Core, Leg, Play
from daemon.ipc.record import Stage
from drives.signals import OperationMode


def advance(core: Core, leg: Leg, *, changing: bool) -> None:
    """Advance the plan of one leg by one cycle.

    `changing`: drives are still changing to another mode. A gait stays in stage ANNOUNCING until
    all drives have changed to the mode in which it is played.
    """
    period_s = core.config.period_s
    plan = leg.plan
    if isinstance(plan, Hold):
        leg.plan = trajectory.advance_hold(plan, period_s)
    elif isinstance(plan, GaitPlay) and not (plan.stage == Stage.ANNOUNCING and changing):
        leg.plan = trajectory.advance_gait(plan, period_s)
    elif isinstance(plan, ExcitePlay):
        leg.plan = trajectory.advance_excite(plan, period_s, leg_plan.measured(leg))
    elif isinstance(plan, TorquePlay):
        leg.plan = trajectory.advance_torque(plan, period_s)
    elif isinstance(plan, ReleasePlay):
        leg.plan = hand_guiding.advance_release(plan, period_s, ready=_in_torque_mode(leg))
    elif isinstance(plan, SelfTestPlay):
        seen = _seen(leg.axes[0]), _seen(leg.axes[1])
        ready = _in_torque_mode(leg)
        leg.plan = self_test.advance_self_test(plan, period_s, seen, ready=ready)
    if isinstance(plan, Play) and isinstance(leg.plan, Play):
        _tell_stage(core, leg, plan.stage, leg.plan.stage)


def _in_torque_mode(leg: Leg) -> bool:
    wanted = OperationMode.CYCLIC_SYNC_TORQUE
    return all(
        axis.mode_sent == wanted
        and axis.feedback is not None
        and axis.feedback.mode_display == wanted
        for axis in leg.axes
    )


def _seen(axis: Axis) -> self_test.Seen:
    joint = axis.joint
    return self_test.Seen(joint.fresh, joint.position_si, joint.effort_si - axis.gravity_si)


def _tell_stage(core: Core, leg: Leg, before: Stage, after: Stage) -> None:
    if before == after:
        return
    core.events.append(f"{leg.name}: {core.mode.name.lower()} {after.name.lower()}")
    if isinstance(leg.plan, ReleasePlay):
        leg.takes_over = True  # no step of torque from hold to hand guiding
