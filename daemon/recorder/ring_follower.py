"""A ring that is followed record by record, for as little as it takes to find a stop in it.

A stop is a verdict newly latched, or another one in its place; and the end of the records.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from daemon.ipc.decoding import Count, Decoder, RefusedError
from daemon.ipc.record import Mode, StopCategory, Verdict, clipped
from daemon.ipc.ring_clip import CORE_ENDED, CORE_SILENT
from daemon.ipc.transport import RingReader
from daemon.wire.fields import name_of


class Glance(msgspec.Struct, frozen=True, array_like=True):
    """The first fields of a `CycleRecord`: all that is needed to find a stop."""

    seq: Count
    cycle: Count
    sync_mono_ns: Count
    sync_utc_ns: Count
    dt_s: float
    mode: Mode
    verdict: Verdict


glance_of: Final = Decoder(msgspec.msgpack.Decoder(Glance).decode).decode


class Stop(NamedTuple):
    """One stop in a ring."""

    cause: str
    drive: str
    detail: str
    seq: int
    utc_ns: int


@dataclass(slots=True, eq=False)
class Trail:
    """A ring that is being followed, record by record."""

    ring: RingReader
    newest: int
    """The highest number that is known to have been written."""
    seq: int
    """The last one that was looked at."""
    last: Glance | None = None
    grown: bool = False
    """Records have come since all that there were had been looked at."""
    ended_seq: int = 0
    """The last record, if it has been judged to be that."""
    aside: Path | None = None
    """To be removed when there is nothing left to keep of it."""
    live: bool = True

    @classmethod
    def of(cls, ring: RingReader, *, live: bool = True) -> "Trail":
        """From the oldest record on."""
        newest = ring.newest_seq()
        return cls(ring, newest, ring.oldest_seq(newest) - 1, live=live)

    @property
    def boot_id(self) -> str:
        """Of its core."""
        return self.ring.header.core_boot_id

    @property
    def caught_up(self) -> bool:
        """Whether all that is known to have been written was looked at."""
        return self.seq >= self.newest

    def advance(self, count: int) -> Iterator[tuple[Glance, Stop | None]]:
        """Look at some more records; with each the stop that it is, if it is one."""
        for _ in range(count):
            data = self.ring.raw(self.seq + 1)
            if data is None and self.caught_up:
                return
            self.seq += 1
            self.newest = max(self.newest, self.seq)
            # A record that is gone, or of a version before us, tells nothing.
            with contextlib.suppress(RefusedError):
                if data is not None:
                    now = glance_of(data)
                    yield now, self._look(now)

    def _look(self, now: Glance) -> Stop | None:
        before, self.last = self.last, now
        verdict = now.verdict
        # What was latched before the first record that we have is none of the ring's.
        if before is None or verdict.category is StopCategory.NONE:
            return None
        if identity(before.verdict) == identity(verdict):
            return None
        cause, detail = name_of(verdict.cause), clipped(verdict.detail)
        return Stop(cause, verdict.drive, detail, now.seq, now.sync_utc_ns)

    def end(self) -> Stop | None:
        """Its last record as a stop, once; None if it has none."""
        last = self.last
        if last is None or last.seq == self.ended_seq:
            return None
        self.ended_seq = last.seq
        return Stop(CORE_SILENT if self.grown else CORE_ENDED, "", "", last.seq, last.sync_utc_ns)


def identity(verdict: Verdict) -> tuple[object, ...]:
    """What makes a verdict another one; its figures do not."""
    return verdict.category, verdict.cause, verdict.drive
