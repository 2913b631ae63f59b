"""Commands to the drives: mode, bounded targets of guidance, and power request.

With guidance by impedance (torque mode), the total effort is g(q) + feedforward + K (q_ref - q) +
D (dq_ref - dq) + assist, bounded as a whole. Zero effort is not rest: the drives carry the
mechanism's weight and springs.

A controller, a spasm or clonus can reduce the stiffness: K is multiplied by the remaining share and
D by its square root, so that the damping ratio is constant. Without guidance, in mode TORQUE, the
effort is g(q) + assist.

With guidance by position, the drives' own loops follow the reference in gait and hold; of these
exercises only an open-loop excitation is in torque mode. The same loops hold and move, so there is
no hand-over at either end of a gait, no sag at its begin, and no mode change in a stop. A target
sent in one cycle acts from the next SYNC and is reached one SYNC later (60C2h), so the leg follows
its reference with a delay of two cycles; the tracking check includes that delay.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from daemon.config.settings import Impedance
from daemon.core.exercises.exercise import Reference
from daemon.core.safety import bounds, stop_sequence
from daemon.core.safety.stop_sequence import Step
from daemon.core.slices import Sent
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import monitors, single_axis, targets, wanted
from daemon.core.steps.targets import DriveRequest, Effort, Position
from drives.cia402.units import effort_to_permille, position_to_counts
from drives.signals import DriveCommand, OperationMode, PowerRequest

STILL_CYCLES: Final = 5
"""Cycles without motion after which a joint is at rest.

A drive that then begins to hold the position of two cycles ago finds the joint there.
"""


class AxisSetpoint(NamedTuple):
    """Unbounded setpoint of the plan for one axis: rad, rad/s and N·m, or m, m/s and N."""

    effort_si: float
    position_si: float
    velocity_si: float


def requests(core: Core) -> list[DriveRequest]:
    """What is requested from every drive together with its targets, in the order of the axes."""
    return [
        _request(core, axis, takes_over=leg.takes_over) for leg in core.legs for axis in leg.axes
    ]


def bounded(core: Core, requests: Sequence[DriveRequest], cycle: int) -> list[Sent] | None:
    """Bounded targets for every drive; None if any value is not finite: such a command is refused.

    A value counts even where its mode does not use it.
    """
    setpoints = [setpoint for leg in core.legs for setpoint in _setpoints(core, leg)]
    if not all(math.isfinite(number) for setpoint in setpoints for number in setpoint):
        return None
    found: list[Sent] = []
    for axis, setpoint, request in zip(core.axes, setpoints, requests, strict=True):
        if core.single_axis is not None:
            target = _prepared(core, axis, setpoint, request)
        else:
            target = _guided(axis, setpoint, request, cycle)
        if target is None:
            return None
        found.append(target)
    return found


def command(core: Core) -> list[DriveCommand]:
    """The command to every drive as it is sent, in the order of the axes."""
    return [_command(core, axis) for axis in core.axes]


def stop_without_feedback(core: Core) -> list[DriveCommand]:
    """Quick stop for every drive in its present mode, without any computation that could fail.

    A drive whose stop is harsher already keeps that one.
    """
    return [
        DriveCommand(
            power=stop_sequence.request(
                Step.QUICK_STOP if axis.stop is None else max(axis.stop.step, Step.QUICK_STOP)
            ),
            mode=axis.sent.mode,
            target_position_counts=axis.sensed.feedback.position_counts
            if axis.sensed.feedback
            else 0,
            target_torque_permille=0,
        )
        for axis in core.axes
    ]


def _request(core: Core, axis: Axis, *, takes_over: bool) -> DriveRequest:
    """The request to one drive; an enabled drive changes its mode only at rest."""
    mode, pushing = wanted.mode_wanted(core, axis), wanted.enable_wanted(core, axis)
    moving = axis.sensed.joint.still_cycles < STILL_CYCLES
    keeps = pushing and axis.sensed.reached_enabled and moving
    return DriveRequest(
        axis.sent.mode if keeps else mode,
        pushing,
        mode != OperationMode.CYCLIC_SYNC_TORQUE,
        core.config.period_s,
        takes_over,
    )


def _setpoints(core: Core, leg: Leg) -> tuple[AxisSetpoint, AxisSetpoint]:
    """Setpoints of the leg's plan for both axes; no effort where no drive is to be enabled."""
    hip, slide = leg.axes
    if single_axis.moving(core) is not None:
        return _preparation_setpoint(core, hip), _preparation_setpoint(core, slide)
    reference = leg.reference
    if reference is None or not wanted.enable_wanted_of(core, leg):
        return AxisSetpoint(0.0, hip.sensed.joint.position_si, 0.0), AxisSetpoint(
            0.0, slide.sensed.joint.position_si, 0.0
        )
    config = core.config
    impedance = None if leg.exercise is None else leg.exercise.impedance
    gains = _gains(impedance or config.hold, leg.guidance_ratio)
    (k0, d0), (k1, d1) = gains
    efforts = (
        _effort(hip, reference, 0, k0, d0) + leg.assist.added_si[0],
        _effort(slide, reference, 1, k1, d1) + leg.assist.added_si[1],
    )
    efforts = monitors.slowed(leg, efforts)
    return (
        AxisSetpoint(efforts[0], reference.position[0], reference.velocity[0]),
        AxisSetpoint(efforts[1], reference.position[1], reference.velocity[1]),
    )


