"""Invariants of the service, checked on the wire and on the true state of the plant.

The checker receives every frame of the master, and knows the true state of drives and plant. The
core's own outputs are used only where they are themselves checked: records, answers, verdicts. The
checker also knows the requests of the session. The rules, by the names that a violation carries:

1. Enables unasked: an RPDO1 that begins to enable a drive comes only after an ENABLE request (or
   one for one axis), with no stop, kill or refusal since then. After a stop other than DISABLE
   there must have been a RESET request before.
2. Powered unasked: a drive enters "operation enabled" only in such a time, or just after: one that
   quick-stopped by itself may execute the last command sent before the stop was seen
   (transition 16).
3. Torque without power: a motor gives torque only in states with the power stage on.
4. Left enabled in silence: a drive to which nothing was sent for 1016h and a margin is not enabled
   any more.
5. Stops apart, stop not done, enabled still: `stops.py`.
6. Beyond the limit: a joint is not more than a margin beyond its hard limit (`position_limits.py`).
7. Torque jumps: 6071h changes by no more than limits.toml's rate times the time between two
   commands, while the drive is commanded to enable in cyclic torque. The first torque is the one
   that holds the leg at its true pose, within FIRST_TORQUE_OFF_MAX and what the damper of the hold
   adds at its true speed, unless a fault made the drive measure or push wrongly.
8. Verdict milder: a latched verdict never becomes milder, and fault is not left, without RESET;
   nor does a core that was left an unreset stop become ready without it.
9. Answers: each request is answered once, within TIMEOUT_S of a living core and gateway.
10. Records: those of one core have no gap, and each can be encoded.
11. Our own bug: no exception leaves a cycle.
12. Assist outlives its lease, assist beyond its limit: `assisted.py`.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gaitd_names import Cause, Mode, Outcome, RequestKind, StopCategory

from daemon.ipc.record import CycleRecord, GatewayState, ModeRequest
from gaitd_lab.random_sessions.assisted import AssistWatch
from gaitd_lab.random_sessions.position_limits import BEFORE_S, BLINDING, outside_limit
from gaitd_lab.random_sessions.stops import StopWatch
from gaitd_lab.random_sessions.watched_drive import Violation, WatchedDrive
from sim_drives.cia402.power_state import POWER_STAGE_ON, PowerState
from sim_drives.plant.truth import Pair, Truth
from sim_drives.settings import FaultKind

NS_PER_S: Final = 1_000_000_000
SYNC_ID: Final = 0x080
NMT_ID: Final = 0x000
RPDO1, RPDO2 = 0x200, 0x300
CYCLIC_TORQUE: Final = 10
ENABLE_MASK, ENABLE_VALUE = 0x008F, 0x000F
NMT_DISABLING: Final = frozenset({0x02, 0x80, 0x81, 0x82})
"""Stop, pre-operational, both resets: the drive leaves operational, and stops."""
ALONE: Final = frozenset({Mode.REFERENCE, Mode.COMMISSION})
WITHOUT_RESET: Final = frozenset({Cause.NONE, Cause.SHUTDOWN, Cause.DRIVE_POWERED})
"""Verdicts not stored over a restart: none, a normal end, and a drive that reappears by itself."""
BROUGHT_UP: Final = frozenset({m for m in Mode if m.active} | {Mode.READY})

TIMEOUT_S: Final = 15.0
"""Time limit of an answer: the longest request, gait from an unfavourable pose, takes seconds."""
SILENCE_MARGIN_S: Final = 0.02
EFFORT_FLOOR: Final = (0.5, 5.0)
"""N·m, N: smaller values are no torque (the current decays within a few milliseconds)."""
FIRST_TORQUE_OFF_MAX: Final = (1.0, 10.0)
"""N·m, N: tolerance of the holding effort; encoder noise, the spring of the first cycles."""
ENABLING_GRACE_S: Final = 0.05
"""Time from a controlword to the drive's state."""
BLINDED_AFTER_NS: Final = round(BEFORE_S * NS_PER_S)
ENABLED_STILL_NS: Final = 50_000_000
"""A drive that has not yet executed DISABLE may be commanded on, and then be enabled again."""
DELAYING: Final = frozenset({FaultKind.SLOW_STATE})
"""Faults after which a state may come later than its controlword."""


class _Before(NamedTuple):
    """A request, and the state before it: a refusal restores it."""

    kind: RequestKind
    permitted: bool
    alone: bool
    needs_reset: bool
    inherited: bool
    reset_requested: bool


