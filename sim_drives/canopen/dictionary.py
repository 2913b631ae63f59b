"""The object dictionary of one virtual drive: entries, access rules and values.

Rules, from CiA 301 7.4 (numbers are SDO abort codes):
1. Unknown index 06020000, known index with unknown sub-index 06090011.
2. Reading a write-only object 06010001, writing a read-only one 06010002.
3. A number must come with exactly its length: longer 06070012, shorter 06070013. A string may be
   up to `STRING_MAX_BYTES` long, a domain up to `DOMAIN_MAX_BYTES`, longer is 05040005.
4. Above its HighLimit 06090031, below its LowLimit 06090032.
5. Then the object's guard, if it has one, may refuse with an abort code before anything is stored.
   Then the value is stored and the object's watchers are called. Reading may have a guard, too.
The drive itself reads and writes with `value` and `put`, without any of these rules.

The description comes from an EDS. Where that has no data type an object is a byte string, and
without access rights it can only be read.
"""

import struct
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

from drives.canopen.data_sheet import DOMAIN, UNICODE_STRING, Address, Variable, parse, text_of
from sim_drives.canopen.aborts import AbortCode, SdoAbortError

type_codes: Final[Mapping[int, str]] = {
    0x01: "?",
    0x02: "b",
    0x03: "h",
    0x04: "i",
    0x05: "B",
    0x06: "H",
    0x07: "I",
    0x15: "q",
    0x1B: "Q",
}
"""CiA 301 data type -> struct code; all other types are byte strings here."""
STRING_MAX_BYTES: Final = 256
DOMAIN_MAX_BYTES: Final = 32_768
_HEARTBEAT_CONSUMER: Final = 0x1016
"""A node id and a time; Elmo's file gives the range of the time alone."""
COMMUNICATION_AREA: Final = range(0x1000, 0x2000)

Value = int | bytes
Guard = Callable[[int, int], None]
"""(sub-index, new value) -> None, or raises SdoAbortError."""
Watcher = Callable[[int], None]
"""(sub-index that was written) -> None."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One variable of the EDS."""

    address: Address
    type_code: str
    """Format code of `struct`; empty for a byte string."""
    max_bytes: int
    readable: bool
    writable: bool
    mappable_out: bool
    """True if it may be mapped into a TPDO."""
    mappable_in: bool
    """True if it may be mapped into an RPDO."""
    low: int | None
    high: int | None
    default: Value

    @property
    def size_bytes(self) -> int:
        """Length of a number; 0 for a byte string."""
        return struct.calcsize("<" + self.type_code)

    def encode(self, value: Value) -> bytes:
        """Encode a value of this entry as little-endian bytes."""
        return value if isinstance(value, bytes) else struct.pack("<" + self.type_code, value)

    def decode(self, data: bytes) -> Value:
        """Decode the bytes of `encode`; a wrong length aborts (rule 3)."""
        self.check_length(len(data))
        if not self.type_code:
            return bytes(data)
        return int(struct.unpack("<" + self.type_code, data)[0])

    def check_length(self, length_bytes: int) -> None:
        """Abort if no value of this entry has that length (rule 3)."""
        if length_bytes > self.max_bytes:
            raise SdoAbortError(AbortCode.TOO_LONG if self.type_code else AbortCode.OUT_OF_MEMORY)
        if length_bytes < self.size_bytes:
            raise SdoAbortError(AbortCode.TOO_SHORT)


def read_eds(path: Path, node_id: int) -> tuple[Entry, ...]:
    """Read all variables of an EDS, with $NODEID replaced.

    Raises:
        OSError: the file cannot be opened.
        ValueError: it describes no object.
    """
    return _entries(text_of(path.read_bytes()), node_id)


@lru_cache(maxsize=16)
def _entries(text: str, node_id: int) -> tuple[Entry, ...]:
    """Parse an EDS, each text once: building a machine takes half of its time for this."""
    return tuple(_entry(variable) for variable in parse(text, node_id).variables.values())


def _entry(variable: Variable) -> Entry:
    code = type_codes.get(variable.data_type or 0, "")
    is_time = variable.index == _HEARTBEAT_CONSUMER and variable.high == 0xFFFF
    return Entry(
        address=variable.address,
        type_code=code,
        max_bytes=_max_bytes(variable.data_type, code),
        readable=variable.readable,
        writable=variable.writable,
        mappable_out=variable.mappable and variable.readable and variable.access != "rww",
        mappable_in=variable.mappable and variable.writable and variable.access != "rwr",
        low=variable.low if isinstance(variable.low, int) else None,
        high=variable.high if isinstance(variable.high, int) and not is_time else None,
        default=_default(variable, code),
    )


def _max_bytes(data_type: int | None, code: str) -> int:
    if code:
        return struct.calcsize("<" + code)
    return DOMAIN_MAX_BYTES if data_type == DOMAIN else STRING_MAX_BYTES


