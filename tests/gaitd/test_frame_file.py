"""Recordings of other programs: all rows, or a note of what was left out, or a refusal in one line.

`public_cases/` was written for this project after public bug reports of python-can, cantools and
canopen; the other rows are of the same classes.
"""

import json
import struct
from pathlib import Path

import can
import pytest
from command_line import gaitd
from sessions import CONFIGS

from daemon.preflight.load import load
from drives.service.bus_recording import RecordedBusError, read_bus
from gaitd.frame_file import FrameFile

TRAINER = CONFIGS / "demo.toml"
LEG = load(TRAINER).legs[0]
CASES = Path(__file__).parent / "public_cases"
BASE = (CASES / "candump_bus_error_frame.log").read_text().splitlines(keepends=True)
PLAIN = "".join(line for line in BASE if " 20000088#" not in line)
ASC = (CASES / "umlaut.asc").read_bytes()
TRC = ";$FILEVERSION={}\n;$STARTTIME=45000.5\n;$COLUMNS=N,O,T,I,d,l,D\n{}"


def imported(path):
    """Count of rows, and the notes."""
    frames = FrameFile(path)
    found = read_bus(frames, LEG.hip, LEG.slide)
    return len(found.rows), [*frames.notes, *found.notes]


def trc(version):
    rows = []
    for number, line in enumerate(PLAIN.splitlines(), 1):
        stamp, _, frame = line.split()
        can_id, _, data = frame.partition("#")
        offset_ms = 1e3 * (float(stamp[1:-1]) - 1.7e9)
        spaced = " ".join(data[n : n + 2] for n in range(0, len(data), 2))
        rows.append(f"{number} {offset_ms:.3f} DT {can_id:>04} Rx {len(data) // 2} {spaced}\n")
    return TRC.format(version, "".join(rows))


def asc(**changes):
    return ASC.decode("cp1252").replace("\r", "").replace(*changes["replace"])


def relative_asc():
    """Each time is that since the event before."""
    lines, before_s = [], 0.0
    for line in asc(replace=("absolute", "relative")).splitlines():
        stamp, _, rest = line.strip().partition(" ")
        if stamp.replace(".", "").isdigit():
            now_s = float(stamp)
            stamp, before_s = f"{now_s - before_s:.6f}", now_s
        lines.append(f"{stamp} {rest}")
    return "\n".join(lines) + "\n"


def decimal_asc():
    lines = []
    for line in asc(replace=("base hex", "base dec")).splitlines():
        words = line.split()
        if "Rx" in words:
            words[2] = str(int(words[2], 16))
            words[6:] = [str(int(word, 16)) for word in words[6:]]
        lines.append(" ".join(words))
    return "\n".join(lines) + "\n"


def swapped(text, by_us):
    """The 9th and 10th line in the other order, with times that are `by_us` apart."""
    lines = text.splitlines(keepends=True)
    early, late = lines[8], lines[9]
    stamp = f"({float(early[1:18]) + by_us * 1e-6:.6f})"
    lines[8:10] = [stamp + late[19:], early]
    return "".join(lines)


FILES = {
    "plain.log": (PLAIN, []),
    "spaces.log": (PLAIN.replace(" can0 ", "  can0  ") + "\n", []),
    "received.log": (PLAIN.replace("\n", " R\n"), []),
    "torn_line.log": (PLAIN + "(1700000000.400000) can0 18", ["1 last line without its end"]),
    "torn_data.log": (PLAIN + "(1700000000.400000) can0 185#37", ["1 last line without its end"]),
    "swapped.log": (swapped(PLAIN, 4), ["1 frames stood out of order"]),
    "remote.log": (PLAIN + "(1700000000.400000) can0 705#R\n", ["1 extended, remote or CAN FD"]),
    "extended.log": (PLAIN + "(1700000000.4) can0 18FF0005#00\n", ["1 extended, remote or CAN FD"]),
    "fd.log": (PLAIN + "(1700000000.4) can0 185##100\n", ["1 extended, remote or CAN FD"]),
    "two_errors.log": (PLAIN + 2 * "(1700000000.4) can1 20000004#0008\n", ["2 error frames"]),
    "relative.asc": (relative_asc(), []),
    "decimal.asc": (decimal_asc(), []),
    "bus_master.asc": ("***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n" + decimal_asc(), []),
    "error.asc": (
        asc(replace=("End Trigger", "   0.400000 1  ErrorFrame\nEnd Trigger")),
        ["1 error frames"],
    ),
    "statistic.asc": (
        asc(replace=("End Trigger", "   0.400000 1  Statistic: D 1 R 0 XD 0\nEnd Trigger")),
        ["1 lines with a time that are no frames"],
    ),
    "long.asc": (asc(replace=("0A\n", "0A  Length = 2 BitCount = 4 ID = 389\n")), []),
    "torn.asc": (asc(replace=("End TriggerBlock\n", "   0.400000 1  18")), ["1 last line without"]),
    "extended.asc": (
        asc(replace=("End Trigger", "   0.400000 1  18FF00x  Rx d 1 00\nEnd Trigger")),
        ["1 extended, remote or CAN FD"],
    ),
    "plain.trc": (trc("2.0"), []),
    "torn.trc": (trc("2.0") + "9999 400.0 DT 0185 Rx 7 37", ["1 last line without its end"]),
    "error.trc": (trc("2.0") + "9999 400.0 ER - Rx 5 04\n", ["1 lines with a time that are no"]),
}
CASES_READ = {
    "candump_bus_error_frame.log": ["1 error frames of the bus"],
    "pdo_switched_off_at_the_end.log": [],
    "default_pdo_after_a_reset.log": ["node 5 left out after its boot-up at 1700000001.391600 s"],
    "pretrigger.asc": [],
    "umlaut.asc": [],
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    for name, (text, _) in FILES.items():
        (folder / name).write_text(text, encoding="utf-8", newline="")
    return folder


@pytest.mark.parametrize("name", [*FILES, *CASES_READ])
def test_all_forty_rows_come_out_and_what_was_left_out_is_told(name, files):
    path = CASES / name if name in CASES_READ else files / name
    told = CASES_READ[name] if name in CASES_READ else FILES[name][1]

    rows, notes = imported(path)

    assert rows == 40
    assert len(notes) == len(told), notes
    assert all(part in note for part, note in zip(told, notes, strict=True)), notes


def test_the_command_tells_what_was_left_out(tmp_path):
    path, written = CASES / "candump_bus_error_frame.log", tmp_path / "out.csv"

    ended = gaitd("import-candump", path, "--config", TRAINER, "--output", written, "--json")

    assert ended.code == 0
    told = json.loads(ended.out)
    assert (told["rows"], told["notes"]) == (40, ["1 error frames of the bus"])
    assert "note: 1 error frames of the bus" in ended.err


def messages():
    for line in PLAIN.splitlines():
        stamp, _, frame = line.split()
        can_id, _, data = frame.partition("#")
        yield can.Message(
            timestamp=float(stamp[1:-1]),
            arbitration_id=int(can_id, 16),
            data=bytes.fromhex(data),
            is_extended_id=False,
            channel=0,
        )


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".csv", ".log", ".trc"])
def test_what_python_can_writes_is_read_whole(suffix, tmp_path):
    path = tmp_path / f"whole{suffix}"
    with can.Logger(path) as logger:
        for message in messages():
            logger(message)

    rows, notes = imported(path)

    assert rows == 40
    assert notes == []


