"""Measured bus load: the bits of every frame sent or received, over each second.

Exact bit stuffing costs some microseconds per frame, so the frames are counted after the cycle's
work. Beyond EXACT_MAX frames at a time the longest possible frame length is used.
"""

from collections.abc import Sequence
from typing import Final

from drives.bringup.bus_load import frame_bits, frame_bits_exact
from drives.canopen.bus import Frame

SPAN_NS: Final = 1_000_000_000
EXACT_MAX: Final = 64
"""Frames whose stuff bits are counted at once: four times the number in a cycle of two legs."""


class LoadMeter:
    """Collects frames, counts their bits, and computes the share of time that they took."""

    def __init__(self, bitrate_bit_per_s: int) -> None:
        self._bitrate_bit_per_s = bitrate_bit_per_s
        self._waiting: list[Frame] = []
        self._bits = 0
        self._begun_ns: int | None = None
        self.busy_ratio = 0.0
        """Bus load of the last whole second, 0..1."""

    def add(self, frames: Sequence[Frame]) -> None:
        """Add frames that were on the bus; error frames are left out, their length is unknown."""
        self._waiting += [frame for frame in frames if not frame.is_error]

    def count(self, now_ns: int) -> None:
        """Count the collected frames; update `busy_ratio` once a second."""
        exact, rest = self._waiting[:EXACT_MAX], self._waiting[EXACT_MAX:]
        self._bits += sum(frame_bits_exact(frame.can_id, frame.data) for frame in exact)
        self._bits += sum(frame_bits(len(frame.data)) for frame in rest)
        self._waiting.clear()
        if self._begun_ns is None:
            self._begun_ns = now_ns
        elapsed_ns = now_ns - self._begun_ns
        if elapsed_ns >= SPAN_NS:
            self.busy_ratio = self._bits / (self._bitrate_bit_per_s * elapsed_ns * 1e-9)
            self._begun_ns, self._bits = now_ns, 0
