"""Sums and counts over more than one cycle for the safety checks, updated in each cycle.

This file combines `inverse_dynamics.py` (effort that the motion needs), `effort_monitor.py` (effort
that the drive gives), `energy.py` (sums over a stride), `stopping_path.py` and `soft_limits.py`
(where the leg would come to rest, and how deep it is in its margins), `spasm.py` and `clonus.py`
(the only ones that read the estimate). `checks.py` checks the results. This file is the only writer
of these sums and counts, and makes `Softened`.
"""

from collections.abc import Iterator

from gaitd_names import EventCode, Stage

from daemon.core.core_config import CoreConfig
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety import effort_monitor, inverse_dynamics, soft_limits, stopping_path
from daemon.core.safety.energy import stride_cycles
from daemon.core.safety.spasm import STILL_CYCLES, softened
from daemon.core.slices import Softened
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import single_axis, wanted
from daemon.ipc.report import Event
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.signals import OperationMode, PowerState
from observer.filter.leg_observer import LegEstimate
from observer.filter.status import Validity


def update(core: Core) -> None:
    """Update all monitors that use only encoders and measured efforts."""
    for leg in core.legs:
        _update_leg(core, leg)


def soften(
    leg: Leg, before: Softened, estimate: LegEstimate, config: CoreConfig, *, guided_motion: bool
) -> Softened:
    """Look for a spasm and clonus in the estimate of a leg, and soften guidance meanwhile.

    Args:
        leg: what its axes show and its reference are read, the watches of its axes are updated.
        before: of the last cycle.
        estimate: of this cycle.
        config: of the core.
        guided_motion: the mode guides a motion; without it a person may move the leg.
    """
    hip, slide = leg.axes
    velocity = hip.sensed.wanted_velocity_si, slide.sensed.wanted_velocity_si
    needed_si = _needed(leg, before.wanted_velocity, velocity, config.period_s)
    _watch_spasm(leg, estimate, needed_si, guided_motion=guided_motion)
    _watch_clonus(leg, estimate, guided_motion=guided_motion)
    in_spasm = hip.spasm.cycles > 0 or slide.spasm.cycles > 0
    in_clonus = hip.clonus.lasts or slide.clonus.lasts
    return Softened(
        spasm_ratio=softened(before.spasm_ratio, config.spasm, in_spasm=in_spasm),
        clonus_ratio=softened(before.clonus_ratio, config.spasm, in_spasm=in_clonus),
        wanted_velocity=velocity,
    )


def news(leg: Leg) -> Iterator[Event]:
    """Clonus that was detected in this cycle."""
    for axis in leg.axes:
        if axis.clonus.begins:
            yield Event(EventCode.CLONUS_BEGUN, axis.name)


def clear_energy(core: Core) -> None:
    """Begin with no energy: the drives are being enabled."""
    for axis in core.axes:
        axis.energy.clear()


def _update_leg(core: Core, leg: Leg) -> None:
    hip, slide = leg.axes
    window_cycles = _window(core, leg)
    leg.dynamics = inverse_dynamics.evaluate(
        leg.dynamics, leg.mechanism, leg.friction_laws, (hip.sensed.joint, slide.sensed.joint)
    )
    pose_known = _pose_is_known(core, leg)
    for index, axis in enumerate(leg.axes):
        axis.watch = effort_monitor.update(
            axis.watch,
            axis.sensed.joint,
            leg.dynamics,
            index,
            single_axis.active_limits(core, axis),
            mismatch_cycles=core.config.thresholds.sign_mismatch_cycles,
            may_give_torque=axis.sensed.feedback is not None
            and axis.sensed.feedback.power_state not in CANNOT_EXERT_TORQUE,
            free=_free(axis),
            pose_known=pose_known,
        )
        _sum_up(leg, index, window_cycles)
    leg.window_cycles = window_cycles
    _predict_stop(core, leg)


def _pose_is_known(core: Core, leg: Leg) -> bool:
    """True if the pose is known, and with it the effort that the mechanism needs on both axes."""
    hip, slide = leg.axes
    homing = single_axis.is_homing(core, hip) or single_axis.is_homing(core, slide)
    return hip.sensed.referenced and slide.sensed.referenced and not homing


def _free(axis: Axis) -> bool:
    """True if the axis is inside its range, as far as it is known."""
    limits = axis.limits
    inside = limits.position_min_si <= axis.sensed.joint.position_si <= limits.position_max_si
    return inside or not axis.sensed.referenced


def _sum_up(leg: Leg, index: int, window_cycles: int) -> None:
    axis = leg.axes[index]
    joint = axis.sensed.joint
    if leg.window_cycles != window_cycles:
        axis.energy.clear()
    axis.energy.add(joint.effort_si * joint.step_si if joint.fresh else 0.0)
    exercise = leg.exercise
    if exercise is None or exercise.stride_hz is None or exercise.stage is not Stage.PLAYING:
        axis.residual.clear()
    else:
        # At rest friction can be any value up to its law, so a mean residual has no meaning.
        moving = joint.still_cycles < STILL_CYCLES
        axis.residual.add(leg.dynamics.residual(index) if moving else 0.0)


