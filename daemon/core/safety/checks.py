"""Safety checks of one cycle: they find the reasons to stop (`bounds.py` bounds the commands).

Rules:
1. `check_raw` uses raw drive values alone (encoder differences, measured current, statusword,
   inputs, ages). The observer may only add a stop (`check_estimate`), never prevent one.
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
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from gaitd_names import Cause, Finding

from daemon.core.period import cycles
from daemon.core.safety.inputs import (
    AxisEstimateInputs,
    AxisInputs,
    LegEstimateInputs,
    LegInputs,
    SafetyInputs,
    ServiceInputs,
)
from daemon.core.safety.joints import jump_reach_si
from daemon.core.safety.limits import Categories, Thresholds
from daemon.core.safety.sign_response import RIGHT_MAX_RATIO, UNCLEAR_MAX_RATIO
from daemon.ipc.record import Verdict
from daemon.wire.causes import LOST_DRIVE
from drives.signals import Input, NmtState, PowerState

NO_VERDICT = Verdict()


OBSERVER_BAD_MAX_CYCLES: Final = cycles(0.5)
"""Half a second without a usable estimate: longer than any gap that the filter predicts over."""
TX_DROPPED_MAX = 3
ENABLE_CYCLES: Final = cycles(0.25)
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
EFFORT_UNCHANGED_CYCLES: Final = cycles(0.5)
"""Cycles of motion in a row, half a second, in which a measured current cannot stay the same count:
load, friction and noise change it."""
AGAINST_DRIVE_MAX_CYCLES: Final = cycles(0.2)
"""Cycles in a row in which a person may move a leg against its drive, 0.2 s. Patients who give 1.4
of the need of a gait at 0.5 Hz do so for 7 at a time."""
HELD_RATIO = 0.1
"""Share of the tracking limit within which a drive's own loops count as holding a joint.

