"""What the safety checks read is collected from the state; the checks are in `checks.py`."""

from gaitd_names import Mode

from daemon.core.safety import checks
from daemon.core.safety.inputs import (
    AxisEstimateInputs,
    AxisInputs,
    LegEstimateInputs,
    LegInputs,
    SafetyInputs,
    ServiceInputs,
)
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import monitors, sensing, single_axis, targets
from daemon.core.steps.wanted import enable_wanted, is_driving
from daemon.core.tick import Tick
from daemon.ipc.record import Verdict


def check_raw(core: Core, tick: Tick) -> tuple[Verdict, ...]:
    """The reasons to stop in raw values; each EMCY alarm is checked once."""
    verdicts = checks.check_raw(safety_inputs(core, tick))
    sensing.alarms_checked(core)
    return verdicts


def check_estimate(core: Core) -> tuple[Verdict, ...]:
    """The reasons to stop in the estimate, while a drive has power."""
    if not is_driving(core):
        return ()
    legs = [_leg_estimate(core, leg) for leg in core.legs]
    return checks.check_estimate(legs, core.config.thresholds, core.config.categories)


def safety_inputs(core: Core, tick: Tick) -> SafetyInputs:
    """Collect all that the raw checks read in this cycle."""
    drives = core.drives
    return SafetyInputs(
        service=ServiceInputs(
            stop_requested=core.inputs.stop,
            shutdown_requested=tick.shutdown,
            gateway_age_cycles=tick.cycle - core.inputs.gateway_state_cycle,
            overruns_in_a_row=tick.overruns_in_a_row,
            bus_off=drives is not None and drives.bus_state.has_been_off,
            bus_error=tick.bus_error,
            tx_dropped_in_a_row=tick.tx_dropped_in_a_row,
        ),
        axes=[_axis(core, leg, index) for leg in core.legs for index in (0, 1)],
        legs=[_leg(core, leg) for leg in core.legs],
        thresholds=core.config.thresholds,
        categories=core.config.categories,
        driving=is_driving(core),
    )


def _leg(core: Core, leg: Leg) -> LegInputs:
    return LegInputs(
        name=leg.name,
        singularity_ratio=leg.placed.singularity_ratio,
        stopping_ratio=leg.monitored.stopping_ratio,
        seeks_home=_seeks_home(core, leg),
    )


def _leg_estimate(core: Core, leg: Leg) -> LegEstimateInputs:
    return LegEstimateInputs(
        name=leg.name,
        axes=[_axis_estimate(axis) for axis in leg.axes],
        observer_bad_cycles=leg.estimated.bad_cycles,
        seeks_home=_seeks_home(core, leg),
    )


def _seeks_home(core: Core, leg: Leg) -> bool:
    return core.single_axis is not None and any(
        single_axis.seeks_home(core, axis) for axis in leg.axes
    )


def _axis_estimate(axis: Axis) -> AxisEstimateInputs:
    return AxisEstimateInputs(
        name=axis.name,
        limits=axis.limits,
        spasm_cycles=axis.spasm.cycles,
        spasm_rise_si=axis.spasm.rise_si,
        clonus_cycles=axis.clonus.cycles,
        clonus_swing_si=axis.clonus.swing_si,
    )


def _axis(core: Core, leg: Leg, index: int) -> AxisInputs:
    axis = leg.axes[index]
    feedback = axis.sensed.feedback
    if feedback is None:
        raise RuntimeError(f"{axis.name} is judged before it was sensed")
    return AxisInputs(
        name=axis.name,
        feedback=feedback,
        joint=axis.sensed.joint,
        limits=single_axis.active_limits(core, axis),
        referenced=axis.sensed.referenced,
        preparing=core.single_axis is not None,
        homing=single_axis.is_homing(core, axis),
        tracking_si=axis.sensed.tracking_si if core.mode != Mode.STOPPING else 0.0,
        held=leg.is_held,
        wanted_velocity_si=axis.sensed.wanted_velocity_si,
        counts_sign=1 if axis.scaling.counts_per_si > 0 else -1,
        loop_distance_si=targets.loop_distance(axis),
        enable_wanted=enable_wanted(core, axis),
        reached_enabled=axis.sensed.reached_enabled,
        unready_cycles=axis.sensed.unready_cycles,
        unexpected_enable_cycles=axis.sensed.unexpected_enable_cycles,
        shown_unpowered=axis.sensed.shown_unpowered,
        reaction_cycles=axis.reaction_cycles,
        mode_wanted=axis.sent.mode,
        new_emergency=feedback.alarm_count > axis.sensed.emergencies_checked,
        sign_trusted=axis.sensed.sign_trusted,
        watch=leg.monitored.watches[index],
        stride_energy_j=monitors.stride_energy(leg, axis),
        stride_drift_si=monitors.stride_drift(leg, axis),
        stopping_end_si=leg.monitored.stopping_end_si[index],
        bring_up_error=axis.sensed.bring_up_error,
    )