@dataclass
class Watch:
    """All rules over one session; collects `violations`."""

    drives: dict[int, WatchedDrive]
    period_s: float
    detection_s: float
    load_of: Callable[[Pair], Pair]
    """Effort that holds a leg at a pose: N·m, N."""
    assist: AssistWatch
    stops: StopWatch
    violations: list[Violation] = field(default_factory=list)
    now_ns: int = 0
    _permitted: bool = False
    _permitted_ns: int = -(10**18)
    _needs_reset: bool = False
    _orderly: bool = False
    """True if DISABLE or RESET was requested since the last ENABLE."""
    _over: bool = False
    """Its value at that ENABLE: the previous enabled time may end after it."""
    _unreset_stop: bool = False
    """True if the core, ending now, would leave a stop that only RESET clears."""
    _inherited: bool = False
    """True if an earlier core has left such a stop, without a RESET request since."""
    _last_frame_ns: int = 0
    _requests: dict[int, "_Before"] = field(default_factory=dict)
    _answers: dict[int, Outcome] = field(default_factory=dict)
    _waiting_s: float = 0.0
    _latched: StopCategory = StopCategory.NONE
    _reset_requested: bool = False
    _left_fault: bool = False
    """True if fault was left since the RESET request."""
    _seq: int | None = None
    _alone: bool = False

    # --- actions of the session -----------------------------------------------------------------

    def request_sent(self, number: int, kind: RequestKind, wanted: ModeRequest) -> None:
        """Note a request that is sent."""
        self._requests[number] = _Before(
            *(kind, self._permitted, self._alone),
            *(self._needs_reset, self._inherited, self._reset_requested),
        )
        self._waiting_s = 0.0
        if kind == RequestKind.RESET:
            self._left_fault = False
        if kind in {RequestKind.DISABLE, RequestKind.RESET}:
            self._orderly = True
            self._needs_reset = self._needs_reset and kind != RequestKind.RESET
            self._reset_requested = self._reset_requested or kind == RequestKind.RESET
            self._inherited = self._inherited and kind != RequestKind.RESET
        enables = kind == RequestKind.ENABLE
        alone = kind == RequestKind.MODE and wanted.mode in ALONE
        if (enables or alone) and not self._needs_reset:
            self._permit(alone=alone)

    def _permit(self, *, alone: bool) -> None:
        if not self._permitted:
            self._permitted_ns = self.now_ns
        self._over = self._orderly
        self._permitted, self._orderly, self._alone = True, False, alone

    def requests_stop(self) -> None:
        """Note that the stop count rises, and a core receives it."""
        self._permitted = False
        self.stops.stop_requested()

    def injects(self, kind: FaultKind, name: str, until_ns: int) -> None:
        """Note that a fault begins."""
        for drive in self.drives.values():
            if name in {drive.rules.name, "*"}:
                if kind in BLINDING:
                    drive.blinded_ns = max(drive.blinded_ns, until_ns)
                if kind in DELAYING:
                    drive.delayed_ns = max(drive.delayed_ns, until_ns)

    def core_ended(self) -> None:
        """Note that the process has ended: a new one enables nothing without a request."""
        self._permitted = False
        self._needs_reset = self._inherited = self._unreset_stop
        self.assist.core_ended()
        self._requests.clear()
        self._answers.clear()
        self._seq = None
        self._latched = StopCategory.NONE
        for drive in self.drives.values():
            if drive.commanded_enable:
                drive.commanded_until_ns = self.now_ns
            drive.commanded_enable, drive.commanded_torque = False, None
        self.stops.core_ended()

    def gateway_state_sent(self, gateway_state: GatewayState) -> None:
        """Note a gateway state sent to the core."""
        self.assist.gateway_state_sent(gateway_state)

    # --- the wire -------------------------------------------------------------------------------

    def sent(self, time_ns: int, can_id: int, data: bytes) -> None:
        """Check a frame of the master."""
        self.now_ns = time_ns
        if can_id == SYNC_ID:
            self._last_frame_ns = time_ns
            self._add_violations(self.stops.sync())
        elif can_id == NMT_ID and data[0] in NMT_DISABLING:
            for drive in self.drives.values():
                if data[1] in {0, drive.rules.node_id}:
                    self._command_enable(drive, enable=False)
        elif can_id - RPDO1 in self.drives:
            self._check_enable(self.drives[can_id - RPDO1], data)
        elif can_id - RPDO2 in self.drives:
            self._check_torque_step(self.drives[can_id - RPDO2], data)
        elif can_id & 0x780 == 0x700:
            self._last_frame_ns = time_ns

    def _check_enable(self, drive: WatchedDrive, data: bytes) -> None:
        controlword = int.from_bytes(data[:2], "little")
        drive.commanded_mode = int.from_bytes(data[2:3], "little", signed=True)
        enable = controlword & ENABLE_MASK == ENABLE_VALUE
        if enable and not drive.commanded_enable and not self._permitted:
            self._break("enables unasked", f"{drive.rules.name} is sent {controlword:04X}h")
        self._command_enable(drive, enable=enable)

    def _command_enable(self, drive: WatchedDrive, *, enable: bool) -> None:
        stops = drive.commanded_enable and not enable
        drive.begins = (drive.begins or not drive.commanded_enable) and enable
        if stops:
            drive.commanded_until_ns = self.now_ns
        drive.commanded_enable = enable
        self._unreset_stop = self._unreset_stop or enable
        self.stops.enable_commanded(drive, enable=enable)
        if not enable:
            drive.commanded_torque = None
        if stops:
            # Just after ENABLE this may be the end of the previous time: a late DISABLE.
            if not self._over or self.now_ns - self._permitted_ns > ENABLED_STILL_NS:
                self._permitted = False
            self._needs_reset = self._needs_reset or not self._orderly
            if not self._alone:
                self.stops.begins(self.drives.values())

    def _add_violations(self, found: Iterable[tuple[str, str]]) -> None:
        for rule, what in found:
            self._break(rule, what)

    def _check_torque_step(self, drive: WatchedDrive, data: bytes) -> None:
        begins, drive.begins = drive.begins, drive.begins and not drive.commanded_enable
        if not (drive.commanded_enable and drive.commanded_mode == CYCLIC_TORQUE):
            drive.commanded_torque = None
            return
        count, before = int.from_bytes(data, "little", signed=True), drive.commanded_torque
        count_si = drive.rules.effort_per_count_si
        if before is not None:
            span_s = max((self.now_ns - drive.commanded_ns) / NS_PER_S, self.period_s)
            step_si = abs(count - before) * count_si
            most_si = drive.rules.rate_si_per_s * span_s * 1.01 + 2 * count_si
            if step_si > most_si:
                what = f"by {step_si:.4g} in {span_s * 1e3:.1f} ms, {most_si:.4g}"
                self._break("torque jumps", f"{drive.rules.name} {what}")
        elif begins and self.now_ns > drive.blinded_ns + BLINDED_AFTER_NS:
            # Magnitudes: the sign in which the drive counts is not checked here.
            off_si = abs(abs(count) * count_si - abs(drive.load_si))
            most_si = FIRST_TORQUE_OFF_MAX[drive.rules.axis] + drive.damper_si
            if off_si > most_si:
                what = f"begins {off_si:.4g} from what holds it, {drive.load_si:.4g}; {most_si:.4g}"
                self._break("torque jumps", f"{drive.rules.name} {what}")
        drive.commanded_torque, drive.commanded_ns = count, self.now_ns

    # --- the truth ------------------------------------------------------------------------------

    def check_truth(self, now_ns: int, truths: dict[str, Truth]) -> None:
        """Check the true state of drives and plants; called about every 10 ms."""
        self.now_ns = now_ns
        for drive in self.drives.values():
            state = drive.node.drive.state
            self._check_power(drive, state)
            truth = truths[drive.rules.leg]
            self._check_torque_off(drive, state, truth)
            axis = drive.rules.axis
            drive.load_si = self.load_of(truth.position)[axis]
            drive.damper_si = drive.rules.damping_si * abs(truth.velocity[axis])
            drive.state = state
            if state not in POWER_STAGE_ON:
                drive.unpowered_ns = now_ns
        for drive in self.drives.values():
            of_leg = [one for one in self.drives.values() if one.rules.leg == drive.rules.leg]
            found = outside_limit(drive, of_leg, truths[drive.rules.leg], now_ns)
            self._add_violations(found)

    def _check_power(self, drive: WatchedDrive, state: PowerState) -> None:
        enabled = state is PowerState.OPERATION_ENABLED
        began = enabled and drive.state is not PowerState.OPERATION_ENABLED
        grace_s = ENABLING_GRACE_S
        if self.now_ns < drive.delayed_ns:
            grace_s += 1.0
        since_ns = max(self._permitted_ns, drive.commanded_until_ns)
        lately = self.now_ns - since_ns < grace_s * NS_PER_S
        if began and not (self._permitted or lately or drive.commanded_enable):
            self._break("powered unasked", f"{drive.rules.name} is enabled")
        self._add_violations(self.stops.check_truth(drive, self.now_ns, enabled=enabled))
        silent_s = (self.now_ns - self._last_frame_ns) / NS_PER_S
        if enabled and silent_s > self.detection_s + SILENCE_MARGIN_S:
            what = f"{drive.rules.name} after {silent_s * 1e3:.0f} ms"
            self._break("left enabled in silence", what)

    def _check_torque_off(self, drive: WatchedDrive, state: PowerState, truth: Truth) -> None:
        off = state not in POWER_STAGE_ON
        axis = drive.rules.axis
        if off and drive.was_off and abs(truth.effort[axis]) > EFFORT_FLOOR[axis]:
            what = f"{drive.rules.name} gives {truth.effort[axis]:.3g} in {state.name.lower()}"
            self._break("torque without power", what)
        drive.was_off = off

    # --- the core's outputs ---------------------------------------------------------------------

    def receive(self, record: CycleRecord) -> None:
        """Check a record of the running core."""
        if self._seq is not None and record.seq != self._seq + 1:
            self._break("records", f"{record.seq} comes after {self._seq}")
        self._seq = record.seq
        self._update_unreset_stop(record)
        self._check_verdict(record)
        self._check_answer(record)
        self._add_violations(self.stops.receive(record))
        self._add_violations(self.assist.receive(record))

    def _update_unreset_stop(self, record: CycleRecord) -> None:
        """Update the unreset stop, before `_latched` is updated by this record."""
        mode, cause = record.mode, record.verdict.cause
        if self._inherited and mode in BROUGHT_UP:
            self._break("verdict milder", f"{mode}, and an earlier core owes a reset")
        stopped = mode in {Mode.STOPPING, Mode.FAULT}
        if stopped and cause not in WITHOUT_RESET:
            self._unreset_stop = True
        elif mode == Mode.READY or (mode == Mode.FAULT and cause == Cause.SHUTDOWN):
            self._unreset_stop = False
        elif self._latched is not StopCategory.NONE and not stopped:
            self._unreset_stop = mode.active

    def _check_verdict(self, record: CycleRecord) -> None:
        before, now = self._latched, record.verdict.category
        stopped = record.mode in {Mode.STOPPING, Mode.FAULT}
        if (
            before is not StopCategory.NONE
            and not self._reset_requested
            and (now.severity < before.severity or not stopped)
        ):
            what = f"{before.name} becomes {now.name} in {record.mode}"
            self._break("verdict milder", what)
        if not stopped:
            self._latched, self._left_fault = StopCategory.NONE, True
            return
        if now is not StopCategory.NONE and before == StopCategory.NONE:
            self._needs_reset, self._reset_requested = True, False
        self._latched = now

    def _check_answer(self, record: CycleRecord) -> None:
        result = record.request
        request = self._requests.get(result.id)
        if request is None:
            return
        before = self._answers.get(result.id)
        if before is not None and result.outcome != before:
            self._break("answers", f"{result.id} was {before.name}, is {result.outcome.name}")
        if result.outcome == Outcome.PENDING:
            return
        if before is None:
            self._answers[result.id] = result.outcome
            self._record_answer(request, result.outcome)

    def _record_answer(self, before: "_Before", outcome: Outcome) -> None:
        if outcome != Outcome.REFUSED:
            return
        if before.kind in {RequestKind.ENABLE, RequestKind.MODE}:
            self._permitted = self._permitted and before.permitted
            self._alone = before.alone
        if before.kind == RequestKind.RESET and not self._left_fault:
            self._needs_reset = self._needs_reset or before.needs_reset
            self._inherited = self._inherited or before.inherited
            self._reset_requested = self._reset_requested and before.reset_requested

    def waits(self, span_s: float, number: int) -> None:
        """Check the time of a pending request; core and gateway are alive."""
        if number in self._answers:
            return
        self._waiting_s += span_s
        if self._waiting_s > TIMEOUT_S:
            kind = self._requests[number].kind
            self._break("answers", f"{kind}, request {number}, has none after {TIMEOUT_S:g} s")
            self._waiting_s = -math.inf

    def outcome(self, number: int) -> Outcome:
        """Check the core's answer to a request."""
        return self._answers.get(number, Outcome.PENDING)

    def breaks(self, rule: str, what: str) -> None:
        """Add a violation that only the session can detect."""
        self._break(rule, what)

    def _break(self, rule: str, what: str) -> None:
        self.violations.append(Violation(self.now_ns / NS_PER_S, rule, what))
