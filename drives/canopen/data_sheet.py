"""Reader and writer of data sheets: EDS and DCF (CiA 306), as makers write them.

Master and virtual drives read a file with this module; tests hold it against python-canopen. Rules:
1.  A file is refused only if it cannot be opened, or describes no object. What is wrong in one
    object is a `Fault` of that object: a program that uses the object judges it.
2.  Case and blanks of section names and keys do not matter, nor 0x or h of an index; an empty value
    is an absent one. A comment begins with `;`, or with ` #` behind what is no text. Text that is
    not UTF-8 is read as a Windows code page: only names can suffer from it.
3.  A number that does not fit its object's data type is its bit pattern: 0xFF of an INTEGER8
    is -1. Suffixes of C, as in 0x12UL, say nothing. A number whose base is doubtful (`010`) is a
    fault.
4.  Limits that leave no value, as 0x00 .. 0xFF of an INTEGER8, or that are wider than the type,
    limit nothing, and are a fault.
5.  Arrays and records by CompactSubObj are expanded; a section of a member wins.
Lists of objects, dummies, comments and modules have no use here and are not read.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TextIO

BOOLEAN: Final = 0x01
_UNSIGNED8: Final = 0x05
REAL32: Final = 0x08
VISIBLE_STRING: Final = 0x09
UNICODE_STRING: Final = 0x0B
DOMAIN: Final = 0x0F
_SIGNED_BITS: Final = {2: 8, 3: 16, 4: 32, 0x10: 24, 0x12: 40, 0x13: 48, 0x14: 56, 0x15: 64}
_UNSIGNED_BITS: Final = {5: 8, 6: 16, 7: 32, 0x16: 24, 0x18: 40, 0x19: 48, 0x1A: 56, 0x1B: 64}
_INTEGER_BITS: Final = _SIGNED_BITS | _UNSIGNED_BITS
_REAL_BITS: Final = {REAL32: 32, 0x11: 64}
_TYPE_NAMES: Final = {
    "BOOLEAN": BOOLEAN,
    "REAL32": REAL32,
    "VISIBLE_STRING": VISIBLE_STRING,
    "UNICODE_STRING": UNICODE_STRING,
    "DOMAIN": DOMAIN,
    **{f"INTEGER{bits}": kind for kind, bits in _SIGNED_BITS.items()},
    **{f"UNSIGNED{bits}": kind for kind, bits in _UNSIGNED_BITS.items()},
}
_TEXTS: Final = frozenset((VISIBLE_STRING, UNICODE_STRING))
_STANDARD_TYPE_MAX: Final = 0x1B
_VARIABLE: Final = 7
_ARRAY: Final = 8
_FIRST_INDEX: Final = 0x1000
"""Lower indices are data types and dummies."""
_SUB_MAX: Final = 0xFE
_ACCESS: Final = {"r": "ro", "w": "wo", "r/w": "rw"} | {
    name: name for name in ("ro", "wo", "rw", "rwr", "rww", "const")
}
_SWITCH: Final = {"": False, "0": False, "1": True, "false": False, "true": True}
_ALLOWED: Final = {
    "ObjectType": "the number of an object type, 7 for a variable",
    "DataType": "the number of a data type of CiA 301, such as 0x0007",
    "AccessType": "ro, wo, rw, rwr, rww or const",
    "PDOMapping": "0 or 1",
    "LowLimit": "a number, or nothing",
    "HighLimit": "a number, or nothing",
    "DefaultValue": "a value of its data type, or nothing",
    "ParameterValue": "a value of its data type, or nothing",
    "CompactSubObj": f"a number of members, 0 to {_SUB_MAX}",
}

Address = tuple[int, int]
"""Index and sub-index."""
Number = int | float
Value = Number | str | bytes
"""A number, a text, or the bytes of every other type."""


class DataSheetError(ValueError):
    """The file describes no object."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A line that cannot be meant as it is written."""

    section: str
    key: str
    value: str
    allowed: str
    is_harmless: bool = False
    """True for a limit that limits nothing."""

    def __str__(self) -> str:
        """Section, key, value and what is allowed."""
        return f"[{self.section}] {self.key}={self.value}: allowed is {self.allowed}"


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of the object dictionary."""

    index: int
    sub: int
    name: str = ""
    parent: str = ""
    """Name of its array or record; empty for a variable alone."""
    data_type: int | None = None
    """CiA 301 data type; DOMAIN for a maker's own, None where the file has none."""
    access: str | None = None
    """ro, wo, rw, rwr, rww, const; None where the file has none."""
    mappable: bool = False
    low: Number | None = None
    high: Number | None = None
    """Limits; a REAL has real ones."""
    default: Value | None = None
    value: Value | None = None
    """ParameterValue of a DCF."""
    in_array: bool = False
    faults: tuple[Fault, ...] = ()

    @property
    def address(self) -> Address:
        """Index and sub-index."""
        return self.index, self.sub

    @property
    def place(self) -> str:
        """`6065h:00`."""
        return f"{self.index:04X}h:{self.sub:02X}"

    @property
    def qualified_name(self) -> str:
        """Name after that of its array or record."""
        return f"{self.parent}.{self.name}" if self.parent else self.name

    @property
    def bits(self) -> int:
        """Width of a number; 0 for texts and bytes."""
        if self.data_type == BOOLEAN:
            return 1
        return (_INTEGER_BITS | _REAL_BITS).get(self.data_type or 0, 0)

    @property
    def is_integer(self) -> bool:
        """True for a signed or unsigned integer, not for a BOOLEAN."""
        return self.data_type in _INTEGER_BITS

    @property
    def is_real(self) -> bool:
        """True for REAL32 and REAL64."""
        return self.data_type in _REAL_BITS

    @property
    def is_text(self) -> bool:
        """True for VISIBLE_STRING and UNICODE_STRING."""
        return self.data_type in _TEXTS

    @property
    def signed(self) -> bool:
        """True for a signed integer."""
        return self.data_type in _SIGNED_BITS

    @property
    def readable(self) -> bool:
        """True unless the file denies it."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """True if the file says so."""
        return self.access is not None and "w" in self.access

    def fault_in(self, *keys: str) -> Fault | None:
        """The first fault of these keys that leaves their meaning open."""
        found = (one for one in self.faults if one.key in keys and not one.is_harmless)
        return next(found, None)


@dataclass(frozen=True, slots=True)
class DataSheet:
    """The variables of a file, in order of index and sub-index."""

    variables: Mapping[Address, Variable]
    device: Mapping[str, str]
    """`[DeviceInfo]`, by key in lower case."""

    def get(self, index: int, sub: int = 0) -> Variable | None:
        """The variable at an address; None if the file has none."""
        return self.variables.get((index, sub))

    def has(self, index: int) -> bool:
        """True if the file has an object with this index."""
        return any(known == index for known, _ in self.variables)

    def device_number(self, key: str) -> int | None:
        """A number of `[DeviceInfo]`; None if it is absent or unreadable."""
        try:
            return integer(self.device.get(key.lower(), ""), 0)
        except ValueError:
            return None

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults of all objects, each once."""
        every = (fault for variable in self.variables.values() for fault in variable.faults)
        return tuple(dict.fromkeys(every))


