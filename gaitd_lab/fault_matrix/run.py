"""All cells: one session for columns that begin alike, and a fork at each cell's moment.

A fork is a copy of the whole session, so a cell costs only the time after its fault; the session
continues to the next cell's moment unaffected. Each cell's moment is drawn from its own name and
the seed: a cell run alone has the same moment, and gives the same bits.
"""

import gc
import multiprocessing
import os
import random
import signal
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Final

import msgspec

from gaitd_lab.fault_matrix.cell import Cell, CellResult, play_cell
from gaitd_lab.fault_matrix.faults import FAULTS
from gaitd_lab.fault_matrix.modes import COLUMNS, Column
from gaitd_lab.fault_matrix.pairs import fault_named
from gaitd_lab.fault_matrix.session import matrix_session
from gaitd_lab.fault_matrix.watch import AXES
from gaitd_lab.lockstep import LockstepSession

CELL_MAX_S: Final = 120
"""Real time; a cell that takes longer hangs."""
PART_COUNT: Final = 60
"""Cells of one part: one session is prepared for each part."""


def cells(
    faults: Sequence[str] = (), modes: Sequence[str] = (), axes: Sequence[str] = AXES
) -> list[Cell]:
    """Return the cells of these rows and columns, in the pages' order; all if none is named."""
    return [
        Cell(fault.name, column, axis)
        for column in (modes or COLUMNS)
        for fault in (fault_named(name) for name in (faults or FAULTS))
        for axis in (axes if fault.of_an_axis else ("",))
    ]


def parts(wanted: Sequence[Cell]) -> list[list[Cell]]:
    """Split the cells of columns that begin alike into parts of a few minutes' simulated time."""
    results: list[list[Cell]] = []
    for beginning in dict.fromkeys(map(_beginning, wanted)):
        alike = [cell for cell in wanted if _beginning(cell) == beginning]
        count = -(-len(alike) // PART_COUNT)
        results += [alike[number::count] for number in range(count)]
    return results


def _beginning(cell: Cell) -> tuple[object, ...]:
    column = COLUMNS[cell.mode]
    return column.begin, column.variant


def run(config: Path, wanted: Sequence[Cell], seed: int, jobs: int) -> Iterator[list[CellResult]]:
    """Run all cells, `jobs` columns at a time; yields the results of each finished part."""
    work = parts(wanted)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=min(jobs, len(work)), mp_context=spawn) as pool:
        running = [pool.submit(play_part, config, part, seed) for part in work]
        for done in as_completed(running):
            yield done.result()


def play_part(config: Path, part: Sequence[Cell], seed: int) -> list[CellResult]:
    """Run cells of columns that begin alike, from one session."""
    column = COLUMNS[part[0].mode]
    session = matrix_session(config, column.variant, seed)
    column.begin(session)
    begun_ns = session.world_ns
    gc.freeze()
    results: list[CellResult] = []
    for delay_s, cell in sorted((_delay_s(cell, seed), cell) for cell in part):
        session.run((begun_ns - session.world_ns) * 1e-9 + delay_s)
        results.append(_forked(session, COLUMNS[cell.mode], cell, seed))
    return results


def _delay_s(cell: Cell, seed: int) -> float:
    """Time of the cell's fork, after the column's start."""
    return random.Random(f"{seed}/{'/'.join(cell)}").uniform(0.0, COLUMNS[cell.mode].window_s)


def _forked(session: LockstepSession, column: Column, cell: Cell, seed: int) -> CellResult:
    """Run one cell in a fork of this process."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _play_and_exit(session, column, cell, seed, writer)
    os.close(writer)
    with open(reader, "rb") as pipe:  # noqa: PTH123 - a descriptor, not a path
        output = pipe.read()
    os.waitpid(child, 0)
    if not output:
        return _unknown(cell, seed, f"the cell died or took more than {CELL_MAX_S} s")
    return msgspec.json.decode(output, type=CellResult)


def _play_and_exit(
    session: LockstepSession, column: Column, cell: Cell, seed: int, writer: int
) -> None:
    """Run one cell and exit in every case. A fork must not continue as a copy of its parent."""
    signal.alarm(CELL_MAX_S)
    results: CellResult | None = None
    try:
        results = play_cell(session, column, fault_named(cell.fault), cell.axis, seed)
    finally:
        output = results or _unknown(cell, seed, traceback.format_exc())
        try:
            with open(writer, "wb") as pipe:
                pipe.write(msgspec.json.encode(output))
        finally:  # also if the parent has ended, and the pipe with it
            os._exit(0)


def _unknown(cell: Cell, seed: int, trouble: str) -> CellResult:
    return CellResult(fault=cell.fault, mode=cell.mode, axis=cell.axis, seed=seed, trouble=trouble)
