"""Dump of all readable objects of one drive according to its EDS, decoded and saved as a DCF.

The DCF (CiA 306: an EDS with ParameterValue) is written and read by canopen 2.4.1. Workarounds,
with their place in canopen: its export writes a negative number as `0x-5`, which its own import
silently drops (eds.py, _revert_variable): numbers are handed over as text. A `;` after a space
begins a comment for its parser: texts are saved without any. An object that the drive refused has
no ParameterValue and is not in the result of `read_dcf`.
"""

import struct
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Final, TextIO, cast

import canopen
from canopen.objectdictionary import ObjectDictionary, ODArray, ODVariable, datatypes

from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
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

FIRST_INDEX: Final = 0x1000
"""Lower indices are data types and dummy entries."""
SILENCES_MAX: Final = 3
"""After this many objects in a row without an answer the drive counts as gone."""
PAUSE_NS: Final = 2_000_000
"""Pause between two transfers, so that a service on the same bus is not disturbed."""
DCF: Final = "dcf"

Value = int | float | str
Address = tuple[int, int]

_UNSIGNED: Final = {
    8: datatypes.UNSIGNED8,
    16: datatypes.UNSIGNED16,
    32: datatypes.UNSIGNED32,
}
_MAPPINGS: Final = (range(Object.RPDO_MAPPING, Object.TPDO), range(Object.TPDO_MAPPING, 0x1C00))
_TEXTS: Final = frozenset((datatypes.VISIBLE_STRING, datatypes.UNICODE_STRING))


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
    node_id: int, variables: Sequence[ODVariable], port: DrivePort, *, as_filled: bool = False
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
        index, sub = variable.index, variable.subindex
        if as_filled and sub > filled.get(index, sub):
            continue
        yield Progress(f"reading {index:04X}h:{sub:02X}", done_count, len(variables))
        entry = _read(variable, node_id, port, silence_count + 1 >= SILENCES_MAX)
        silence_count = silence_count + 1 if entry.silent else 0
        entries.append(entry)
        if sub == 0 and isinstance(entry.value, int) and _is_filled(variable):
            filled[index] = entry.value
    return tuple(entries)


def _is_filled(variable: ODVariable) -> bool:
    """True if sub-index 0 gives the number of valid entries."""
    mapping = any(variable.index in indices for indices in _MAPPINGS)
    return mapping or isinstance(cast("object", variable.parent), ODArray)


def readable(dictionary: ObjectDictionary) -> list[ODVariable]:
    """List every readable variable, in order."""
    variables: list[ODVariable] = []
    for index in dictionary:
        item = dictionary[index]
        if index >= FIRST_INDEX:
            variables += [item] if isinstance(item, ODVariable) else [item[sub] for sub in item]
    return [variable for variable in variables if variable.readable]


def variable_at(dictionary: ObjectDictionary, index: int, sub: int, bits: int) -> ODVariable:
    """The EDS's object, or a plain unsigned one where the EDS lacks it."""
    variable = dictionary.get_variable(index, sub)
    if variable is None:
        variable = ODVariable("(not in the EDS)", index, sub)
        variable.data_type = _UNSIGNED[bits]
    return variable


def _read(variable: ODVariable, node_id: int, port: DrivePort, last_chance: bool) -> Entry:
    index, sub, name = variable.index, variable.subindex, variable.qualname
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


def bits_of(variable: ODVariable) -> int:
    """Width of an integer; 0 for other types."""
    return len(variable) if variable.data_type in datatypes.INTEGER_TYPES else 0


def decoded(variable: ODVariable, data: bytes) -> Value:
    """Decode the bytes of an object by its data type; bytes without a type as hex.

    Some drives answer four bytes for a smaller number: it is cut to its own width.
    """
    kind = variable.data_type
    if kind in datatypes.INTEGER_TYPES or kind == datatypes.BOOLEAN:
        size = max(1, len(variable) // 8)
        return int.from_bytes(data[:size], "little", signed=kind in datatypes.SIGNED_TYPES)
    if kind in datatypes.FLOAT_TYPES and len(data) * 8 == len(variable):
        return struct.unpack("<f" if len(data) == 4 else "<d", data)[0]
    if kind in _TEXTS:
        encoding = "utf-16-le" if kind == datatypes.UNICODE_STRING else "latin-1"
        return kept_text(data.decode(encoding, errors="replace"))
    return data.hex()


def kept_text(text: str) -> str:
    """Make a text fit for a DCF: one line, no `;`, only printable characters."""
    letters = text.split("\0", maxsplit=1)[0].replace(";", ",")
    return "".join(letter if letter.isprintable() else "?" for letter in letters).strip()


# --- files ----------------------------------------------------------------------------------------


def write_dcf(
    entries: tuple[Entry, ...], dictionary: ObjectDictionary, node_id: int, file: TextIO
) -> None:
    """Write what was read as a DCF; also sets the values in `dictionary`."""
    dictionary.node_id = node_id
    for entry in entries:
        variable = dictionary.get_variable(entry.index, entry.sub)
        if variable is not None and entry.value is not None:
            # The export uses `value_raw` unchanged; the class does not declare it.
            vars(variable).update(value=entry.value, value_raw=str(entry.value))
    canopen.export_od(dictionary, file, doc_type=DCF)


def read_dcf(path: str, node_id: int) -> dict[Address, Value]:
    """The values of a DCF, by index and sub-index.

    Raises:
        DescriptionError: it cannot be read, or holds no values.
    """
    values: dict[Address, Value] = {}
    for variable in readable(load_eds(path, node_id)):
        if variable.value is not None:
            values[variable.index, variable.subindex] = _kept(variable.value)
    if not values:
        allowed = "a DCF with values: this one has no ParameterValue"
        raise DescriptionError("axis", "dcf", path, allowed)
    return values


def settings(dictionary: ObjectDictionary) -> list[ODVariable]:
    """List writable and constant variables, which excludes measurements."""
    return [
        variable
        for variable in readable(dictionary)
        if variable.writable or variable.access_type == "const"
    ]


def defaults(dictionary: ObjectDictionary) -> dict[Address, Value]:
    """The EDS's default values."""
    variables = readable(dictionary)
    return {(v.index, v.subindex): _kept(v.default) for v in variables if v.default is not None}


def _kept(value: object) -> Value:
    """Convert a value of canopen to the form of `decoded`."""
    if isinstance(value, bytes):
        return value.hex()
    return value if isinstance(value, int | float) else kept_text(str(value))
