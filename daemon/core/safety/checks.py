"""Safety checks of one cycle: `check` finds the reasons to stop (`bounds.py` bounds the commands).

Rules:
1. All checks use raw drive values (encoder differences, measured current, statusword, inputs,
   ages). The observer may only add a stop (`_check_leg`), never prevent one.
2. A cause has one category: fixed by the design, or chosen in `limits.toml` (`Categories`).
3. The harshest verdict of a cycle is published; of equals the first in the order of the checks
   below, which goes from operator actions to their consequences. Each axis is stopped by its own
   verdict as well.
4. A milder verdict never replaces a harsher one (`worse`). Verdicts latch until a reset.
5. A number that is not finite stops the machine; it is never replaced by zero.
6. A drive counts as silent only if frames reach it: while the master's own frames cannot be sent, a
   quick stop is tried, and no drive counts as lost.

The checks are the same for real and simulated drives.
"""

import math
from collections.abc import Callable, Iterator

from daemon.core.safety.inputs import AxisInputs, LegInputs, SafetyInputs, ServiceInputs
from daemon.core.safety.joints import jump_reach_si
from daemon.core.safety.limits import Thresholds
from daemon.core.safety.sign_response import RIGHT_MAX_RATIO, UNCLEAR_MAX_RATIO
from daemon.ipc.record import Cause, StopCategory, Verdict
from daemon.wire.causes import LOST_DRIVE
from drives.signals import Input, NmtState, PowerState

NO_VERDICT = Verdict()


OBSERVER_BAD_MAX_CYCLES = 50
"""Half a second without a usable estimate: longer than any gap that the filter predicts over."""
TX_DROPPED_MAX = 3
ENABLE_CYCLES = 25
"""Longest time for which a drive may stay powered without a request, as while it switches off."""
FREEZE_DECELERATION_RATIO = 3.0
"""Multiple of the quick-stop deceleration above which a standstill is an encoder fault."""
FROZEN_PUSH_RATIO = 3.0
"""Change of effort at standstill, as a multiple of breakaway, that shows a frozen encoder.

Standstill is within `still_counts_max`. Friction hides a change of twice the breakaway, from one
sign to the other. A larger change without motion means that the encoder or the joint is stuck. A
patient who leans steadily on a held leg causes no change, and no fault.
"""
EFFORT_POSSIBLE_RATIO = 4.0
"""Multiple of the effort limit, which the drive keeps itself, above which a value is no
measurement. Only the observer of an encoder at standstill would take it for an effort."""
EFFORT_UNCHANGED_CYCLES = 50
"""Cycles of motion in a row, half a second, in which a measured current cannot stay the same count:
load, friction and noise change it."""
AGAINST_DRIVE_MAX_CYCLES = 20
"""Cycles in a row in which a person may move a leg against its drive, 0.2 s. Patients who give 1.4
of the need of a gait at 0.5 Hz do so for 7 at a time."""
HELD_RATIO = 0.1
"""Share of the tracking limit within which a drive's own loops count as holding a joint.

Such a drive may change its effort without motion: it holds against a patient who leans. Where the
loops leave the joint farther off, they push at their limit without motion.
"""

Finding = tuple[Cause, float, float, str]
"""A reason to stop: cause, value, limit, detail."""


def worse(latched: Verdict, verdicts: Verdict) -> Verdict:
    """The harsher of two verdicts; the latched one if they are equal."""
    return verdicts if verdicts.category > latched.category else latched


def check(inputs: SafetyInputs) -> tuple[Verdict, ...]:
    """Run all checks; returns the harshest verdict of each axis, each leg and the service.

    The harshest verdict is first. Two axes may fail in the same cycle; each is then stopped by its
    own cause. Of equally harsh ones a lost drive counts before all others: what its last frames
    showed stands still, and it gets a stop of its own (`stop_sequence.py`). Else the first counts.
    """
    verdicts: dict[str, Verdict] = {}
    for name, (cause, value, limit, detail) in _findings(inputs):
        verdict = Verdict(inputs.categories.of(cause), cause, name, value, limit, detail)
        if _rank(verdict) > _rank(verdicts.get(name, NO_VERDICT)):
            verdicts[name] = verdict
    return tuple(sorted(verdicts.values(), key=lambda verdict: -verdict.category))


def _rank(verdict: Verdict) -> tuple[StopCategory, bool]:
    return verdict.category, verdict.cause in LOST_DRIVE


