"""Comparison of a drive's objects with the bring-up plan, an EDS, or an earlier dump.

`read_with_plan` and `read_with_values` read the drive; the rest is pure. `expectations` takes from
a plan everything that bring-up would write or check, with the final value of each object: a mapping
is emptied, filled and counted, and only the count remains. Objects that are only reported, or
depend on the joint's position (the target position), are not expected.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
from drives.bringup.steps import ALL_BITS, PDO_OFF, Step, StepKind
from drives.canopen.data_sheet import Address, DataSheet
from drives.cia402.profile import BASE_TOLERANCE_RATIO
from drives.service.dump import Entry, Value, read_objects, settings, variable_at
from drives.service.scan import Progress


class Expectation(NamedTuple):
    """One object and the value that bring-up expects of it."""

    step: Step
    """Step with `value` for this object alone: a range becomes two of them."""

    @property
    def address(self) -> Address:
        """Index and sub-index."""
        return self.step.index, self.step.sub

    @property
    def wanted(self) -> str:
        """The expected value as text."""
        match self.step.kind:
            case StepKind.SWITCH_OFF:
                return "off (bit 31)"
            case StepKind.COMPARE:
                return f"about {self.step.value_text(self.step.value)}"
            case _:
                return self.value_text(self.step.value)

    def is_met(self, value: int) -> bool:
        """True if bring-up would accept the value that was read, or leave it behind."""
        step = self.step
        match step.kind:
            case StepKind.SWITCH_OFF:
                return bool(value & PDO_OFF)
            case StepKind.COMPARE:
                return value != 0 and abs(value - step.value) <= BASE_TOLERANCE_RATIO * step.value
            case StepKind.CHECK:
                return value & step.mask == step.value
            case _:
                return (value ^ step.value) & step.mask & ((1 << step.bits) - 1) == 0

    def value_text(self, value: int) -> str:
        """Format a value restricted to the bits of this expectation."""
        masked = value if self.step.mask == ALL_BITS else value & self.step.mask
        return self.step.value_text(masked)


@dataclass(frozen=True, slots=True)
class Compared:
    """One object with its expected and its present value."""

    index: int
    sub: int
    name: str
    wanted: str
    found: str
    why: str
    same: bool

    @property
    def place(self) -> str:
        """`6065h:00`."""
        return f"{self.index:04X}h:{self.sub:02X}"


_EXPECTED = frozenset(
    (
        StepKind.CHECK,
        StepKind.COMPARE,
        StepKind.SWITCH_OFF,
        StepKind.WRITE,
        StepKind.CLEAR,
        StepKind.RANGE,
    )
)


def expectations(plan: DrivePlan) -> tuple[Expectation, ...]:
    """List the expectation of bring-up for each object, in order of first use."""
    wanted: dict[tuple[int, int, int], Expectation] = {}
    for step in plan.steps:
        if step.kind in _EXPECTED:
            for part in _parts(step):
                # Two checks of one object may test different bits; a write replaces earlier
                # expectations.
                bits = part.mask if step.kind is StepKind.CHECK else 0
                wanted[part.index, part.sub, bits] = Expectation(part)
    return tuple(wanted.values())


def _parts(step: Step) -> Iterator[Step]:
    if step.kind is StepKind.RANGE:
        yield replace(step, kind=StepKind.WRITE)
        yield replace(step, kind=StepKind.WRITE, sub=step.sub + 1, value=step.second)
    else:
        yield step


def expected_of(plan: DrivePlan, sheet: DataSheet) -> tuple[Expectation, ...]:
    """The expectations for a drive with this EDS: what is only cleared need not be there."""
    return tuple(
        one
        for one in expectations(plan)
        if one.step.kind is not StepKind.CLEAR or sheet.get(*one.address) is not None
    )


def read_with_plan(
    plan: DrivePlan, sheet: DataSheet, port: DrivePort
) -> Generator[Progress, None, tuple[Compared, ...]]:
    """Read what a plan expects, and compare; raises as `read_objects`."""
    wanted = expected_of(plan, sheet)
    variables = [variable_at(sheet, *one.address, one.step.bits) for one in wanted]
    entries = yield from read_objects(plan.description.node_id, variables, port)
    return with_plan(wanted, {(entry.index, entry.sub): entry for entry in entries})


def read_with_values(
    plan: DrivePlan,
    sheet: DataSheet,
    port: DrivePort,
    values: Mapping[Address, Value],
    why: str,
) -> Generator[Progress, None, tuple[Compared, ...]]:
    """Read the settings that have a value in `values`, and compare; raises as `read_objects`."""
    variables = [v for v in settings(sheet) if v.address in values]
    entries = yield from read_objects(plan.description.node_id, variables, port)
    return with_values(values, entries, why)


def with_plan(
    wanted: Iterable[Expectation], found: Mapping[Address, Entry]
) -> tuple[Compared, ...]:
    """Compare a plan's expectations with a drive. `found` has every object of `wanted`."""
    return tuple(
        _with_expectation(expectation, found[expectation.address]) for expectation in wanted
    )


def _with_expectation(expectation: Expectation, entry: Entry) -> Compared:
    found, same = entry.trouble or str(entry.value), False
    if isinstance(entry.value, int):
        found, same = expectation.value_text(entry.value), expectation.is_met(entry.value)
    why = expectation.step.why
    return Compared(entry.index, entry.sub, entry.name, expectation.wanted, found, why, same)


def with_values(
    wanted: Mapping[Address, Value], found: Iterable[Entry], why: str
) -> tuple[Compared, ...]:
    """Compare given values with a drive. `wanted` has every object of `found`."""
    return tuple(_with_value(wanted[entry.index, entry.sub], entry, why) for entry in found)


def _with_value(wanted: Value, entry: Entry, why: str) -> Compared:
    return Compared(
        entry.index,
        entry.sub,
        entry.name,
        value_text(wanted, entry.bits),
        entry.trouble if entry.value is None else value_text(entry.value, entry.bits),
        why,
        same=entry.value == wanted,
    )


def value_text(value: Value, bits: int) -> str:
    """Format a value for the operator: numbers in decimal and hex."""
    if isinstance(value, int) and bits:
        return f"{value} ({in_hex(value, bits)})"
    return str(value) if value != "" else '""'


def in_hex(value: int, bits: int) -> str:
    """Format as the drive holds it, in two's complement: `FFFFFFFEh`."""
    return f"{value & ((1 << bits) - 1):0{(bits + 3) // 4}X}h"
