"""The steps of `gaitd commission --report`, one after the other, by requests to a running service.

    objects        read from each drive: identity, units, option codes, all that bring-up has set;
                   nothing moves if one is wrong
    sign           the service's sign test of each axis, and what the operator saw
    units          the operator moves the axis by hand between two marks; the drives have no power
    home           of each axis that has no valid position
    self-test      load and friction of each axis against the robot file
    stops          in gait: by request (S2), hand switch (S1) and emergency stop (S0), of each leg
    limits         what of the above has shown a limit to act, and what was not shown, and why

Nothing is commanded here. Each step is a mode of the service, whose limits and stops are in force;
its motion is described before, and the operator agrees. A step that fails blocks those that need
it, and they are in the record as not measured.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Final, NamedTuple, Protocol

from gaitd_client import ClientError, wire
from gaitd_client.trainer import NOT_STOPPED

from analysis.acceptance.record import Judgement, Line, Section, StopTrace
from analysis.acceptance.stops import NoStopError, StopRules, judge, measure
from daemon.config.bundle import Settings
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.safety.stop_sequence import HOLD_GRACE_CYCLES
from daemon.core.state import Axis
from daemon.ipc.record import Cause, CycleRecord, DriveRecord, Mode, Stage, StopCategory
from daemon.ipc.report import Event, EventCode
from daemon.wire.report_texts import detail_text, event_text
from gaitd.operator_texts import (
    HOMING_MAX_S,
    MOTIONS,
    MOVES,
    STEP_MAX_S,
    prompt,
)

READY_MAX_S: Final = 30.0
BEGIN_MAX_S: Final = 60.0
REST_MAX_S: Final = 20.0
AFTER_STOP_S: Final = 1.2
RETRY_S: Final = 0.5
UNIT_TOLERANCE_RATIO: Final = 0.05
"""Tolerance of a motion that a person has measured with a ruler or a protractor."""
STRIDES_WATCHED: Final = 1
FAST_RATIO: Final = 0.95
"""A stop is asked for at this share of the highest common speed of both axes in a stride."""
GAIT_S: Final = 120.0
STOP_MAX_S: Final = 10.0
BOUND_RATIO: Final = 0.98
"""A command of this share of its bound has reached it."""
PRESSED: Final = frozenset({Cause.STO_ACTIVE, Cause.DRIVE_FAULT, Cause.EMERGENCY})
"""Causes of a stop that an emergency stop without power may leave."""
AT_REST: Final = frozenset({Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.FAULT})
"""Modes in which the service moves nothing and holds nothing."""
PASSED_OR_FAILED: Final = {True: Judgement.PASSED, False: Judgement.FAILED}


class Operator(Protocol):
    """The person at the machine."""

    def tell(self, text: str) -> None:
        """Show a text."""
        ...

    def agrees(self, text: str) -> bool:
        """Ask before something moves."""
        ...

    def acts(self, text: str) -> bool:
        """Ask for something that the operator does by hand; false if there is none."""
        ...

    def saw(self, text: str) -> bool | None:
        """Ask for what was seen; None: no answer can be had."""
        ...

    def number(self, text: str) -> float | None:
        """Ask for a number; None: there is none."""
        ...


class Answer(NamedTuple):
    """The answer to a request."""

    reason: str
    """Why it is refused; empty: it is done."""
    refusal: wire.Refusal | None = None
    """The same as a code, if the core has refused it."""


class Bench(Protocol):
    """A running service and its bus."""

    def request(self, name: str, **arguments: object) -> Answer:
        """Send a request and wait for its answer."""
        ...

    def until(self, reached: Callable[[CycleRecord], bool], within_s: float) -> CycleRecord | None:
        """The first new record that meets the condition; None if none does in that time."""
        ...

    def since(self, seq: int) -> Sequence[CycleRecord]:
        """Records after one, as far back as they are kept."""
        ...

    def newest(self) -> CycleRecord | None:
        """The newest record; None if there is none."""
        ...

    def objects(self, drive: str, *, is_set_up: bool) -> tuple[Section, ...]:
        """What the drive's objects hold, compared with the configuration.

        Without a bring-up only identity and torque base are judged.
        """
        ...


class Gait(NamedTuple):
    """The gait in which the machine is stopped."""

    cadence_hz: float
    amplitude_ratio: float


class How(NamedTuple):
    """A way to stop the machine."""

    category: StopCategory
    cause: Cause
    prompt: str
    """For the operator; empty: the stop is requested."""
    title: str


class Stops(Enum):
    """The ways in which the machine is stopped, mildest first."""

    REQUEST = How(StopCategory.S2, Cause.STOP_REQUESTED, "", "stop by request")
    HAND_SWITCH = How(
        StopCategory.S1,
        Cause.HAND_SWITCH_OPEN,
        "NOW let go of the hand switch.",
        "stop by the hand switch",
    )
    STO = How(StopCategory.S0, Cause.STO_ACTIVE, "NOW press the emergency stop.", "stop by STO")


LOAD: Final = "load and friction in a slow motion: torque and position fit the robot file"
BOUND: Final = "bound of the torque of the sign test"
NOT_SHOWN: Final = (
    ("torque or current limit of the drive", "would need a torque beyond the service's own bound"),
    ("speed limit of the drive (6080h)", "would need a motion at the highest speed"),
    ("position limits of the drive (607Dh) and of the service", "would need a motion to them"),
    ("following error window of the drive (6065h)", "would need a blocked axis in position mode"),
    ("loss of the master's heartbeat (1016h, 6007h)", "would need the service to fall silent"),
)
"""Limits that this procedure does not approach; their values are read back."""


class NotMeasuredError(Exception):
    """A step cannot be done, or has failed; the message is the reason for the record."""

    def __init__(self, why: str, judged: Judgement = Judgement.NOT_MEASURED) -> None:
        self.judged = judged
        super().__init__(why)


class Acceptance:
    """One run of the procedure; `sections` and `stops` hold the result of each drive."""

    def __init__(self, settings: Settings, bench: Bench, operator: Operator, gait: Gait) -> None:
        self._settings, self._bench, self._operator, self._gait = settings, bench, operator, gait
        core = build(settings, "", PersistentState()).core
        self._axes: Mapping[str, Axis] = {axis.name: axis for axis in core.axes}
        self.sections: dict[str, list[Section]] = {name: [] for name in self._axes}
        self.stops: dict[str, list[StopTrace]] = {name: [] for name in self._axes}
        self.blocked = ""
        """Why the machine is not moved any more, and the rest is not measured."""
        self._shown: dict[str, list[Line]] = {name: [] for name in self._axes}
        """Limits that were shown to act."""
        self._measured = Cause.NONE
        """Cause of the stop that was measured last, which may be reset."""

    def run(self, blocked: str = "") -> None:
        """Do all steps; each drive then has all sections, measured or not.

        The machine is stopped at the end. So it is if an exception ends the procedure, for instance
        Ctrl-C; what was measured before is kept, with a line about the rest.

        Args:
            blocked: why nothing can be requested; the drives are read all the same.
        """
        why = "interrupted"
        try:
            self._all_steps(blocked)
            why = ""
        except ClientError as error:
            why = f"interrupted: {error}"
            raise
        finally:
            self._end(why)

    def _all_steps(self, blocked: str) -> None:
        self.blocked = blocked
        if not blocked and self._bench.until(_is_ready, READY_MAX_S) is None:
            self.blocked = f"the service is not ready: {self._state()}"
        is_set_up = not self.blocked
        for name in self._axes:
            self.sections[name] += self._bench.objects(name, is_set_up=is_set_up)
            found = {line.judgement for section in self.sections[name] for line in section.lines}
            if not self.blocked and Judgement.FAILED in found:
                self.blocked = f"{name} does not hold what bring-up has set"
            elif not self.blocked and Judgement.NOT_MEASURED in found:
                self.blocked = f"the objects of {name} could not be read"
        for name in self._axes:
            self._step(name, "Sign", self._sign)
        for name in self._axes:
            self._step(name, "Units by a measured motion", self._units)
        for name in self._axes:
            self._step(name, "Position", self._position)
        self._self_test()
        for leg in self._settings.legs:
            for how in Stops:
                self._stop((leg.hip.name, leg.slide.name), how.value)

    def _end(self, interrupted: str) -> None:
        """Complete the sections, and leave the machine stopped."""
        for name, sections in self.sections.items():
            if interrupted:
                self.blocked = interrupted
                rest = _missing("all that follows", NotMeasuredError(interrupted))
                sections.append(Section("Interrupted", (rest,)))
            lines = (*self._shown[name], *(_not_shown(*one) for one in NOT_SHOWN))
            sections.append(Section("Limits shown to act", lines))
        record = self._bench.newest()
        if record is None:
            return
        if record.mode not in AT_REST:
            self._bench.request("stop")
            record = self._bench.until(lambda one: one.mode in AT_REST, STOP_MAX_S)
        if record is None:
            self._operator.tell(f"{self._state()}: {NOT_STOPPED}.")
        elif record.mode is Mode.FAULT:
            self._operator.tell(
                f"The machine is left stopped: {self._state()}. Then `gaitd reset`."
            )

    # --- parts of steps -------------------------------------------------------------------------

    def _step(self, name: str, title: str, measured: Callable[[str], Iterator[Line]]) -> None:
        """Add one section of one drive; a reason instead of what could not be measured."""
        lines: list[Line] = []
        try:
            self._must_be_free()
            lines.extend(measured(name))  # what came before an exception stays
        except NotMeasuredError as why:
            lines.append(_missing(title.lower(), why))
        finally:
            self.sections[name].append(Section(title, tuple(lines)))

    def _must_be_free(self) -> None:
        """Raises NotMeasuredError if the machine is not moved any more."""
        if self.blocked:
            raise NotMeasuredError(self.blocked)

    def _state(self) -> str:
        """Mode and verdict of the service now."""
        record = self._bench.newest()
        if record is None:
            return "it writes no records"
        verdict = record.verdict
        cause = f", {verdict.cause.name.lower()} {verdict.drive} {detail_text(verdict)}".rstrip()
        return f"mode {record.mode.name.lower()}{cause if verdict.category else ''}"

    def _seq(self) -> int:
        record = self._bench.newest()
        if record is None:
            raise NotMeasuredError("the service writes no records")
        return record.seq

    def _agreed(self, text: str) -> None:
        if not self._operator.agrees(text):
            raise NotMeasuredError("the operator did not agree to the motion")
        self._bench.newest()  # what came while the operator read is not waited for

    def _must(self, request: str, **arguments: object) -> None:
        reason = self._bench.request(request, **arguments).reason
        if reason:
            raise NotMeasuredError(f"refused: {reason}")

    def _reached(self, mode: Mode, within_s: float) -> CycleRecord:
        """Wait for a mode; a stop, or the time, ends the wait.

        Raises:
            NotMeasuredError: another one came; the machine is not moved any more after a stop.
        """
        ends = {mode, Mode.FAULT}
        found = self._bench.until(lambda record: record.mode in ends, within_s)
        if found is None or found.mode is not mode:
            reason = f"mode {mode.name.lower()} did not come: {self._state()}"
            if found is not None:
                raise self._failed(reason)
            raise NotMeasuredError(reason)
        return found

    def _failed(self, why: str) -> NotMeasuredError:
        """A failure after which the machine is not moved any more."""
        self.blocked = why
        return NotMeasuredError(why, Judgement.FAILED)

    def _pass(self, duration_s: float) -> None:
        self._bench.until(lambda _: False, duration_s)

    def _until_done(self, request: str) -> None:
        """Repeat a request, and prompt the operator, until nothing is missing.

        Raises:
            NotMeasuredError: it is refused for too long, or a stop has come meanwhile.
        """
        shown = reason = ""
        begun = self._seq()
        for _ in range(round(STEP_MAX_S / RETRY_S)):
            answer = self._bench.request(request)
            reason = answer.reason
            if not reason:
                return
            begun = self._checked(begun)
            text = prompt(*answer)
            if text != shown:
                shown = text
                self._operator.tell(text)
            self._pass(RETRY_S)
        raise self._failed(f"{request} refused: {reason}")

    def _checked(self, begun: int) -> int:
        """Check for a stop since a record; return the record from which the next check goes.

        The fault that some drives report where the emergency stop is pressed without power, as the
        daily check of the inputs asks for, is reset.

        Raises:
            NotMeasuredError: another stop has come, which the operator has to look at first.
        """
        records = self._bench.since(begun - 1)
        if records[0].mode is Mode.FAULT or records[-1].mode is not Mode.FAULT:
            return begun
        was_driving = any(record.mode not in AT_REST for record in records)
        was_pressed = any(not drive.sto_released for one in records for drive in one.drives)
        if was_driving or not was_pressed or records[-1].verdict.cause not in PRESSED:
            raise self._failed(self._state())
        self._operator.tell(f"{self._state()}: the emergency stop was seen to act; it is reset.")
        self._reset()
        return self._seq()

    def _reset(self) -> None:
        self._until_done("reset")
        self._reached(Mode.READY, READY_MAX_S)

    def _enabled(self) -> None:
        """Bring the leg into mode hold, from READY or from the stop that was measured last.

        Raises:
            NotMeasuredError: it cannot be, or another stop is latched, which the operator has to
                look at first; nothing that needs it is tried again.
        """
        record = self._bench.newest()
        if record is not None and record.mode is Mode.FAULT:
            if record.verdict.cause is not self._measured:
                raise self._failed(self._state())
            self._reset()
        record = self._bench.newest()
        if record is None or record.mode is not Mode.HOLD:
            self._until_done("enable")
            self._reached(Mode.HOLD, READY_MAX_S)
        self._pass(1.0)  # the static load is compared after it
        record = self._bench.newest()
        if record is None or record.mode is not Mode.HOLD:
            raise self._failed(f"the leg is not held: {self._state()}")

    # --- sign -----------------------------------------------------------------------------------

    def _sign(self, name: str) -> Iterator[Line]:
        axis, begun = self._axes[name], self._seq()
        unit, effort_unit = units_of(name)
        push = axis.push
        described = MOTIONS.get(name.rpartition("/")[2], "it first goes forth, then back")
        bounds = f"at most {push.effort_max_si:g} {effort_unit}, {push.motion_si:.3g} {unit}"
        self._agreed(
            f"{name} alone is pushed forth and back ({bounds}). If all is right, {described}."
        )
        self._must("mode", mode="commission", axis=name)
        self._reached(Mode.COMMISSION, READY_MAX_S)
        self._bench.until(lambda record: record.mode in {Mode.OFF, Mode.FAULT}, BEGIN_MAX_S)
        everything = self._bench.since(begun)
        records = [one for one in everything if one.mode is Mode.COMMISSION]
        drives = [drive_of(record, name) for record in records if record.stage is Stage.PLAYING]
        pushes = (("forth", 1.0), ("back", -1.0))
        lines = [_pushed(word, along, drives, axis) for word, along in pushes]
        lines += _torque_lines(drives, axis)
        self._shown[name].append(_bound_line(drives, axis))
        lines.append(_own_judgement(name, everything))
        yield from lines
        self._reached(Mode.READY, READY_MAX_S)
        if any(line.judgement is Judgement.FAILED for line in lines):
            self.blocked = f"the sign of {name} is not proven"
            return
        yield self._seen(name, described)

    def _seen(self, name: str, described: str) -> Line:
        asked, allowed = "direction seen by the operator", described
        seen = self._operator.saw(f"Did you see that {described}?")
        if seen is None:
            return Line(asked, "no operator has seen it", allowed, Judgement.NOT_MEASURED)
        if not seen:
            self.blocked = f"{name} moved opposite to the description: transmission.sign is wrong"
            return Line(asked, "it was opposite", allowed, Judgement.FAILED)
        self._must("mode", mode="commission", axis=name, witnessed=True)
        return Line(asked, "as described", allowed, Judgement.PASSED)

    # --- units, position ------------------------------------------------------------------------

    def _units(self, name: str) -> Iterator[Line]:
        axis = self._axes[name]
        unit, _ = units_of(name)
        typed, scale = ("degrees", math.radians(1)) if unit == "rad" else ("mm", 1e-3)
        marks = (
            f"{name} has no power. Move it by hand to a mark on the machine, and hold it.",
            "Now to a second mark, and hold it.",
        )
        held_si = [self._held_si(name, text) for text in marks]
        moved_si = held_si[1] - held_si[0]
        number = self._operator.number(f"Distance between the marks as you measured it, {typed}")
        if not number or not math.isfinite(number):
            raise NotMeasuredError("no distance was measured")
        wanted_si = abs(number) * scale
        ratio = abs(moved_si) / wanted_si
        good = abs(ratio - 1) <= UNIT_TOLERANCE_RATIO
        counts = abs(moved_si * axis.scaling.counts_per_si)
        yield Line(
            f"motion between two marks, {number:g} {typed} measured by the operator",
            f"{abs(moved_si):.4g} {unit} ({counts:.0f} increments), {ratio:.3f} of it",
            f"within {UNIT_TOLERANCE_RATIO:.0%} of {wanted_si:.4g} {unit}, by"
            f" {abs(axis.scaling.counts_per_si):.6g} increments/{unit} of the axis file",
            PASSED_OR_FAILED[good],
        )
        if not good:
            self.blocked = f"the encoder's unit of {name} is not that of its axis file"

    def _held_si(self, name: str, text: str) -> float:
        """Position of an axis once the operator has moved it."""
        if not self._operator.acts(text):
            raise NotMeasuredError("needs a motion that an operator has measured")
        self._bench.newest()
        self._pass(0.1)
        record = self._bench.newest()
        position_si = None if record is None else drive_of(record, name).position_si
        if position_si is None:
            raise NotMeasuredError("there is no sample of its position")
        return position_si

    def _position(self, name: str) -> Iterator[Line]:
        record = self._bench.newest()
        how = "was valid before"
        if record is not None and not drive_of(record, name).referenced:
            self._agreed(f"{name} alone moves slowly to its home by its drive's own homing.")
            self._must("mode", mode="reference", axis=name)
            self._reached(Mode.REFERENCE, READY_MAX_S)
            self._bench.until(lambda one: one.mode in {Mode.OFF, Mode.FAULT}, HOMING_MAX_S)
            record, how = self._reached(Mode.READY, READY_MAX_S), "by homing"
        valid = record is not None and drive_of(record, name).referenced
        text = f"valid, {how}" if valid else "not valid"
        yield Line("position of the joint", text, "valid", PASSED_OR_FAILED[valid])
        if not valid:
            self.blocked = f"{name} is not referenced"

    # --- self-test ------------------------------------------------------------------------------

    def _self_test(self) -> None:
        try:
            tested = self._tested()
        except NotMeasuredError as error:
            tested, why = [], error
        else:
            why = NotMeasuredError(f"the self-test gave no result: {self._state()}")
        rules = self._settings.trainer.self_test
        tolerances = (
            f"load within {rules.hip.load_tolerance_nm:g} N·m",
            f"load within {rules.slide.load_tolerance_n:g} N",
        )
        friction = f"friction {rules.friction_min_ratio:g} to {rules.friction_max_ratio:g}"
        for index, name in enumerate(self._axes):
            allowed = f"{tolerances[index % 2]}, {friction} of the configured"
            mine = next((event for event in tested if event.subject == name), None)
            line = _missing(LOAD, why, allowed)
            if mine is not None:
                passed = mine.code is EventCode.SELF_TEST_PASSED
                line = Line(LOAD, event_text(mine), allowed, PASSED_OR_FAILED[passed])
            self.sections[name].append(Section("Self-test", (line,)))
        record = self._bench.newest()
        if any(event.code is EventCode.SELF_TEST_FAILED for event in tested):
            self.blocked = "the self-test has failed"
        elif record is not None and record.mode is Mode.FAULT:
            self.blocked = self.blocked or self._state()

    def _tested(self) -> list[Event]:
        """The results of a self-test, an event for each axis."""
        self._must_be_free()
        rules = self._settings.trainer.self_test
        self._agreed(
            "The drives are enabled and hold the leg. Then each axis alone moves forth and back:"
            f" hip {rules.hip.motion_deg:g} deg, slide {1e3 * rules.slide.motion_m:g} mm."
        )
        self._enabled()
        begun = self._seq()
        self._must("mode", mode="self_test")
        self._reached(Mode.SELF_TEST, READY_MAX_S)
        self._bench.until(lambda record: record.mode is not Mode.SELF_TEST, STEP_MAX_S)
        self._pass(0.1)
        events = [event for record in self._bench.since(begun) for event in record.events]
        results = {EventCode.SELF_TEST_PASSED, EventCode.SELF_TEST_FAILED}
        return [event for event in events if event.code in results]

    # --- stops ----------------------------------------------------------------------------------

    def _stop(self, names: tuple[str, str], how: How) -> None:
        """Stop a walking leg in one way, and measure both of its axes."""
        try:
            self._must_be_free()
            records = self._stopped(names, how)
        except NotMeasuredError as why:
            for name in names:
                lines = (_missing(how.title, why),)
                self.sections[name].append(Section(_stop_title(how), lines))
                self._show(name, how, why.judged, str(why))
            return
        for name in names:
            self._measure(records, name, how)
        self._measured = how.cause

    def _measure(self, records: Sequence[CycleRecord], name: str, how: How) -> None:
        rules = self._stop_rules(name)
        try:
            stop = measure(records, name, rules)
        except NoStopError as why:
            judged, shown = Judgement.FAILED, str(why)
            lines = (Line(how.title, shown, "", judged),)
        else:
            lines = tuple(judge(stop, how.category, rules))
            self.stops[name].append(stop.trace)
            shown = f"{stop.category.name} by {stop.cause.name.lower()}"
            judged = PASSED_OR_FAILED[stop.cause is how.cause]
        if Judgement.FAILED in {judged, *(line.judgement for line in lines)}:
            # The next way of stopping is a harder one; it is tried after this one works only.
            self.blocked = f"{how.title} of {name} is not as it must be"
        self.sections[name].append(Section(_stop_title(how), lines))
        self._show(name, how, judged, shown)

    def _show(self, name: str, how: How, judged: Judgement, text: str) -> None:
        line = Line(f"{how.title} acts", text, f"a stop by {how.cause.name.lower()}", judged)
        self._shown[name].append(line)

    def _stopped(self, names: tuple[str, str], how: How) -> Sequence[CycleRecord]:
        """Walk, stop at speed, and wait for rest; the records around the stop."""
        gait = self._gait
        what = how.prompt.removeprefix("NOW ") or "a stop is requested."
        self._agreed(
            f"All legs walk: {gait.cadence_hz:g} strides/s, {gait.amplitude_ratio:g} of the full"
            f" gait, after an announcement of {self._settings.trainer.gait.announce_s:g} s. When"
            f" {' and '.join(names)} are fast: {what}"
        )
        self._enabled()
        self._must(
            "mode",
            mode="gait",
            cadence_hz=gait.cadence_hz,
            amplitude_ratio=gait.amplitude_ratio,
            duration_s=GAIT_S,
        )
        self._reached(Mode.GAIT, READY_MAX_S)
        begun = self._fast(names)
        if how.prompt:
            self._operator.tell(how.prompt)
        else:
            reason = self._bench.request("stop").reason
            if reason:
                raise self._failed(f"the stop was refused: {reason}")
        stopped = self._bench.until(lambda record: bool(record.verdict.category), STEP_MAX_S)
        if stopped is None:
            self._bench.request("stop")
            raise self._failed(f"{how.title}: no stop came within {STEP_MAX_S:g} s")
        self._bench.until(lambda record: record.mode is Mode.FAULT, REST_MAX_S)
        self._pass(AFTER_STOP_S)
        return self._bench.since(begun)

    def _fast(self, names: tuple[str, str]) -> int:
        """Wait until both axes are as fast together as in the strides before; number of a record.

        Raises:
            NotMeasuredError: the gait has ended.
        """
        self._walking(lambda record: record.gait_phase >= 0, BEGIN_MAX_S)
        stride_s = 1 / self._gait.cadence_hz
        self._pass(self._settings.trainer.gait.ramp_strides * stride_s)
        begun = self._seq()
        self._pass(STRIDES_WATCHED * stride_s)
        records = self._bench.since(begun)
        highest = {name: max(abs(_speed(record, name)) for record in records) for name in names}

        def share(record: CycleRecord) -> float:
            return min(abs(_speed(record, name)) / (highest[name] or 1.0) for name in names)

        wanted = FAST_RATIO * max(share(record) for record in records)
        self._walking(lambda record: share(record) >= wanted, 2 * stride_s)
        return self._seq() - 50

    def _walking(self, reached: Callable[[CycleRecord], bool], within_s: float) -> None:
        found = self._bench.until(
            lambda record: record.mode is not Mode.GAIT or reached(record), within_s
        )
        if found is None or found.mode is not Mode.GAIT:
            raise self._failed(f"the gait did not go on: {self._state()}")

    def _stop_rules(self, name: str) -> StopRules:
        axis, stop = self._axes[name], self._settings.limits.stop
        period_s = self._settings.trainer.cycle.period_ms * 1e-3
        unit, effort_unit = units_of(name)
        return StopRules(
            deceleration_si_per_s2=axis.limits.quick_stop_deceleration_si_per_s2,
            standstill_si_per_s=axis.limits.standstill_si_per_s,
            standstill_cycles=stop.standstill_cycles,
            obey_s=stop.obey_cycles * period_s,
            hold_obey_s=(stop.obey_cycles + HOLD_GRACE_CYCLES) * period_s,
            margin_ratio=stop.ramp_margin_ratio,
            effort_free_si=axis.limits.effort_deviation_max_si,
            position_unit=unit,
            effort_unit=effort_unit,
        )


def _is_ready(record: CycleRecord) -> bool:
    return record.mode is Mode.READY


def units_of(name: str) -> tuple[str, str]:
    """Units of position and effort of an axis."""
    return ("rad", "N·m") if name.endswith("/hip") else ("m", "N")


def drive_of(record: CycleRecord, name: str) -> DriveRecord:
    """A drive's part of a record."""
    return next(drive for drive in record.drives if drive.name == name)


