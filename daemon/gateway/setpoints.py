"""Setpoints from clients: limited in number, decoded strictly, refused with a reason.

A setpoint passes three checks:

    SetpointBox     in Zenoh's thread: keeps the newest few, counts the rest, limits wake-ups
    SetpointStore   in the loop: size, JSON, schema, leg, lease, order; the newest of each leg
    the core        again lease and order, then age, limits and mode (core/motion/assist.py)

A flood costs a short callback for each message and nothing else. Messages that contain the digits
of the lease's number are kept apart from all others, so that other clients cannot displace the
holder's.
"""

import contextlib
import os
import threading
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import msgspec
from gaitd_client import wire
from gaitd_names import SetpointRefusal

from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import Setpoint

SETPOINT_SIZE_MAX: Final = 1024
"""Maximum size of a payload in bytes."""
HOLDER_COUNT: Final = 8
"""Messages of the holder that are kept between two turns: two legs, and some to spare."""
OTHERS_COUNT: Final = 4
"""Messages of other clients that are kept between two turns, to report why they are refused."""
WAKES_MAX: Final = 4
REARM_NS: Final = 10_000_000
"""Setpoints wake the loop at most WAKES_MAX times in this time."""

_NOT_FINITE: Final = (b"NaN", b"Infinity")
"""Not JSON, but written by common encoders for numbers that are not finite."""
_OUT_OF_RANGE: Final = ("<=", ">=", "out of range")
"""Parts of msgspec's error texts for a number of the right type beyond the range of the schema."""


class Arrival(NamedTuple):
    """One message on LEG/setpoint."""

    leg: str
    payload: bytes
    """Truncated to one byte more than allowed, if it is too large."""


class Batch(NamedTuple):
    """Messages that have arrived since the last turn."""

    arrivals: tuple[Arrival, ...] = ()
    """The holder's first, then the others'; oldest first."""
    dropped_count: int = 0
    """Number of messages that were dropped unread."""


NOTHING: Final = Batch()


class SetpointBox:
    """Buffer between Zenoh's threads, which put messages, and the loop, which drains them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of_holder: deque[Arrival] = deque(maxlen=HOLDER_COUNT)
        self._of_others: deque[Arrival] = deque(maxlen=OTHERS_COUNT)
        self._dropped_count = 0
        self._digits = b""
        self._wakes_left, self._armed_ns = WAKES_MAX, 0
        self._fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """File descriptor for poll(): readable when a setpoint of the holder has arrived."""
        return self._fd

    def expect(self, lease: int) -> None:
        """Set the number of the lease that is held; 0: none."""
        self._digits = str(lease).encode() if lease else b""

    def put(self, leg: str, payload: bytes) -> None:
        """Add a message; called in a thread of Zenoh."""
        digits = self._digits
        known = bool(digits) and digits in payload
        with self._lock:
            queued = self._of_holder if known else self._of_others
            self._dropped_count += len(queued) == queued.maxlen
            queued.append(Arrival(leg, payload))
            wakes = known and self._wakes_left > 0
            self._wakes_left -= wakes
        if wakes:
            os.eventfd_write(self._fd, 1)

    def drain(self, now_ns: int) -> Batch:
        """Return and remove all messages that were kept."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._fd)
        with self._lock:
            batch = Batch((*self._of_holder, *self._of_others), self._dropped_count)
            self._of_holder.clear()
            self._of_others.clear()
            self._dropped_count = 0
            if now_ns - self._armed_ns >= REARM_NS:
                self._wakes_left, self._armed_ns = WAKES_MAX, now_ns
        return batch

    def close(self) -> None:
        """Close the file descriptor; no callback may run any more."""
        os.close(self._fd)


@dataclass(slots=True)
class SetpointStore:
    """Decodes setpoints and keeps the newest of each leg under the lease that is held."""

    _newest: dict[str, Setpoint] = field(default_factory=dict[str, Setpoint])

    @property
    def newest(self) -> tuple[Setpoint, ...]:
        """The newest setpoint of each leg, for the gateway state."""
        return tuple(self._newest.values())

    def clear(self) -> None:
        """Drop all setpoints, because the lease has changed or ended."""
        self._newest.clear()

    def receive(
        self, arrival: Arrival, legs: Collection[str], lease: int
    ) -> SetpointRefusal | None:
        """Check one message and keep its setpoint; returns None or the reason for refusal."""
        if len(arrival.payload) > SETPOINT_SIZE_MAX:
            return SetpointRefusal.TOO_LARGE
        read = _read(arrival.payload)
        if isinstance(read, SetpointRefusal):
            return read
        if arrival.leg not in legs:
            return SetpointRefusal.UNKNOWN_LEG
        if lease == 0:
            return SetpointRefusal.UNLEASED
        if read.lease != lease:
            return SetpointRefusal.WRONG_LEASE
        before = self._newest.get(arrival.leg)
        if before is not None and read.seq <= before.seq:
            repeated = read.seq == before.seq
            return SetpointRefusal.REPEATED if repeated else SetpointRefusal.REORDERED
        setpoint = msgspec.convert(read, Setpoint, from_attributes=True)
        self._newest[arrival.leg] = msgspec.structs.replace(setpoint, leg=arrival.leg)
        return None


def _read(payload: bytes) -> wire.SetpointMessage | SetpointRefusal:
    try:
        return _DECODER.decode(payload)
    except RefusedError as error:
        if any(word in payload for word in _NOT_FINITE):
            return SetpointRefusal.NON_FINITE
        beyond = any(word in str(error) for word in _OUT_OF_RANGE)
        return SetpointRefusal.OUT_OF_RANGE if beyond else SetpointRefusal.MALFORMED


_DECODER: Final = Decoder(msgspec.json.Decoder(wire.SetpointMessage).decode)
