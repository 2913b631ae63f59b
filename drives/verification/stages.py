"""What is played, in order, and how it is judged. `verify` is a generator, as `bring_up` is.

Rules:
1.  Bring-up comes first and alone decides whether anything moves: a drive that is another one, or
    does not keep a mapping, a limit, an option code or a cleared offset, is refused by it.
2.  Torque is given in pulses of opposite signs, so that the motor ends at rest. They grow to the
    limit; a velocity above half of its limit ends them at once.
3.  A fact that fails before the first stop ends the verification, and so does a sign that was not
    measured: what comes after moves on the strength of it. Its facts are then not measured.
4.  Each stop begins from the same velocity, or is not judged. The master's heartbeat and the
    commands are left out here alone.
5.  A drive that is not to be enabled, a motor that does not run, and while it has torque a drive
    that is silent and a cycle of ours that is late end the verification.
6.  At the end the power is asked off by RPDO and by SDO until the drive shows that it is off.
"""

import math
from collections.abc import Callable, Generator
from typing import Final, NamedTuple

import numpy as np

from drives.bringup.bringup import bring_up
from drives.bringup.plan import CycleSettings, DrivePlan
from drives.bringup.port import DrivePort
from drives.canopen.bus import Bus, Clock
from drives.canopen.objects import Object
from drives.cia402.units import effort_to_permille, permille_to_effort, position_si
from drives.errors import BringUpRefused, BusError, DriveSilent
from drives.service.scan import Progress
from drives.signals import OperationMode, PowerRequest, PowerState
from drives.verification.bench import Bench, BenchLimits, Row
from drives.verification.facts import (
    Fact,
    FactCode,
    Judgement,
    after_lost_master,
    after_quick_stop,
    brakes_on_ramp,
    named,
    number,
)
from drives.verification.measure import inverse_inertia, ratio, rest_time_s

SAMPLE_CYCLES: Final = 100
SAMPLES_MIN_RATIO: Final = 0.99
ENABLE_MAX_S: Final = 2.0
STILL_CYCLES: Final = 50
STILL_MAX_REV: Final = 0.02
PULSE_CYCLES: Final = 5
AFTER_PULSE_CYCLES: Final = 20
EFFORT_RATIOS: Final = (0.1, 0.2, 0.4, 0.7, 1.0)
"""Shares of the limit of effort; the largest one that is not too fast is measured."""
TURNED_MIN_REV: Final = 0.06
"""Less may be the compliance of a contact that still sticks."""
TOO_FAST_RATIO: Final = 0.5
CORRELATION_MIN: Final = 0.5
SCALE_TOLERANCE: Final = 0.15
INERTIA_TOLERANCE: Final = 0.25
VELOCITY_RATIO: Final = 0.25
"""Velocity from which the stops begin, as a share of the limit."""
RUN_CYCLES: Final = 50
ANSWER_CYCLES: Final = 10
RUNS_MIN_RATIO: Final = 0.5
REST_MAX_CYCLES: Final = 25
SILENT_CYCLES: Final = 3
SPEED_UP_CYCLES: Final = 40
VELOCITY_TOLERANCE: Final = 0.2
STOP_CYCLES: Final = 150
SLACK_S: Final = 0.05
"""Added to each time limit: the cycles of command and sample."""
COMMAND_S: Final = 0.02
"""From the cycle of a command until a sample can show its effect."""
RAMP_MAX_RATIO: Final = 1.5
HAND_MAX_CYCLES: Final = 30_000
TURN_TOLERANCE: Final = 0.03
RESET_MAX_CYCLES: Final = 150
COMMUNICATION_ERRORS: Final = (0x8100, 0x82FF)
"""EMCY codes of CiA 301: monitoring, communication, protocol."""
NOTHING: Final = PowerRequest.DISABLE_VOLTAGE
_OFF: Final = PowerState.SWITCH_ON_DISABLED.name
TORQUE, POSITION = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION
_VELOCITY_ACTUAL: Final = 0x606C


