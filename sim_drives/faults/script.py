"""Faults of the virtual machine, by script (`[[fault]]`) and by command: which drive, and when.

A command is one line of text: `KIND DRIVE [DURATION_S [VALUE]]`, where DRIVE is LEG/AXIS or `*`
and a DURATION_S of `-` means until cleared; or `clear KIND DRIVE`. For example

    silent right/hip 0.5            lost_tpdo * 0.1 2        emcy right/slide - 0x2310
    clear emcy right/slide          reboot right/hip         hand_switch_open *

A duration is decimal and in s, and most values are whole: so a command in another order is refused.
RULES of `rules.py` has one row for each kind. A new fault of the same kind on the same drive
replaces the previous one.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from sim_drives.faults.rules import RULES
from sim_drives.settings import FaultKind

EVERY_DRIVE: Final = "*"
CLEAR: Final = "clear"
OPEN_END: Final = "-"
HEX: Final = "0x"
DURATION_MIN_S: Final = 0.001
DURATION_MAX_S: Final = 1e6
COMMAND_FORM: Final = "KIND DRIVE [DURATION_S|- [VALUE]], or: clear KIND DRIVE"


class FaultCommandError(ValueError):
    """Operator error: unknown fault, or invalid arguments."""


@dataclass(frozen=True, slots=True)
class FaultOrder:
    """A fault to begin or to clear now."""

    drive: str
    kind: FaultKind
    duration_s: float | None = None
    value: float = 0.0
    clear: bool = False

    def on(self, drive: str) -> "FaultOrder":
        """Return the same order for one drive."""
        return replace(self, drive=drive)


def help_text() -> str:
    """Return the table of faults as text for the operator."""
    rows = [f"{COMMAND_FORM}"]
    for kind, rule in RULES.items():
        value = f" (value: {rule.value_text})" if rule.value_text else ""
        rows.append(f"{kind.value}: {rule.text}{value}")
    return "\n".join(rows)


def parse_command(line: str) -> FaultOrder:
    """Parse one command.

    Raises:
        FaultCommandError: names the wrong word and the allowed ones.
    """
    words = line.split()
    clear = bool(words) and words[0] == CLEAR
    if clear:
        words = words[1:]
    if not 2 <= len(words) <= (2 if clear else 4):
        raise FaultCommandError(f"{line.strip()!r}: expected {COMMAND_FORM}")
    kind = _kind(words[0])
    duration_s = _duration(words[2]) if len(words) > 2 else None
    value = _number(words[3], "value") if len(words) > 3 else None
    if not clear:
        check_value(kind, value)
    return FaultOrder(words[1], kind, duration_s, value or 0.0, clear)


def check_value(kind: FaultKind, value: float | None) -> None:
    """Refuse a value that the kind does not allow.

    Raises:
        FaultCommandError: names kind, value and range.
    """
    rule = RULES[kind]
    if value is None:
        if rule.value_needed:
            raise FaultCommandError(f"{kind.value} needs a value: {rule.value_text}")
    elif not rule.value_text and value != 0:
        raise FaultCommandError(f"{kind.value} has no value")
    elif rule.value_text and not rule.value_low <= value <= rule.value_high:
        raise FaultCommandError(
            f"{kind.value}: value {value:g} ({rule.value_text}) is not within "
            f"{rule.value_low:g} to {rule.value_high:g}"
        )
    elif rule.value_text and rule.is_whole and value % 1:
        raise FaultCommandError(f"{kind.value}: value {value:g} ({rule.value_text}) is not whole")


def _kind(word: str) -> FaultKind:
    known = {kind.value: kind for kind in FaultKind}
    if word not in known:
        raise FaultCommandError(f"unknown kind {word!r}; known: {', '.join(known)}")
    return known[word]


def _duration(word: str) -> float | None:
    if word == OPEN_END:
        return None
    if word.lower().startswith(HEX):
        raise FaultCommandError(f"duration {word!r} is no time in s; expected {COMMAND_FORM}")
    duration_s = _number(word, "duration")
    if not DURATION_MIN_S <= duration_s <= DURATION_MAX_S:
        raise FaultCommandError(
            f"duration {word!r} must be {DURATION_MIN_S:g} to {DURATION_MAX_S:g} s, or {OPEN_END}"
        )
    return duration_s


def _number(word: str, what: str) -> float:
    try:
        value = float(int(word, 0)) if word.lower().startswith(HEX) else float(word)
    except ValueError:
        raise FaultCommandError(f"{what} {word!r} is no number") from None
    if not math.isfinite(value):
        raise FaultCommandError(f"{what} {word!r} is not finite")
    return value
