"""Sums and counts over more than one cycle for the safety checks, updated in each cycle.

This file combines `inverse_dynamics.py` (effort that the motion needs), `effort_monitor.py` (effort
that the drive gives), `energy.py` (sums over a stride), `stopping_path.py` and `soft_limits.py`
(where the leg would come to rest, and how deep it is in its margins), `spasm.py` and `clonus.py`
(the only ones that read the estimate). `checks.py` checks the results. This file makes `Monitored`
and `Softened`, and is the only writer of the sums and of the watches for spasm and clonus.
"""

from collections.abc import Iterator, Sequence

from gaitd_names import EventCode, Stage
from msgspec.structs import replace

from daemon.core.core_config import CoreConfig
from daemon.core.motion.gait_shape import Pair
from daemon.core.safety import effort_monitor, inverse_dynamics, soft_limits, stopping_path
from daemon.core.safety.energy import stride_cycles
from daemon.core.safety.limits import AxisLimits, Thresholds
from daemon.core.safety.spasm import STILL_CYCLES, softened
from daemon.core.slices import Monitored, Softened
from daemon.core.state import Axis, Core, Leg
from daemon.ipc.report import Event
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.signals import OperationMode, PowerState
from observer.filter.leg_observer import LegEstimate
from observer.filter.status import Validity


def update(
    leg: Leg,
    before: Monitored,
    limits: tuple[AxisLimits, AxisLimits],
    config: CoreConfig,
    *,
    homing: bool,
) -> Monitored:
    """Update all monitors of a leg that use only encoders and measured efforts.

    Args:
        leg: what its axes show, its exercise and its assist are read, the sums are updated.
        before: of the last cycle.
        limits: in force on hip and slide.
        config: of the core.
        homing: a drive moves an axis of this leg by its own homing.
    """
    hip, slide = leg.axes
    dynamics = inverse_dynamics.evaluate(
        before.dynamics, leg.mechanism, leg.friction_laws, (hip.sensed.joint, slide.sensed.joint)
    )
    # With the pose, the effort that the mechanism needs on both axes is known.
    pose_known = hip.sensed.referenced and slide.sensed.referenced and not homing
    mismatch_cycles = config.thresholds.sign_mismatch_cycles
    watch_hip, watch_slide = [
        effort_monitor.update(
            before.watches[index],
            axis.sensed.joint,
            dynamics,
            index,
            limits[index],
            mismatch_cycles=mismatch_cycles,
            may_give_torque=axis.sensed.feedback is not None
            and axis.sensed.feedback.power_state not in CANNOT_EXERT_TORQUE,
            free=_free(axis),
            pose_known=pose_known,
        )
        for index, axis in enumerate(leg.axes)
    ]
    window_cycles = _window(leg, config)
    for index, axis in enumerate(leg.axes):
        if before.window_cycles != window_cycles:
            axis.energy.clear()
        _sum_up(leg, axis, dynamics.residual(index))
    end_si, ratio, zone = _predict_stop(leg, config.thresholds)
    return Monitored(dynamics, (watch_hip, watch_slide), window_cycles, end_si, ratio, zone)