def _predict_stop(core: Core, leg: Leg) -> None:
    """Update where both axes come to rest if they brake now; only if both are referenced."""
    hip, slide = leg.axes
    if not leg.is_located:
        hip.stopping_end_si, slide.stopping_end_si = (
            hip.sensed.joint.position_si,
            slide.sensed.joint.position_si,
        )
        leg.stopping_ratio, leg.zone = 1.0, soft_limits.SoftZone()
        return
    position = hip.sensed.joint.position_si, slide.sensed.joint.position_si
    velocity = hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si
    ramps = (
        hip.limits.quick_stop_deceleration_si_per_s2,
        slide.limits.quick_stop_deceleration_si_per_s2,
    )
    reaction_s = stopping_path.reaction_s(assisted=leg.assist.effort_si != (0.0, 0.0))
    for axis, at, speed, ramp in zip(leg.axes, position, velocity, ramps, strict=True):
        axis.stopping_end_si = stopping_path.end_of(at, speed, ramp, reaction_s)
    leg.stopping_ratio = stopping_path.least_ratio(
        leg.mechanism, position, velocity, ramps, reaction_s
    )
    leg.zone = soft_limits.zone_at(
        (hip.limits, slide.limits), core.config.thresholds, position, leg.singularity_ratio
    )


def slowed(leg: Leg, efforts: tuple[float, float]) -> tuple[float, float]:
    """The efforts of guidance, reduced where they would move the leg deeper into a soft margin."""
    hip, slide = leg.axes
    return soft_limits.slowed(
        leg.zone,
        leg.parameters,
        (hip.limits, slide.limits),
        (hip.sensed.joint.position_si, slide.sensed.joint.position_si),
        (hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si),
        (hip.sensed.gravity_si, slide.sensed.gravity_si),
        efforts,
    )


def _watch_spasm(leg: Leg, estimate: LegEstimate, needed_si: Pair, *, guided_motion: bool) -> None:
    for index, axis in enumerate(leg.axes):
        # Without guided motion, the person who moves the leg would look like a spasm. A sign
        # mismatch in the raw values has its own check.
        guided = guided_motion and axis.watch.sign_mismatch_cycles == 0
        if estimate.validity[index] is Validity.BAD or not guided:
            axis.spasm.reset()
            continue
        limits, sensed = axis.limits, axis.sensed
        axis.spasm.update(
            estimate.state[6 + index],
            sensed.joint.velocity_si,
            sensed.wanted_velocity_si,
            needed_si[index],
            sensed.joint.still_cycles,
            limits.spasm_rise_si,
            limits.standstill_si_per_s,
        )


def _watch_clonus(leg: Leg, estimate: LegEstimate, *, guided_motion: bool) -> None:
    for index, axis in enumerate(leg.axes):
        if not guided_motion:
            axis.clonus.reset()
            continue
        bad = estimate.validity[index] is Validity.BAD
        axis.clonus.update(None if bad else estimate.state[6 + index], axis.limits.clonus_swing_si)


def _needed(leg: Leg, before: Pair, velocity: Pair, period_s: float) -> Pair:
    """Effort that the motion of the leg's reference needs beyond the load; 0 without one."""
    if leg.reference is None or not leg.reference.guided:
        return 0.0, 0.0
    return inverse_dynamics.needed(
        leg.mechanism,
        leg.friction_laws,
        leg.reference.position,
        velocity,
        ((velocity[0] - before[0]) / period_s, (velocity[1] - before[1]) / period_s),
    )


def is_saturated(leg: Leg) -> bool:
    """True if the effort sent to a drive is at its configured limit."""
    hip, slide = leg.axes
    return (
        abs(hip.sent.effort_si) >= hip.limits.effort_max_si
        or abs(slide.sent.effort_si) >= slide.limits.effort_max_si
    )


def stride_energy(leg: Leg, axis: Axis) -> float:
    """Net energy that this axis's drive put into the leg over the last stride or window, J."""
    return axis.energy.so_far(leg.window_cycles)


def stride_drift(leg: Leg, axis: Axis) -> float:
    """Mean effort residual over the last stride of a gait; 0 before a whole stride."""
    total = axis.residual.over(leg.window_cycles)
    return 0.0 if total is None else total / leg.window_cycles


def _window(core: Core, leg: Leg) -> int:
    stride_hz = None if leg.exercise is None else leg.exercise.stride_hz
    if stride_hz is not None:
        return stride_cycles(stride_hz, core.config.period_s)
    return core.config.thresholds.energy_window_cycles


def store_commands(core: Core) -> None:
    """Store the efforts sent, to compare them with the measured ones later."""
    for axis in core.axes:
        feedback = axis.sensed.feedback
        active = (
            feedback is not None
            and feedback.power_state == PowerState.OPERATION_ENABLED
            and feedback.mode_display == OperationMode.CYCLIC_SYNC_TORQUE
            and axis.sent.mode == OperationMode.CYCLIC_SYNC_TORQUE
            and wanted.enable_wanted(core, axis)
        )
        axis.watch = effort_monitor.record_sent(axis.watch, axis.sent.effort_si, active=active)
