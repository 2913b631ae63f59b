"""Reads a ring record by record, decoding only what is needed to find a stop.

A stop is a newly latched verdict, or another one in its place; and the end of the records.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from gaitd_names import Mode, StopCategory

from daemon.ipc.decoding import Count, Decoder, RefusedError
from daemon.ipc.record import Verdict
from daemon.ipc.ring_clip import CORE_ENDED, CORE_SILENT
from daemon.ipc.transport import RingReader


class RecordHeader(msgspec.Struct, frozen=True, array_like=True):
    """The first fields of a `CycleRecord`, which suffice to find a stop."""

    seq: Count
    cycle: Count
    sync_mono_ns: Count
    sync_utc_ns: Count
    dt_s: float
    mode: Mode
    verdict: Verdict


header_of: Final = Decoder(msgspec.msgpack.Decoder(RecordHeader).decode).decode


class Stop(NamedTuple):
    """One stop in a ring."""

    cause: str
    drive: str
    seq: int
    utc_ns: int


@dataclass(slots=True, eq=False)
class RingFollower:
    """Position of the reader in a ring, and the state of that ring."""

    ring: RingReader
    newest: int
    """The highest number that is known to have been written."""
    seq: int
    """Number of the last record that was read."""
    last: RecordHeader | None = None
    has_grown: bool = False
    """Records have arrived after all existing ones had been read."""
    ended_seq: int = 0
    """Number of the last record, once it is known to be the last."""
    renamed_file: Path | None = None
    """File to be removed when there is nothing left to keep of it."""
    live: bool = True

    @classmethod
    def starting_at(cls, ring: RingReader, *, live: bool = True) -> "RingFollower":
        """Start at the oldest record."""
        newest = ring.newest_seq()
        return cls(ring, newest, ring.oldest_seq(newest) - 1, live=live)

    @property
    def boot_id(self) -> str:
        """Boot id of its core."""
        return self.ring.header.core_boot_id

    @property
    def caught_up(self) -> bool:
        """True if all records known to have been written were read."""
        return self.seq >= self.newest

    def advance(self, count: int) -> Iterator[tuple[RecordHeader, Stop | None]]:
        """Read up to `count` more records; yields each with its stop, or None."""
        for _ in range(count):
            data = self.ring.raw(self.seq + 1)
            if data is None and self.caught_up:
                return
            self.seq += 1
            self.newest = max(self.newest, self.seq)
            # A record that is gone, or of another version, is skipped.
            with contextlib.suppress(RefusedError):
                if data is not None:
                    now = header_of(data)
                    yield now, self._stop_of(now)

    def _stop_of(self, now: RecordHeader) -> Stop | None:
        before, self.last = self.last, now
        verdict = now.verdict
        # A verdict latched before the first available record is not a stop in this ring.
        if before is None or verdict.category is StopCategory.NONE:
            return None
        if identity(before.verdict) == identity(verdict):
            return None
        return Stop(verdict.cause, verdict.drive, now.seq, now.sync_utc_ns)

    def end(self) -> Stop | None:
        """The last record as a stop, once; None if there is none."""
        last = self.last
        if last is None or last.seq == self.ended_seq:
            return None
        self.ended_seq = last.seq
        cause = CORE_SILENT if self.has_grown else CORE_ENDED
        return Stop(cause, "", last.seq, last.sync_utc_ns)


def identity(verdict: Verdict) -> tuple[object, ...]:
    """The fields that distinguish verdicts; value and limit do not."""
    return verdict.category, verdict.cause, verdict.drive
