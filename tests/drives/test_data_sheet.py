"""Data sheets as makers write them: the EDS of the virtual EPOS4 with one place changed.

Each row is accepted like the original, or its one fault is named with section, key, value and what
is allowed: an objection of `gaitd check` where bring-up needs the object, a note elsewhere.
"""

import io
import struct
from dataclasses import replace

import pytest
from drive_files import CYCLE, FOLDER, HIP_LIMITS, drive

from drives.bringup.plan import plan
from drives.canopen.data_sheet import DataSheet, Variable, parse, text_of, write_dcf
from drives.service import eds
from drives.service.dump import decoded, defaults
from sim_drives.canopen.dictionary import read_eds

NODE = 5
ORIGINAL = (FOLDER / "epos4.eds").read_bytes()
PLAN = plan(drive("hip_epos4"), HIP_LIMITS, CYCLE)
HEAD = b"[FileInfo]\n"
COMMENTS = b"[Comments]\nLines=2\nLine1=first\nline2=second\n"

SAME = [
    ("lower-case line", HEAD, COMMENTS + HEAD),
    ("too few comments", HEAD, b"[Comments]\nLines=9\n" + HEAD),
    ("lines of comments in words", HEAD, b"[Comments]\nLines=many\n" + HEAD),
    ("a comment of several lines", HEAD, b"[Comments]\nLines=1\nLine1=a\n and more\n" + HEAD),
    ("leading zeros", b"VendorNumber=0x000000FB", b"VendorNumber=001"),
    ("no vendor number", b"VendorNumber=0x000000FB", b"VendorNumber="),
    ("vendor number in words", b"VendorNumber=0x000000FB", b"VendorNumber=maxon"),
    ("a rate in words", b"BaudRate_125=1", b"BaudRate_125=yes"),
    ("dummies of six", HEAD, b"[DummyUsage]\nDummy0001=0\nDummy0006=1\n" + HEAD),
    ("a dummy in words", HEAD, b"[DummyUsage]\nDummy0001=\n" + HEAD),
    ("mapping empty", b"0x00020192\nPDOMapping=0", b"0x00020192\nPDOMapping="),
    ("mapping absent", b"0x00020192\nPDOMapping=0\n", b"0x00020192\n"),
    ("mapping in other letters", b"PDOMapping=", b"PdoMapping="),
    ("keys in lower case", b"DataType=", b"datatype="),
    ("blanks around", b"AccessType=ro", b"AccessType = RO "),
    ("access in upper case", b"AccessType=rw", b"AccessType=RW"),
    ("members in capitals", b"[1018sub1]", b"[1018SUB1]"),
    ("members in mixed letters", b"[1018sub", b"[1018Sub"),
    ("member with a leading zero", b"[1018sub1]", b"[1018sub01]"),
    ("index in lower case", b"[30B0]", b"[30b0]"),
    ("no list of objects", b"[OptionalObjects]", b"[OptionalObject]"),
    ("no record above its members", b"[1018]\n", b"[OfAnother]\n"),
    ("no object type", b"ObjectType=0x7\nDataType=0x0007", b"DataType=0x0007"),
    ("a comment behind", b"DataType=0x0002", b"DataType=0x0002 ; INTEGER8"),
    ("a comment close behind", b"DataType=0x0002", b"DataType=0x0002;INTEGER8"),
    ("a comment of another kind", b"DataType=0x0002", b"DataType=0x0002 # INTEGER8"),
    ("a suffix of C", b"DataType=0x0002", b"DataType=0x0002UL"),
    ("0x before an index", b"[6060]", b"[0x6060]"),
    ("h behind an index", b"[6060]", b"[6060h]"),
    ("a blank in a title", b"[1018sub1]", b"[1018 sub 1]"),
    ("a data type by its name", b"DataType=0x0002", b"DataType=Integer8"),
    ("h behind", b"DataType=0x0002", b"DataType=02h"),
    ("GBK", b"ParameterName=Controlword", "ParameterName=控制字".encode("gbk")),
    ("Shift-JIS", b"ParameterName=Controlword", "ParameterName=制御語".encode("shift-jis")),
    ("a code page", b"ParameterName=Controlword", b"ParameterName=Temperatur \xb0C"),
    ("no name", b"ParameterName=Controlword\n", b""),
    ("a name with a colon", b"ParameterName=Controlword", b"ParameterName: Controlword"),
    ("a line twice", b"[6060]\n", b"[6060]\nDataType=0x0002\n"),
    ("a section twice", b"[6060]\n", b"[6060]\nPDOMapping=1\n[6060]\n"),
    ("limits of the whole type", b"[6060]\n", b"[6060]\nLowLimit=\nHighLimit=\n"),
    ("NODEID without $", b"$NODEID+", b"NodeID + "),
    ("a section of a tool", HEAD, b"[Tool: 5.1]\nwhatever\n" + HEAD),
    ("a text before all", HEAD, b"made by hand\n" + HEAD),
    ("Windows' line ends", b"\n", b"\r\n"),
]
"""What differs, bytes in the file, bytes instead of them."""