def read(path: Path, node_id: int) -> DataSheet:
    """Read an EDS or a DCF.

    Args:
        path: the file.
        node_id: replaces $NODEID.

    Raises:
        OSError: it cannot be opened.
        DataSheetError: it describes no object.
    """
    return parse(text_of(path.read_bytes()), node_id)


def text_of(data: bytes) -> str:
    """Decode a file; CiA 306 requires ASCII, and tools write what they like."""
    if data.isascii():
        return data.decode("ascii")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def parse(text: str, node_id: int) -> DataSheet:
    """Read the text of a file; see `read`."""
    sections = _sections(text)
    variables: dict[Address, Variable] = {}
    members: list[Variable] = []
    for title, section in sections.items():
        if (match := _OBJECT.fullmatch(title)) is None or int(match[1], 16) < _FIRST_INDEX:
            continue
        index, parent = int(match[1], 16), sections.get(match[1])
        if match[2] is not None:
            above = _Section(match[1]) if parent is None else parent
            member = _variable(section, sections, index, int(match[2], 16), node_id)
            in_array = above.number("ObjectType", [], _VARIABLE) == _ARRAY
            members.append(replace(member, parent=above.text("ParameterName"), in_array=in_array))
        elif compact := tuple(_compact(section, sections, index, node_id)):
            variables |= {variable.address: variable for variable in compact}
        elif section.number("ObjectType", [], _VARIABLE) not in (_ARRAY, _ARRAY + 1):
            variables[index, 0] = _variable(section, sections, index, 0, node_id)
    variables |= {variable.address: variable for variable in members}
    if not variables:
        raise DataSheetError("it has no section of an object, such as [1000] or [1018sub1]")
    device = sections.get("deviceinfo", _Section("DeviceInfo"))
    keys = {key: value for key, (_, value) in device.lines.items()}
    return DataSheet(dict(sorted(variables.items())), keys)


