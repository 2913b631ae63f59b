"""Daily test: the results of input checks and self-test, and how long they are valid.

Rules:
1. Passive: for each drive the state file keeps the times when its hand switch input was seen open
   and closed, and its STO active and released, in READY and FAULT. No request is needed: the
   operator releases the switch and presses the emergency stop once.
2. Active: the state file keeps the findings of `self_test.py` for every axis, with their time.
   They are valid for one robot file: another leg, or the empty machine, needs another test.
3. Both are valid for `valid_h`. A time in the future is not valid.
4. Both belong to one drive: another serial number needs another test.
5. UTC comes with the tick and is used for nothing else. The latest time ever read is kept too: a
   clock that is set back makes the results void, so that they are never valid for longer.
6. While the drives are enabled nothing of this is written: a write to a memory page that is being
   flushed to the disk waits for the disk.
"""

from typing import Final

from msgspec.structs import replace

from daemon.core.exercises.self_test import Finding, SelfTest, result_text
from daemon.core.modes.persistent_state import AxisTestNote, InputsNote, SelfTestNote
from daemon.core.state import Axis, Core
from daemon.ipc.record import Cause, Mode, Verdict
from drives.signals import Input

NS_PER_HOUR: Final = 3_600_000_000_000
NOTE_NS: Final = 60_000_000_000
"""Interval at which the state file is updated with the time and with unchanged inputs."""
SLEW_NS: Final = 2_000_000_000
"""Backward step of a disciplined clock that does not count as set back."""


def follow(core: Core, utc_ns: int) -> None:
    """Check clock and inputs once a cycle, and update what the daily test still needs."""
    _watch_clock(core, utc_ns)
    if core.mode in {Mode.READY, Mode.FAULT}:
        for axis in core.axes:
            _look(core, axis, utc_ns)
    if core.config.self_test.required == "daily":
        core.inputs_unseen = _unseen(core, utc_ns)
        core.self_test_due = _due(core, utc_ns)


def _watch_clock(core: Core, utc_ns: int) -> None:
    newest_ns = max(core.utc_newest_ns, core.notes.utc_newest_ns)
    if utc_ns < newest_ns - SLEW_NS:
        if core.notes.self_test is not None or core.notes.inputs:
            back_s = (newest_ns - utc_ns) * 1e-9
            core.events.append(
                f"the clock went back by {back_s:.0f} s: what was tested today counts no more"
            )
        core.notes = replace(core.notes, self_test=None, inputs={}, utc_newest_ns=utc_ns)
        core.utc_newest_ns = utc_ns
        return
    core.utc_newest_ns = max(newest_ns, utc_ns)
    if not core.mode.active and core.utc_newest_ns - core.notes.utc_newest_ns > NOTE_NS:
        core.notes = replace(core.notes, utc_newest_ns=core.utc_newest_ns)


def _look(core: Core, axis: Axis, utc_ns: int) -> None:
    feedback = axis.feedback
    if feedback is None or not feedback.fresh:
        return
    noted = _inputs_noted(core, axis)
    closed = Input.HAND_SWITCH_CLOSED in feedback.inputs
    released = Input.STO_RELEASED in feedback.inputs
    seen = replace(
        noted,
        **{
            "hand_switch_closed_utc_ns" if closed else "hand_switch_open_utc_ns": utc_ns,
            "sto_released_utc_ns" if released else "sto_active_utc_ns": utc_ns,
        },
    )
    if _is_news(noted, seen):
        core.notes = replace(core.notes, inputs={**core.notes.inputs, axis.name: seen})


def _inputs_noted(core: Core, axis: Axis) -> InputsNote:
    noted = core.notes.inputs.get(axis.name)
    if noted is None or _is_other_drive(axis, noted.serial_number):
        return InputsNote(serial_number=axis.serial_number)
    return noted


def _is_other_drive(axis: Axis, serial_number: int) -> bool:
    """True if the drive has another serial number; it is 0 (unknown) before bring-up."""
    return axis.serial_number not in {0, serial_number}


def _is_news(noted: InputsNote, seen: InputsNote) -> bool:
    return any(
        later - before > NOTE_NS or later < before
        for before, later in zip(_times(noted), _times(seen), strict=True)
    )


def _times(note: InputsNote) -> tuple[int, int, int, int]:
    return (
        note.hand_switch_open_utc_ns,
        note.hand_switch_closed_utc_ns,
        note.sto_active_utc_ns,
        note.sto_released_utc_ns,
    )


_WORDS: Final = (
    "hand switch open",
    "hand switch closed",
    "emergency stop (STO) pressed",
    "emergency stop (STO) released",
)
"""In the order of `_times`."""


def _unseen(core: Core, utc_ns: int) -> tuple[str, ...]:
    return tuple(
        f"{axis.name} {word}"
        for axis in core.axes
        for word, seen_ns in zip(_WORDS, _times(_inputs_noted(core, axis)), strict=True)
        if not counts(seen_ns, utc_ns, core.config.self_test.valid_h)
    )


def _due(core: Core, utc_ns: int) -> str:
    note = core.notes.self_test
    if note is None:
        return "no self-test has been passed today"
    if not note.passed:
        return "the last self-test was not passed"
    if note.leg_digest != core.config.leg_digest:
        return "the last self-test was of another robot file"
    if not counts(note.utc_ns, utc_ns, core.config.self_test.valid_h):
        return f"the last self-test is older than {core.config.self_test.valid_h:g} h"
    if any(axis.name not in note.axes for axis in core.axes):
        return "the last self-test was of other axes"
    if any(_is_other_drive(axis, note.axes[axis.name].serial_number) for axis in core.axes):
        return "the last self-test was of another drive"
    return ""


def counts(seen_utc_ns: int, utc_ns: int, valid_h: float) -> bool:
    """True if a result from `seen_utc_ns` is still valid now (rule 3)."""
    age_ns = utc_ns - seen_utc_ns
    return seen_utc_ns > 0 and -SLEW_NS <= age_ns <= valid_h * NS_PER_HOUR


def conclude(core: Core, utc_ns: int) -> Verdict | None:
    """Store and publish the findings of a finished self-test; returns a verdict if it failed."""
    found = [
        finding
        for leg in core.legs
        if isinstance(leg.exercise, SelfTest)
        for finding in leg.exercise.findings()
    ]
    passed = not any(one.fault for one in found)
    note = SelfTestNote(
        utc_ns=utc_ns,
        passed=passed,
        leg_digest=core.config.leg_digest,
        axes={one.name: _test_note(one, _serial_number(core, one.name)) for one in found},
    )
    core.notes = replace(core.notes, self_test=note)
    core.events += [result_text(one) for one in found]
    return None if passed else _verdict(core, next(one for one in found if one.fault))


def _serial_number(core: Core, name: str) -> int:
    return next(axis.serial_number for axis in core.axes if axis.name == name)


def _test_note(found: Finding, serial_number: int) -> AxisTestNote:
    return AxisTestNote(
        found.friction_si, found.friction_ratio, found.load_error_si, found.moved_si, serial_number
    )


def _verdict(core: Core, found: Finding) -> Verdict:
    cause = Cause.SELF_TEST_FAILED
    category = core.config.categories.of(cause)
    return Verdict(category, cause, found.name, found.value, found.limit, found.fault)
