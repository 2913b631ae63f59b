"""The steps of a plan that touch one object of one drive: read, compare, write, read back.

Every refusal is a BringUpRefused that names drive, object, value and reason; no answer is a
DriveSilent. Both carry the failure that the step names: no answer to an identity read means that
the node is absent, no answer to a setting means that its configuration failed. What is written is
read back and must be the same under the step's mask.
"""

from typing import Final, NamedTuple

from drives.bringup.port import DrivePort
from drives.bringup.steps import PDO_OFF, Step, StepKind
from drives.cia402.profile import BASE_TOLERANCE_RATIO
from drives.errors import (
    BootFailure,
    BringUpRefused,
    DriveSilent,
    SdoAborted,
    SdoGarbled,
    SdoTimeout,
)

_NO_SUCH_OBJECT: Final = frozenset((0x0602_0000, 0x0609_0011))
"""Abort codes of an object and of a sub-index that a drive does not have (CiA 301 7.2.4.3.17)."""


class SdoTarget(NamedTuple):
    """Address of a transfer."""

    port: DrivePort
    drive: str
    node_id: int


def examine(step: Step, target: SdoTarget) -> int:
    """Read an object, check it as CHECK, COMPARE, REPORT or ASK requires, and return its value.

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    if step.kind is StepKind.ASK:
        return _read_or_zero(step, target)
    value = read(step, target)
    if step.kind is StepKind.CHECK and value & step.mask != step.value:
        found = f"expected {step.value_text(step.value)} ({step.why})"
        raise _refusal(step, target, step.value_text(value), found)
    if step.kind is StepKind.COMPARE:
        _compare(step, target, value)
    return value


def switch_off(step: Step, target: SdoTarget) -> None:
    """Write a PDO's own identifier back with bit 31 set (CiA 301 7.5.2.35).

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    write(step, target, read(step, target) | PDO_OFF)


def clear(step: Step, target: SdoTarget) -> None:
    """Write 0 and read back, where the drive has the object and it holds another value.

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    if _read_or_zero(step, target, _NO_SUCH_OBJECT):
        write(step, target, 0)


def write_range(step: Step, target: SdoTarget) -> None:
    """Write a minimum and the adjacent maximum in an order in which they never cross.

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    upper = _beside(step)
    old_maximum = read(upper, target)
    pair = ((step, step.value), (upper, step.second))
    for part, value in pair if step.value <= old_maximum else reversed(pair):
        write(part, target, value)


def write(step: Step, target: SdoTarget, value: int) -> None:
    """Write and read back.

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    size = step.bits // 8
    data = value.to_bytes(size, "little", signed=value < 0)
    try:
        target.port.write(target.node_id, step.index, step.sub, data)
    except SdoAborted as abort:
        raise _aborted(step, target, step.value_text(value), abort) from abort
    except (SdoTimeout, SdoGarbled) as error:
        raise _silence(step, target, error) from error
    found = read(step, target)
    if (found ^ value) & step.mask & ((1 << step.bits) - 1):
        shown = step.value_text(value)
        reason = f"written, but it reads back {step.value_text(found)} ({step.why})"
        raise _refusal(step, target, shown, reason)


def read(step: Step, target: SdoTarget) -> int:
    """Read an object.

    Raises:
        BringUpRefused, DriveSilent: see the head of this file.
    """
    try:
        data = target.port.read(target.node_id, step.index, step.sub)
    except SdoAborted as abort:
        raise _aborted(step, target, "(read)", abort) from abort
    except (SdoTimeout, SdoGarbled) as error:
        raise _silence(step, target, error) from error
    size = step.bits // 8
    if len(data) < size:
        reason = f"{len(data)} bytes instead of {size} ({step.why})"
        raise _refusal(step, target, data.hex(), reason)
    # Some drives answer four bytes for a smaller object.
    return int.from_bytes(data[:size], "little", signed=step.signed)


def _read_or_zero(step: Step, target: SdoTarget, codes: frozenset[int] | None = None) -> int:
    """Read an object; 0 where the drive aborts, with one of these codes if they are given."""
    try:
        return read(step, target)
    except BringUpRefused as refused:
        abort = refused.__cause__
        if isinstance(abort, SdoAborted) and (codes is None or abort.code in codes):
            return 0
        raise


def _compare(step: Step, target: SdoTarget, value: int) -> None:
    if value == 0:
        reason = f"the drive has no motor data: expected about {step.value} ({step.why})"
        raise _refusal(step, target, "0", reason)
    if abs(value - step.value) > BASE_TOLERANCE_RATIO * abs(step.value):
        percent = BASE_TOLERANCE_RATIO * 100
        reason = f"more than {percent:g} % from the axis file's {step.value} ({step.why})"
        raise _refusal(step, target, str(value), reason)


def _beside(step: Step) -> Step:
    return Step(StepKind.WRITE, step.why, step.index, step.sub + 1, step.bits, step.signed)


def _aborted(step: Step, target: SdoTarget, value: str, abort: SdoAborted) -> BringUpRefused:
    reason = f"refused with {abort.code:08X}h, {abort.text} ({step.why})"
    return _refusal(step, target, value, reason)


def _refusal(step: Step, target: SdoTarget, value: str, reason: str) -> BringUpRefused:
    return BringUpRefused(target.drive, step.failure, reason, place=step.place, value=value)


def _silence(step: Step, target: SdoTarget, error: SdoTimeout | SdoGarbled) -> DriveSilent:
    unknown = step.kind is StepKind.CHECK
    failure = BootFailure.NO_ANSWER if unknown else BootFailure.CONFIGURATION
    return DriveSilent(target.drive, failure, str(error))
