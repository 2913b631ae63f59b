"""The laws that every cell must satisfy; a violation is described in a sentence.

1.  No drive without power gets power, and no inactive mode becomes an active one: what was stopped
    stays stopped when its fault has ended.
2.  All axes, with two legs those of both, are commanded to stop between the same two SYNCs; where
    nothing can be sent, the drives stop by themselves within the time of their own watchdogs.
3.  The cause is one that is expected for the fault, its category is the required one, or the one
    that the design fixes, and what is latched afterwards is the same or a consequence of it.
4.  The leg comes to rest, unless it has no power or is still guided by hand; and no joint moves
    farther than its mechanical stop and the stop's deflection, which is larger where a patient or a
    drive throws a leg of which a drive has lost its power: no speed limit holds for it then
    (`Law.pushed`, `Law.runs_away`). Nor do rest and speed limit hold where no command reaches a
    drive that drives the joint on (`Law.unreachable`). A stop begins without power in an S0 alone,
    and only for the axis of the cause where its feedback is in doubt: any other drive loses it by
    escalation.
5.  A mode that need not stop continues, and nothing is latched.
6.  A motor or encoder that is reversed is found no later, and moves the leg no farther, than before
    a person could explain a mismatch (`reversals.py`).
7.  No exception leaves the loop except an injected one, and then the loop ends with its exit code.
"""

from collections.abc import Iterator, Set
from typing import Final

from gaitd_names import Cause, Mode, StopCategory

from daemon.wire.causes import DOUBTFUL_FEEDBACK, FIXED_CATEGORY
from gaitd_lab.fault_matrix import reversals
from gaitd_lab.fault_matrix.cell import CellResult
from gaitd_lab.fault_matrix.law import DETECTION_CYCLES, Law, Resting
from gaitd_lab.fault_matrix.modes import COLUMNS
from gaitd_lab.fault_matrix.pairs import law_of, parts_of

STOP_HIP_DEG: Final = 8.9
"""plant.toml's stop is 3 deg behind the limit. Its spring k is deflected by a patient's weight with
F = PUSH_NM at the speed limit: k x^2 / 2 = F x + J v^2 / 2 gives 5.9 deg.
"""
STOP_SLIDE_MM: Final = 96.0
"""Slide travel beyond the limit, by the same equation: 20 mm to the stop, and 76 mm of its spring
by PUSH_N and 20 kg at the speed limit.
"""
THROWN_HIP_DEG: Final = 36.0
"""Where a leg is thrown that the drives do not hold (`Law.pushed`, `Law.runs_away`): 700 N of a
patient, more than the 480 N of a drive, over 0.95 m of the rail, and the hip's stop takes all of
it. k x^2 / 2 = 665 J gives 33 deg, behind 3 deg to the stop.
"""
THROWN_SLIDE_MM: Final = 169.0
"""The same energy in the slide's stop: 149 mm, behind 20 mm to the stop."""
REST_CYCLES: Final = 250.0
"""Time after the stop command, or after the drives' own stop."""
LOST_MODES: Final = frozenset({Mode.OFF, Mode.BRINGING_UP, Mode.READY})
RESTING_MODES: Final = {
    Resting.UNTOUCHED: frozenset({Mode.READY}),
    Resting.LOST: LOST_MODES,
    Resting.FAULTY: frozenset({Mode.FAULT}),
    Resting.EITHER: LOST_MODES | {Mode.FAULT},
}


def broken(cell: CellResult) -> list[str]:
    """Return the laws that a cell violates; none for a good cell."""
    right = law_of(cell.cell, cell.exit_code)
    column = COLUMNS[cell.mode]
    said = [*_process(cell, right), *_enabling(cell), *reversals.exceeded(cell)]
    if column.mode in {Mode.STOPPING, Mode.FAULT}:
        return [*said, *_stays_stopped(cell, right)]
    if column.is_idle:
        return [*said, *_resting(cell, right)]
    unseen = right.may_go_on and not cell.causes
    if not right.stops or unseen:
        return [*said, *_continuing(cell, right.ends_in or {column.mode, *column.leads_to})]
    return [*said, *_stopping(cell, right)]


