"""Dump of all readable objects of one drive according to its EDS, decoded and saved as a DCF.

The DCF (CiA 306: an EDS with ParameterValue) holds texts without `;`, which begins a comment there.
An object that the drive refused has no ParameterValue and is not in the result of `read_dcf`.
"""

import struct
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import Final, TextIO

from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
from drives.canopen import data_sheet
from drives.canopen.data_sheet import Address, DataSheet, Variable
from drives.canopen.objects import Object
from drives.canopen.sniffer import NodeTraffic
from drives.errors import (
    BootFailure,
    DescriptionError,
    DriveSilent,
    SdoAborted,
    SdoGarbled,
    SdoTimeout,
)
from drives.service.eds import load_eds
from drives.service.scan import Progress
from drives.signals import NmtState

SILENCES_MAX: Final = 3
"""After this many objects in a row without an answer the drive counts as gone."""
PAUSE_NS: Final = 2_000_000
"""Pause between two transfers, so that a service on the same bus is not disturbed."""

Value = int | float | str

_UNSIGNED: Final = {8: 0x05, 16: 0x06, 32: 0x07}
"""CiA 301 data type of an unsigned integer, by its width."""
_MAPPINGS: Final = (range(Object.RPDO_MAPPING, Object.TPDO), range(Object.TPDO_MAPPING, 0x1C00))


@dataclass(frozen=True, slots=True)
class Entry:
    """One object as read; either `value` or `trouble` is set."""

    index: int
    sub: int
    name: str
    value: Value | None = None
    bits: int = 0
    """Width of an integer; 0 for other types. Bytes without a type are text in hex."""
    trouble: str = ""
    """Why there is no value: the abort text, or no answer."""
    silent: bool = False

    @property
    def place(self) -> str:
        """`6065h:00`."""
        return f"{self.index:04X}h:{self.sub:02X}"


def check_alone(plan: DrivePlan, traffic: NodeTraffic) -> None:
    """Check that no other SDO client uses the drive: both would break each other's transfers.

    A service that reads the temperature in its cycle waits for this client (temperature.py).

    Raises:
        DriveSilent: another client reads or writes the drive's objects now.
    """
    if traffic.foreign_count_besides(plan.description.profile.uploaded_in_cycle):
        reason = "another client reads or writes its objects now (a service's bring-up?): try later"
        raise DriveSilent(plan.description.name, BootFailure.FOREIGN_MASTER, reason)


def silence(plan: DrivePlan, traffic: NodeTraffic) -> str:
    """Explain why a drive does not answer."""
    node_id = plan.description.node_id
    if traffic.watch.state is NmtState.STOPPED:
        return f"node {node_id} is stopped: no SDO in this state; it answers after power-on"
    return f"no answer from node {node_id}; `gaitd scan` lists the nodes that are there"


def read_objects(
    node_id: int, variables: Sequence[Variable], port: DrivePort, *, as_filled: bool = False
) -> Generator[Progress, None, tuple[Entry, ...]]:
    """Read objects in the given order, one at a time, with pauses.

    Args:
        node_id: the drive.
        variables: the objects.
        port: the bus.
        as_filled: read only as many entries of an array or a mapping as its sub-index 0 says.

    Raises:
        SdoTimeout: several objects in a row were not answered.
        BusError: the bus is down.
    """
    entries: list[Entry] = []
    silence_count = 0
    filled: dict[int, int] = {}
    for done_count, variable in enumerate(variables):
        index, sub = variable.address
        if as_filled and sub > filled.get(index, sub):
            continue
        yield Progress(f"reading {index:04X}h:{sub:02X}", done_count, len(variables))
        entry = _read(variable, node_id, port, silence_count + 1 >= SILENCES_MAX)
        silence_count = silence_count + 1 if entry.silent else 0
        entries.append(entry)
        if sub == 0 and isinstance(entry.value, int) and _is_filled(variable):
            filled[index] = entry.value
    return tuple(entries)


def _is_filled(variable: Variable) -> bool:
    """True if sub-index 0 gives the number of valid entries."""
    return variable.in_array or any(variable.index in indices for indices in _MAPPINGS)


def readable(sheet: DataSheet) -> list[Variable]:
    """List every readable variable, in order."""
    return [variable for variable in sheet.variables.values() if variable.readable]


