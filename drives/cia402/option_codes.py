"""Option codes of CiA 402: a drive's own reactions, as text, and the values that are refused.

605Ah selects the quick stop: 0 to 4 end without torque (transition 12), 5 to 8 stop in the same
ways and then hold in quick stop active. 605Eh selects the stop of a fault; every fault ends without
torque. 605Dh selects the stop of a halt. 6007h selects the reaction to a lost master. Source: CiA
402-2 / IEC 61800-7-201 as reproduced by public manuals (Applied Motion CANopen manual, Parker
SLVD-N, Kollmorgen AKD CAN-BUS communication).
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Final

from msgspec import Meta

from drives.canopen.objects import Object
from drives.cia402.torque import ObjectRef, Word
from drives.errors import DescriptionError

_HOW: Final = {
    0: "switch off at once and coast",
    1: "slow down on the slow-down ramp",
    2: "slow down on the quick-stop ramp",
    3: "slow down at the current limit",
    4: "slow down at the voltage limit",
}
_MEANINGS: Final[Mapping[int, Mapping[int, str]]] = {
    Object.ABORT_CONNECTION: {
        0: "nothing",
        1: "fault, then as defined by 605Eh",
        2: "disable voltage and coast",
        3: "quick stop, then as defined by 605Ah",
    },
    Object.QUICK_STOP: {
        **{code: f"{how}, then switch off" for code, how in _HOW.items() if code},
        0: _HOW[0],
        **{code + 4: f"{how} and stay in quick stop" for code, how in _HOW.items() if code},
    },
    Object.HALT: {code: f"{how} and stay enabled" for code, how in _HOW.items() if code},
    Object.FAULT_REACTION: {
        **{code: f"{how}, then switch off" for code, how in _HOW.items() if code},
        0: _HOW[0],
    },
}
_NAMES: Final[Mapping[int, str]] = {
    Object.ABORT_CONNECTION: "master gone",
    Object.QUICK_STOP: "quick stop",
    Object.HALT: "halt",
    Object.FAULT_REACTION: "fault",
}

_NEVER: Final = {
    Object.QUICK_STOP: (0, "a quick stop that only switches off lets the leg fall"),
    Object.ABORT_CONNECTION: (0, "a drive that continues without its master moves uncontrolled"),
    Object.FAULT_REACTION: (0, "a fault that only switches off lets the leg fall"),
}
"""Option codes that every profile must write, the values that are refused, and why."""

_WITHOUT_BRAKE: Final[Mapping[int, tuple[Sequence[int], str]]] = {
    Object.QUICK_STOP: (range(5), "5 to 8, which hold"),
    Object.ABORT_CONNECTION: ((2,), "1 or 3, which slow down first"),
}
"""Codes that leave an axis without torque while it may still move, and the codes that hold it."""


class WrittenObject(ObjectRef, frozen=True, kw_only=True):
    """A setting that bring-up writes and reads back, whatever its present value."""

    value: Word
    """Value that bring-up writes, and reads back."""
    legal: Annotated[tuple[Word, ...], Meta(min_length=1)]
    """Values that this drive accepts; `value` must be one of them."""
    why: Annotated[str, Meta(min_length=5)]
    """Reason, for the person who reads the plan of a bring-up."""


def in_words(entry: WrittenObject) -> str | None:
    """`quick stop (605Ah = 6): slow down on ... `; None for other objects."""
    if entry.index not in _MEANINGS:
        return None
    meaning = _MEANINGS[entry.index].get(entry.value, "manufacturer-specific")
    return f"{_NAMES[entry.index]} ({entry.index:04X}h = {entry.value}): {meaning}"


def check_written(written: tuple[WrittenObject, ...], *, halt: bool) -> None:
    """Check that every option code is written, legal for this drive, and none drops a leg.

    Args:
        written: all settings of the profile.
        halt: the drive has 605Dh.

    Raises:
        DescriptionError: the first that is not.
    """
    by_index = {entry.index: entry for entry in written}
    for index, (forbidden, why) in _NEVER.items():
        entry = by_index.get(index)
        if entry is None:
            raise _missing(written, index, f"must be among them, since {why}")
        if entry.value == forbidden:
            raise _refused(entry, f"not {forbidden}: {why}")
    if (Object.HALT in by_index) != halt:
        wanted = "must be among them" if halt else "must not be among them"
        raise _missing(written, Object.HALT, f"{wanted}, because of optional_objects.halt_option")
    for entry in written:
        if entry.value not in entry.legal:
            raise _refused(entry, f"one of {', '.join(map(str, entry.legal))}")
        if entry.value not in entry.values:
            raise _refused(entry, entry.values_in_words)


def holds_after_quick_stop(written: tuple[WrittenObject, ...]) -> bool:
    """605Ah is 5 to 8: the drive keeps its torque."""
    return any(entry.index == Object.QUICK_STOP and entry.value in range(5, 9) for entry in written)


def without_torque(
    written: tuple[WrittenObject, ...],
) -> tuple[tuple[WrittenObject, str], ...]:
    """List the codes that an axis without a brake must not have, with the alternatives."""
    return tuple(
        (entry, instead)
        for entry in written
        for values, instead in (_WITHOUT_BRAKE.get(entry.index, ((), "")),)
        if entry.value in values
    )


def _missing(written: tuple[WrittenObject, ...], index: int, allowed: str) -> DescriptionError:
    listed = sorted((entry.index, entry.sub) for entry in written)
    return DescriptionError("profile", "written", listed, f"{index:04X}h:00 {allowed}")


def _refused(entry: WrittenObject, allowed: str) -> DescriptionError:
    key = f"written[{entry.index:04X}h].value"
    return DescriptionError("profile", key, entry.value, allowed)