class Options(NamedTuple):
    """What the operator knows or does."""

    inertia_si: float | None = None
    """At the joint, kg·m² or kg; None: not known, and the scale of the torque is not measured."""
    turn_by_hand: Callable[[], bool] | None = None
    """True as soon as a person has turned the motor by one turn, in the sense in which the axis is
    positive; asked each cycle. None: no one turns it."""


class Verification(NamedTuple):
    """Everything that was found."""

    facts: tuple[Fact, ...]
    steps: tuple[str, ...]
    """Steps of bring-up that were done."""
    refusal: str
    """Why bring-up ended early; empty if it did not."""
    rows: tuple[Row, ...]
    serial_number: int = 0
    """1018h:04 as read; 0: unknown."""
    is_off: bool = True
    """The drive has shown that its power stage is off."""

    @property
    def passed(self) -> bool:
        """True if nothing failed."""
        return all(fact.judgement is not Judgement.FAILED for fact in self.facts)


Stage = Callable[[Bench, Options], list[Fact]]


def verify(
    plan: DrivePlan,
    limits: BenchLimits,
    cycle: CycleSettings,
    options: Options,
    *,
    bus: Bus,
    clock: Clock,
    port: DrivePort,
) -> Generator[Progress, None, Verification]:
    """Bring the drive up, play all stages, and return what was found.

    Args:
        plan: bring-up of the drive, as of a single axis.
        limits: bounds of the motion.
        cycle: as the plan was made with.
        options: of the operator.
        bus: with this drive alone.
        clock: of the bus.
        port: over the bus.

    Raises:
        BusError: the bus is down.
    """
    steps: list[str] = []
    bringing = bring_up([plan], port, cycle)
    total_count = len(plan.steps) + 2 + len(_STAGES)
    try:
        while True:
            step = next(bringing)
            steps.append(step.text)
            yield Progress(step.text, step.done_count, total_count)
    except StopIteration as end:
        report = end.value[0]
    except (BringUpRefused, DriveSilent) as error:
        facts = (named(FactCode.BRING_UP, type(error).__name__, "done"), *_unmeasured())
        return Verification(facts, tuple(dict.fromkeys(steps)), str(error), ())
    bench = Bench(plan, report, limits, cycle, bus=bus, clock=clock, port=port)
    found = [named(FactCode.BRING_UP, "done", "done")]
    refusal, is_off = "", False
    try:
        for number_of, (name, stage) in enumerate(_STAGES.items()):
            yield Progress(name, len(plan.steps) + 2 + number_of, total_count)
            bench.stage = name
            made = stage(bench, options)
            found += made
            ending = next(filter(_ends, made), None)
            if ending is not None:
                refusal = f"{name}: {ending.code.name}, {ending.judgement.name}"
                break
    except (_EndedError, BusError) as error:
        refusal = f"{bench.stage}: {error}"
    finally:
        bench.stage = "leave"
        is_off = bench.leave()
    found.append(named(FactCode.COMPLETED, refusal or "done", "done"))
    known = {fact.code for fact in found}
    found += [fact for fact in _unmeasured() if fact.code not in known]
    return Verification(
        tuple(found),
        tuple(dict.fromkeys(steps)),
        refusal,
        tuple(bench.rows),
        report.serial_number,
        is_off,
    )


class _EndedError(Exception):
    """The verification cannot go on; the text says why."""


def _ends(fact: Fact) -> bool:
    """Rule 3."""
    if fact.judgement is Judgement.NOT_MEASURED:
        return fact.code in _NEEDED
    return fact.judgement is Judgement.FAILED and fact.code in _DECISIVE


# --- at rest --------------------------------------------------------------------------------------


def _samples(bench: Bench, _options: Options) -> list[Fact]:
    fresh = [bench.turn(NOTHING).fresh for _ in range(SAMPLE_CYCLES)]
    share = sum(fresh) / len(fresh)
    word, position = bench.feedback.statusword, bench.feedback.position_counts
    read_word = bench.read(Object.STATUSWORD, 0)
    read_position = bench.read(Object.POSITION, 0, signed=True)
    different = None if read_word is None else float((word ^ read_word).bit_count())
    apart = None if read_position is None else float(position - read_position)
    allowed = bench.counts_per_rev * STILL_MAX_REV
    return [
        number(FactCode.SAMPLES, share, SAMPLES_MIN_RATIO, 1.0),
        number(FactCode.STATUSWORD_MAPPED, different, 0, 0),
        number(FactCode.POSITION_MAPPED, apart, -allowed, allowed),
    ]


