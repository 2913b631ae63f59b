"""EDS and DCF files: of others by our reader, and ours by others.

Master and virtual drives share the reader (`drives.canopen.data_sheet`): python-canopen, and facts
looked up by hand, say whether it is right. The files in `eds/` are not ours (`eds/LICENSES.md`).
"""

import configparser
import contextlib
import math
import re
import struct
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from drive_files import FOLDER as DRIVES
from durand import MinimalNode
from durand.eds import EDS
from durand.network import NetworkABC
from hypothesis import given, settings
from hypothesis import strategies as st

from drives.errors import DescriptionError
from drives.service.eds import load_eds
from sim_drives.canopen.dictionary import read_eds

FOLDER = Path(__file__).parent / "eds"
THEIRS = sorted(path for path in FOLDER.iterdir() if path.suffix != ".md")
OURS = sorted(DRIVES.glob("*.eds"))
NODE = 5


def both(path):
    """Master's and virtual drives' view of a file: variables by address."""
    entries = {entry.address: entry for entry in read_eds(Path(path), NODE)}
    return load_eds(str(path), NODE), entries


def of_canopen(path):
    """python-canopen's view of a file."""
    read = canopen.import_od(str(path), NODE)
    objects = [one for index, one in read.indices.items() if index >= 0x1000]
    parts = [[one] if isinstance(one, ODVariable) else one.subindices.values() for one in objects]
    every = [one for part in parts for one in part]
    # canopen's own sub-index 0 of a compact array can be written
    return {(one.index, one.subindex): one for one in every if one.name != "Number of entries"}


@pytest.mark.parametrize("path", [*THEIRS, *OURS], ids=lambda path: path.name)
def test_a_file_that_canopen_can_read_says_the_same_to_us(path):
    theirs = of_canopen(path)
    sheet = load_eds(str(path), NODE)

    for address, one in theirs.items():
        ours = sheet.get(*address)
        assert ours.data_type == one.data_type, address
        assert ours.bits in {len(one), 0, 1}, address
        assert (ours.readable, ours.writable) == (one.readable, one.writable), address
        assert ours.mappable == one.pdo_mappable, address
        if ours.is_integer and ours.bits in {8, 16, 32, 64}:  # canopen drops those of the others
            assert (ours.low, ours.high) == (one.min, one.max), address
        assert ours.qualified_name.startswith(one.qualname), address
        for mine, other in ((ours.default, one.default), (ours.value, one.value)):
            assert same_value(mine, other, ours.bits), (address, mine, other)
    compact = {address for address in sheet.variables if address not in theirs}
    assert all(sheet.get(index, 1) for index, _ in compact)


def same_value(mine, other, bits):
    """Equal, or the same bits, or empty; a REAL32 is rounded to what the drive holds."""
    if isinstance(mine, int) and other is not None:
        return (mine - other) % (1 << bits) == 0
    if isinstance(mine, float):
        return math.isclose(mine, other, rel_tol=1e-6)
    return (mine or None) == (other or None) or (bits == 0 and other is None)  # a DOMAIN's 0x0


@pytest.mark.parametrize("path", [*THEIRS, *OURS], ids=lambda path: path.name)
def test_every_object_of_a_file_is_known(path):
    dictionary, entries = both(path)

    sections = re.findall(r"(?m)^\[([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]+))?\]", text_of(path))
    whole = {index for index, sub in sections if sub}
    addresses = {(int(i, 16), int(s or "0", 16)) for i, s in sections if s or i not in whole}
    addresses = {a for a in addresses if a[0] >= 0x1000 and (a in entries or not bare(path, a))}
    assert addresses
    for address in addresses:
        assert address in entries, address
        assert dictionary.get(*address) is not None, address


@pytest.mark.parametrize("path", [*THEIRS, *OURS], ids=lambda path: path.name)
def test_every_default_can_be_sent(path):
    for entry in read_eds(path, NODE):
        assert isinstance(entry.encode(entry.default), bytes), entry.address


def text_of(path):
    return path.read_text(encoding="utf-8").replace("\r", "")