def changed(old, new):
    assert old in ORIGINAL
    return ORIGINAL.replace(old, new)


def without_names(sheet):
    return {
        address: replace(variable, name="", parent="", in_array=False, faults=())
        for address, variable in sheet.variables.items()
    }


def read(data):
    return parse(text_of(data), NODE)


WHOLE = without_names(read(ORIGINAL))


@pytest.mark.parametrize(("old", "new"), [row[1:] for row in SAME], ids=[row[0] for row in SAME])
def test_what_does_not_change_an_object_is_read_like_the_original(old, new):
    sheet = read(changed(old, new))

    assert without_names(sheet) == WHOLE
    assert eds.objections(PLAN, sheet) == []


@pytest.mark.parametrize("end", [b"\x1a", b"\0\0\0", b"\r\n\x1a\0"])
def test_what_ends_a_file_in_old_editors_is_no_part_of_it(end):
    assert without_names(read(ORIGINAL + end)) == WHOLE


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_understood(encoding):
    assert without_names(read(ORIGINAL.decode().encode(encoding))) == WHOLE


USED = [
    ("6060", "DataType", ""),
    ("6060", "DataType", "VAR"),
    ("6085", "DataType", "0x07 0x08"),
    ("6085", "LowLimit", "low"),
    ("6085", "HighLimit", "010"),
    ("605A", "HighLimit", "-0x12345"),
    ("6085", "AccessType", "any"),
    ("6041", "PDOMapping", "perhaps"),
    ("1018sub1", "DefaultValue", "maxon"),
]


@pytest.mark.parametrize(("section", "key", "value"), USED)
def test_a_line_that_bring_up_needs_is_an_objection_that_names_it(section, key, value):
    head, mark, tail = ORIGINAL.decode().partition(f"[{section}]\n")
    body, end, rest = tail.partition("\n\n")
    lines = [line for line in body.splitlines() if not line.startswith(f"{key}=")]
    text = head + mark + "\n".join([*lines, f"{key}={value}"]) + end + rest

    sheet = parse(text, NODE)
    found = eds.objections(PLAN, sheet)

    assert [line for line in found if f"[{section}] {key}={value}: allowed is " in line]
    assert [(one.section, one.key) for one in sheet.faults] == [(section, key)]
    assert eds.doubtful(sheet, found) is None


UNUSED = [
    (b"AccessType=", "AccessType", ""),
    (b"AccessType=perhaps", "AccessType", "perhaps"),
    (b"AccessType=ro\nDataType=", "DataType", ""),
    (b"AccessType=ro\nDataType=UNSIGNED12", "DataType", "UNSIGNED12"),
    (b"AccessType=ro\nDataType=6\nDefaultValue=n/a", "DefaultValue", "n/a"),
    (b"AccessType=ro\nDataType=6\nPDOMapping=2;\nPDOMapping=1", "PDOMapping", "1"),
    (b"AccessType=ro\nDataType=6\nLowLimit=9\nHighLimit=3", "HighLimit", "3"),
    (b"AccessType=ro\nDataType=6\nCompactSubObj=many", "CompactSubObj", "many"),
    (b"AccessType=ro\nDataType=6\nhere nothing is said", "here nothing is said", ""),
]


@pytest.mark.parametrize(("lines", "key", "value"), UNUSED)
def test_a_line_that_is_not_needed_is_named_and_refuses_nothing(lines, key, value, tmp_path):
    path = tmp_path / "maker.eds"
    types = b"" if b"DataType" in lines else b"DataType=6\n"
    path.write_bytes(ORIGINAL + b"\n[2FFF]\nParameterName=of the maker\n" + types + lines + b"\n")

    sheet = eds.load_eds(str(path), NODE)

    assert eds.objections(PLAN, sheet) == []
    assert f"[2FFF] {key}={value}: allowed is " in eds.doubtful(sheet, [])
    assert {entry.address for entry in read_eds(path, NODE)} == {*WHOLE, (0x2FFF, 0)}


