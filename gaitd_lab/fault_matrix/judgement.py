"""The laws that every cell must satisfy; a violation is described in a sentence.

1.  No drive without power gets power, and no inactive mode becomes an active one: what was stopped
    stays stopped when its fault has ended.
2.  Both axes are commanded to stop between the same two SYNCs; where nothing can be sent, the
    drives stop by themselves within the time of their own watchdogs.
3.  The cause is one that is expected for the fault, its category is the required one, and what is
    latched afterwards is the same or a consequence of it.
4.  The leg comes to rest, unless it has no power or is still guided by hand; and no joint moves
    farther than its mechanical stop and the stop's deflection.
5.  A mode that need not stop continues, and nothing is latched.
6.  No exception leaves the loop except an injected one, and then the loop ends with its exit code.
"""

from collections.abc import Iterator
from typing import Final

from daemon.ipc.record import Cause, Mode, StopCategory
from gaitd_lab.fault_matrix.cell import Found
from gaitd_lab.fault_matrix.expected import DETECTION_CYCLES, Law, Resting
from gaitd_lab.fault_matrix.modes import COLUMNS, Group
from gaitd_lab.fault_matrix.pairs import law_of

STOP_HIP_DEG: Final = 8.9
"""plant.toml's stop is 3 deg behind the limit. Its spring k is deflected by a patient's weight with
F = PUSH_NM at the speed limit: k x^2 / 2 = F x + J v^2 / 2 gives 5.9 deg.
"""
STOP_SLIDE_MM: Final = 96.0
"""Slide travel beyond the limit, by the same equation: 20 mm to the stop, and 76 mm of its spring
by PUSH_N and 20 kg at the speed limit.
"""
REST_CYCLES: Final = 250.0
"""Time after the stop command, or after the drives' own stop."""
LOST_MODES: Final = frozenset({Mode.OFF, Mode.BRINGING_UP, Mode.READY})
RESTING_MODES: Final = {
    Resting.UNTOUCHED: frozenset({Mode.READY}),
    Resting.LOST: LOST_MODES,
    Resting.FAULTY: frozenset({Mode.FAULT}),
    Resting.EITHER: LOST_MODES | {Mode.FAULT},
}


def broken(found: Found) -> list[str]:
    """Return the laws that a cell violates; none for a good cell."""
    right = law_of(found.cell, found.exit_code)
    column = COLUMNS[found.mode]
    said = [*_process(found, right), *_enabling(found)]
    if column.mode in {Mode.STOPPING, Mode.FAULT}:
        return [*said, *_stays_stopped(found, right)]
    if column.group is Group.IDLE:
        return [*said, *_resting(found, right)]
    unseen = right.may_go_on and not found.causes
    if not right.stops or unseen:
        return [*said, *_going_on(found, right.ends_in or column.goes_to)]
    return [*said, *_stopping(found, right)]


def _process(found: Found, right: Law) -> Iterator[str]:
    if found.exit_code != right.exit_code:
        yield f"ended with exit code {found.exit_code}, right is {right.exit_code}: {found.trouble}"
    elif found.trouble and right.exit_code is None:
        yield f"an exception: {found.trouble}"


def _enabling(found: Found) -> Iterator[str]:
    if found.enabled_anew:
        yield f"enabled without a request: {', '.join(found.enabled_anew)}"
    if found.active_again:
        yield "a mode that drives nothing became one that does, without a request"


def _causes(found: Found, right: Law) -> Iterator[str]:
    allowed = {one.name for one in right.causes | right.later}
    strange = [one for one in found.causes[1:] if one not in allowed]
    first = {one.name for one in right.causes}
    if found.causes and found.causes[0] not in first:
        yield f"cause {found.causes[0]}, right is {_names(first)}"
    latched = {one.name for one in right.latches}
    if latched and found.final_cause not in latched:
        yield f"latched is {found.final_cause}, right is {_names(latched)}"
    if strange:
        yield f"then {_names(set(strange))}, right may be {_names(allowed)}"