def bare(path, address):
    """Whether an entry is an array or record whose members are nowhere described."""
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";",))
    parser.read_string(text_of(path))
    for section in parser.sections():
        if section.upper() == f"{address[0]:04X}":
            kind = int(parser.get(section, "ObjectType", fallback="7"), 0)
            return kind in (8, 9) and not parser.has_option(section, "CompactSubObj")
    return False


# file, index, sub-index, bits, writable, default, low, high: read with the eye
SPOTS = [
    ("cia402_slave.eds", 0x1018, 1, 32, False, 0x555, None, None),
    ("cia402_slave.eds", 0x1400, 1, 32, True, 0x8000_0205, None, None),
    ("cia402_slave.eds", 0x1A00, 1, 32, True, 0x6041_0010, None, None),
    ("cia402_slave.eds", 0x605A, 0, 16, True, 2, None, None),
    ("cia402_slave.eds", 0x6067, 0, 32, True, 0xFFFF_FFFF, None, None),
    ("cia402_slave.eds", 0x60C2, 2, 8, True, -2, None, None),
    ("cia402_slave.eds", 0x6502, 0, 32, False, 0xA5, None, None),
    ("prbt_0_1.dcf", 0x1800, 1, 32, True, 0x185, None, None),
    ("prbt_0_1.dcf", 0x60C2, 1, 8, True, 8, None, None),
    ("prbt_0_1.dcf", 0x60C2, 2, 8, True, -3, None, None),
    ("prbt_0_1.dcf", 0x6081, 0, 32, True, 0x2710, None, None),
    ("prbt_0_1.dcf", 0x6502, 0, 32, False, 0x43, None, None),
    ("demoDevice.eds", 0x1014, 0, 32, True, 0x85, None, None),
    ("demoDevice.eds", 0x1200, 2, 32, False, 0x585, None, None),
    ("demoDevice.eds", 0x1802, 1, 32, True, 0xC000_0385, None, None),
    ("sample.eds", 0x1400, 1, 32, True, 0x205, None, None),
    ("sample.eds", 0x1403, 1, 32, True, 0x505, None, None),
    ("sample.eds", 0x3020, 0, 8, True, 0, 0, 127),
    ("sample.eds", 0x3021, 0, 8, True, 0, 2, 10),
    ("sample.eds", 0x3030, 0, 32, True, 0, -(2**31), -1),
    ("sample.eds", 0x3040, 0, 64, True, 0, -10, 10),
]


@pytest.mark.parametrize(
    ("name", "index", "sub", "bits", "writable", "default", "low", "high"), SPOTS
)
def test_objects_looked_up_by_hand_are_as_the_file_says(
    name, index, sub, bits, writable, default, low, high
):
    dictionary, entries = both(FOLDER / name)
    variable, entry = dictionary.get(index, sub), entries[index, sub]

    assert (variable.bits, 8 * entry.size_bytes) == (bits, bits)
    assert (variable.writable, entry.writable) == (writable, writable)
    assert (variable.default or 0, entry.default) == (default, default)
    assert (variable.low, variable.high) == (low, high)
    assert (entry.low, entry.high) == (low, high)


def test_what_may_be_mapped_is_as_the_file_says():
    entries = {entry.address: entry for entry in read_eds(FOLDER / "cia402_slave.eds", NODE)}

    assert entries[0x6040, 0].mappable_in  # AccessType=rww
    assert entries[0x6041, 0].mappable_out and not entries[0x6041, 0].mappable_in
    assert not entries[0x6502, 0].mappable_out


def test_a_dcf_s_values_are_beside_its_defaults():
    prbt = load_eds(str(FOLDER / "prbt_0_1.dcf"), NODE)

    assert prbt.get(0x60C2, 1).value == 10
    assert prbt.get(0x60C2, 1).default == 8
    assert prbt.get(0x1800, 1).value == 0x185


def test_texts_and_reals_keep_their_bytes():
    entries = {entry.address: entry for entry in read_eds(FOLDER / "demoDevice.eds", NODE)}

    assert "like '€', tabs".encode() in entries[0x2121, 2].default
    assert entries[0x2120, 3].default == struct.pack("<f", 12.345)
    assert entries[0x2120, 4].default == struct.pack("<d", 456.789)