def _stop_title(how: How) -> str:
    return f"{how.title[0].upper()}{how.title[1:]} in gait"


def _speed(record: CycleRecord, name: str) -> float:
    return drive_of(record, name).velocity_si or 0.0


def _missing(asked: str, why: NotMeasuredError, allowed: str = "") -> Line:
    return Line(asked, str(why), allowed, why.judged)


def _not_shown(what: str, why: str) -> Line:
    return Line(what, why, "the value read back above", Judgement.NOT_MEASURED)


def _pushed(word: str, along: float, drives: Sequence[DriveRecord], axis: Axis) -> Line:
    """The line of one push: the joint must not move against its torque."""
    unit, effort_unit = units_of(axis.name)
    pushed = [drive for drive in drives if drive.target_effort_si * along > 0]
    known = [drive.position_si for drive in pushed if drive.position_si is not None]
    moved_si = known[-1] - known[0] if known else 0.0
    effort_si = max((drive.target_effort_si * along for drive in pushed), default=0.0) * along
    least_si = 0.5 * axis.push.motion_si
    allowed = f"at least {least_si:.3g} {unit} along its torque"
    measured = f"{effort_si:+.3g} {effort_unit}: {moved_si:+.3g} {unit}"
    if moved_si * along >= least_si:
        judged = Judgement.PASSED
    else:
        judged = Judgement.FAILED if moved_si * along <= -least_si else Judgement.NOT_MEASURED
    if judged is Judgement.NOT_MEASURED:
        measured += ", not moved: at an end stop?"
    return Line(f"torque {word}, sign of the motion", measured, allowed, judged)