def with_sent(leg: Leg, enabled: Sequence[bool]) -> Monitored:
    """What is monitored of a leg, with the efforts sent, which later measured ones are compared to.

    Args:
        leg: what its axes show and what was sent to them are read.
        enabled: hip and slide should have power.
    """
    hip, slide = [
        effort_monitor.record_sent(
            watch, axis.sent.effort_si, active=is_enabled and _shows_torque_mode(axis)
        )
        for watch, axis, is_enabled in zip(leg.monitored.watches, leg.axes, enabled, strict=True)
    ]
    return replace(leg.monitored, watches=(hip, slide))


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
    needed = _needed(leg, before.wanted_velocity, velocity, config.period_s)
    certain_si = (0.0, 0.0) if needed is None else needed.certain
    _watch_spasm(leg, estimate, certain_si, guided_motion=guided_motion)
    _watch_clonus(leg, estimate, guided_motion=guided_motion)
    in_spasm = hip.spasm.cycles > 0 or slide.spasm.cycles > 0
    in_clonus = hip.clonus.lasts or slide.clonus.lasts
    return Softened(
        spasm_ratio=softened(before.spasm_ratio, config.spasm, in_spasm=in_spasm),
        clonus_ratio=softened(before.clonus_ratio, config.spasm, in_spasm=in_clonus),
        wanted_velocity=velocity,
        needed_si=None if needed is None else needed.whole,
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


def _free(axis: Axis) -> bool:
    """True if the axis is inside its range, as far as it is known."""
    limits = axis.limits
    inside = limits.position_min_si <= axis.sensed.joint.position_si <= limits.position_max_si
    return inside or not axis.sensed.referenced


def _sum_up(leg: Leg, axis: Axis, residual_si: float) -> None:
    joint = axis.sensed.joint
    axis.energy.add(joint.effort_si * joint.step_si if joint.fresh else 0.0)
    exercise = leg.exercise
    if exercise is None or exercise.stride_hz is None or exercise.stage is not Stage.PLAYING:
        axis.residual.clear()
    else:
        # At rest friction can be any value up to its law, so a mean residual has no meaning.
        axis.residual.add(residual_si if joint.still_cycles < STILL_CYCLES else 0.0)


def _predict_stop(leg: Leg, thresholds: Thresholds) -> tuple[Pair, float, soft_limits.SoftZone]:
    """Where both axes come to rest if they brake now, if both are referenced, and the soft zone."""
    hip, slide = leg.axes
    position = hip.sensed.joint.position_si, slide.sensed.joint.position_si
    if not leg.is_located:
        return position, 1.0, soft_limits.SoftZone()
    velocity = hip.sensed.joint.velocity_si, slide.sensed.joint.velocity_si
    ramps = (
        hip.limits.quick_stop_deceleration_si_per_s2,
        slide.limits.quick_stop_deceleration_si_per_s2,
    )
    reaction_s = stopping_path.reaction_s(assisted=leg.assist.effort_si != (0.0, 0.0))
    return (
        (
            stopping_path.end_of(position[0], velocity[0], ramps[0], reaction_s),
            stopping_path.end_of(position[1], velocity[1], ramps[1], reaction_s),
        ),
        stopping_path.least_ratio(leg.mechanism, position, velocity, ramps, reaction_s),
        soft_limits.zone_at(
            (hip.limits, slide.limits), thresholds, position, leg.placed.singularity_ratio
        ),
    )


def slowed(leg: Leg, efforts: tuple[float, float]) -> tuple[float, float]:
    """The efforts of guidance, reduced where they would move the leg deeper into a soft margin."""
    hip, slide = leg.axes
    return soft_limits.slowed(
        leg.monitored.zone,
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
        guided = guided_motion and leg.monitored.watches[index].sign_mismatch_cycles == 0
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


def _needed(
    leg: Leg, before: Pair, velocity: Pair, period_s: float
) -> inverse_dynamics.Needed | None:
    """Effort that the motion of the leg's reference needs beyond the load; None without one."""
    if leg.reference is None or not leg.reference.guided:
        return None
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
    return axis.energy.so_far(leg.monitored.window_cycles)


def stride_drift(leg: Leg, axis: Axis) -> float:
    """Mean effort residual over the last stride of a gait; 0 before a whole stride."""
    total = axis.residual.over(leg.monitored.window_cycles)
    return 0.0 if total is None else total / leg.monitored.window_cycles


def _window(leg: Leg, config: CoreConfig) -> int:
    stride_hz = None if leg.exercise is None else leg.exercise.stride_hz
    if stride_hz is not None:
        return stride_cycles(stride_hz, config.period_s)
    return config.thresholds.energy_window_cycles


def _shows_torque_mode(axis: Axis) -> bool:
    """True if the drive is enabled in torque mode, as it was told to be."""
    feedback = axis.sensed.feedback
    return (
        feedback is not None
        and feedback.power_state == PowerState.OPERATION_ENABLED
        and feedback.mode_display == axis.sent.mode == OperationMode.CYCLIC_SYNC_TORQUE
    )
