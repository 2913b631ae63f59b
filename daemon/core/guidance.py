"""What is sent to each drive: the mode's wish as an effort, bounded, and the power request.

Total effort = g(q) + feedforward + K (q_ref - q) + D (dq_ref - dq), bounded as a whole: zero effort
is not rest, the mechanism's weight and springs are carried by the drives.
"""

from collections.abc import Sequence

from daemon.config.settings import Impedance
from daemon.core import conduct, preparing, safety, stopping
from daemon.core.reference import GaitPlay, Reference
from daemon.core.state import Axis, Core, Leg
from daemon.record import Cause, Verdict
from drives.signals import DriveCommand, PowerRequest, PowerState
from drives.units import effort_to_permille


def command(core: Core, cycle: int) -> list[DriveCommand]:
    """The command to every drive, in the order of the axes."""
    wanted = [effort for leg in core.legs for effort in _wanted(core, leg)]
    sent = _bounded(core, wanted)
    if sent is None:
        verdict = Verdict(
            core.config.categories.of(Cause.COMMAND_NOT_FINITE),
            Cause.COMMAND_NOT_FINITE,
            detail=f"wanted {wanted}",
        )
        conduct.stop(core, verdict, cycle)
        sent = [0.0] * len(wanted)
    commands: list[DriveCommand] = []
    for axis, effort_si in zip(core.axes, sent, strict=True):
        axis.effort_sent_si = effort_si
        commands.append(_command(core, axis))
    return commands


def _wanted(core: Core, leg: Leg) -> tuple[float, float]:
    """Efforts that the leg's plan asks for; none where no drive is to push."""
    hip, slide = leg.axes
    if preparing.in_work(core) is not None:
        return preparing.target_effort_si(core, hip), preparing.target_effort_si(core, slide)
    reference = leg.reference
    if reference is None or not any(conduct.enable_wanted(core, axis) for axis in leg.axes):
        return 0.0, 0.0
    config = core.config
    walking = isinstance(leg.plan, GaitPlay)
    (k0, d0), (k1, d1) = _gains(config.gait.impedance if walking else config.hold)
    return (
        _effort(hip, reference, 0, k0, d0),
        _effort(slide, reference, 1, k1, d1),
    )


def _effort(
    axis: Axis, reference: Reference, index: int, stiffness_si: float, damping_si: float
) -> float:
    load_si = axis.gravity_si if reference.load is None else reference.load[index]
    base_si = load_si + reference.feedforward[index]
    if not reference.guided:
        return base_si
    joint = axis.joint
    return (
        base_si
        + stiffness_si * (reference.position[index] - joint.position_si)
        + damping_si * (reference.velocity[index] - joint.velocity_si)
    )


def _gains(impedance: Impedance) -> tuple[tuple[float, float], tuple[float, float]]:
    return (
        (impedance.hip_stiffness_nm_per_rad, impedance.hip_damping_nm_s_per_rad),
        (impedance.slide_stiffness_n_per_m, impedance.slide_damping_n_s_per_m),
    )


def _bounded(core: Core, wanted: Sequence[float]) -> list[float] | None:
    """Bounded efforts, or None as soon as one is not finite."""
    period_s = core.config.period_s
    bounded: list[float] = []
    for axis, effort_si in zip(core.axes, wanted, strict=True):
        pushing = conduct.enable_wanted(core, axis)
        limits = preparing.limits_in_force(core, axis)
        # Before a drive pushes, its target may go straight to what will hold the pose.
        straight = not axis.reached_enabled and core.preparation is None
        last_si = axis.gravity_si if straight else axis.effort_sent_si
        sent_si = safety.bound(effort_si, last_si if pushing else 0.0, limits, period_s)
        if sent_si is None:
            return None
        bounded.append(sent_si if pushing else 0.0)
    return bounded


def _command(core: Core, axis: Axis) -> DriveCommand:
    feedback = axis.feedback
    return DriveCommand(
        power=_power(core, axis),
        mode=conduct.mode_wanted(core, axis),
        # Seeded with the present position, so that a change of mode finds no distance to go.
        target_position_counts=feedback.position_counts if feedback else 0,
        target_torque_permille=effort_to_permille(axis.effort_sent_si, axis.scaling),
    )


def _power(core: Core, axis: Axis) -> PowerRequest:
    if axis.stop is not None:
        return stopping.request(axis.stop.step)
    if conduct.enable_wanted(core, axis):
        run = core.preparation
        return PowerRequest.HOME if run is not None and run.searching else PowerRequest.ENABLE
    faulty = axis.feedback is not None and axis.feedback.power_state == PowerState.FAULT
    if core.reset_cycles_left > 0 and faulty:
        return PowerRequest.FAULT_RESET
    return PowerRequest.DISABLE_VOLTAGE
