"""The power state machine of CiA 402-2 from tables that neither side of ours has seen.

ARROWS and PATTERNS are copied from the figure and the controlword table that public manuals
reproduce (Toshiba VF-S15 CANopen, Kollmorgen AKD CANopen, MovingCap object 6040h).
"""

import re

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
STANDING = tuple(name for name in STATUS if name != "not ready to switch on")
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
    found = [
        name
        for name, pattern in STATUS.items()
        if fits(pattern, bits(statusword, 6, 5, 3, 2, 1, 0))
    ]
    return found[0] if found else None


def statusword(state, spare):
    """One that shows the state; its other bits as `spare` has them."""
    word = spare
    for number, bit in zip((6, 5, 3, 2, 1, 0), STATUS[state], strict=True):
        if bit != "x":
            word = word & ~(1 << number) | int(bit) << number
    return word


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