# --- traps, each in a small file of our own ---------------------------------------------------

HEAD = "[DeviceInfo]\nVendorName=%s\n\n"


def small(folder, objects, *, vendor="ours", encoding="utf-8", newline="\n"):
    path = folder / "small.eds"
    text = HEAD % vendor + "\n".join(objects) + "\n"
    path.write_bytes(text.replace("\n", newline).encode(encoding))
    return path


def var(section, kind, *lines):
    head = f"[{section}]\nParameterName=x\nObjectType=0x7\nDataType={kind:#06x}\nAccessType=rw"
    return "\n".join([head, *lines, ""])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "ascii"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_file_is_read_in_whatever_code_page_and_line_ends_it_was_written(
    tmp_path, encoding, newline
):
    vendor = "Antriebe" if encoding == "ascii" else "“Motoren” Müller"
    path = small(tmp_path, [var("2000", 7)], vendor=vendor, encoding=encoding, newline=newline)

    dictionary, entries = both(path)

    assert dictionary.device["vendorname"] == vendor
    assert (0x2000, 0) in entries


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("$NODEID+0x180", 0x185),
        ("0x180+$NODEID", 0x185),
        ("$NODEID+384", 0x185),
        ("$NodeID + 0x40000180", 0x4000_0185),
        ("0x80000201", 0x8000_0201),
    ],
)
def test_a_formula_with_the_node_id_is_worked_out(tmp_path, written, meant):
    dictionary, entries = both(small(tmp_path, [var("1800", 7, f"DefaultValue={written}")]))

    assert dictionary.get(0x1800, 0).default == meant
    assert entries[0x1800, 0].default == meant


@pytest.mark.parametrize(
    ("kind", "low", "high", "meant"),
    [
        (0x02, "0x80", "0x7F", (-128, 127)),
        (0x03, "0x8000", "0x7FFF", (-32768, 32767)),
        (0x04, "0x80000000", "0xFFFFFFFF", (-(2**31), -1)),
        (0x04, "-5", "5", (-5, 5)),
        (0x06, "0", "0xFFFF", (0, 65535)),
        (0x06, "", "", (None, None)),
    ],
)
def test_limits_of_signed_numbers_are_signed_however_they_are_written(
    tmp_path, kind, low, high, meant
):
    path = small(tmp_path, [var("2000", kind, f"LowLimit={low}", f"HighLimit={high}")])

    dictionary, entries = both(path)

    variable, entry = dictionary.get(0x2000, 0), entries[0x2000, 0]
    assert (variable.low, variable.high) == (entry.low, entry.high) == meant


@pytest.mark.parametrize(
    ("kind", "written", "sent"),
    [
        (0x02, "0xFD", "fd"),
        (0x02, "-3", "fd"),
        (0x04, "0x80000000", "00000080"),
        (0x06, "", "0000"),
        (0x05, "0xFF", "ff"),
        (0x09, "abc", "616263"),
        (0x0A, "DEAD01", "dead01"),
        (0x0B, "aé", "6100e900"),
        (0x08, "1.5", "0000c03f"),
        (0x16, "0x123456", "563412"),
    ],
)
def test_a_default_is_sent_in_the_object_s_own_bytes(tmp_path, kind, written, sent):
    _, entries = both(small(tmp_path, [var("2000", kind, f"DefaultValue={written}")]))

    assert entries[0x2000, 0].encode(entries[0x2000, 0].default).hex() == sent


def test_an_array_by_compact_sub_objects_has_all_of_its_members(tmp_path):
    head = "[1016]\nParameterName=x\nObjectType=0x8\nDataType=0x0007\nAccessType=rw\n"
    path = small(tmp_path, [head + "DefaultValue=7\nCompactSubObj=3\n"])

    dictionary, entries = both(path)

    assert [address for address in entries if address[0] == 0x1016] == [
        (0x1016, n) for n in range(4)
    ]
    assert [entries[0x1016, n].default for n in range(4)] == [3, 7, 7, 7]
    assert all(dictionary.get(0x1016, sub).bits == 32 for sub in (1, 2, 3))