def _encoder(bench: Bench, options: Options) -> list[Fact]:
    ratio = None
    if options.turn_by_hand is not None:
        before = bench.turn(NOTHING).position_counts
        for _ in range(HAND_MAX_CYCLES):
            if options.turn_by_hand():
                break
            bench.turn(NOTHING)
        bench.turn(NOTHING)
        after = bench.turn(NOTHING).position_counts
        sign = bench.plan.description.axis.transmission.sign
        ratio = sign * (after - before) / bench.counts_per_rev
    return [number(FactCode.ENCODER, ratio, 1 - TURN_TOLERANCE, 1 + TURN_TOLERANCE)]


# --- torque ---------------------------------------------------------------------------------------


def _enable(bench: Bench, mode: OperationMode) -> float | None:
    """Enable; return the time that it took, or None."""
    for count in range(round(ENABLE_MAX_S / bench.period_s)):
        if bench.turn(PowerRequest.ENABLE, mode).power_state is PowerState.OPERATION_ENABLED:
            return count * bench.period_s
    return None


def _pulses(bench: Bench, options: Options) -> list[Fact]:
    """Torque of 0, then of both signs, in growing pulses."""
    if bench.feedback.power_state is PowerState.FAULT:  # of before
        _reset_fault(bench)
    took_s = _enable(bench, TORQUE)
    facts = [number(FactCode.ENABLED, took_s, 0, ENABLE_MAX_S)]
    if took_s is None:
        return [Fact(FactCode.ENABLED, Judgement.FAILED)]
    before, turned = bench.feedback.position_counts, 0.0
    for _ in range(STILL_CYCLES):
        bench.turn(PowerRequest.ENABLE, TORQUE)
        _refuse_blind(bench)
        turned = abs(bench.feedback.position_counts - before) / bench.counts_per_rev
        if turned > STILL_MAX_REV:
            break
    facts.append(number(FactCode.STANDSTILL, turned, 0, STILL_MAX_REV))
    if facts[-1].judgement is Judgement.FAILED:
        return facts
    sign = scale = mass = None
    for share in EFFORT_RATIOS:
        rows, is_too_fast = _doublet(bench, share * bench.limits.effort_max_si)
        position = np.array([row.position_counts for row in rows], dtype=np.float64)
        if np.ptp(position) < TURNED_MIN_REV * bench.counts_per_rev:
            if is_too_fast:
                break
            continue
        commanded = np.array(
            [permille_to_effort(row.torque_permille, bench.scaling) for row in rows]
        )
        seen = np.array([row.torque_raw for row in rows]) * bench.scaling.effort_per_torque_count_si
        moved = np.array([position_si(one, bench.scaling) for one in position])
        speeding, sign = inverse_inertia(commanded, moved, bench.period_s)
        scale = ratio(commanded, seen)
        if options.inertia_si is not None and speeding > 0.0:
            mass = 1.0 / speeding / options.inertia_si
        if is_too_fast:
            break
    _rest(bench)
    low, high = 1 - INERTIA_TOLERANCE, 1 + INERTIA_TOLERANCE
    return [
        *facts,
        number(FactCode.SIGN, sign, CORRELATION_MIN, 1.0),
        number(FactCode.EFFORT_SCALE, scale, 1 - SCALE_TOLERANCE, 1 + SCALE_TOLERANCE),
        number(FactCode.INERTIA, mass, low, high),
    ]


def _doublet(bench: Bench, effort_si: float) -> tuple[list[Row], bool]:
    """Pulses of +, − twice as long, and +: velocity and position end near where they began.

    Returns: the cycles, and whether they ended early because the motor was too fast.
    """
    begin, is_too_fast = len(bench.rows), False
    fast = TOO_FAST_RATIO * bench.limits.velocity_max_si_per_s * bench.period_s
    for sign in (1, -1, -1, 1):
        permille = effort_to_permille(sign * effort_si, bench.scaling)
        for _ in range(0 if is_too_fast else PULSE_CYCLES):
            before = bench.feedback.position_counts
            after = bench.turn(PowerRequest.ENABLE, TORQUE, torque_permille=permille)
            _refuse_blind(bench)
            is_too_fast |= abs(after.position_counts - before) > abs(
                fast * bench.scaling.counts_per_si
            )
            if is_too_fast:
                break
    for _ in range(AFTER_PULSE_CYCLES):
        bench.turn(PowerRequest.ENABLE, TORQUE)
    return bench.rows[begin:], is_too_fast