def integer(text: str, node_id: int) -> int:
    """A number as makers write it: decimal, 0x1F or 1Fh, with $NODEID or without.

    Raises:
        ValueError: it is none, or its base is doubtful.
    """
    bare = "".join(text.partition(";")[0].split()).lower()
    added = 0
    if (match := _WITH_NODE.fullmatch(bare)) is not None:
        bare, added = match[1] or match[2] or "0", node_id
    if (match := _NUMBER.fullmatch(bare)) is None:
        raise ValueError(text)
    sign, hexadecimal = -1 if match[1] == "-" else 1, match[2] or match[3]
    if hexadecimal:
        return sign * int(hexadecimal, 16) + added
    digits = match[4]
    decimal = int(digits)
    if digits.startswith("0") and not set(digits) & {"8", "9"} and int(digits, 8) != decimal:
        raise ValueError(text)
    return sign * decimal + added


# --- parts of a file ----------------------------------------------------------------------------

_OBJECT: Final = re.compile(r"([0-9a-f]{4})(?:sub([0-9a-f]{1,2}))?")
_INDEX_FIRST: Final = re.compile(r"(?:0x)?([0-9a-f]{4})h?((?:sub|name|value).*)?")
_WITH_NODE: Final = re.compile(r"\$?nodeid(?:\+(.+))?|(.+)\+\$?nodeid")
_NUMBER: Final = re.compile(r"([+-]?)(?:0x([0-9a-f]+)|([0-9a-f]+)h|([0-9]+))u?l{0,2}")
_TEXT_COMMENT: Final = re.compile(r"\s;")
_COMMENT: Final = re.compile(r"\s[;#]")
"""Names and other texts may have a #, as "input # 1"."""
_AFTER_THE_END: Final = "\0\x1a \t\r\n"


class _Section:
    """The lines of one section, by key in lower case, as (key, value)."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.lines: dict[str, tuple[str, str]] = {}
        self.faults: list[Fault] = []

    def add(self, line: str) -> None:
        key, equals, value = (part.strip() for part in line.partition("="))
        comment = _COMMENT if key.lower() in _NO_TEXTS else _TEXT_COMMENT
        value = comment.split(f" {value}", maxsplit=1)[0].strip()
        if not equals:
            self.faults.append(Fault(self.title, key, "", "KEY=VALUE"))
            return
        known, first = self.lines.setdefault(key.lower(), (key, value))
        if first != value:
            allowed = f"one value: it is {first} above"
            self.faults.append(Fault(self.title, _ORDINARY.get(key.lower(), known), value, allowed))

    def text(self, key: str) -> str:
        return self.lines.get(key.lower(), ("", ""))[1]

    def number(self, key: str, faults: list[Fault], missing: int) -> int:
        text = self.text(key)
        try:
            return integer(text, 0) if text else missing
        except ValueError:
            faults.append(self.fault(key))
            return missing

    def fault(self, key: str) -> Fault:
        return Fault(self.title, key, self.text(key), _ALLOWED[key])


_ORDINARY: Final = {key.lower(): key for key in _ALLOWED}
_NO_TEXTS: Final = frozenset(_ORDINARY) - {"defaultvalue", "parametervalue"}


def _sections(text: str) -> dict[str, _Section]:
    """Sections by title as `_title` has it; one that comes twice is one section."""
    sections: dict[str, _Section] = {}
    present = _Section("")
    for raw in text.rstrip(_AFTER_THE_END).splitlines():
        line = raw.strip(_AFTER_THE_END)
        if line.startswith("[") and "]" in line:
            title = line[1:].partition("]")[0].strip()
            present = sections.setdefault(_title(title), _Section(title))
        elif line and not line.startswith((";", "#", "//")):
            present.add(line)
    return sections


def _title(written: str) -> str:
    """In lower case, without blanks, and an index as four digits alone (rule 2)."""
    title = "".join(written.split()).lower()
    match = _INDEX_FIRST.fullmatch(title)
    return title if match is None else match[1] + (match[2] or "")


def _variable(
    section: _Section, sections: Mapping[str, _Section], index: int, sub: int, node_id: int
) -> Variable:
    faults = list(section.faults)
    kind = _data_type(section, sections, faults)
    bare = Variable(index, sub, data_type=kind)
    access = _ACCESS.get(section.text("AccessType").lower())
    if access is None:
        faults.append(section.fault("AccessType"))
    mappable = _SWITCH.get(section.text("PDOMapping").lower())
    if mappable is None:
        mappable = bool(section.number("PDOMapping", faults, 0))
    limits = [_limit(section, key, bare, node_id, faults) for key in ("LowLimit", "HighLimit")]
    low, high = limits
    if low is not None and high is not None and low > high:
        written = section.text("HighLimit")
        allowed = f"a number above LowLimit={section.text('LowLimit')} in {bare.bits} bits"
        text = f"{allowed}: they limit nothing"
        faults.append(Fault(section.title, "HighLimit", written, text, is_harmless=True))
        low = high = None
    return replace(
        bare,
        name=section.text("ParameterName"),
        access=access,
        mappable=mappable,
        low=low,
        high=high,
        default=_value(section, "DefaultValue", bare, node_id, faults),
        value=_value(section, "ParameterValue", bare, node_id, faults),
        faults=tuple(faults),
    )


def _data_type(
    section: _Section, sections: Mapping[str, _Section], faults: list[Fault]
) -> int | None:
    """The data type; CANFestival's editor names a section that has it, such as [A0sub1]."""
    if (named_type := _TYPE_NAMES.get(section.text("DataType").upper())) is not None:
        return named_type
    kind = section.number("DataType", faults, 0)
    if kind > _STANDARD_TYPE_MAX:
        named = sections.get(f"{kind:x}sub1") or sections.get(f"{kind:04x}sub1")
        return DOMAIN if named is None else named.number("DefaultValue", faults, DOMAIN)
    if kind == 0 and section.fault("DataType") not in faults:
        faults.append(section.fault("DataType"))
    return kind or None


