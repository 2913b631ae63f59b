"""The table of docs/evidence/process_faults.md, row by row as the tests see them."""

from typing import NamedTuple

from fault_observations import Moved

HEAD = """# What a process that dies, hangs or runs out of something does to the leg

Measured by `tests/service/` with the virtual drives as a process of their own, in simulated time;
written by `.venv/bin/pytest tests/service -m "" --write-process-faults`. Times and distances are of
one run, from the moment of the fault. "Moved" is the farthest that hip and slide really were from
where the fault found them (the plant's truth), "rest" when the leg stood for good. While walking
the gait goes on or ends with a ramp, so it moves; while holding it must not.

| fault | while | who noticed | reaction | moved (hip, slide) | rest | cause | mode after |
|---|---|---|---|---|---|---|---|
"""


class Row(NamedTuple):
    """One fault."""

    fault: str
    doing: str
    noticed: str
    reaction: str
    moved: Moved | None
    cause: str
    mode: str


class FaultTable:
    """Rows in the order of the tests."""

    def __init__(self) -> None:
        self._rows: list[Row] = []

    def add(self, *row: object) -> None:
        self._rows.append(Row(*row))

    def text(self) -> str:
        return HEAD + "".join(_line(row) for row in self._rows)


def _line(row: Row) -> str:
    moved, rest = "–", "–"
    if row.moved is not None:
        moved = f"{row.moved.hip_deg:.1f}°, {row.moved.slide_mm:.0f} mm"
        rest = "goes on" if row.moved.rest_ms is None else f"{row.moved.rest_ms:.0f} ms"
    cells = (row.fault, row.doing, row.noticed, row.reaction, moved, rest, row.cause, row.mode)
    return f"| {' | '.join(cells)} |\n"