def _own_judgement(name: str, records: Iterable[CycleRecord]) -> Line:
    """What the service says about its sign test."""
    ended = [
        event
        for record in records
        for event in record.events
        if event.subject == name
        and event.code in {EventCode.SIGN_TESTED, EventCode.SINGLE_AXIS_FAILED}
    ]
    text = event_text(ended[-1]).removeprefix(f"{name}: ") if ended else "it did not end"
    judged = PASSED_OR_FAILED[bool(ended) and ended[-1].code is EventCode.SIGN_TESTED]
    return Line("the service's own judgement", text, MOVES, judged)


def _torque_lines(drives: Sequence[DriveRecord], axis: Axis) -> Iterator[Line]:
    """The measured torque against the commanded one, in value and sign."""
    _, effort_unit = units_of(axis.name)
    largest_si = max((abs(drive.target_effort_si) for drive in drives), default=0.0)
    pairs = [
        (drive.target_effort_si, drive.effort_si)
        for drive in drives
        if drive.effort_si is not None and abs(drive.target_effort_si) > 0.5 * largest_si
    ]
    limit_si = axis.limits.effort_deviation_max_si
    allowed = f"same sign, at most {limit_si:g} {effort_unit} apart"
    if not pairs:
        yield _missing("measured torque", NotMeasuredError("no sample of it"), allowed)
        return
    apart_si = sum(abs(effort - target) for target, effort in pairs) / len(pairs)
    same = sum(effort * target for target, effort in pairs) > 0
    yield Line(
        "measured torque, sign and value",
        f"{'same' if same else 'OPPOSITE'} sign, {apart_si:.2g} {effort_unit} apart on average",
        allowed,
        PASSED_OR_FAILED[same and apart_si <= limit_si],
    )


def _bound_line(drives: Sequence[DriveRecord], axis: Axis) -> Line:
    """The bound of the sign test, which is also the drive's limit while it lasts.

    Most axes move before they reach it: then nothing has shown it to act.
    """
    _, effort_unit = units_of(axis.name)
    limit_si = axis.push.effort_max_si
    wanted_si = max((abs(drive.target_effort_si) for drive in drives), default=0.0)
    largest_si = max((abs(drive.effort_si or 0.0) for drive in drives), default=0.0)
    judged = PASSED_OR_FAILED[largest_si <= limit_si + axis.limits.effort_deviation_max_si]
    measured = f"{largest_si:.3g} {effort_unit} at most"
    if judged is Judgement.PASSED and wanted_si < BOUND_RATIO * limit_si:
        judged, measured = Judgement.NOT_MEASURED, f"not reached: {measured}"
    return Line(
        BOUND,
        measured,
        f"at most {limit_si:g} {effort_unit}, and {axis.limits.effort_deviation_max_si:g} of noise",
        judged,
    )