def _limit(
    section: _Section, key: str, bare: Variable, node_id: int, faults: list[Fault]
) -> Number | None:
    text = section.text(key)
    if not bare.bits:
        return None
    if bare.is_integer and _is_wide(text, key, bare, node_id):
        allowed = f"a number of {bare.bits} bits: it limits nothing"
        faults.append(Fault(section.title, key, text, allowed, is_harmless=True))
        return None
    value = _value(section, key, bare, node_id, faults)
    return value if isinstance(value, int | float) else None


def _is_wide(text: str, key: str, bare: Variable, node_id: int) -> bool:
    """True for a limit beyond the type; a hexadecimal one may be a bit pattern (rule 3)."""
    try:
        number = integer(text, node_id)
    except ValueError:
        return False
    lowest, highest = _range(bare)
    if not (number > highest if key == "HighLimit" else number < lowest):
        return False
    try:
        _fitted(number, bare)
    except ValueError:
        return True
    return not text.lower().startswith("0x")


def _range(bare: Variable) -> tuple[int, int]:
    lowest = -(1 << bare.bits - 1) if bare.signed else 0
    return lowest, lowest + (1 << bare.bits) - 1


def _value(
    section: _Section, key: str, bare: Variable, node_id: int, faults: list[Fault]
) -> Value | None:
    written = section.lines.get(key.lower())
    if written is None or (not written[1] and not (bare.is_text and key == "ParameterValue")):
        return None
    try:
        return _of_type(written[1], bare, node_id)
    except (ValueError, OverflowError):
        if bare.data_type is not None:
            faults.append(section.fault(key))
        return None


