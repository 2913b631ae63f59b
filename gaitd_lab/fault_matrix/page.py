"""docs/evidence/fault_matrix.md: what every fault did in every mode, and what is right."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from gaitd_names import Mode

from analysis import markdown
from gaitd_lab.fault_matrix.cell import CellResult
from gaitd_lab.fault_matrix.evaluation import broken
from gaitd_lab.fault_matrix.exceptions import EXCEPTIONS
from gaitd_lab.fault_matrix.faults import FAULTS, LAWS
from gaitd_lab.fault_matrix.law import Law
from gaitd_lab.fault_matrix.modes import COLUMNS

PAGE: Final = "fault_matrix.md"


_HEAD: Final = """# Fault matrix

Made by `gaitd matrix --output docs/evidence` (seed {seed}); do not edit. The real loop, its
drives' frames and a plant with a patient in lock-step: each fault in each mode on each axis.
`gaitd matrix --fault NAME --mode NAME` plays one cell again, bit for bit the same. {count} cells;
{open_count} of them break a law today (last section).

## How to read it

- A stop: *CAUSE category · reaction · hip, slide*. The reaction is in cycles of 10 ms from the
  moment of the fault, anywhere in a cycle, to the frame that tells the last of both axes to stop;
  `drives 9.1` where no frame could be sent: to the moment at which the last drive has left
  operation enabled by itself. Hip and slide are the farthest that each joint got from where it
  was when the fault began, until both rest: in the truth of the plant, not as the service saw it.
  `no rest` is a leg that has no power and on which the patient goes on working.
- *goes on* is right where nothing need stop. A mode in capitals is where a machine that drives
  nothing ended, with the cause that it told.
- Where both axes do the same, the larger numbers of the two are given; else each has its line.
- Categories: S2 the core brakes and holds, S1 quick stop by the drives, S0 no voltage. A cause of
  one axis' feedback is S0 for it and S1 for the other.
- Every cell is held to the laws at the head of `gaitd_lab/fault_matrix/evaluation.py`: nothing is
  enabled again when the fault has gone, both axes are told between the same two SYNCs, the cause
  is right, the leg comes to rest inside its mechanical stops, what need not stop goes on.
"""


def page(results: Sequence[CellResult]) -> str:
    """Return the whole page."""
    bad = [(one, reasons) for one in results if (reasons := broken(one))]
    cells = {(one.fault, one.mode, one.axis): one for one in results}
    seed = results[0].seed if results else 0
    return markdown.page(
        _HEAD.format(seed=seed, count=len(results), open_count=len(bad)),
        _results(cells),
        *laws(),
        _open(bad),
    )


def laws() -> tuple[str, ...]:
    """Return the sections that follow from the laws alone, without a result."""
    return _columns(), _rows(), _exceptions()


def entry(cells: Sequence[CellResult]) -> str:
    """Describe one fault in one mode: once, if it was the same on both axes."""
    if not cells:
        return "not played"
    if len({_kind(one) for one in cells}) == 1:
        return _entry(cells)
    return "<br>".join(f"{one.axis.rpartition('/')[2]}: {_entry([one])}" for one in cells)


def _kind(one: CellResult) -> tuple[object, ...]:
    return (one.stopped, one.causes[:1], one.category, one.final_mode, _mark([one]))


def _entry(cells: Sequence[CellResult]) -> str:
    one = cells[0]
    ended = "" if one.exit_code is None else f", exit {one.exit_code}"
    cause = one.causes[0] if one.causes else ""
    if not one.stopped:
        quiet = "goes on" if one.driven else one.final_mode
        text = f"{quiet}, {cause}" if cause else quiet
        return f"{text}{ended}{_mark(cells)}"
    column = COLUMNS[one.mode]
    if not cause and column.mode not in {Mode.STOPPING, Mode.FAULT}:
        return f"goes on{ended}{_mark(cells)}"
    what = f"{cause} {one.category}" if cause else "stopped as before"
    return f"{what} · {_reaction(cells)} · {_moved(cells)}{ended}{_mark(cells)}"


def _reaction(cells: Sequence[CellResult]) -> str:
    told = [one.told_cycles for one in cells if one.told_cycles is not None]
    left = [one.left_cycles for one in cells if one.left_cycles is not None]
    if left and (not told or max(left) < max(told)):
        return f"drives {max(left):g}"
    return f"{max(told):g}" if told else "none"


def _moved(cells: Sequence[CellResult]) -> str:
    hip, slide = max(one.hip_deg for one in cells), max(one.slide_mm for one in cells)
    rest = "" if all(one.rest_cycles is not None for one in cells) else ", no rest"
    return f"{hip:.1f}°, {slide:.0f} mm{rest}"


def _mark(cells: Sequence[CellResult]) -> str:
    return " **open**" if any(broken(one) for one in cells) else ""


def _section(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return f"## {title}\n\n{markdown.table(head, rows)}"


def _results(cells: Mapping[tuple[str, str, str], CellResult]) -> str:
    rows = [
        [f"`{fault}`", *(_both(fault, column, cells) for column in COLUMNS)] for fault in FAULTS
    ]
    return _section("What each fault did in each mode", ["fault", *COLUMNS], rows)


def _both(fault: str, column: str, cells: Mapping[tuple[str, str, str], CellResult]) -> str:
    """The entry of a fault in a mode, on both axes."""
    return entry([one for (name, mode, _), one in cells.items() if (name, mode) == (fault, column)])


def _columns() -> str:
    rows = [(f"`{one.name}`", one.text) for one in COLUMNS.values()]
    return _section("The modes", ("mode", "how it is"), rows)


def _rows() -> str:
    rows = [
        (f"`{one.name}`", one.text, f"{one.lasts_s:g} s", _right(LAWS[one.name]))
        for one in FAULTS.values()
    ]
    head = ("fault", "what it is", "lasts", "right")
    return _section("The faults, and what is right", head, rows)


def _right(law: Law) -> str:
    if not law.stops:
        return f"goes on: {law.why}" if law.why else "goes on"
    causes = ", ".join(sorted(one.name for one in law.causes))
    categories = " or ".join(sorted(one.name for one in law.categories))
    bound = "" if law.within_cycles is None else f", within {law.within_cycles:g} cycles"
    bound = ", by the drives themselves" if law.by_drives else bound
    ended = "" if law.exit_code is None else f", exit {law.exit_code}"
    why = f"; {law.why}" if law.why else ""
    return f"{categories} by {causes}{bound}{ended}{why}"


def _exceptions() -> str:
    rows = [
        (f"`{fault}`", f"`{mode}`", axis or "both", _right(law).partition(":")[0], law.why)
        for (fault, mode, axis), law in EXCEPTIONS.items()
    ]
    head = ("fault", "mode", "axis", "right here", "why")
    return _section("Where it is not the row's usual one", head, rows)


def _open(bad: Sequence[tuple[CellResult, list[str]]]) -> str:
    lines = [f"- `{command(one)}`: {'; '.join(reasons)}" for one, reasons in bad]
    return "\n".join(("## Open", "", *(lines or ["Every cell keeps every law."])))


def command(one: CellResult) -> str:
    """Return the command that runs one cell again."""
    axis = f" --axis {one.axis}" if one.axis else ""
    return f"gaitd matrix --fault {one.fault} --mode {one.mode}{axis} --seed {one.seed}"
