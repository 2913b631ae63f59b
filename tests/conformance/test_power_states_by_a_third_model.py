"""The power state machine of CiA 402-2 from a table that neither side of ours has seen.

ARROWS and PATTERNS are copied from the figure and the controlword table that public manuals
reproduce (Toshiba VF-S15 CANopen, Kollmorgen AKD CANopen, MovingCap object 6040h). The virtual
drives are walked through it by raw PDO frames, the master by scripted statuswords.
"""

import itertools
import re
import struct

import pytest
from drive_bench import Bench
from hypothesis import given, settings
from hypothesis import strategies as st

from drives.cia402 import Sent, decode_statusword, next_word
from drives.signals import PowerRequest

PATTERNS = (
    # controlword bits 7 3 2 1 0; x: not looked at
    ("shutdown", "0x110"),
    ("switch on", "00111"),
    ("enable operation", "01111"),
    ("disable voltage", "0xx0x"),
    ("quick stop", "0x01x"),
)
ARROWS = (
    # number, from, command, to ("disable operation" is the word of "switch on")
    (2, "switch on disabled", "shutdown", "ready to switch on"),
    (3, "ready to switch on", "switch on", "switched on"),
    (4, "switched on", "enable operation", "operation enabled"),
    (5, "operation enabled", "switch on", "switched on"),
    (6, "switched on", "shutdown", "ready to switch on"),
    (7, "ready to switch on", "disable voltage", "switch on disabled"),
    (7, "ready to switch on", "quick stop", "switch on disabled"),
    (8, "operation enabled", "shutdown", "ready to switch on"),
    (9, "operation enabled", "disable voltage", "switch on disabled"),
    (10, "switched on", "disable voltage", "switch on disabled"),
    (10, "switched on", "quick stop", "switch on disabled"),
    (11, "operation enabled", "quick stop", "quick stop active"),
    (12, "quick stop active", "disable voltage", "switch on disabled"),
    (16, "quick stop active", "enable operation", "operation enabled"),
)
STATUS = {
    # statusword bits 6 5 3 2 1 0
    "not ready to switch on": "0x0000",
    "switch on disabled": "1x0000",
    "ready to switch on": "010001",
    "switched on": "010011",
    "operation enabled": "010111",
    "quick stop active": "000111",
    "fault reaction active": "0x1111",
    "fault": "0x1000",
}
STANDING = tuple(name for name in STATUS if name not in ("not ready to switch on",))
POWERED = ("operation enabled", "quick stop active", "fault reaction active")
WORDS = [high << 7 | low for high in (0, 1) for low in range(16)]
"""One for each class of bits 7, 3, 2, 1, 0."""


def bits(word, *numbers):
    return "".join(str(word >> number & 1) for number in numbers)


def fits(pattern, word_bits):
    return re.fullmatch(pattern.replace("x", "."), word_bits) is not None


def command_of(word):
    """The command of a controlword; None where the table has none (bit 7 is high)."""
    found = [name for name, pattern in PATTERNS if fits(pattern, bits(word, 7, 3, 2, 1, 0))]
    assert len(found) <= 1
    return found[0] if found else None


def state_of(statusword):
    found = [name for name, pattern in STATUS.items() if fits(pattern, bits(statusword, 6, 5, 3, 2, 1, 0))]
    return found[0] if found else None


class Model:
    """One drive of the standard. `automatic_4`: 0Fh in ready to switch on goes on to enabled."""

    def __init__(self, state, *, automatic_4, stays=True):
        self.state, self.automatic_4, self.stays = state, automatic_4, stays
        self.word = 0
        self.numbers = []

    def take(self, word):
        rising = word & ~self.word & 0x80
        self.word = word
        if self.state == "fault" and rising:
            self._move(15, "switch on disabled")
            return
        command = command_of(word)
        if self.state == "ready to switch on" and command == "enable operation":
            self._move(3, "switched on")
            if not self.automatic_4:
                return
        for number, source, wanted, target in ARROWS:
            if (source, wanted) == (self.state, command) and (number != 16 or self.stays):
                self._move(number, target)
                break
        if self.state == "quick stop active" and not self.stays:
            self._move(12, "switch on disabled")

    def _move(self, number, state):
        self.numbers.append(number)
        self.state = state


def test_the_table_itself_has_one_command_for_each_word_whose_bit_7_is_low():
    assert all(command_of(word) for word in range(0x80))
    assert not any(command_of(word) for word in range(0x80, 0x100))
    assert len({(source, command) for _, source, command, _ in ARROWS}) == len(ARROWS)


# --- the virtual drives, by raw frames --------------------------------------------------------

KINDS = {
    "epos4": ({}, 0x30D1_0220, True),
    "generic": ({"personality": "generic", "eds": "drives/generic402.eds"}, 0x6078_0010, False),
}
WAY = {
    "switch on disabled": (),
    "ready to switch on": (0x06,),
    "switched on": (0x06, 0x07),
    "operation enabled": (0x06, 0x07, 0x0F),
    "quick stop active": (0x06, 0x07, 0x0F, 0x02),
}


class Drive:
    """A virtual drive, driven and seen by PDOs alone: RPDO1 and SYNC in, TPDO1 out."""

    def __init__(self, kind, *, quick_stop_option=6):
        changes, torque, self.automatic_4 = KINDS[kind]
        self.bench = Bench(hip=changes)
        self.bench.boot()
        for index, value in ((0x605B, 0), (0x605C, 0), (0x605A, quick_stop_option)):
            assert self.bench.write(index, 0, value, 2) == 0
        self.bench.go_operational(torque=torque)

    def take(self, word):
        """The word by RPDO1, applied at the next SYNC; what TPDO1 of the one after shows."""
        self.bench.send(0x205, struct.pack("<Hbi", word, 10, 0))
        self.bench.send(0x080)
        self.bench.run_ms(10)
        return self.state

    @property
    def state(self):
        self.bench.send(0x205, struct.pack("<Hbi", self.last_word, 10, 0))
        return None


class PdoDrive(Drive):
    """Shows its state without another controlword: the TPDO comes with a SYNC of its own."""

    @property
    def state(self):
        self.bench.forget()
        self.bench.send(0x080)
        self.bench.run_ms(5)
        (data,) = self.bench.frames(0x185)
        return state_of(struct.unpack_from("<H", data)[0])
