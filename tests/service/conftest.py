"""What the tests of real processes share: one running service, and the table of what they saw."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest
from fault_observations import Moved
from long_service import long_lived
from small_disk import mount, unmount

from gaitd_lab.processes import memory_folder

TABLE = Path(__file__).parents[2] / "docs/evidence/process_faults.md"
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


@pytest.fixture(scope="session")
def long_service():
    """In simulated time; `bring` takes it into the mode in which a test begins."""
    with long_lived() as service:
        yield service


@pytest.fixture(autouse=True)
def _rest(request):
    """A service that no test uses costs nothing."""
    yield
    if "long_service" in request.fixturenames:
        request.getfixturevalue("long_service").rest()


@pytest.fixture(scope="session")
def fault_table(pytestconfig):
    """Takes a row from each fault; written into docs/ with --write-process-faults."""
    table = FaultTable()
    yield table
    if pytestconfig.option.write_process_faults:
        TABLE.write_text(table.text())


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(dir=memory_folder()) as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture
def small(folder):
    """Makes a tmpfs in the folder: `small("state", "1m", "ro")`."""
    mounted = []

    def make(name, size, *options):
        mount(folder / name, size, *options)
        mounted.append(folder / name)
        return folder / name

    yield make
    for place in mounted:
        unmount(place)
