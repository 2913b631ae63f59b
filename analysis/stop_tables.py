"""Tables and CSV of one stop: the file, the machine around the stop, and the events."""

import csv
import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from gaitd_names import POWER_STATES, StopCategory
from gaitd_texts import Catalogue

from analysis.recording import COLUMNS
from analysis.stop_recording import StopRecording, about, inputs_of, observed, remedy_of
from daemon.ipc.record import CycleRecord, DriveRecord
from daemon.report_messages import judgement, progress_message

Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]
"""Title, column heads, rows of text."""
EventTexts = Callable[[CycleRecord, CycleRecord], Iterable[tuple[str, str]]]
"""Priority and text of the events between two records, as the gateway publishes them."""

AROUND_S: Final = (
    *(-10.0, -5.0, -2.0, -1.0, -0.5, -0.2, -0.1, -0.05, -0.03, -0.02, -0.01, 0.0),
    *(0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0),
)
"""Times from the stop, s, at which records are shown; denser near the stop."""
EVENT_COUNT: Final = 20
_UNITS: Final = {"hip": ("rad", "rad/s", "N·m")}
_SLIDE_UNITS: Final = ("m", "m/s", "N")


def tables(recording: StopRecording, events: EventTexts, texts: Catalogue) -> tuple[Table, ...]:
    """Format the recording of a stop as tables of text."""
    head = (
        *about(recording, texts),
        *((("remedy", r),) if (r := remedy_of(recording, texts)) else ()),
    )
    names = [drive.name for drive in recording.stop.drives]
    return (
        (recording.path.name, ("", ""), head),
        ("Mode and verdict", ("s", "mode", "verdict", "said"), tuple(_modes(recording, texts))),
        *(_drive_table(recording, name) for name in names),
        ("The last events", ("s", "", ""), tuple(_events(recording, events))),
    )


def _nearest(recording: StopRecording) -> list[CycleRecord]:
    """The records nearest to AROUND_S, and the first and the last, each once."""
    times_s = [recording.from_stop_s(record) for record in recording.records]
    wanted = [at_s for at_s in AROUND_S if times_s[0] <= at_s <= times_s[-1] + 1e-3]
    half_s = recording.header.period_ns * 0.5e-9
    near = {min(bisect_left(times_s, at_s - half_s), len(times_s) - 1) for at_s in wanted}
    return [recording.records[index] for index in sorted({0, *near, len(times_s) - 1})]


def _modes(recording: StopRecording, texts: Catalogue) -> Iterator[tuple[str, ...]]:
    """One row for each change of mode or verdict."""
    before: tuple[object, ...] = ()
    for record in recording.records:
        verdict = record.verdict
        now = (record.mode, verdict.category, verdict.cause, verdict.drive)
        if now != before:
            before = now
            where = f" ({verdict.drive})" if verdict.drive else ""
            stops = verdict.category is not StopCategory.NONE
            judged = f"{verdict.category.name} {verdict.cause}{where}"
            yield (
                f"{recording.from_stop_s(record):+.2f}",
                record.mode,
                judged if stops else "-",
                texts.verdict(judgement(verdict))
                if stops
                else texts.progress(progress_message(record.progress)),
            )


def _drive_table(recording: StopRecording, name: str) -> Table:
    position, speed, effort = _UNITS.get(name.rpartition("/")[2], _SLIDE_UNITS)
    columns = ("s", position, speed, f"{effort} measured", f"{effort} commanded", "drive", "inputs")
    rows = (
        (f"{recording.from_stop_s(record):+.2f}", *_drive_cells(drive))
        for record in _nearest(recording)
        for drive in record.drives
        if drive.name == name
    )
    return name, columns, tuple(rows)


def _drive_cells(drive: DriveRecord) -> tuple[str, ...]:
    troubles = {
        "no sample": not drive.fresh,
        "hand switch open": not drive.hand_switch_closed,
        "STO": not drive.sto_released,
        "not referenced": not drive.referenced,
        f"EMCY 0x{drive.emergency_code:04X}": bool(drive.emergency_code),
    }
    return (
        _number(drive.position, 4),
        _number(drive.velocity, 3),
        _number(drive.effort, 1),
        _number(drive.target_effort, 1),
        POWER_STATES[drive.power_state].replace("_", " "),
        ", ".join(text for text, there in troubles.items() if there),
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:+.{digits}f}"


def _events(recording: StopRecording, events: EventTexts) -> Iterator[tuple[str, ...]]:
    """The newest events around the stop."""
    rows = [
        (f"{recording.from_stop_s(now):+.2f}", *event)
        for before, now in pairwise(recording.records)
        for event in events(before, now)
    ]
    yield from rows[-EVENT_COUNT:] or [("", "", "none")]


# --- CSV ------------------------------------------------------------------------------------------

MORE_COLUMNS: Final = ("from_stop_s", "mode", "category", "cause")
"""Columns added to those of a recording; readers of recordings ignore them."""


def write_csv(recording: StopRecording, leg: str, path: Path) -> int:
    """Write the recording of one leg in the format of `gaitd replay`; return the number of rows.

    Raises:
        OSError: the file cannot be written.
    """
    rows = list(_rows(recording, leg))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow((*COLUMNS, *MORE_COLUMNS))
        writer.writerows(rows)
    return len(rows)


def _rows(recording: StopRecording, leg: str) -> Iterator[tuple[str, ...]]:
    """Rows of the cycles in which the observer ran, as a replay of the ring selects them."""
    index = recording.header.leg_names.index(leg)
    for record, time_s, one in observed(recording.records, index):
        yield (
            *_cells((time_s, *inputs_of(one))),
            f"{recording.from_stop_s(record):.6f}",
            record.mode,
            record.verdict.category.name,
            record.verdict.cause,
        )


def _cells(values: Sequence[float]) -> Iterator[str]:
    """Format each number to its last bit, and a missing one as an empty cell."""
    return ("" if math.isnan(value) else repr(value) for value in values)
