"""Two CAN adapters on serial lines, and the wire between them; the kernel drives them by `slcan`.

What QEMU's controllers do not do, these do: they count errors, and go error passive and bus-off.
They speak the text protocol of their kind (LAWICEL): `S8` 1 Mbit/s, `O` open, `C` close, `tIIIL..`
a frame; `sPRRRTTT` from the adapter tells its state and both error counters. Errors are counted as
ISO 11898-1 (fault confinement) has it:

    a transmission fails                                 transmit counter + 8
    ... because nobody acknowledges, and error passive   unchanged: a lonely node goes no farther
    a transmission succeeds                              transmit counter - 1
    a counter reaches 96, 128, 256                       warning, error passive, bus-off

A frame that fails is sent again until it is through; bus-off ends that, until the adapter is closed
and opened again: it has no other restart.
"""

import fcntl
import json
import os
import pty
import select
import struct
import termios
import time
import traceback
import tty
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, NoReturn

N_SLCAN = 17
SIOCGIFNAME = 0x8910
BUFFERS = 3
"""Frames that wait in an adapter; more are lost."""
CHUNK = 4096
PATIENCE_S, POLL_S = 60.0, 0.1
"""Until both are there."""


class State(Enum):
    """Of an adapter, by the letter that it tells."""

    ACTIVE = "a"
    WARNING = "w"
    PASSIVE = "p"
    BUS_OFF = "b"


def state_of(transmit_errors: int) -> State:
    for least, state in ((256, State.BUS_OFF), (128, State.PASSIVE), (96, State.WARNING)):
        if transmit_errors >= least:
            return state
    return State.ACTIVE


@dataclass
class Adapter:
    """One adapter: what its host says comes into `take`, what it says goes to `tell`."""

    tell: Callable[[str], None]
    peer: "Adapter | None" = None
    is_open: bool = False
    speed: str = ""
    broken: bool = False
    """Its transceiver is: whatever it sends is disturbed."""
    errors: int = 0
    """The transmit error counter."""
    state: State = State.ACTIVE
    waiting: deque[str] = field(default_factory=deque)

    def take(self, line: str) -> None:
        """One line of the host."""
        command = line[:1]
        if command == "S":
            self.speed = line
        elif command == "C":
            self.is_open = False
            self.waiting.clear()
        elif command == "O":
            self.is_open, self.errors, self.state = True, 0, State.ACTIVE
            if self.peer is not None:
                self.peer.send()
        elif command in {"t", "T", "r", "R"} and len(self.waiting) < BUFFERS:
            self.waiting.append(line)
            self.send()

    def send(self) -> None:
        """All that waits, as far as it gets."""
        while self.waiting and self.is_open and self.state is not State.BUS_OFF:
            if self.broken:
                self._count(8)
            elif self._is_heard():
                assert self.peer is not None
                self.peer.tell(self.waiting.popleft())
                self._count(-1)
            elif self.state is State.PASSIVE:
                return
            else:
                self._count(8)

    def _is_heard(self) -> bool:
        """Somebody acknowledges: the other one listens, at the same bit rate."""
        peer = self.peer
        on_the_bus = peer is not None and peer.is_open and peer.state is not State.BUS_OFF
        return on_the_bus and peer is not None and peer.speed == self.speed

    def _count(self, change: int) -> None:
        self.errors = max(self.errors + change, 0)
        state = state_of(self.errors)
        if state is not self.state:
            self.state = state
            self.tell(f"s{state.value}000{min(self.errors, 255):03}")
            if state is State.BUS_OFF:
                self.waiting.clear()


def pair(tell: tuple[Callable[[str], None], Callable[[str], None]]) -> tuple[Adapter, Adapter]:
    """Two adapters on one wire."""
    one, other = Adapter(tell[0]), Adapter(tell[1])
    one.peer, other.peer = other, one
    return one, other


class Line:
    """The serial line of one adapter: a pseudo terminal, its far end in the hands of slcan."""

    def __init__(self) -> None:
        self.near, self._far = pty.openpty()
        tty.setraw(self._far)
        os.set_blocking(self.near, False)
        fcntl.ioctl(self._far, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        name = fcntl.ioctl(self._far, SIOCGIFNAME, bytes(32))
        self.interface = name.rstrip(b"\0").decode()
        self._said = b""

    def tell(self, line: str) -> None:
        os.write(self.near, line.encode() + b"\r")

    def lines(self) -> list[str]:
        *whole, self._said = (self._said + os.read(self.near, CHUNK)).split(b"\r")
        return [line.decode() for line in whole]


def serve(control: int, kept: Path) -> None:
    """Run both adapters until `control` (a pipe) closes.

    It takes `break NUMBER` and `mend NUMBER`, one a line. `kept` tells the interfaces and the
    state of both, whenever one of them changes.
    """
    lines = Line(), Line()
    adapters = pair((lines[0].tell, lines[1].tell))
    told = ""
    while True:
        found = json.dumps([_told(*one) for one in zip(lines, adapters, strict=True)])
        if found != told:
            told = found
            _keep(kept, told)
        ready, _, _ = select.select([control, lines[0].near, lines[1].near], [], [])
        for line, adapter in zip(lines, adapters, strict=True):
            if line.near in ready:
                for said in line.lines():
                    adapter.take(said)
        if control in ready:
            ordered = os.read(control, CHUNK).decode().split()
            if not ordered:
                return
            for word, number in zip(ordered[::2], ordered[1::2], strict=True):
                adapters[int(number)].broken = word == "break"


def _told(line: Line, adapter: Adapter) -> dict[str, object]:
    name, state = line.interface, adapter.state.name
    return {"interface": name, "state": state, "broken": adapter.broken}


def _keep(kept: Path, text: str) -> None:
    """Whole or not at all."""
    aside = kept.with_suffix(".new")
    aside.write_text(text)
    aside.replace(kept)


def _serve_and_exit(control: int, kept: Path) -> NoReturn:
    """A fork must not come back into its parent's story."""
    code = 1
    try:
        serve(control, kept)
        code = 0
    except Exception as failure:
        traceback.print_exception(failure)
        raise
    finally:
        os._exit(code)


class Wire:
    """Both adapters and the wire in a process of their own."""

    def __init__(self, kept: Path) -> None:
        reading, self._orders = os.pipe()
        self._kept = kept
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self._orders)
            _serve_and_exit(reading, kept)
        os.close(reading)
        for _ in range(round(PATIENCE_S / POLL_S)):
            if kept.exists():
                return
            time.sleep(POLL_S)
        raise AssertionError("the adapters did not come up")

    def told(self) -> list[dict[str, Any]]:
        """Interface, state, and whether it is broken, of each."""
        return json.loads(self._kept.read_text())

    def order(self, words: str) -> None:
        """`break NUMBER` or `mend NUMBER`."""
        os.write(self._orders, words.encode() + b"\n")

    def end(self) -> None:
        """Both lines are unplugged."""
        os.close(self._orders)
        os.waitpid(self._pid, 0)