@pytest.mark.parametrize("text", ["", "no section\n", "[DeviceInfo]\nNrOfRXPDO=4\n", "\x00\x01"])
def test_what_describes_no_object_is_refused_by_name(tmp_path, text):
    path = tmp_path / "broken.eds"
    path.write_text(text, encoding="utf-8")

    with pytest.raises(DescriptionError, match=r"broken\.eds.*no section of an object"):
        load_eds(str(path), NODE)
    with pytest.raises(ValueError, match="no section of an object"):
        read_eds(path, NODE)


CIA402 = text_of(FOLDER / "cia402_slave.eds").splitlines()


@settings(max_examples=60)
@given(st.data())
def test_a_damaged_file_never_breaks_the_reader(tmp_path_factory, data):
    start = data.draw(st.integers(0, len(CIA402) - 40))
    lines = CIA402[start : start + 40]
    for _ in range(data.draw(st.integers(1, 4))):
        number = data.draw(st.integers(0, len(lines) - 1))
        cut = data.draw(st.integers(0, 12))
        lines[number] = data.draw(st.sampled_from(["", lines[number][:cut], "=", "[", lines[0]]))
    path = tmp_path_factory.mktemp("eds") / "damaged.eds"
    path.write_text("\n".join(lines), encoding="utf-8")

    with contextlib.suppress(DescriptionError, ValueError):
        load_eds(str(path), NODE)
        for entry in read_eds(path, NODE):
            entry.encode(entry.default)


# --- ours, by others --------------------------------------------------------------------------


@pytest.mark.parametrize("path", OURS, ids=lambda path: path.name)
def test_canopen_s_copy_of_our_eds_says_what_ours_says(path, tmp_path):
    # Read, written out by canopen, read again: what its exporter understood of our file.
    ours = canopen.import_od(str(path), NODE)
    copy = str(tmp_path / "copy.eds")
    canopen.export_od(ours, copy)

    again = {entry.address: entry for entry in read_eds(Path(copy), NODE)}

    for entry in read_eds(path, NODE):
        found = again[entry.address]
        assert found.default == entry.default, entry.address
        assert (found.low, found.high) == (entry.low, entry.high), entry.address
        assert (found.mappable_in, found.mappable_out) == (entry.mappable_in, entry.mappable_out)


@pytest.mark.parametrize("path", OURS, ids=lambda path: path.name)
def test_our_eds_lists_what_it_describes_and_counts_it(path):
    # CiA 306: three lists with SupportedObjects, and SubNumber members of each array and record.
    parser = configparser.RawConfigParser()
    parser.read_string(text_of(path))
    listed = []
    for name in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        rows = [parser[name][str(n)] for n in range(1, parser.getint(name, "SupportedObjects") + 1)]
        assert len(parser[name]) == len(rows) + 1, name
        listed += [int(row, 0) for row in rows]

    described = [section for section in parser.sections() if re.fullmatch("[0-9A-F]{4}", section)]
    assert sorted(listed) == sorted(int(section, 16) for section in described)
    for section in described:
        members = [name for name in parser.sections() if name.startswith(f"{section}sub")]
        assert len(members) == int(parser.get(section, "SubNumber", fallback="0"), 0), section
        assert all(parser.has_option(name, "DataType") for name in members or [section])


class Nowhere(NetworkABC):
    """A network on which durand's node hears nothing."""

    def add_subscription(self, cob_id, callback):
        pass

    def remove_subscription(self, cob_id):
        pass

    def send(self, cob_id, msg):
        pass


def test_the_eds_that_durand_writes_of_its_node_is_read(tmp_path):
    path = tmp_path / "durand.eds"
    path.write_text(EDS(MinimalNode(Nowhere(), NODE)).content, encoding="utf-8")

    dictionary, entries = both(path)

    for address in ((0x1000, 0), (0x1001, 0), (0x1018, 4), (0x1200, 1), (0x1400, 1), (0x1A00, 8)):
        assert address in entries
        assert dictionary.get(*address) is not None
    assert dictionary.get(0x1018, 1).bits == 32
