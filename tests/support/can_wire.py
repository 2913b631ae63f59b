"""Two CAN controllers and the wire between them, with what QEMU's do not have: errors.

Errors are counted as ISO 11898-1 (fault confinement) has it:

    a transmission fails                                 transmit counter + 8
    ... because no node acknowledges, and error passive  unchanged: a lonely node goes no farther
    a transmission succeeds                              transmit counter - 1
    a counter reaches 96, 128, 256                       warning, error passive, bus-off

A frame that fails is sent again until it is through; bus-off ends that, until the controller is
opened again. What waits in it then is lost, and so is what comes until it is opened.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

BUFFERS = 3
"""Frames that wait in a controller; for more there is no room."""


class State(Enum):
    """By what the transmit counter has reached."""

    ACTIVE = 0
    WARNING = 96
    PASSIVE = 128
    BUS_OFF = 256


def state_of(transmit_errors: int) -> State:
    return max((one for one in State if transmit_errors >= one.value), key=lambda one: one.value)


class Host(Protocol):
    """Whose controller it is."""

    def hear(self, frame: bytes) -> None:
        """A frame came from the wire."""
        ...

    def learn(self, state: State, errors: int) -> None:
        """The controller's state has changed, or it was opened."""
        ...


@dataclass
class Controller:
    """One controller; `connect` gives it a wire."""

    host: Host
    peer: "Controller | None" = None
    bitrate_bit_per_s: int = 0
    """0: it is closed."""
    broken: bool = False
    """Its transceiver is: whatever it sends is disturbed."""
    errors: int = 0
    """The transmit error counter."""
    state: State = State.ACTIVE
    waiting: deque[bytes] = field(default_factory=deque)

    def open(self, bitrate_bit_per_s: int) -> None:
        """Come to the bus, without errors."""
        self.bitrate_bit_per_s, self.errors, self.state = bitrate_bit_per_s, 0, State.ACTIVE
        self.host.learn(self.state, self.errors)
        if self.peer is not None:
            self.peer.go_on()

    def close(self) -> None:
        """Leave the bus."""
        self.bitrate_bit_per_s = 0
        self.waiting.clear()

    @property
    def has_room(self) -> bool:
        return len(self.waiting) < BUFFERS

    def send(self, frame: bytes) -> None:
        """Only where there is room."""
        if self.state is not State.BUS_OFF:
            self.waiting.append(frame)
            self.go_on()

    def go_on(self) -> None:
        """Send what waits, as far as it gets."""
        while self.waiting and self.bitrate_bit_per_s:
            if self.broken:
                self._count(8)
            elif self._is_heard():
                assert self.peer is not None
                self.peer.host.hear(self.waiting.popleft())
                self._count(-1)
            elif self.state is State.PASSIVE:
                return
            else:
                self._count(8)

    def _is_heard(self) -> bool:
        """A frame is acknowledged: the other one listens, at the same bit rate."""
        peer = self.peer
        if peer is None or peer.state is State.BUS_OFF:
            return False
        return peer.bitrate_bit_per_s == self.bitrate_bit_per_s

    def _count(self, change: int) -> None:
        self.errors = max(self.errors + change, 0)
        state = state_of(self.errors)
        if state is not self.state:
            self.state = state
            if state is State.BUS_OFF:
                self.waiting.clear()
            self.host.learn(state, self.errors)


def connect(one: Controller, other: Controller) -> None:
    """Lay a wire between them."""
    one.peer, other.peer = other, one
