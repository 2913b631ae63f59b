"""Faults of the virtual machine: what each does, by script (`[[fault]]`) and by command.

A command is one line of text: `KIND DRIVE [DURATION_S [VALUE]]`, where DRIVE is LEG/AXIS or `*`
and a DURATION_S of `-` means until cleared; or `clear KIND DRIVE`. For example

    silent right/hip 0.5            lost_tpdo * 0.1 2        emcy right/slide - 0x2310
    clear emcy right/slide          reboot right/hip         hand_switch_open *

RULES has one row for each kind: what it does, what its value means, and how it begins and ends.
The same kind on the same drive again replaces the one before.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from sim_drives.node import Node
from sim_drives.settings import FaultKind
from sim_drives.timers import MILLISECOND

EVERY_DRIVE: Final = "*"
CLEAR: Final = "clear"
OPEN_END: Final = "-"
COMMAND_FORM: Final = "KIND DRIVE [DURATION_S|- [VALUE]], or: clear KIND DRIVE"


class FaultCommandError(ValueError):
    """The operator's: a fault that does not exist, or not so."""


@dataclass(frozen=True, slots=True)
class FaultRule:
    """One kind of fault."""

    text: str
    begin: Callable[[Node, float], None]
    end: Callable[[Node, float], None]
    value_text: str = ""
    """What the value means; empty when there is none."""
    value_low: float = 0.0
    value_high: float = 0.0
    value_needed: bool = False
    momentary: bool = False
    """Over at once unless a duration is given."""


def _lose_tpdo(node: Node, value: float) -> None:
    node.disturbance.lost_tpdo = int(value)


def _find_tpdo(node: Node, _: float) -> None:
    node.disturbance.lost_tpdo = None


def _delay_tpdo(node: Node, value: float) -> None:
    node.disturbance.late_ns = round(value * MILLISECOND)


def _be_on_time(node: Node, _: float) -> None:
    node.disturbance.late_ns = 0


def _mute(node: Node, _: float) -> None:
    node.disturbance.mute = True


def _unmute(node: Node, _: float) -> None:
    node.disturbance.mute = False


def _unplug(node: Node, _: float) -> None:
    node.disturbance.unplugged = True


def _plug(node: Node, _: float) -> None:
    node.disturbance.unplugged = False


def _emergency(node: Node, value: float) -> None:
    node.begin_error(int(value))


def _emergency_gone(node: Node, value: float) -> None:
    node.end_error(int(value))


def _freeze(node: Node, _: float) -> None:
    node.drive.measurement.encoder_frozen = True


def _thaw(node: Node, _: float) -> None:
    node.drive.measurement.encoder_frozen = False


def _glitch(node: Node, value: float) -> None:
    node.drive.measurement.begin_glitch(int(value))


def _end_glitch(node: Node, _: float) -> None:
    node.drive.measurement.end_glitch()


def _power_off(node: Node, _: float) -> None:
    node.power_off()


def _power_on(node: Node, _: float) -> None:
    node.power_on()


def _block(node: Node, _: float) -> None:
    node.axis.block(blocked=True)


def _unblock(node: Node, _: float) -> None:
    node.axis.block(blocked=False)


def _open_hand_switch(node: Node, _: float) -> None:
    node.drive.measurement.hand_switch_closed = False


def _close_hand_switch(node: Node, _: float) -> None:
    node.drive.measurement.hand_switch_closed = True


def _open_sto(node: Node, _: float) -> None:
    node.drive.switch_sto(released=False)


def _release_sto(node: Node, _: float) -> None:
    node.drive.switch_sto(released=True)


RULES: Final[Mapping[FaultKind, FaultRule]] = MappingProxyType(
    {
        FaultKind.LOST_TPDO: FaultRule(
            "TPDOs do not reach the bus", _lose_tpdo, _find_tpdo, "TPDO number, 0: all", 0, 4
        ),
        FaultKind.LATE_TPDO: FaultRule(
            "synchronous TPDOs leave later",
            _delay_tpdo,
            _be_on_time,
            "delay in ms",
            0.001,
            1000,
            value_needed=True,
        ),
        FaultKind.SILENT: FaultRule("nothing of the node reaches the bus", _mute, _unmute),
        FaultKind.UNPLUGGED: FaultRule("cut off from the bus, both ways", _unplug, _plug),
        FaultKind.EMCY: FaultRule(
            "a fault with this code; its cause lasts as long as the fault here",
            _emergency,
            _emergency_gone,
            "error code",
            1,
            0xFFFF,
            value_needed=True,
        ),
        FaultKind.FROZEN_ENCODER: FaultRule("the position that is reported stands", _freeze, _thaw),
        FaultKind.ENCODER_GLITCH: FaultRule(
            "the next position that is sampled is wrong; with a duration, all of them",
            _glitch,
            _end_glitch,
            "counts",
            -(2**31),
            2**31 - 1,
            value_needed=True,
            momentary=True,
        ),
        FaultKind.REBOOT: FaultRule(
            "loses its power; comes back after the duration, or at once",
            _power_off,
            _power_on,
            momentary=True,
        ),
        FaultKind.BLOCKED_ROTOR: FaultRule("the joint is jammed", _block, _unblock),
        FaultKind.HAND_SWITCH_OPEN: FaultRule(
            "the patient lets the hand switch go", _open_hand_switch, _close_hand_switch
        ),
        FaultKind.STO_OPEN: FaultRule("safe torque off is asked for", _open_sto, _release_sto),
    }
)


@dataclass(frozen=True, slots=True)
class FaultOrder:
    """A fault to begin or to clear now."""

    drive: str
    kind: FaultKind
    duration_s: float | None = None
    value: float = 0.0
    clear: bool = False

    def on(self, drive: str) -> "FaultOrder":
        """The same for one drive."""
        return replace(self, drive=drive)


def help_text() -> str:
    """The table, for people."""
    rows = [f"{COMMAND_FORM}"]
    for kind, rule in RULES.items():
        value = f" (value: {rule.value_text})" if rule.value_text else ""
        rows.append(f"{kind.value}: {rule.text}{value}")
    return "\n".join(rows)


def parse_command(line: str) -> FaultOrder:
    """Read one command.

    Raises:
        FaultCommandError: says what is wrong with which word, and what is allowed.
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
    """Refuse a value that the kind cannot have.

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


def _kind(word: str) -> FaultKind:
    known = {kind.value: kind for kind in FaultKind}
    if word not in known:
        raise FaultCommandError(f"unknown kind {word!r}; known: {', '.join(known)}")
    return known[word]


def _duration(word: str) -> float | None:
    if word == OPEN_END:
        return None
    duration_s = _number(word, "duration")
    if duration_s <= 0:
        raise FaultCommandError(f"duration {word!r} must be above 0 s, or {OPEN_END}")
    return duration_s


def _number(word: str, what: str) -> float:
    try:
        value = float(int(word, 0)) if word.lower().startswith("0x") else float(word)
    except ValueError:
        raise FaultCommandError(f"{what} {word!r} is no number") from None
    if not math.isfinite(value):
        raise FaultCommandError(f"{what} {word!r} is not finite")
    return value
