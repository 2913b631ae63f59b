"""Records of a stop from a ring: the records around it, its cause, and its description.

A file of the black box names the stop that it was saved for. In the ring of a core the stop is the
newest latched verdict; without one, the last record is used.
"""

import lzma
import math
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from gaitd_names import StopCategory
from gaitd_texts import Catalogue
from gaitd_texts.stops import key_of

from analysis.recording import RecordingError
from daemon.ipc.record import CycleRecord, LegRecord
from daemon.ipc.ring_clip import CORE_ENDED, CORE_SILENT
from daemon.ipc.transport import Kept, RingError, RingHeader, RingReader
from daemon.report_messages import judgement

_NO_STOP: Final = "none"
"""Cause of a ring without a stop."""
_WITHOUT_VERDICT: Final = {CORE_SILENT, CORE_ENDED, _NO_STOP}


class StopRecording(NamedTuple):
    """Records around a stop; at least one."""

    path: Path
    header: RingHeader
    records: tuple[CycleRecord, ...]
    kept: Kept
    """Stop as given by the file, or as found in a ring."""
    whole: bool
    """True for a complete ring of a core, which was not cut around a stop."""
    damaged_count: int = 0
    """Records that are present and cannot be read."""

    def from_stop_s(self, record: CycleRecord) -> float:
        """Time of a record in seconds from the stop."""
        return (record.sync_mono_ns - self.stop.sync_mono_ns) * 1e-9

    @property
    def stop(self) -> CycleRecord:
        """The record of the stop, or the nearest available one."""
        return min(self.records, key=lambda record: abs(record.seq - self.kept.stop_seq))

    @property
    def missing_count(self) -> int:
        """Number of missing or damaged records between the first and the last."""
        return self.records[-1].seq - self.records[0].seq + 1 - len(self.records)


@contextmanager
def opened(path: Path, hint: str = "") -> Generator[RingReader]:
    """Open a ring of records, also compressed (`.ring.xz`).

    Args:
        path: the file.
        hint: added to the message for a file that is none.

    Raises:
        RecordingError: the file cannot be read, or is no ring.
    """
    try:
        if path.suffix == ".xz":
            with TemporaryDirectory(prefix="gaitd-") as folder:
                plain = Path(folder) / path.stem
                plain.write_bytes(lzma.decompress(path.read_bytes()))
                with opened(plain, hint) as ring:
                    yield ring
            return
        with closing(RingReader(path)) as ring:
            yield ring
    except lzma.LZMAError as error:
        raise RecordingError(f"{path}: is no xz file: {error}") from error
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except RingError as error:
        raise RecordingError(f"{error}{hint}") from error


def observed(
    records: Iterable[CycleRecord], leg: int
) -> Iterator[tuple[CycleRecord, float, LegRecord]]:
    """Yield the cycles in which a leg's observer ran, each with the time since the first, s."""
    first_ns, last_ns = None, 0
    for record in records:
        if len(record.legs) <= leg or record.sync_mono_ns <= last_ns:
            continue
        last_ns = record.sync_mono_ns
        first_ns = last_ns if first_ns is None else first_ns
        yield record, (last_ns - first_ns) * 1e-9, record.legs[leg]


def inputs_of(leg: LegRecord) -> tuple[float, ...]:
    """Inputs of a leg's observer, in the order of the columns of a recording."""
    axes = leg.axes
    return *(one.measured_position for one in axes), *(one.effort for one in axes)


def read_stop(path: Path) -> StopRecording:
    """Read a file of the black box, or the ring of a core.

    Raises:
        RecordingError: the file is neither, or holds no record.
    """
    with opened(path) as ring:
        header, records = ring.header, tuple(ring.since(0))
        damaged_count = ring.damaged_count
    if not records:
        damaged = f" that can be read; {damaged_count} are damaged" if damaged_count else ""
        raise RecordingError(f"{path}: holds no record{damaged}")
    return stop_of(path, header, records, damaged_count)


def stop_of(
    path: Path, header: RingHeader, records: Sequence[CycleRecord], damaged_count: int = 0
) -> StopRecording:
    """Make a stop recording of records already read; at least one."""
    kept = header.kept or _found(records)
    whole = header.kept is None
    return StopRecording(path, header, tuple(records), kept, whole, damaged_count)


def _found(records: Sequence[CycleRecord]) -> Kept:
    """Find the newest stop in a ring without metadata."""
    pairs = list(pairwise(records))
    latched = (
        now
        for before, now in reversed(pairs)
        if now.verdict.category is not StopCategory.NONE
        and (before.verdict.cause, before.verdict.drive) != (now.verdict.cause, now.verdict.drive)
    )
    stop = next(latched, None)
    last = stop or records[-1]
    return Kept(
        cause=last.verdict.cause if stop else _NO_STOP,
        drive=last.verdict.drive if stop else "",
        stop_seq=last.seq,
        stop_utc_ns=last.sync_utc_ns,
        first_seq=records[0].seq,
        last_seq=records[-1].seq,
        active=any(record.mode.active for record in records),
    )


def stop_text(recording: StopRecording, texts: Catalogue) -> str:
    """Sentence of the stop, or of how the records end."""
    cause, verdict = recording.kept.cause, recording.stop.verdict
    if cause in _WITHOUT_VERDICT:
        return texts.text(f"records.{cause}")
    if verdict.cause == cause:
        return texts.verdict(judgement(verdict))
    return texts.text(f"stopped.{key_of(cause)}", cause=cause)  # its record is damaged


def remedy_of(recording: StopRecording, texts: Catalogue) -> str:
    """Recommended action of the operator; empty where nothing was stopped."""
    cause = recording.kept.cause
    return "" if cause in _WITHOUT_VERDICT else texts.remedy(cause)


def utc_text(utc_ns: int) -> str:
    """Format a UTC time for the operator, to the millisecond."""
    at = datetime.fromtimestamp(utc_ns // 1_000_000 / 1e3, UTC)
    return f"{at:%Y-%m-%d %H:%M:%S}.{at.microsecond // 1000:03d} UTC"


def about(recording: StopRecording, texts: Catalogue) -> tuple[tuple[str, str], ...]:
    """Describe the file: names and values, in the order of reading."""
    header, kept, records = recording.header, recording.kept, recording.records
    before_s, after_s = -recording.from_stop_s(records[0]), recording.from_stop_s(records[-1])
    gaps = f", {recording.missing_count} missing" if recording.missing_count else ""
    where = f" ({kept.drive})" if kept.drive else ""
    also = ", then " + ", ".join(kept.also) if kept.also else ""
    what = "ring of a core" if recording.whole else "black box"
    return (
        (what, f"{header.trainer}, gaitd {header.version}, core {header.core_boot_id}"),
        ("cause", f"{kept.cause}{where}{also}"),
        ("meaning", stop_text(recording, texts)),
        ("stopped", utc_text(kept.stop_utc_ns)),
        *(
            (("damaged", f"{recording.damaged_count} records, left out"),)
            if recording.damaged_count
            else ()
        ),
        (
            "kept",
            f"{before_s:.2f} s before it, {after_s:.2f} s after; {len(records)} records{gaps}",
        ),
    )


def known(value: float | None) -> float:
    """Convert None to NaN, for arrays."""
    return math.nan if value is None else value