def _process(cell: CellResult, right: Law) -> Iterator[str]:
    if cell.exit_code != right.exit_code:
        yield f"ended with exit code {cell.exit_code}, right is {right.exit_code}: {cell.trouble}"
    elif cell.trouble and right.exit_code is None:
        yield f"an exception: {cell.trouble}"


def _enabling(cell: CellResult) -> Iterator[str]:
    if cell.enabled_anew:
        yield f"enabled without a request: {', '.join(cell.enabled_anew)}"
    if cell.active_again:
        yield "a mode that drives nothing became one that does, without a request"


def _causes(cell: CellResult, right: Law) -> Iterator[str]:
    allowed = {one.name for one in right.causes | right.later}
    strange = [one for one in cell.causes[1:] if one not in allowed]
    first = {one.name for one in right.causes}
    if cell.causes and cell.causes[0] not in first:
        yield f"cause {cell.causes[0]}, right is {_names(first)}"
    latched = {one.name for one in right.latches}
    if latched and cell.final_cause not in latched:
        yield f"latched is {cell.final_cause}, right is {_names(latched)}"
    if strange:
        yield f"then {_names(set(strange))}, right may be {_names(allowed)}"


def _stays_stopped(cell: CellResult, right: Law) -> Iterator[str]:
    """Check a machine already stopped: it stays so, and a new cause is an expected one."""
    ended = right.exit_code is not None
    moves_on = parts_of(cell.fault) is not None and _is_without_power(cell)
    if cell.final_mode != Mode.FAULT.name and not ended and not moves_on:
        yield f"in mode {cell.final_mode}, right is FAULT"
    allowed = {one.name for one in right.causes | right.later} | {
        Cause.STOP_REQUESTED.name,
        Cause.HAND_SWITCH_OPEN.name,
    }
    strange = set(cell.causes) - allowed
    if strange:
        yield f"cause {_names(strange)}, right is {_names(allowed)}"


def _resting(cell: CellResult, right: Law) -> Iterator[str]:
    """Check a machine without an enabled drive: it may look for drives again, or latch a cause."""
    allowed = RESTING_MODES[right.resting]
    if cell.mode != "ready":  # a bring-up that continues, or is repeated
        allowed = allowed | LOST_MODES
    if cell.final_mode not in {mode.name for mode in allowed}:
        yield f"in mode {cell.final_mode}, right is {_names({mode.name for mode in allowed})}"
    strange = set(cell.causes) - {one.name for one in right.causes | right.later}
    if cell.mode == "ready" and strange:
        yield f"cause {_names(strange)}"
    told = right.resting in {Resting.LOST, Resting.FAULTY}
    if cell.mode == "ready" and told and not cell.causes:
        yield "nothing was told"


def _continuing(cell: CellResult, goes_to: Set[Mode]) -> Iterator[str]:
    if cell.causes:
        yield f"stopped by {cell.causes[0]} ({cell.category}), right is to go on"
    elif cell.final_mode not in {mode.name for mode in goes_to}:
        yield f"in mode {cell.final_mode}, right is {_names({mode.name for mode in goes_to})}"


def _stopping(cell: CellResult, right: Law) -> Iterator[str]:
    if not cell.stopped or not cell.causes:
        causes = _names({one.name for one in right.causes})
        yield f"went on in mode {cell.final_mode}, right is a stop by {causes}"
        return
    yield from _causes(cell, right)
    fixed = FIXED_CATEGORY.get(Cause[cell.causes[0]])
    categories = {one.name for one in right.categories if fixed in {None, one}}
    if cell.category not in categories:
        yield f"category {cell.category}, right is {_names(categories)}"
    may_part = right.by_drives and parts_of(cell.fault) is not None
    if not (cell.together or may_part):
        yield "the axes were not told to stop between the same two SYNCs"
    yield from _power(cell, right)
    yield from _reaction(cell, right)
    yield from _place(cell, right)