@pytest.mark.parametrize("is_told", [True, False])
@pytest.mark.parametrize("part", [0.05, 0.3, 0.5, 0.9, 0.99])
def test_half_of_a_blf_is_never_read_without_a_word(part, is_told, tmp_path):
    path = tmp_path / "half.blf"
    with can.Logger(path) as logger:
        for message in messages():
            logger(message)
    data = path.read_bytes()
    data = data if is_told else data[:16] + bytes(8) + data[24:]  # a logger that was killed
    path.write_bytes(data[: round(part * len(data))])

    try:
        _, notes = imported(path)
    except RecordedBusError as error:
        assert str(error)
    else:
        assert any("torn off" in note or "cannot be read" in note for note in notes)


def with_a_container_of_another_compression(container, others):
    return container + container[:16] + b"\7\0" + container[18:] + others


def with_an_object_of_another_header(container, others):
    at = container[32:].index(b"LOBJ") + 32
    return container[: at + 6] + b"\3\0" + container[at + 8 :] + others


def with_a_frame_outside(container, others):
    at = container[32:].index(b"LOBJ") + 32
    return container + container[at : at + 48] + others


@pytest.mark.parametrize(
    ("change", "row_count", "note"),
    [
        (with_a_container_of_another_compression, 40, "1 parts of the BLF left out, with their"),
        (with_an_object_of_another_header, 39, "1 parts of the BLF left out, with their"),
        (with_a_frame_outside, 40, "1 frames of the BLF outside a container: left out"),
    ],
)
def test_what_the_library_leaves_out_of_a_blf_is_told(change, row_count, note, tmp_path):
    path = tmp_path / "other.blf"
    with can.Logger(path, compression_level=0) as logger:
        for message in messages():
            logger(message)
    data = path.read_bytes()
    (size,) = struct.unpack_from("<L", data, 144 + 8)
    end = 144 + size + size % 4
    path.write_bytes(data[:144] + change(data[144:end], data[end:]))

    rows, notes = imported(path)

    assert rows == row_count
    assert [one for one in notes if one.startswith(note)], notes


REFUSED = {
    "not_a_blf.blf": (None, "not_a_blf.blf: frame 1: Unexpected file format"),
    "empty.blf": ("", "empty.blf: frame 1"),
    "v12.trc": (trc("1.2"), "it is TRC 1.2; allowed are 1.0, 1.1, 1.3, 2.0, 2.1"),
    "middle.log": ("(1.0) can0 18\n" + PLAIN, "line 1: '(1.0) can0 18'; allowed is what"),
    "odd.log": ("(1.0) can0 185#3\n" + PLAIN, "line 1: '(1.0) can0 185#3'; allowed is what"),
    "columns.log": ("  can0  185   [2]  37 12\n", "line 1: 'can0  185   [2]  37 12'; allowed"),
    "back.log": (swapped(PLAIN, 4000), "frame 10: time goes back to"),
    "bytes.asc": (asc(replace=("d 7 37 12 60", "d 7 37 12 ZZ")), "allowed are bytes of base 16"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_in_one_line(name, tmp_path):
    text, words = REFUSED[name]
    path = CASES / name if text is None else tmp_path / name
    if text is not None:
        path.write_text(text, encoding="utf-8")

    with pytest.raises(RecordedBusError) as refused:
        imported(path)

    assert words in str(refused.value)
    assert name in str(refused.value)
    assert "\n" not in str(refused.value)