def _default(variable: Variable, code: str) -> Value:
    default = variable.default
    if code:
        return default if isinstance(default, int) else 0
    match default:
        case str():
            wide = variable.data_type == UNICODE_STRING
            return default.encode("utf-16-le" if wide else "utf-8")
        case int():
            return (default % (1 << variable.bits)).to_bytes(variable.bits // 8, "little")
        case float():
            return struct.pack("<f" if variable.bits == 32 else "<d", default)
        case _:
            return default or b""


class ObjectDictionary:
    """Values by address, with the access rules of this module."""

    def __init__(self, entries: tuple[Entry, ...]) -> None:
        self._entries = {entry.address: entry for entry in entries}
        self._indices = {index for index, _ in self._entries}
        self._values: dict[Address, Value] = {e.address: e.default for e in entries}
        self._guards: dict[int, Guard] = {}
        self._reading_guards: dict[int, Callable[[int], None]] = {}
        self._watchers: defaultdict[int, list[Watcher]] = defaultdict(list)
        self.revision = 0
        """Incremented when a parameter may have changed (SDO write or restore), not by PDOs."""
        self.refused_index: int | None = None
        """Injected fault: writing this object is aborted with 08000020."""
        self.before_upload: Callable[[], None] = lambda: None
        """Updates the process values; called before an SDO read above 1FFFh."""

    def entry(self, index: int, subindex: int = 0) -> Entry:
        """Return the description of one variable; abort if there is none (rule 1)."""
        entry = self._entries.get((index, subindex))
        if entry is None:
            known = index in self._indices
            raise SdoAbortError(AbortCode.NO_SUBINDEX if known else AbortCode.NO_OBJECT)
        return entry

    def subindices(self, index: int) -> list[int]:
        """Return the existing sub-indices in order."""
        return sorted(subindex for known, subindex in self._entries if known == index)

    def __contains__(self, address: Address) -> bool:
        return address in self._entries

    def value(self, index: int, subindex: int = 0) -> int:
        """Return the number at an existing address; a string's address is a programming error."""
        value = self._values[index, subindex]
        if isinstance(value, bytes):
            raise TypeError(f"{index:04X}h:{subindex} holds a string")
        return value

    def value_or(self, index: int, subindex: int, missing: int) -> int:
        """Return the number at an address, or `missing` if this drive does not have the object."""
        value = self._values.get((index, subindex), missing)
        if isinstance(value, bytes):
            raise TypeError(f"{index:04X}h:{subindex} holds a string")
        return value

    def assume(self, standard: Mapping[Address, Value]) -> None:
        """Fill in what the EDS leaves empty; what it lacks is the drive's own, hidden from SDO."""
        for address, value in standard.items():
            if not self._values.get(address):
                self._values[address] = value
                if address in self._entries:
                    entry = replace(self._entries[address], default=value)
                    self._entries[address] = entry

    def put(self, index: int, subindex: int, value: Value) -> None:
        """Store a value without rules, on behalf of the drive itself."""
        address = index, subindex
        if address not in self._values:
            raise KeyError(f"{index:04X}h:{subindex}")
        self._values[address] = value

    def upload(self, index: int, subindex: int) -> bytes:
        """Return the bytes of an SDO read, or abort."""
        entry = self.entry(index, subindex)
        if not entry.readable:
            raise SdoAbortError(AbortCode.WRITE_ONLY)
        if index in self._reading_guards:
            self._reading_guards[index](subindex)
        if index not in COMMUNICATION_AREA:
            self.before_upload()
        return entry.encode(self._values[index, subindex])

    def download(self, index: int, subindex: int, data: bytes) -> None:
        """Execute an SDO write, or abort."""
        entry = self.entry(index, subindex)
        if not entry.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        if index == self.refused_index:
            raise SdoAbortError(AbortCode.CANNOT_STORE)
        value = entry.decode(data)
        if not isinstance(value, bytes):
            _check_range(entry, value)
            self.check(index, subindex, value)
        self._values[index, subindex] = value
        self.revision += 1
        self.notify(index, subindex)

    def check(self, index: int, subindex: int, value: int) -> None:
        """Call the object's guard (rule 5)."""
        guard = self._guards.get(index)
        if guard is not None:
            guard(subindex, value)

    def accepts(self, index: int, subindex: int, value: int) -> bool:
        """Return whether a mapped value passes its range and its guard."""
        entry, guard = self._entries.get((index, subindex)), self._guards.get(index)
        if entry is None or not (entry.low is None or entry.low <= value):
            return False
        if not (entry.high is None or value <= entry.high):
            return False
        if guard is not None:
            try:
                guard(subindex, value)
            except SdoAbortError:
                return False
        return True

    def notify(self, index: int, subindex: int) -> None:
        """Call the object's watchers after a write."""
        for watcher in self._watchers.get(index, ()):
            watcher(subindex)

    def guard(self, index: int, guard: Guard) -> None:
        """Install `guard` for every write to an index; one guard per index."""
        self._guards[index] = guard

    def guard_reading(self, index: int, guard: Callable[[int], None]) -> None:
        """Install `guard` for every SDO read of an index; it receives the sub-index."""
        self._reading_guards[index] = guard

    def watch(self, index: int, watcher: Watcher) -> None:
        """Call `watcher` after every write to an index."""
        self._watchers[index].append(watcher)

    def parameters(self) -> dict[Address, Value]:
        """Return the values of all writable entries, which 1010h saves."""
        return {a: self._values[a] for a, entry in self._entries.items() if entry.writable}

    def defaults(self) -> dict[Address, Value]:
        """Return the EDS default values of all writable entries."""
        return {a: e.default for a, e in self._entries.items() if e.writable}

    def restore(self, parameters: Mapping[Address, Value], *, communication_only: bool) -> None:
        """Restore saved parameters; with `communication_only`, only those of 1000h to 1FFFh."""
        self.revision += 1
        for address, value in parameters.items():
            if not communication_only or address[0] in COMMUNICATION_AREA:
                self._values[address] = value


def _check_range(entry: Entry, value: int) -> None:
    if entry.high is not None and value > entry.high:
        raise SdoAbortError(AbortCode.TOO_HIGH)
    if entry.low is not None and value < entry.low:
        raise SdoAbortError(AbortCode.TOO_LOW)