def _findings(inputs: SafetyInputs) -> Iterator[tuple[str, Finding]]:
    service, thresholds, driving = inputs.service, inputs.thresholds, inputs.driving
    if driving:
        for finding in _check_service(service, thresholds):
            yield "", finding
    for finding in _check_bus(service):
        yield "", finding
    checks = DRIVING_CHECKS if driving else RESTING_CHECKS
    mute = service.tx_dropped_in_a_row >= TX_DROPPED_MAX
    for axis in inputs.axes:
        for check_axis in checks:
            for finding in check_axis(axis, thresholds):
                if not (mute and finding[0] == Cause.DRIVE_SILENT):
                    yield axis.name, finding
    if driving:
        for leg in inputs.legs:
            for finding in _check_leg(leg, thresholds):
                yield leg.name, finding


def _check_service(service: ServiceInputs, thresholds: Thresholds) -> Iterator[Finding]:
    if service.stop_requested:
        yield Cause.STOP_REQUESTED, 0.0, 0.0, ""
    if service.shutdown_requested:
        yield Cause.SHUTDOWN, 0.0, 0.0, ""
    if service.gateway_age_cycles > thresholds.gateway_silence_cycles:
        yield (
            Cause.GATEWAY_SILENT,
            float(service.gateway_age_cycles),
            float(thresholds.gateway_silence_cycles),
            "cycles since the gateway's newest word",
        )
    if service.overruns_in_a_row >= thresholds.overruns_in_a_row:
        yield (
            Cause.CYCLE_OVERRUN,
            float(service.overruns_in_a_row),
            float(thresholds.overruns_in_a_row),
            "grid points missed in a row",
        )


def _check_bus(service: ServiceInputs) -> Iterator[Finding]:
    if service.bus_error:
        yield Cause.BUS_DOWN, 0.0, 0.0, service.bus_error
    if service.bus_off:
        yield Cause.BUS_OFF, 0.0, 0.0, "the controller reports bus-off"
    if service.tx_dropped_in_a_row >= TX_DROPPED_MAX:
        yield (
            Cause.TRANSMIT_QUEUE_FULL,
            float(service.tx_dropped_in_a_row),
            float(TX_DROPPED_MAX),
            "cycles in a row whose frames were not all sent",
        )