def variable_at(sheet: DataSheet, index: int, sub: int, bits: int) -> Variable:
    """The EDS's object, or a plain unsigned one where the EDS lacks it."""
    plain = Variable(index, sub, "(not in the EDS)", data_type=_UNSIGNED[bits])
    return sheet.get(index, sub) or plain


def _read(variable: Variable, node_id: int, port: DrivePort, last_chance: bool) -> Entry:
    index, sub, name = variable.index, variable.sub, variable.qualified_name
    try:
        data = port.read(node_id, index, sub)
    except SdoAborted as abort:
        return Entry(index, sub, name, trouble=f"{abort.text} ({abort.code:08X}h)")
    except SdoGarbled as error:
        return Entry(index, sub, name, trouble=str(error))
    except SdoTimeout as error:
        if last_chance:
            raise
        return Entry(index, sub, name, trouble=str(error), silent=True)
    finally:
        pause(port)
    return Entry(index, sub, name, decoded(variable, data), bits_of(variable))


def pause(port: DrivePort) -> None:
    """Receive during a short pause that leaves the bus to others."""
    end_ns = port.now_ns() + PAUSE_NS
    while port.now_ns() < end_ns:
        port.wait(end_ns)


def bits_of(variable: Variable) -> int:
    """Width of an integer; 0 for other types."""
    return variable.bits if variable.is_integer else 0


def decoded(variable: Variable, data: bytes) -> Value:
    """Decode the bytes of an object by its data type; bytes without a type as hex.

    Some drives answer four bytes for a smaller number: it is cut to its own width.
    """
    if variable.is_real and len(data) * 8 == variable.bits:
        return struct.unpack("<f" if len(data) == 4 else "<d", data)[0]
    if variable.is_text:
        is_wide = variable.data_type == data_sheet.UNICODE_STRING
        encoding = "utf-16-le" if is_wide else "latin-1"
        return kept_text(data.decode(encoding, errors="replace"))
    if variable.bits and not variable.is_real:
        size = max(1, variable.bits // 8)
        return int.from_bytes(data[:size], "little", signed=variable.signed)
    return data.hex()


def kept_text(text: str) -> str:
    """Make a text fit for a DCF: one line, no `;`, only printable characters."""
    letters = text.split("\0", maxsplit=1)[0].replace(";", ",")
    return "".join(letter if letter.isprintable() else "?" for letter in letters).strip()


# --- files ----------------------------------------------------------------------------------------


def write_dcf(entries: tuple[Entry, ...], sheet: DataSheet, node_id: int, file: TextIO) -> None:
    """Write what was read as a DCF; a number that came with a wrong length has no value there."""
    read = {(entry.index, entry.sub): entry.value for entry in entries}
    held: dict[Address, Variable] = {}
    for address, variable in sheet.variables.items():
        value = read.get(address)
        fits = not variable.bits or not isinstance(value, str)
        held[address] = replace(variable, value=value if fits else None)
    data_sheet.write_dcf(replace(sheet, variables=held), node_id, file)


def read_dcf(path: str, node_id: int) -> dict[Address, Value]:
    """The values of a DCF, by index and sub-index.

    Raises:
        DescriptionError: it cannot be read, or holds no values, or one that is none.
    """
    variables = readable(load_eds(path, node_id))
    for fault in (variable.fault_in("ParameterValue") for variable in variables):
        if fault is not None:
            raise DescriptionError("axis", "dcf", path, str(fault))
    values = {v.address: _kept(v.value) for v in variables if v.value is not None}
    if not values:
        allowed = "a DCF with values: this one has no ParameterValue"
        raise DescriptionError("axis", "dcf", path, allowed)
    return values


def settings(sheet: DataSheet) -> list[Variable]:
    """List writable and constant variables, which excludes measurements."""
    return [
        variable for variable in readable(sheet) if variable.writable or variable.access == "const"
    ]


def defaults(sheet: DataSheet) -> dict[Address, Value]:
    """The EDS's default values."""
    return {v.address: _kept(v.default) for v in readable(sheet) if v.default is not None}


def _kept(value: data_sheet.Value) -> Value:
    """Convert a value of a data sheet to the form of `decoded`."""
    if isinstance(value, bytes):
        return value.hex()
    return kept_text(value) if isinstance(value, str) else value