Such a drive may change its effort without motion: it holds against a patient who leans. Where the
loops leave the joint farther off, they push at their limit without motion.
"""


class Reason(NamedTuple):
    """A reason to stop."""

    cause: Cause
    value: float = 0.0
    limit: float = 0.0
    finding: Finding = Finding.NONE
    said: str = ""


def worse(latched: Verdict, verdicts: Verdict) -> Verdict:
    """The harsher of two verdicts; the latched one if they are equal."""
    return verdicts if verdicts.category.severity > latched.category.severity else latched


def check_raw(inputs: SafetyInputs) -> tuple[Verdict, ...]:
    """Run all checks of raw values; returns the harshest verdicts, see `harshest_of_each`."""
    return harshest_of_each(_verdicts(_reasons(inputs), inputs.categories))


def check_estimate(
    legs: Sequence[LegEstimateInputs], thresholds: Thresholds, categories: Categories
) -> tuple[Verdict, ...]:
    """Run all checks of the estimate, while drives are powered; see `harshest_of_each`."""
    reasons: list[tuple[str, Reason]] = []
    for leg in legs:
        for axis in leg.axes:
            reasons += _check_patient(axis, thresholds)
        reasons += _check_observer(leg)
    return harshest_of_each(_verdicts(reasons, categories)) if reasons else ()


def harshest_of_each(verdicts: Iterable[Verdict]) -> tuple[Verdict, ...]:
    """The harshest of these verdicts for each axis, each leg and the service.

    The harshest verdict is first. Two axes may fail in the same cycle; each is then stopped by its
    own cause. Of equally harsh ones a lost drive counts before all others: what its last frames
    showed stands still, and it gets a stop of its own (`stop_sequence.py`). Else the first counts.
    """
    found: dict[str, Verdict] = {}
    for verdict in verdicts:
        if _rank(verdict) > _rank(found.get(verdict.drive, NO_VERDICT)):
            found[verdict.drive] = verdict
    return tuple(sorted(found.values(), key=lambda verdict: -verdict.category.severity))


def _verdicts(reasons: Iterable[tuple[str, Reason]], categories: Categories) -> Iterator[Verdict]:
    for name, (cause, value, limit, finding, said) in reasons:
        yield Verdict(categories.of(cause), cause, name, value, limit, finding, said)


def _rank(verdict: Verdict) -> tuple[int, bool]:
    return verdict.category.severity, verdict.cause in LOST_DRIVE


def _reasons(inputs: SafetyInputs) -> Iterator[tuple[str, Reason]]:
    service, thresholds, driving = inputs.service, inputs.thresholds, inputs.driving
    if driving:
        for reason in _check_service(service, thresholds):
            yield "", reason
    for reason in _check_bus(service):
        yield "", reason
    checks = DRIVING_CHECKS if driving else RESTING_CHECKS
    mute = service.tx_dropped_in_a_row >= TX_DROPPED_MAX
    for axis in inputs.axes:
        for check_axis in checks:
            for reason in check_axis(axis, thresholds):
                if not (mute and reason.cause == Cause.DRIVE_SILENT):
                    yield axis.name, reason
    if driving:
        for leg in inputs.legs:
            for reason in _check_leg(leg, thresholds):
                yield leg.name, reason


def _check_service(service: ServiceInputs, thresholds: Thresholds) -> Iterator[Reason]:
    if service.stop_requested:
        yield Reason(Cause.STOP_REQUESTED)
    if service.shutdown_requested:
        yield Reason(Cause.SHUTDOWN)
    if service.gateway_age_cycles > thresholds.gateway_silence_cycles:
        yield Reason(
            Cause.GATEWAY_SILENT,
            float(service.gateway_age_cycles),
            float(thresholds.gateway_silence_cycles),
            Finding.CYCLES,
        )
    if service.overruns_in_a_row >= thresholds.overruns_in_a_row:
        yield Reason(
            Cause.CYCLE_OVERRUN,
            float(service.overruns_in_a_row),
            float(thresholds.overruns_in_a_row),
            Finding.MISSED_CYCLES,
        )


def _check_bus(service: ServiceInputs) -> Iterator[Reason]:
    if service.bus_error:
        yield Reason(Cause.BUS_DOWN, said=service.bus_error)
    if service.bus_off:
        yield Reason(Cause.BUS_OFF, 0.0, 0.0, Finding.CONTROLLER_OFF)
    if service.tx_dropped_in_a_row >= TX_DROPPED_MAX:
        yield Reason(
            Cause.TRANSMIT_QUEUE_FULL,
            float(service.tx_dropped_in_a_row),
            float(TX_DROPPED_MAX),
            Finding.CYCLES_NOT_ALL_SENT,
        )


def _inputs_shown(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    """Check that a drive shows inputs that its wiring can produce; in every mode."""
    if Input.IMPOSSIBLE in axis.feedback.inputs:
        yield Reason(Cause.INPUTS_IMPOSSIBLE, 0.0, 0.0, Finding.IMPOSSIBLE_BITS)


def _inputs(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    if not axis.joint.known or Input.IMPOSSIBLE in axis.feedback.inputs:
        return
    if Input.HAND_SWITCH_CLOSED not in axis.feedback.inputs:
        yield Reason(Cause.HAND_SWITCH_OPEN, 0.0, 1.0)
    if Input.STO_RELEASED not in axis.feedback.inputs:
        yield Reason(Cause.STO_ACTIVE, 0.0, 1.0)


def _limit_switches(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
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
            yield Reason(Cause.LIMIT_SWITCH, speed_si, axis.limits.standstill_si_per_s, name)


_SWITCHES = (
    (Input.NEGATIVE_LIMIT, -1, Finding.NEGATIVE_SWITCH),
    (Input.POSITIVE_LIMIT, 1, Finding.POSITIVE_SWITCH),
)


def _communication(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Reason]:
    feedback = axis.feedback
    if feedback.rebooted:
        yield Reason(Cause.DRIVE_REBOOTED, 0.0, 0.0, Finding.BOOT_UP_MESSAGE)
    elif feedback.heartbeat_age_ns > thresholds.heartbeat_timeout_ns:
        yield Reason(
            Cause.HEARTBEAT_LOST,
            feedback.heartbeat_age_ns * 1e-6,
            thresholds.heartbeat_timeout_ns * 1e-6,
            Finding.HEARTBEAT_AGE_MS,
        )
    elif feedback.nmt_state not in {NmtState.OPERATIONAL, NmtState.UNKNOWN}:
        yield Reason(Cause.DRIVE_NOT_OPERATIONAL, float(feedback.nmt_state), 0.0, Finding.NMT_STATE)
    elif feedback.sample_age_cycles > thresholds.sample_age_max_cycles:
        yield Reason(
            Cause.DRIVE_SILENT,
            float(feedback.sample_age_cycles),
            float(thresholds.sample_age_max_cycles),
            Finding.CYCLES_WITHOUT_SAMPLE,
        )


def _fault(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    """Check for drive faults and new EMCY alarms; a later 0000h does not cancel an alarm."""
    feedback = axis.feedback
    if feedback.in_fault:
        code, text = axis.bring_up_error
        if feedback.error_code:
            code, text = feedback.error_code, feedback.error_text
        finding = Finding.ERROR_CODE if code else Finding.NO_EMCY
        if (sent := feedback.alarm or feedback.emergency) is not None:
            code, text, finding = sent.code, sent.text, Finding.EMCY
        yield Reason(Cause.DRIVE_FAULT, float(code), 0.0, finding, text)
    if axis.new_emergency and feedback.alarm is not None:
        code, text = feedback.alarm.code, feedback.alarm.text
        yield Reason(Cause.EMERGENCY, float(code), 0.0, Finding.EMCY, text)


def _unexpected_enable(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
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
        yield Reason(
            Cause.UNEXPECTED_ENABLE,
            float(axis.unexpected_enable_cycles),
            float(limit_cycles),
            Finding.CYCLES,
        )


def _power(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Reason]:
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
        finding = Finding.POWER_STATE if axis.reached_enabled else Finding.NEVER_ENABLED
        yield Reason(Cause.DRIVE_LEFT_ENABLED, float(feedback.power_state), 0.0, finding)
        return
    if axis.reached_enabled:
        limit_cycles = thresholds.mode_switch_cycles
    if axis.unready_cycles <= limit_cycles:
        return
    if feedback.mode_display != axis.mode_wanted:
        yield Reason(
            Cause.MODE_NOT_SHOWN,
            float(feedback.mode_display),
            float(axis.mode_wanted),
            Finding.MODE_DISPLAY,
        )
    elif not feedback.following and not axis.homing:
        yield Reason(Cause.NOT_FOLLOWING, 0.0, 1.0, Finding.NOT_FOLLOWING_BIT)


def _numbers(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    """Check that position and effort are finite: NaN would pass every comparison below."""
    if not axis.joint.known:
        return
    if not math.isfinite(axis.joint.position_si):
        yield Reason(Cause.ENCODER_JUMP, 0.0, 0.0, Finding.POSITION_NOT_FINITE)
    if not math.isfinite(axis.joint.effort_si):
        yield Reason(Cause.EFFORT_DEVIATION, 0.0, 0.0, Finding.EFFORT_NOT_FINITE)
    elif _is_effort_impossible(axis):
        limit_si = EFFORT_POSSIBLE_RATIO * axis.limits.effort_max_si
        yield Reason(
            Cause.EFFORT_DEVIATION, abs(axis.joint.effort_si), limit_si, Finding.EFFORT_IMPOSSIBLE
        )


def _is_effort_impossible(axis: AxisInputs) -> bool:
    return abs(axis.joint.effort_si) > EFFORT_POSSIBLE_RATIO * axis.limits.effort_max_si


def _encoder(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Reason]:
    joint, limits = axis.joint, axis.limits
    sampled = joint.fresh and joint.elapsed_s > 0
    reach_si = jump_reach_si(joint, limits, thresholds)
    if sampled and abs(joint.step_si) > reach_si:
        yield Reason(Cause.ENCODER_JUMP, abs(joint.step_si), reach_si, Finding.STEP_BETWEEN_SAMPLES)
    known = (axis.referenced or axis.preparing) and not axis.feedback.reference_lost
    if not known and not axis.feedback.rebooted:
        yield Reason(Cause.UNREFERENCED, 0.0, 1.0)
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
        yield Reason(
            Cause.ENCODER_FROZEN, joint.speed_before_still_si, possible_si, Finding.SPEED_LOST
        )
        return
    if axis.loop_distance_si < HELD_RATIO * limits.tracking_max_si or _is_effort_impossible(axis):
        return
    watch = axis.watch
    change_si = abs(watch.held_si - watch.held_before_still_si)
    if math.isfinite(axis.loop_distance_si):
        # A drive whose own loops have lost the joint pushes to reach it, not to carry its load.
        change_si = max(change_si, abs(joint.effort_si - watch.effort_before_still_si))
    if change_si > FROZEN_PUSH_RATIO * limits.breakaway_si:
        yield Reason(
            Cause.ENCODER_FROZEN,
            change_si,
            FROZEN_PUSH_RATIO * limits.breakaway_si,
            Finding.EFFORT_WITHOUT_MOTION,
        )


def _efforts(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Reason]:
    """Check that measured and sent effort match (`effort_monitor.py`), with power or without."""
    watch, limits = axis.watch, axis.limits
    if watch.gap_cycles >= thresholds.deviation_cycles:
        yield Reason(
            Cause.EFFORT_DEVIATION,
            watch.gap_si,
            limits.effort_deviation_max_si,
            Finding.EFFORT_WITHOUT_POWER if watch.unpowered_cycles else Finding.EFFORT_NOT_AS_SENT,
        )
    if watch.unchanged_cycles >= EFFORT_UNCHANGED_CYCLES:
        yield Reason(
            Cause.EFFORT_DEVIATION,
            float(watch.unchanged_cycles),
            float(EFFORT_UNCHANGED_CYCLES),
            Finding.EFFORT_UNCHANGED,
        )


def _directions(axis: AxisInputs, thresholds: Thresholds) -> Iterator[Reason]:
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
        yield Reason(Cause.SIGN_WRONG, *mismatch, Finding.EFFORT_AGAINST_MOTION)
    elif (
        watch.response_ratio >= RIGHT_MAX_RATIO
        or watch.sign_mismatch_cycles > AGAINST_DRIVE_MAX_CYCLES
    ):
        yield Reason(Cause.MOVED_AGAINST_DRIVE, *mismatch, Finding.PUSHED_BACK)


def _strides(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    """Check the sums over the last stride."""
    limits = axis.limits
    if abs(axis.stride_drift_si) > limits.load_deviation_max_si:
        yield Reason(
            Cause.EFFORT_DEVIATION,
            abs(axis.stride_drift_si),
            limits.load_deviation_max_si,
            Finding.MEAN_OF_STRIDE,
        )
    if axis.stride_energy_j > limits.stride_energy_max_j:
        yield Reason(
            Cause.ENERGY_LIMIT,
            axis.stride_energy_j,
            limits.stride_energy_max_j,
            Finding.STRIDE_ENERGY_J,
        )


def _positions(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    joint, limits = axis.joint, axis.limits
    if not joint.known or not axis.referenced or axis.homing:
        return
    lowest_si, highest_si = limits.position_min_si, limits.position_max_si
    if joint.position_si < lowest_si:
        yield Reason(Cause.POSITION_LIMIT, joint.position_si, lowest_si, Finding.BELOW)
    elif axis.stopping_end_si < lowest_si:
        yield Reason(Cause.STOPPING_PATH, axis.stopping_end_si, lowest_si, Finding.RESTS_BELOW)
    if joint.position_si > highest_si:
        yield Reason(Cause.POSITION_LIMIT, joint.position_si, highest_si, Finding.ABOVE)
    elif axis.stopping_end_si > highest_si:
        yield Reason(Cause.STOPPING_PATH, axis.stopping_end_si, highest_si, Finding.RESTS_ABOVE)


def _limits(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    joint, limits = axis.joint, axis.limits
    if not joint.known:
        return
    temperature_degc = axis.feedback.temperature_degc
    if axis.feedback.temperature_overdue:
        yield Reason(Cause.TEMPERATURE_LIMIT, 0.0, 0.0, Finding.NOT_MEASURED)
    if temperature_degc is not None and temperature_degc > limits.temperature_max_degc:
        yield Reason(
            Cause.TEMPERATURE_LIMIT,
            temperature_degc,
            limits.temperature_max_degc,
            Finding.TEMPERATURE_DEGC,
        )
    for cause, value, limit in (
        (Cause.VELOCITY_LIMIT, abs(joint.velocity_si), limits.velocity_max_si),
        (Cause.EFFORT_LIMIT, abs(joint.effort_si), limits.effort_max_si * EFFORT_MARGIN_RATIO),
        (Cause.POWER_LIMIT, joint.effort_si * joint.velocity_si, limits.power_max_w),
    ):
        if value > limit:
            yield Reason(cause, value, limit)


def _tracking(axis: AxisInputs, _: Thresholds) -> Iterator[Reason]:
    """Check that a joint is near its reference, whatever moves it away.

    A drive whose own loops hold a joint elsewhere than it was told does not obey its target, and
    would not obey that of a stop in which it holds.
    """
    limits = axis.limits
    limit_si = limits.hold_distance_max_si if axis.held else limits.tracking_max_si
    if axis.held and limit_si < axis.loop_distance_si < math.inf:
        yield Reason(Cause.NOT_FOLLOWING, axis.loop_distance_si, limit_si, Finding.HELD_AWAY)
    if abs(axis.tracking_si) > limit_si:
        yield Reason(Cause.TRACKING_LIMIT, abs(axis.tracking_si), limit_si)


EFFORT_MARGIN_RATIO = 1.1
"""Margin over the effort limit: the command is bounded, but the current loop may overshoot."""

Check = Callable[[AxisInputs, Thresholds], Iterator[Reason]]
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


def _check_leg(leg: LegInputs, thresholds: Thresholds) -> Iterator[Reason]:
    """Check the pose of a leg.

    Not while an axis seeks its home: it would be judged by the origin that the homing corrects, or
    is to find. That axis has the limits of its homing then, and all raw checks of both axes stay
    in force, as at a first homing, when no pose is known.
    """
    if leg.seeks_home:
        return
    if leg.singularity_ratio < thresholds.singularity_stop_ratio:
        yield Reason(
            Cause.SINGULARITY,
            leg.singularity_ratio,
            thresholds.singularity_stop_ratio,
            Finding.ANGLE_OF_SHOE,
        )
    elif leg.stopping_ratio < thresholds.singularity_stop_ratio:
        yield Reason(
            Cause.STOPPING_PATH,
            leg.stopping_ratio,
            thresholds.singularity_stop_ratio,
            Finding.ANGLE_ON_WAY_TO_REST,
        )


def _check_patient(
    axis: AxisEstimateInputs, thresholds: Thresholds
) -> Iterator[tuple[str, Reason]]:
    """Check the durations of a spasm and of clonus."""
    if axis.spasm_cycles > thresholds.spasm_patience_cycles:
        rise_si, limit_si = abs(axis.spasm_rise_si), axis.limits.spasm_rise_si
        yield axis.name, Reason(Cause.SPASM, rise_si, limit_si, Finding.RISE_AGAINST_MOTION)
    if axis.clonus_cycles > thresholds.clonus_patience_cycles:
        swing_si, limit_si = axis.clonus_swing_si, axis.limits.clonus_swing_si
        yield axis.name, Reason(Cause.CLONUS, swing_si, limit_si, Finding.SWINGS)


def _check_observer(leg: LegEstimateInputs) -> Iterator[tuple[str, Reason]]:
    """Check that the estimate of a leg is usable; not while an axis seeks its home (see above)."""
    if not leg.seeks_home and leg.observer_bad_cycles > OBSERVER_BAD_MAX_CYCLES:
        yield (
            leg.name,
            Reason(
                Cause.OBSERVER_INVALID,
                float(leg.observer_bad_cycles),
                float(OBSERVER_BAD_MAX_CYCLES),
                Finding.CYCLES_WITHOUT_ESTIMATE,
            ),
        )