LIMITS = [
    (0x02, "0x80", "0x7F", (-128, 127), 0),
    (0x02, "0x00", "0xFF", (None, None), 1),
    (0x02, "0xFFFFFF80", "0x7F", (-128, 127), 0),
    (0x04, "0x80000000", "0x7FFFFFFF", (-(2**31), 2**31 - 1), 0),
    (0x06, "9", "3", (None, None), 1),
    (0x07, "0", "-1", (0, 2**32 - 1), 0),
    (0x05, "0", "0xFFF", (0, None), 1),
    (0x06, "0", "65536", (0, None), 1),
    (0x03, "-40000", "40000", (None, None), 2),
    (0x07, "-5", "5", (None, 5), 1),
    (0x08, "-1.5", "1.5", (-1.5, 1.5), 0),
    (0x09, "0", "12", (None, None), 0),
]


@pytest.mark.parametrize(("kind", "low", "high", "meant", "fault_count"), LIMITS)
def test_limits_are_those_of_the_data_type_or_none(kind, low, high, meant, fault_count):
    sheet = of(f"DataType={kind}", f"LowLimit={low}", f"HighLimit={high}")

    assert (sheet.get(0x2000).low, sheet.get(0x2000).high) == meant
    assert len(sheet.faults) == fault_count


def of(*lines):
    return parse("\n".join(["[2000]", "ParameterName=x", "AccessType=rw", *lines]), NODE)


@pytest.mark.parametrize(
    ("kind", "written", "held"),
    [
        (0x03, "0xFFFF", struct.pack("<h", -1)),
        (0x03, "65534", struct.pack("<h", -2)),
        (0x04, "-7", struct.pack("<i", -7)),
        (0x07, "-1", struct.pack("<I", 2**32 - 1)),
        (0x10, "0xFFFFFF", b"\xff\xff\xff"),
        (0x08, "12.345", struct.pack("<f", 12.345)),
        (0x08, "0x3F800000", struct.pack("<f", 1.0)),
        (0x11, "1e-3", struct.pack("<d", 1e-3)),
        (0x01, "TRUE", b"\1"),
        (0x0A, "01FE", b"\x01\xfe"),
        (0x09, "input # 1", b"input # 1"),
        (0x11, "1.5 # V", struct.pack("<d", 1.5)),
        (0x0F, "0x0", b"\0"),
    ],
)
def test_a_default_is_compared_as_the_drive_holds_it(kind, written, held):
    sheet = of(f"DataType={kind}", f"DefaultValue={written}")

    assert defaults(sheet) == {(0x2000, 0): decoded(sheet.get(0x2000), held)}


@pytest.mark.parametrize("object_type", [8, 9])
def test_compact_arrays_and_records_have_all_members(object_type):
    text = f"""[2000]
ParameterName=x
ObjectType={object_type}
DataType=7
AccessType=rw
CompactSubObj=9
DefaultValue=1
[2000Name]
NrOfEntries=1
3=third
[2000Value]
NrOfEntries=2
2=0x22
4=no
[2000SUB7]
ParameterName=seventh
DataType=6
AccessType=ro
"""
    sheet = parse(text, NODE)

    assert [sub for _, sub in sheet.variables] == [*range(10)]
    assert (sheet.get(0x2000).default, sheet.get(0x2000).access) == (9, "ro")
    assert [sheet.get(0x2000, sub).name for sub in (3, 4, 7)] == ["third", "x 4", "seventh"]
    assert [sheet.get(0x2000, sub).value for sub in (2, 3)] == [0x22, None]
    assert sheet.get(0x2000, 7).bits == 16
    assert [str(one) for one in sheet.faults] == [
        "[2000Value] 4=no: allowed is a value of its data type, or nothing"
    ]


def test_what_is_written_is_read_again():
    kinds = {
        2: -5,
        7: 2**32 - 1,
        8: 0.25,
        9: "Antrieb, °C",
        0xA: b"\x01\xfe",
        0x11: -1e-9,
        0x15: -9,
    }
    many = [
        Variable(
            index, sub, f"n{kind}", "list" * array, kind, "rw", True, default=value, value=value
        )
        for index, array in ((0x2000, 1), (0x2001, 0))
        for sub, (kind, value) in enumerate(kinds.items())
    ]
    bare = [Variable(0x2002, 0), Variable(0x2003, 0, "x", data_type=2, low=-9, high=9)]
    variables = {one.address: one for one in (*many, *bare)}
    file = io.StringIO()

    write_dcf(DataSheet(variables, {"vendorname": "M\u00fcller"}), NODE, file)

    again = parse(file.getvalue(), NODE)
    assert {
        address: replace(one, faults=()) for address, one in again.variables.items()
    } == variables
    assert again.device == {"vendorname": "M\u00fcller"}