def _stays_stopped(found: Found, right: Law) -> Iterator[str]:
    """Check a machine already stopped: it stays so, and a new cause is an expected one."""
    ended = right.exit_code is not None
    if found.final_mode != Mode.FAULT.name and not ended and not _is_let_go(found):
        yield f"in mode {found.final_mode}, right is FAULT"
    allowed = {one.name for one in right.causes | right.later} | {
        Cause.STOP_REQUESTED.name,
        Cause.HAND_SWITCH_OPEN.name,
    }
    strange = set(found.causes) - allowed
    if strange:
        yield f"cause {_names(strange)}, right is {_names(allowed)}"


def _resting(found: Found, right: Law) -> Iterator[str]:
    """Check a machine without an enabled drive: it may look for drives again, or latch a cause."""
    allowed = RESTING_MODES[right.resting]
    if found.mode != "ready":  # a bring-up that continues, or is repeated
        allowed = allowed | LOST_MODES
    if found.final_mode not in {mode.name for mode in allowed}:
        yield f"in mode {found.final_mode}, right is {_names({mode.name for mode in allowed})}"
    strange = set(found.causes) - {one.name for one in right.causes | right.later}
    if found.mode == "ready" and strange:
        yield f"cause {_names(strange)}"
    told = right.resting in {Resting.LOST, Resting.FAULTY}
    if found.mode == "ready" and told and not found.causes:
        yield "nothing was told"


def _going_on(found: Found, goes_to: frozenset[Mode]) -> Iterator[str]:
    if found.causes:
        yield f"stopped by {found.causes[0]} ({found.category}), right is to go on"
    elif found.final_mode not in {mode.name for mode in goes_to}:
        yield f"in mode {found.final_mode}, right is {_names({mode.name for mode in goes_to})}"


def _stopping(found: Found, right: Law) -> Iterator[str]:
    if not found.stopped or not found.causes:
        causes = _names({one.name for one in right.causes})
        yield f"went on in mode {found.final_mode}, right is a stop by {causes}"
        return
    yield from _causes(found, right)
    if found.category not in {one.name for one in right.categories}:
        categories = {one.name for one in right.categories}
        yield f"category {found.category}, right is {_names(categories)}"
    if not (found.together or right.may_part):
        yield "the axes were not told to stop between the same two SYNCs"
    yield from _reaction(found, right)
    yield from _place(found, right)


def _reaction(found: Found, right: Law) -> Iterator[str]:
    if right.by_drives:
        most, seen = DETECTION_CYCLES + right.delay_cycles, found.left_cycles
        if seen is None or seen > most:
            yield f"the drives stopped after {seen} cycles, right is {most:g}"
        return
    if found.told_cycles is None:
        yield "no frame told both drives to stop"
    elif right.within_cycles is not None and found.told_cycles > right.within_cycles:
        yield f"told after {found.told_cycles:g} cycles, right is {right.within_cycles:g}"


def _place(found: Found, right: Law) -> Iterator[str]:
    ended = right.exit_code is not None
    without_power = found.category == StopCategory.S0.name
    if found.final_mode != Mode.FAULT.name and not ended and not _is_let_go(found):
        yield f"in mode {found.final_mode} at the end, right is FAULT"
    led = COLUMNS[found.mode].mode == Mode.HAND_GUIDING
    held = not without_power and not led
    stopped = min((one for one in (found.told_cycles, found.left_cycles) if one), default=0.0)
    if held and (found.rest_cycles is None or found.rest_cycles - stopped > REST_CYCLES):
        yield f"at rest after {found.rest_cycles} cycles, right is {REST_CYCLES:g}"
    if found.beyond_hip_deg > STOP_HIP_DEG * right.beyond_ratio:
        yield (
            f"the hip was {found.beyond_hip_deg:g} deg beyond its limit,"
            f" {STOP_HIP_DEG:g} is its stop"
        )
    if found.beyond_slide_mm > STOP_SLIDE_MM * right.beyond_ratio:
        yield (
            f"the slide was {found.beyond_slide_mm:g} mm beyond its limit,"
            f" {STOP_SLIDE_MM:g} is its stop"
        )


def _is_let_go(found: Found) -> bool:
    """True if the leg still moves without power: FAULT comes after 3 s."""
    return found.category == StopCategory.S0.name and found.final_mode == Mode.STOPPING.name


def _names(names: set[str]) -> str:
    return " or ".join(sorted(names)) or "nothing"