def _rest(bench: Bench) -> None:
    """Take the power off, and wait until the motor rests."""
    _without_power(bench)
    for _ in range(REST_MAX_CYCLES):
        before = bench.feedback.position_counts
        _without_power(bench)
        if abs(bench.feedback.position_counts - before) <= STILL_MAX_REV * bench.counts_per_rev:
            return
    raise _EndedError("the motor does not come to rest without power")


def _refuse_blind(bench: Bench) -> None:
    """Rule 5: no torque without a view of the motor."""
    if bench.was_late:
        raise _EndedError("this computer began a cycle more than a period late: gaitd doctor")
    if bench.silent_count >= SILENT_CYCLES:
        raise _EndedError(f"the drive sent no whole sample in {SILENT_CYCLES} cycles")


# --- position and velocity ------------------------------------------------------------------------


class _Run:
    """A motion of constant velocity in cyclic synchronous position, towards the first position."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        sense = 1 if bench.feedback.position_counts < bench.rows[0].position_counts else -1
        velocity = VELOCITY_RATIO * bench.limits.velocity_max_si_per_s
        self.counts_per_s = sense * velocity * abs(bench.scaling.counts_per_si)
        if _enable(bench, POSITION) is None:
            raise _EndedError("the drive is not to be enabled")
        self.target = float(bench.feedback.position_counts)
        self.apart_max, before = 0.0, 0
        for count in range(RUN_CYCLES):
            before = bench.feedback.position_counts
            self.step(min(1.0, count / SPEED_UP_CYCLES))
        speed = (bench.feedback.position_counts - before) / bench.period_s
        if not RUNS_MIN_RATIO <= speed / self.counts_per_s <= 1 / RUNS_MIN_RATIO:
            raise _EndedError("the motor does not run with the velocity of its target")

    def step(self, share: float = 1.0) -> None:
        """One more cycle of the motion."""
        bench = self._bench
        self.target += share * self.counts_per_s * bench.period_s
        seen = bench.turn(PowerRequest.ENABLE, POSITION, target_counts=round(self.target))
        _refuse_blind(bench)
        self.apart_max = max(self.apart_max, abs(self.target - seen.position_counts))


def _velocity(bench: Bench, _options: Options) -> list[Fact]:
    run = _Run(bench)
    bench.request(_VELOCITY_ACTUAL, 0)
    for _ in range(ANSWER_CYCLES):
        run.step()
    shown = bench.answer(_VELOCITY_ACTUAL, 0)
    unit = bench.scaling.speed_counts_per_si / abs(bench.scaling.counts_per_si)
    ratio = None if shown is None else shown / (run.counts_per_s * unit)
    for count in range(SPEED_UP_CYCLES):
        run.step(1.0 - count / SPEED_UP_CYCLES)
    window = bench.limits.following_error_si * abs(bench.scaling.counts_per_si)
    low, high = 1 - VELOCITY_TOLERANCE, 1 + VELOCITY_TOLERANCE
    facts = [
        number(FactCode.FOLLOWING, run.apart_max / window, 0, 1),
        number(FactCode.VELOCITY_UNIT, ratio, low, high),
    ]
    _without_power(bench)
    return facts


def _without_power(bench: Bench) -> None:
    for _ in range(AFTER_PULSE_CYCLES):
        bench.turn(NOTHING)


# --- stops ----------------------------------------------------------------------------------------


class _Stop(NamedTuple):
    """What a stop looked like."""

    left_s: float | None
    """Time until operation enabled was left, or the drive fell silent."""
    rest_s: float | None
    way_counts: float
    """From the cycle of the command to rest."""
    state: str | None
    """By SDO, at the end."""


def _stopped(
    bench: Bench, run: _Run, power: PowerRequest, *, heartbeat: bool = True, commands: bool = True
) -> _Stop:
    """Play what stops the drive, and look at it until it has had time to rest."""
    positions: list[float] = [bench.feedback.position_counts]
    left_s = None
    for count in range(STOP_CYCLES):
        if left_s is None:  # a target that stood still would brake, too
            run.target += run.counts_per_s * bench.period_s
        seen = bench.turn(
            power,
            POSITION,
            target_counts=round(run.target),
            heartbeat=heartbeat,
            commands=commands,
        )
        is_left = seen.power_state is not PowerState.OPERATION_ENABLED
        if left_s is None and (is_left or bench.silent_count == SILENT_CYCLES):
            left_s = (count + 1 - max(bench.silent_count, 1)) * bench.period_s
        position = seen.position_counts if seen.fresh else bench.answer(Object.POSITION, 0)
        positions.append(float("nan") if position is None else position)
        if not seen.fresh:  # its PDOs may have ended, its SDOs have not
            bench.request(Object.POSITION, 0)
    rest_s = rest_time_s(positions, bench.period_s, run.counts_per_s)
    state = bench.power_state()
    known = [one for one in positions if not math.isnan(one)]
    way_counts = abs(known[-1] - known[0])
    return _Stop(left_s, rest_s, way_counts, None if state is None else state.name)


def _quick_stop(bench: Bench, _options: Options) -> list[Fact]:
    stop = _stopped(bench, run := _Run(bench), PowerRequest.QUICK_STOP)
    _without_power(bench)
    ratio = None
    if brakes_on_ramp(bench.plan):
        speed = abs(run.counts_per_s)
        ramp = bench.limits.deceleration_si_per_s2 * abs(bench.scaling.counts_per_si)
        allowed = speed * COMMAND_S + RAMP_MAX_RATIO * speed**2 / 2 / ramp
        ratio = stop.way_counts / allowed
    ended = after_quick_stop(bench.plan).name
    return [
        named(FactCode.QUICK_STOP_STATE, stop.state, ended),
        number(FactCode.QUICK_STOP_WAY, ratio, 0, 1),
    ]


def _shutdown(bench: Bench, _options: Options) -> list[Fact]:
    stop = _stopped(bench, _Run(bench), PowerRequest.READY)
    _without_power(bench)
    return [named(FactCode.SHUTDOWN_STATE, stop.state, PowerState.READY_TO_SWITCH_ON.name)]


def _disable_voltage(bench: Bench, _options: Options) -> list[Fact]:
    stop = _stopped(bench, _Run(bench), PowerRequest.DISABLE_VOLTAGE)
    return [named(FactCode.DISABLE_VOLTAGE_STATE, stop.state, _OFF)]


def _command_loss(bench: Bench, options: Options) -> list[Fact]:
    """A drive with 1400h:05 leaves operation enabled without commands; SYNC and heartbeat go on."""
    if not bench.plan.description.profile.pdo.rpdo_timeout:
        return []
    stop = _stopped(bench, _Run(bench), PowerRequest.ENABLE, commands=False)
    limit_s = bench.cycle.rpdo_timeout_ms * 1e-3 + SLACK_S
    found = STOP_CYCLES * bench.period_s if stop.left_s is None else stop.left_s
    after = [fact for fact in _reset(bench, options) if fact.judgement is Judgement.FAILED]
    return [
        *after,
        number(FactCode.COMMAND_LOSS_TIME, found, 0, limit_s),
        named(FactCode.COMMAND_LOSS_STATE, stop.state, *after_lost_master(bench.plan)),
    ]


def _heartbeat_loss(bench: Bench, _options: Options) -> list[Fact]:
    emergencies = bench.drive.emergencies
    before = emergencies.count
    stop = _stopped(bench, _Run(bench), PowerRequest.ENABLE, heartbeat=False)
    limit_s = bench.cycle.drive_detection_ms * 1e-3 + SLACK_S
    never_s = STOP_CYCLES * bench.period_s
    left_s = never_s if stop.left_s is None else stop.left_s
    rest_s = never_s if stop.rest_s is None else stop.rest_s
    codes, new_count = [one.code for one in emergencies.ring], emergencies.count - before
    new = codes[-new_count:] if new_count else []
    low, high = COMMUNICATION_ERRORS
    code = next((one for one in new if low <= one <= high), new[-1] if new else 0)
    fault_s = bench.plan.description.profile.fault_reaction_max_ms * 1e-3
    return [
        number(FactCode.HEARTBEAT_LOSS_TIME, left_s, 0, limit_s),
        named(FactCode.HEARTBEAT_LOSS_STATE, stop.state, *after_lost_master(bench.plan)),
        number(FactCode.HEARTBEAT_LOSS_REST, rest_s, 0, limit_s + fault_s),
        number(FactCode.HEARTBEAT_LOSS_EMCY, code, low, high),
    ]


def _reset_fault(bench: Bench) -> None:
    for _ in range(RESET_MAX_CYCLES):
        if bench.turn(PowerRequest.FAULT_RESET).power_state is PowerState.SWITCH_ON_DISABLED:
            break
    _without_power(bench)


def _reset(bench: Bench, _options: Options) -> list[Fact]:
    """Bring the drive up again, which is how the service meets it, and reset its fault."""
    try:
        bench.bring_up()
    except (BringUpRefused, DriveSilent) as error:
        return [named(FactCode.FAULT_RESET, type(error).__name__, _OFF)]
    _without_power(bench)
    _reset_fault(bench)
    state, register = bench.power_state(), bench.read(Object.ERROR_REGISTER, 0)
    return [
        named(FactCode.FAULT_RESET, None if state is None else state.name, _OFF),
        number(FactCode.ERROR_CLEARED, None if register is None else float(register), 0, 0),
    ]


_STAGES: Final[dict[str, Stage]] = {
    "samples": _samples,
    "encoder": _encoder,
    "torque": _pulses,
    "velocity": _velocity,
    "quick stop": _quick_stop,
    "shutdown": _shutdown,
    "disable voltage": _disable_voltage,
    "command loss": _command_loss,
    "heartbeat loss": _heartbeat_loss,
    "reset": _reset,
}
_OF_STAGE: Final[dict[str, tuple[FactCode, ...]]] = {
    "samples": (FactCode.SAMPLES, FactCode.STATUSWORD_MAPPED, FactCode.POSITION_MAPPED),
    "encoder": (FactCode.ENCODER,),
    "torque": (
        FactCode.ENABLED,
        FactCode.STANDSTILL,
        FactCode.SIGN,
        FactCode.EFFORT_SCALE,
        FactCode.INERTIA,
    ),
    "velocity": (FactCode.FOLLOWING, FactCode.VELOCITY_UNIT),
    "quick stop": (FactCode.QUICK_STOP_STATE, FactCode.QUICK_STOP_WAY),
    "shutdown": (FactCode.SHUTDOWN_STATE,),
    "disable voltage": (FactCode.DISABLE_VOLTAGE_STATE,),
    "command loss": (FactCode.COMMAND_LOSS_TIME, FactCode.COMMAND_LOSS_STATE),
    "heartbeat loss": (
        FactCode.HEARTBEAT_LOSS_TIME,
        FactCode.HEARTBEAT_LOSS_STATE,
        FactCode.HEARTBEAT_LOSS_REST,
        FactCode.HEARTBEAT_LOSS_EMCY,
    ),
    "reset": (FactCode.FAULT_RESET, FactCode.ERROR_CLEARED),
}
_DECISIVE: Final = frozenset(
    {
        *_OF_STAGE["samples"],
        *_OF_STAGE["encoder"],
        *_OF_STAGE["torque"],
        *_OF_STAGE["velocity"],
        FactCode.FAULT_RESET,
    }
)
_NEEDED: Final = frozenset({FactCode.STATUSWORD_MAPPED, FactCode.POSITION_MAPPED, FactCode.SIGN})
"""Facts that later stages rely on, and those of them that must have been measured."""


def _unmeasured() -> list[Fact]:
    return [Fact(code, Judgement.NOT_MEASURED) for codes in _OF_STAGE.values() for code in codes]
