"""SYNC consumer (CiA 301 7.2.5, 7.5.2.5 to 7, 7.5.2.22). No drive here produces SYNC.

Rules:
1. 1005h: the identifier. A producer, a 29-bit identifier or a restricted one is 06090030.
2. 1019h is 0 or missing: SYNC has no data; else exactly one byte, its counter. Another length is
   8240h, and that SYNC is not used; the next valid one ends the error.
3. 1019h may be 0 or 2 to 240 (06090030) and changes only while 1006h is 0 (08000022).
4. 1007h, the synchronous window in µs, 0 for none: PDOs that would be sent or received later after
   the SYNC are dropped. Before the first SYNC the window is open.
5. 1006h, the cycle in µs: after a SYNC, none for one and a half cycles is 8100h; the next one ends
   it. The standard does not define the consumer's reaction; here it only reports the error.
"""

from collections.abc import Callable
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.cob_id import EXTENDED_BITS, FLAG_30, can_id_of, is_restricted
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.objects import Object

COUNTER_MAX: Final = 240
SYNC_LENGTH_CODE: Final = 0x8240
SYNC_LOST_CODE: Final = 0x8100
_MICROSECOND: Final = 1000


class SyncConsumer:
    """The SYNC state of one node."""

    def __init__(self, context: NodeContext, report: Callable[[int, bool], None]) -> None:
        """`report` receives an error code and whether the error is present."""
        self._dictionary, self._line, self._timers = context
        self._report = report
        self._last_ns: int | None = None
        self.counter = 0
        """Counter of the last SYNC; 0 without counter."""
        self._dictionary.guard(Object.SYNC_COB_ID, self._check_cob_id)
        self._dictionary.guard(Object.SYNC_COUNTER, self._check_overflow)
        self._dictionary.watch(Object.SYNC_PERIOD, lambda _: self._timers.cancel(SyncConsumer))

    def reset(self) -> None:
        """Start without a received SYNC."""
        self._last_ns = None
        self._timers.cancel(SyncConsumer)

    @property
    def can_id(self) -> int:
        """CAN identifier of SYNC (rule 1)."""
        return can_id_of(self._dictionary.value(Object.SYNC_COB_ID))

    def receive(self, data: bytes) -> bool:
        """Process a frame with SYNC's identifier; return whether it is a valid SYNC (rule 2)."""
        fits = len(data) == (1 if self._dictionary.value_or(Object.SYNC_COUNTER, 0, 0) else 0)
        self._report(SYNC_LENGTH_CODE, not fits)
        if fits:
            self._last_ns = self._line.now_ns
            self.counter = data[0] if data else 0
            self._report(SYNC_LOST_CODE, False)
            self._watch_for_next()
        return fits

    def within_window(self, delay_ns: int = 0) -> bool:
        """Return whether now plus a delay is within the window of the last SYNC (rule 4)."""
        window_ns = self._dictionary.value_or(Object.SYNC_WINDOW, 0, 0) * _MICROSECOND
        if not window_ns or self._last_ns is None:
            return True
        return self._line.now_ns + delay_ns - self._last_ns <= window_ns

    def _watch_for_next(self) -> None:
        period_ns = self._dictionary.value_or(Object.SYNC_PERIOD, 0, 0) * _MICROSECOND
        if period_ns:
            at_ns = self._line.now_ns + period_ns * 3 // 2
            self._timers.start(SyncConsumer, at_ns, lambda: self._report(SYNC_LOST_CODE, True))

    def _check_cob_id(self, _: int, value: int) -> None:
        if value & (EXTENDED_BITS | FLAG_30) or is_restricted(can_id_of(value)):
            raise SdoAbortError(AbortCode.RANGE)

    def _check_overflow(self, _: int, value: int) -> None:
        if self._dictionary.value_or(Object.SYNC_PERIOD, 0, 0):
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        if value == 1 or value > COUNTER_MAX:
            raise SdoAbortError(AbortCode.RANGE)