def _inputs_shown(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check that a drive shows inputs that its wiring can produce; in every mode."""
    if Input.IMPOSSIBLE in axis.feedback.inputs:
        yield Cause.INPUTS_IMPOSSIBLE, 0.0, 0.0, "bits of 60FDh that are always 0"


def _inputs(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    if not axis.joint.known or Input.IMPOSSIBLE in axis.feedback.inputs:
        return
    if Input.HAND_SWITCH_CLOSED not in axis.feedback.inputs:
        yield Cause.HAND_SWITCH_OPEN, 0.0, 1.0, ""
    if Input.STO_RELEASED not in axis.feedback.inputs:
        yield Cause.STO_ACTIVE, 0.0, 1.0, ""


def _limit_switches(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check for motion towards an active limit switch; motion away from it is allowed.

    A homing moves to its switch on purpose.
    """
    if not axis.joint.known or axis.homing:
        return
    for switch, sign, name in _SWITCHES:
        if switch not in axis.feedback.inputs:
            continue
        towards = sign * axis.counts_sign
        speed_si = max(towards * axis.joint.velocity_si, towards * axis.wanted_velocity_si)
        if speed_si > axis.limits.standstill_si_per_s:
            yield Cause.LIMIT_SWITCH, speed_si, axis.limits.standstill_si_per_s, name


_SWITCHES = (
    (Input.NEGATIVE_LIMIT, -1, "towards the drive's negative limit switch"),
    (Input.POSITIVE_LIMIT, 1, "towards the drive's positive limit switch"),
)


def _communication(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    feedback = axis.feedback
    if feedback.rebooted:
        yield Cause.DRIVE_REBOOTED, 0.0, 0.0, "boot-up message in operation"
    elif feedback.heartbeat_age_ns > thresholds.heartbeat_timeout_ns:
        yield (
            Cause.HEARTBEAT_LOST,
            feedback.heartbeat_age_ns * 1e-6,
            thresholds.heartbeat_timeout_ns * 1e-6,
            "ms since its last heartbeat",
        )
    elif feedback.nmt_state not in {NmtState.OPERATIONAL, NmtState.UNKNOWN}:
        yield Cause.DRIVE_NOT_OPERATIONAL, 0.0, 0.0, feedback.nmt_state.name
    elif feedback.sample_age_cycles > thresholds.sample_age_max_cycles:
        yield (
            Cause.DRIVE_SILENT,
            float(feedback.sample_age_cycles),
            float(thresholds.sample_age_max_cycles),
            "cycles without a complete sample",
        )


def _fault(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check for drive faults and new EMCY alarms; a later 0000h does not cancel an alarm."""
    feedback = axis.feedback
    if feedback.in_fault:
        reason = feedback.alarm or feedback.emergency
        said = f"{reason.code:04X}h {reason.text}" if reason else axis.bring_up_error
        detail = said or "no EMCY seen"
        yield Cause.DRIVE_FAULT, 0.0, 0.0, detail
    if axis.new_emergency and feedback.alarm is not None:
        yield Cause.EMERGENCY, 0.0, 0.0, f"{feedback.alarm.code:04X}h {feedback.alarm.text}"


def _unexpected_enable(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check for a drive that has power without a request by the core.

    Power that appears after the drive was off counts at once. A drive that was enabled by the core
    has ENABLE_CYCLES to switch off, and a fault reaction its own time.
    """
    state, limit_cycles = axis.feedback.power_state, ENABLE_CYCLES
    if state == PowerState.FAULT_REACTION_ACTIVE:
        limit_cycles = axis.reaction_cycles
    elif axis.shown_unpowered and state != PowerState.UNKNOWN:
        limit_cycles = 0
    if axis.unexpected_enable_cycles > limit_cycles:
        yield (
            Cause.UNEXPECTED_ENABLE,
            float(axis.unexpected_enable_cycles),
            float(limit_cycles),
            "cycles",
        )


def _power(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    """Check that a drive that should be enabled is enabled, in its mode and following.

    The newest statusword counts even in an incomplete sample, since the next controlword depends on
    it. Quick stop active is no state on the way to operation enabled.
    """
    if not axis.enable_wanted:
        return
    feedback = axis.feedback
    enabled = feedback.power_state == PowerState.OPERATION_ENABLED
    stopping = feedback.power_state == PowerState.QUICK_STOP_ACTIVE
    limit_cycles = axis.limits.enable_max_cycles
    late = axis.unready_cycles > limit_cycles
    if not enabled and (axis.reached_enabled or stopping or late):
        yield Cause.DRIVE_LEFT_ENABLED, 0.0, 0.0, feedback.power_state.name
        return
    if axis.reached_enabled:
        limit_cycles = thresholds.mode_switch_cycles
    if axis.unready_cycles <= limit_cycles:
        return
    if feedback.mode_display != axis.mode_wanted:
        yield (
            Cause.MODE_NOT_SHOWN,
            float(feedback.mode_display),
            float(axis.mode_wanted),
            "mode of operation display",
        )
    elif not feedback.following and not axis.homing:
        yield Cause.NOT_FOLLOWING, 0.0, 1.0, "statusword bit 12"


def _numbers(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check that position and effort are finite: NaN would pass every comparison below."""
    if not axis.joint.known:
        return
    if not math.isfinite(axis.joint.position_si):
        yield Cause.ENCODER_JUMP, 0.0, 0.0, "its position is no number"
    if not math.isfinite(axis.joint.effort_si):
        yield Cause.EFFORT_DEVIATION, 0.0, 0.0, "its effort is no number"
    elif _is_effort_impossible(axis):
        limit_si = EFFORT_POSSIBLE_RATIO * axis.limits.effort_max_si
        yield Cause.EFFORT_DEVIATION, abs(axis.joint.effort_si), limit_si, "no drive gives that"


def _is_effort_impossible(axis: AxisInputs) -> bool:
    return abs(axis.joint.effort_si) > EFFORT_POSSIBLE_RATIO * axis.limits.effort_max_si


def _encoder(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    joint, limits = axis.joint, axis.limits
    sampled = joint.fresh and joint.elapsed_s > 0
    reach_si = jump_reach_si(joint, limits, thresholds)
    if sampled and abs(joint.step_si) > reach_si:
        yield Cause.ENCODER_JUMP, abs(joint.step_si), reach_si, "between two samples"
    known = (axis.referenced or axis.preparing) and not axis.feedback.reference_lost
    if not known and not axis.feedback.rebooted:
        yield Cause.UNREFERENCED, 0.0, 1.0, ""
    if not sampled:
        return
    if axis.homing or joint.still_cycles < thresholds.encoder_frozen_cycles:
        return
    possible_si = (
        FREEZE_DECELERATION_RATIO * limits.quick_stop_deceleration_si_per_s2 * joint.elapsed_s
    )
    if joint.still_cycles == thresholds.encoder_frozen_cycles and (
        joint.speed_before_still_si > possible_si
    ):
        yield Cause.ENCODER_FROZEN, joint.speed_before_still_si, possible_si, "speed lost at once"
        return
    if axis.loop_distance_si < HELD_RATIO * limits.tracking_max_si or _is_effort_impossible(axis):
        return
    watch = axis.watch
    change_si = abs(watch.held_si - watch.held_before_still_si)
    if math.isfinite(axis.loop_distance_si):
        # A drive whose own loops have lost the joint pushes to reach it, not to carry its load.
        change_si = max(change_si, abs(joint.effort_si - watch.effort_before_still_si))
    if change_si > FROZEN_PUSH_RATIO * limits.breakaway_si:
        yield (
            Cause.ENCODER_FROZEN,
            change_si,
            FROZEN_PUSH_RATIO * limits.breakaway_si,
            "effort changed, and the joint stood still",
        )


def _efforts(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    """Check that measured and sent effort match (`effort_monitor.py`), with power or without."""
    watch, limits = axis.watch, axis.limits
    if watch.gap_cycles >= thresholds.deviation_cycles:
        yield (
            Cause.EFFORT_DEVIATION,
            watch.gap_si,
            limits.effort_deviation_max_si,
            "measured without power" if watch.unpowered_cycles else "measured from sent",
        )
    if watch.unchanged_cycles >= EFFORT_UNCHANGED_CYCLES:
        yield (
            Cause.EFFORT_DEVIATION,
            float(watch.unchanged_cycles),
            float(EFFORT_UNCHANGED_CYCLES),
            "cycles of motion with the same effort",
        )


def _directions(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    """Check that a joint moves with its drive's effort, or that a person moves it against that.

    It can be a person only if the drive's sign is trusted, a patient can give such an effort, and
    the joint's response is not that of a wrong sign (`sign_response.py`). Where the response has
    the drive's sign, a person may move the leg against the drive for a short time, as one who is
    ahead of the gait does. All else is a wrong sign.
    """
    watch, limits = axis.watch, axis.limits
    if watch.sign_mismatch_cycles < thresholds.sign_mismatch_cycles:
        return
    possible = axis.sign_trusted and abs(watch.patient_si) <= limits.patient_effort_max_si
    mismatch = watch.sign_mismatch_si, limits.sign_mismatch_effort_min_si
    if not possible or watch.response_ratio > UNCLEAR_MAX_RATIO:
        yield Cause.SIGN_WRONG, *mismatch, "effort one way, motion the other"
    elif (
        watch.response_ratio >= RIGHT_MAX_RATIO
        or watch.sign_mismatch_cycles > AGAINST_DRIVE_MAX_CYCLES
    ):
        yield Cause.MOVED_AGAINST_DRIVE, *mismatch, "the leg moves, its drive pushes back"


def _strides(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Finding]:
    """Check the sums over the last stride, and the durations of a spasm and of clonus."""
    limits = axis.limits
    if abs(axis.stride_drift_si) > limits.load_deviation_max_si:
        yield (
            Cause.EFFORT_DEVIATION,
            abs(axis.stride_drift_si),
            limits.load_deviation_max_si,
            "mean of a stride from what motion and load ask for",
        )
    if axis.stride_energy_j > limits.stride_energy_max_j:
        yield Cause.ENERGY_LIMIT, axis.stride_energy_j, limits.stride_energy_max_j, "J in a stride"
    if axis.spasm_cycles > thresholds.spasm_patience_cycles:
        yield Cause.SPASM, abs(axis.spasm_rise_si), limits.spasm_rise_si, "rise against the motion"
    if axis.clonus_cycles > thresholds.clonus_patience_cycles:
        yield Cause.CLONUS, axis.clonus_swing_si, limits.clonus_swing_si, "swings to and fro"


def _positions(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    joint, limits = axis.joint, axis.limits
    if not joint.known or not axis.referenced or axis.homing:
        return
    lowest_si, highest_si = limits.position_min_si, limits.position_max_si
    if joint.position_si < lowest_si:
        yield Cause.POSITION_LIMIT, joint.position_si, lowest_si, "below"
    elif axis.stopping_end_si < lowest_si:
        yield Cause.STOPPING_PATH, axis.stopping_end_si, lowest_si, "comes to rest below"
    if joint.position_si > highest_si:
        yield Cause.POSITION_LIMIT, joint.position_si, highest_si, "above"
    elif axis.stopping_end_si > highest_si:
        yield Cause.STOPPING_PATH, axis.stopping_end_si, highest_si, "comes to rest above"


def _limits(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    joint, limits = axis.joint, axis.limits
    if not joint.known:
        return
    temperature_degc = axis.feedback.temperature_degc
    if axis.feedback.temperature_overdue:
        yield Cause.TEMPERATURE_LIMIT, 0.0, 0.0, "not measured any more"
    if temperature_degc is not None and temperature_degc > limits.temperature_max_degc:
        yield Cause.TEMPERATURE_LIMIT, temperature_degc, limits.temperature_max_degc, "degC"
    for cause, value, limit in (
        (Cause.VELOCITY_LIMIT, abs(joint.velocity_si), limits.velocity_max_si),
        (Cause.EFFORT_LIMIT, abs(joint.effort_si), limits.effort_max_si * EFFORT_MARGIN_RATIO),
        (Cause.POWER_LIMIT, joint.effort_si * joint.velocity_si, limits.power_max_w),
    ):
        if value > limit:
            yield cause, value, limit, ""


def _tracking(axis: AxisInputs, _: Thresholds) -> Iterator[Finding]:
    """Check that a joint is near its reference, whatever moves it away.

    A drive whose own loops hold a joint elsewhere than it was told does not obey its target, and
    would not obey that of a stop in which it holds.
    """
    limits = axis.limits
    limit_si = limits.hold_distance_max_si if axis.held else limits.tracking_max_si
    if axis.held and limit_si < axis.loop_distance_si < math.inf:
        yield Cause.NOT_FOLLOWING, axis.loop_distance_si, limit_si, "held away from its target"
    if abs(axis.tracking_si) > limit_si:
        yield Cause.TRACKING_LIMIT, abs(axis.tracking_si), limit_si, ""


EFFORT_MARGIN_RATIO = 1.1
"""Margin over the effort limit: the command is bounded, but the current loop may overshoot."""

Check = Callable[[AxisInputs, Thresholds], Iterator[Finding]]
RESTING_CHECKS: tuple[Check, ...] = (
    _inputs_shown,
    _communication,
    _fault,
    _unexpected_enable,
    _efforts,
)
DRIVING_CHECKS: tuple[Check, ...] = (
    _inputs_shown,
    _inputs,
    _limit_switches,
    _communication,
    _fault,
    _unexpected_enable,
    _numbers,
    _encoder,
    _directions,
    _efforts,
    _positions,
    _limits,
    _tracking,
    _strides,
    _power,
)


def _check_leg(leg: LegInputs, thresholds: Thresholds) -> Iterator[Finding]:
    """Check the pose of a leg, and that its estimate is usable.

    Not while an axis seeks its home: both would be judged by the origin that the homing corrects,
    or is to find. That axis has the limits of its homing then, and all raw checks of both axes stay
    in force, as at a first homing, when no pose is known.
    """
    if leg.seeks_home:
        return
    if leg.singularity_ratio < thresholds.singularity_stop_ratio:
        yield (
            Cause.SINGULARITY,
            leg.singularity_ratio,
            thresholds.singularity_stop_ratio,
            "|sin| between shank and shoe",
        )
    elif leg.stopping_ratio < thresholds.singularity_stop_ratio:
        yield (
            Cause.STOPPING_PATH,
            leg.stopping_ratio,
            thresholds.singularity_stop_ratio,
            "|sin| between shank and shoe on the way to rest",
        )
    if leg.observer_bad_cycles > OBSERVER_BAD_MAX_CYCLES:
        yield (
            Cause.OBSERVER_INVALID,
            float(leg.observer_bad_cycles),
            float(OBSERVER_BAD_MAX_CYCLES),
            "cycles without a usable estimate",
        )