def _power(cell: CellResult, right: Law) -> Iterator[str]:
    if right.exit_code is not None:  # the next core finds the drives enabled
        return
    allowed = set[str]()
    if cell.category == StopCategory.S0.name:
        if Cause[cell.causes[0]] not in DOUBTFUL_FEEDBACK:
            return
        allowed = {cell.drive}
    beyond = set(cell.powerless_at_once) - allowed
    if beyond:
        yield f"without power at once: {_names(beyond)}, right is {_names(allowed)}"


def _reaction(cell: CellResult, right: Law) -> Iterator[str]:
    if right.by_drives:
        parts, seen = parts_of(cell.fault), cell.left_cycles
        most = DETECTION_CYCLES + (parts.offset_cycles if parts else 0)
        if seen is None or seen > most:
            yield f"the drives stopped after {seen} cycles, right is {most:g}"
        return
    if cell.told_cycles is None:
        yield "no frame told both drives to stop"
    elif right.within_cycles is not None and cell.told_cycles > right.within_cycles:
        yield f"told after {cell.told_cycles:g} cycles, right is {right.within_cycles:g}"


def _place(cell: CellResult, right: Law) -> Iterator[str]:
    ended = right.exit_code is not None
    without_power = cell.category == StopCategory.S0.name
    explained = parts_of(cell.fault) is not None or _had_s0(cell)
    pushed_on = right.pushed and explained and len(cell.lost_power) > 0
    moves_on = _is_without_power(cell) or (pushed_on and cell.final_mode == Mode.STOPPING.name)
    if cell.final_mode != Mode.FAULT.name and not ended and not moves_on:
        yield f"in mode {cell.final_mode} at the end, right is FAULT"
    led = COLUMNS[cell.mode].mode == Mode.HAND_GUIDING
    # The second fault of a pair may make an S0 of a stop: its leg then swings without power.
    swings = parts_of(cell.fault) is not None and _had_s0(cell)
    held = not (without_power or swings or led or pushed_on or right.unreachable)
    stopped = min((one for one in (cell.told_cycles, cell.left_cycles) if one), default=0.0)
    if held and (cell.rest_cycles is None or cell.rest_cycles - stopped > REST_CYCLES):
        yield f"at rest after {cell.rest_cycles} cycles, right is {REST_CYCLES:g}"
    legs = [drive.partition("/")[0] for drive in cell.lost_power]
    runs_away = right.runs_away and any(legs.count(leg) == 2 for leg in legs)
    thrown = pushed_on or runs_away or right.unreachable
    hip_deg = THROWN_HIP_DEG if thrown else STOP_HIP_DEG
    slide_mm = THROWN_SLIDE_MM if thrown else STOP_SLIDE_MM
    if cell.beyond_hip_deg > hip_deg:
        yield f"the hip was {cell.beyond_hip_deg:g} deg beyond its limit, {hip_deg:g} is its stop"
    if cell.beyond_slide_mm > slide_mm:
        yield (
            f"the slide was {cell.beyond_slide_mm:g} mm beyond its limit, {slide_mm:g} is its stop"
        )


def _had_s0(cell: CellResult) -> bool:
    """True if one of its causes demands an S0."""
    return any(FIXED_CATEGORY.get(Cause[one]) is StopCategory.S0 for one in cell.causes)


def _is_without_power(cell: CellResult) -> bool:
    """True if the leg still moves after an S0, at first or by escalation: FAULT comes after 3 s."""
    escalated = len(cell.lost_power) > 0 and (
        FIXED_CATEGORY.get(Cause[cell.final_cause]) is StopCategory.S0
    )
    return cell.final_mode == Mode.STOPPING.name and (
        escalated or cell.category == StopCategory.S0.name
    )


def _names(names: Set[str]) -> str:
    return " or ".join(sorted(names)) or "nothing"