def _of_type(text: str, bare: Variable, node_id: int) -> Value:
    """A written value as the drive holds it (rule 3)."""
    if bare.is_text:
        return text
    text = _COMMENT.split(f" {text}", maxsplit=1)[0].strip()
    if bare.is_real:
        code = "f" if bare.data_type == REAL32 else "d"
        if text.lower().startswith("0x"):
            pattern = int(text, 16).to_bytes(bare.bits // 8, "little")
            return float(struct.unpack(f"<{code}", pattern)[0])
        return float(struct.unpack(f"<{code}", struct.pack(f"<{code}", float(text)))[0])
    if bare.data_type == BOOLEAN and text.lower() in _SWITCH:
        return int(_SWITCH[text.lower()])
    if bare.bits:
        return _fitted(integer(text, node_id), bare)
    digits = text.lower().removeprefix("0x")
    return bytes.fromhex("0" * (len(digits.replace(" ", "")) % 2) + digits)


def _fitted(number: int, bare: Variable) -> int:
    """A number in its type's range, or the one whose bits it has there, or in 32 or 64 bits.

    Raises:
        ValueError: there is none.
    """
    lowest, highest = _range(bare)
    if lowest <= number <= highest:
        return number
    negative_min = -(1 << bare.bits - 1)
    for bits in (bare.bits, 32, 64):
        is_pattern = 1 << bits - 1 <= number < 1 << bits
        signed = number - (1 << bits) if is_pattern else number
        if negative_min <= signed < 0:
            return signed if bare.signed else signed + (1 << bare.bits)
    raise ValueError(number)


def _compact(
    section: _Section, sections: Mapping[str, _Section], index: int, node_id: int
) -> Iterator[Variable]:
    """The members of an array or record by CompactSubObj; none without that key."""
    count = section.number("CompactSubObj", section.faults, 0)
    if not 0 < count <= _SUB_MAX:
        return
    parent = section.text("ParameterName")
    names = sections.get(f"{index:04x}name", _Section(""))
    values = sections.get(f"{index:04x}value", _Section(""))
    in_array = section.number("ObjectType", [], _VARIABLE) == _ARRAY
    top, kind = "Highest sub-index supported", _UNSIGNED8
    yield Variable(index, 0, top, parent, kind, "ro", default=count, in_array=in_array)
    first = replace(
        _variable(section, sections, index, 1, node_id), parent=parent, in_array=in_array
    )
    for sub in range(1, count + 1):
        name, text = names.text(str(sub)) or f"{parent} {sub}", values.text(str(sub))
        value, faults = None, first.faults
        try:
            value = _of_type(text, first, node_id) if text else None
        except (ValueError, OverflowError):
            fault = Fault(values.title, str(sub), text, _ALLOWED["ParameterValue"])
            faults = (*faults, fault)
        yield replace(first, sub=sub, name=name, value=value, faults=faults)


# --- writing ------------------------------------------------------------------------------------


def write_dcf(sheet: DataSheet, node_id: int, file: TextIO) -> None:
    """Write the variables as a DCF, with their values; `read` gives them again.

    Texts must be of one line, without `;`.
    """
    print("[FileInfo]\nEDSVersion=4.0\n\n[DeviceInfo]", file=file)
    for key, value in sheet.device.items():
        print(f"{_DEVICE_KEYS.get(key, key)}={value}", file=file)
    print(f"\n[DeviceComissioning]\nNodeID={node_id}", file=file)
    count: dict[int, int] = {}
    for index, _ in sheet.variables:
        count[index] = count.get(index, 0) + 1
    above: int | None = None
    for variable in sheet.variables.values():
        alone = variable.sub == 0 and count[variable.index] == 1 and not variable.parent
        if not alone and variable.index != above:
            above, kind = variable.index, _ARRAY if variable.in_array else _ARRAY + 1
            print(f"\n[{above:04X}]\nParameterName={variable.parent}", file=file)
            print(f"ObjectType=0x{kind:X}\nSubNumber={count[above]}", file=file)
        place = f"{variable.index:04X}" + ("" if alone else f"sub{variable.sub:X}")
        print(f"\n[{place}]\nParameterName={variable.name}\nObjectType=0x7", file=file)
        for key, value in _lines(variable):
            print(f"{key}={value.hex() if isinstance(value, bytes) else value}", file=file)


_DEVICE_KEYS: Final = {
    key.lower(): key
    for key in (
        "VendorName", "VendorNumber", "ProductName", "ProductNumber", "RevisionNumber",
        "OrderCode", "NrOfRXPDO", "NrOfTXPDO", "LSS_Supported",
    )
}  # fmt: skip
"""Their usual spelling: other readers distinguish upper from lower case."""


def _lines(variable: Variable) -> Iterator[tuple[str, object]]:
    kind = variable.data_type
    for key, value in (
        ("DataType", None if kind is None else f"0x{kind:04X}"),
        ("AccessType", variable.access),
        ("PDOMapping", int(variable.mappable)),
        ("LowLimit", variable.low),
        ("HighLimit", variable.high),
        ("DefaultValue", variable.default),
        ("ParameterValue", variable.value),
    ):
        if value is not None:
            yield key, value