def _preparation_setpoint(core: Core, axis: Axis) -> AxisSetpoint:
    return AxisSetpoint(
        single_axis.target_effort_si(core, axis), axis.sensed.joint.position_si, 0.0
    )


def _effort(
    axis: Axis, reference: Reference, index: int, stiffness_si: float, damping_si: float
) -> float:
    load_si = axis.sensed.gravity_si if reference.load is None else reference.load[index]
    base_si = load_si + reference.feedforward[index]
    if not reference.guided:
        return base_si
    joint = axis.sensed.joint
    return (
        base_si
        + stiffness_si * (reference.position[index] - joint.position_si)
        + damping_si * (reference.velocity[index] - joint.velocity_si)
    )


def _gains(
    impedance: Impedance, stiffness_ratio: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    damping_ratio = math.sqrt(stiffness_ratio)
    return (
        (
            stiffness_ratio * impedance.hip.stiffness_nm_per_rad,
            damping_ratio * impedance.hip.damping_nm_s_per_rad,
        ),
        (
            stiffness_ratio * impedance.slide.stiffness_n_per_m,
            damping_ratio * impedance.slide.damping_n_s_per_m,
        ),
    )


def _prepared(core: Core, axis: Axis, setpoint: AxisSetpoint, request: DriveRequest) -> Sent | None:
    """Targets during a homing or sign test: the small effort of that test, present position."""
    before, limits = axis.sent, single_axis.active_limits(core, axis)
    bound_si = bounds.bound(setpoint.effort_si, before.effort_si, limits, request.dt_s)
    if bound_si is None:
        return None
    effort_si = bound_si if request.pushing else 0.0
    effort = Effort(effort_si, before.effort_offset_si, before.effort_mean_si)
    position = Position(axis.sensed.joint.position_si, before.position_offset_si)
    return targets.sent(axis, effort, position, request)


def _guided(axis: Axis, setpoint: AxisSetpoint, request: DriveRequest, cycle: int) -> Sent | None:
    aim_si, offset_si = setpoint.position_si, axis.sent.position_offset_si
    if request.pushing and axis.stop is not None and axis.stop.since_cycle == cycle:
        speed_si, dt_s = setpoint.velocity_si, request.dt_s
        offset_si = targets.braking_offset_si(axis.sent, aim_si, speed_si, dt_s)
    effort = targets.effort(axis, setpoint.effort_si, request)
    position = targets.position(axis, aim_si, offset_si, request)
    if effort is None or position is None:
        return None
    return targets.sent(axis, effort, position, request)


def _command(core: Core, axis: Axis) -> DriveCommand:
    return DriveCommand(
        power=_power(core, axis),
        mode=axis.sent.mode,
        target_position_counts=position_to_counts(axis.sent.position_si, axis.scaling),
        target_torque_permille=effort_to_permille(axis.sent.effort_si, axis.scaling),
    )


def _power(core: Core, axis: Axis) -> PowerRequest:
    if axis.stop is not None:
        return stop_sequence.request(axis.stop.step)
    if wanted.enable_wanted(core, axis):
        run = core.single_axis
        return PowerRequest.HOME if run is not None and run.searching else PowerRequest.ENABLE
    if core.reset_cycles_left > 0:
        # In every power state: one request is one edge of the controlword (`power_state.py`).
        return PowerRequest.FAULT_RESET
    return PowerRequest.DISABLE_VOLTAGE
