"""Files of the black box: exactly the records of the window, in a ring that every reader opens."""

import struct
import sys
from contextlib import closing, nullcontext
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from records import HEADER, cut_out, record

from daemon.ipc import transport
from daemon.ipc.ring_clip import (
    CORE_ENDED,
    CORE_SILENT,
    FOLDER,
    PART_SUFFIX,
    ClipFile,
    ClipWriter,
    clip_file,
    clip_files,
    name_of,
    order_of,
    trimmed,
)
from daemon.ipc.transport import (
    PREVIOUS_RING_NAME,
    RING_NAME,
    Kept,
    RingReader,
    RingWriter,
)
from daemon.recorder import black_box
from daemon.recorder.black_box import Window
from daemon.recorder.ring_follower import RingFollower, Stop

KEPT = Kept("hand_switch_open", "right/hip", 5, 1_795_261_054_999_999_999, 1, 9, True)


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A ring that has gone round once and a half, with some records that were never written."""
    path = tmp_path_factory.mktemp("ring") / RING_NAME
    writer = RingWriter(path, HEADER)
    for seq in range(1, transport.SLOT_COUNT * 3 // 2):
        if seq % 97:
            writer.write(record(seq))
    writer.close()
    with closing(RingReader(path)) as opened:
        yield opened


def cutting_of(*seqs):
    return cut_out(map(record, seqs))


def read(path):
    with closing(RingReader(path)) as opened:
        return opened.header, opened.since(0)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    first=st.integers(1, transport.SLOT_COUNT * 2),
    count=st.integers(1, 400),
    piece=st.integers(1, 150),
)
def test_a_window_keeps_exactly_those_of_its_records_that_the_ring_has(
    ring, tmp_path, first, count, piece
):
    last = first + count - 1
    there = [one for one in map(ring.read, range(first, last + 1)) if one is not None]
    stop = Stop("cause", "", first, 0)
    window = Window(RingFollower.starting_at(ring), stop, first, last, due_ns=0)

    while not window.copy(piece):
        pass

    kept = range(window.copied.first_seq, window.copied.last_seq + 1)
    assert [seq for seq in kept if window.copied.raw(seq)] == [one.seq for one in there]
    if not there:
        return
    path = tmp_path / "kept.ring"
    path.write_bytes(b"".join(trimmed(HEADER, window.copied)))
    header, found = read(path)
    assert header == HEADER
    assert msgspec.msgpack.encode(found) == msgspec.msgpack.encode(there)


def test_a_window_of_thousands_of_records_is_not_thousands_of_objects(ring):
    stop = Stop("cause", "", transport.SLOT_COUNT, 0)
    window = Window(
        RingFollower.starting_at(ring),
        stop,
        transport.SLOT_COUNT - 1000,
        transport.SLOT_COUNT + 400,
        due_ns=0,
    )
    window.copy(1)
    before = sys.getallocatedblocks()

    window.copy(1400)

    assert len(window.copied) > 1350
    assert sys.getallocatedblocks() - before < 100


def test_a_window_longer_than_its_ring_asks_for_no_more_memory_than_the_ring_has(ring, monkeypatch):
    asked: list[int] = []
    monkeypatch.setattr(
        black_box, "ClipWriter", lambda room: asked.append(room) or ClipWriter(room)
    )
    newest = ring.newest_seq()
    window = Window(
        RingFollower.starting_at(ring), Stop("cause", "", newest, 0), 1, 10**12, due_ns=0
    )

    while not window.copy(1000):
        pass

    assert asked == [transport.SLOT_COUNT * transport.SLOT_SIZE]
    assert window.copied.last_seq == newest


def test_a_file_says_what_it_was_kept_for_and_its_name_does(tmp_path):
    header = msgspec.structs.replace(HEADER, kept=KEPT)
    path = tmp_path / name_of("1a2b3c4d5", KEPT)
    path.write_bytes(b"".join(trimmed(header, cutting_of(5))))

    assert path.name == "20261121T113734.999Z_hand_switch_open_1a2b3c4d_5.ring"
    assert clip_file(path).kept == KEPT
    assert read(path)[0] == header


def test_a_header_of_a_service_before_the_black_box_is_read(tmp_path):
    old = msgspec.to_builtins(HEADER)
    del old["kept"]

    assert msgspec.convert(old, transport.RingHeader).kept is None


def test_files_are_listed_by_time_and_one_that_is_damaged_is_named(tmp_path):
    (tmp_path / "2.ring").write_bytes(b"")
    (tmp_path / "1.ring").write_bytes(b"".join(trimmed(HEADER, cutting_of(1))))
    (tmp_path / "3.ring.damaged").write_bytes(b"")
    (tmp_path / "4.ring.part").write_bytes(b"")
    (tmp_path / "other.txt").write_text("no ring")
    (tmp_path / "folder.ring").mkdir()

    first, second, third = clip_files(tmp_path)

    one = tmp_path / "1.ring"
    assert first == ClipFile(one, one.stat().st_size, "boot", HEADER.period_ns, None, "")
    assert second == ClipFile(tmp_path / "2.ring", 0, "", 0, None, second.trouble)
    assert "is empty" in second.trouble
    assert third.path.name == "3.ring.damaged"
    assert clip_files(tmp_path / "nowhere") == []
    assert clip_file(tmp_path / "folder.ring").trouble == f"{tmp_path}/folder.ring: Is a directory"


def test_files_are_in_the_order_of_their_numbers_and_then_of_their_names():
    files = [
        ClipFile(Path("0"), 1, kept=msgspec.structs.replace(KEPT, number=1)),
        ClipFile(Path("c"), 1),
        ClipFile(Path("b"), 1, kept=KEPT),
        ClipFile(Path("a"), 1),
    ]

    assert [str(file.path) for file in sorted(files, key=order_of)] == ["a", "b", "c", "0"]
    assert (*("blackbox", ".part", "core_silent", "core_ended"),) == (
        FOLDER,
        PART_SUFFIX,
        CORE_SILENT,
        CORE_ENDED,
    )


def test_what_no_ring_can_hold_makes_no_file():
    with pytest.raises(ValueError, match="0 records"):
        list(trimmed(HEADER, cutting_of()))
    room = transport.HEADER_SIZE - 20 - len(msgspec.msgpack.encode(HEADER)) + len(HEADER.version)
    for too_long, pieces in ((0, 2), (1, 0)):
        header = msgspec.structs.replace(HEADER, version="x" * (room - 2 + too_long))
        with pytest.raises(ValueError, match="16365") if too_long else nullcontext():
            assert len(list(trimmed(header, cutting_of(1)))) == pieces


def test_records_are_cut_out_with_their_gaps_and_their_memory_is_given_back():
    cutting = ClipWriter(0)
    assert (len(cutting), cutting.longest_bytes) == (0, 0)
    cutting.add(7, b"seven")
    cutting.add(10, b"ten")

    assert (cutting.first_seq, cutting.last_seq, len(cutting)) == (7, 10, 4)
    assert [cutting.raw(seq) for seq in range(7, 11)] == [b"seven", b"", b"", b"ten"]
    assert cutting.longest_bytes == 5
    head, *slots = trimmed(HEADER, cutting)
    assert head[:16] == b"GAITDRB2" + struct.pack("<II", 24, 4)
    assert [(len(slot), *struct.unpack_from("<QI5s", slot)) for slot in slots] == [
        *((24, 0, 0, bytes(5)), (24, 0, 0, bytes(5))),  # 8 and 9 are missing
        *((24, 10, 3, b"ten\0\0"), (24, 7, 5, b"seven")),
    ]
    cutting.add(11, b"eleven")
    assert cutting.longest_bytes == 6
    cutting.close()
    with pytest.raises(ValueError, match="closed"):
        cutting.raw(7)


@pytest.mark.parametrize(("data", "size"), [(b"a", 16), (b"four", 16), (b"fives", 24)])
def test_a_slot_is_the_smallest_multiple_of_eight_bytes_that_holds_the_longest_record(data, size):
    cutting = ClipWriter(0)
    cutting.add(1, data)

    _, slot = trimmed(HEADER, cutting)

    assert len(slot) == size


def test_the_ring_that_stopped_first_stays_aside_until_it_is_taken(tmp_path):
    for boot_id in ("first", "second", "third"):
        header = msgspec.structs.replace(HEADER, core_boot_id=boot_id)
        RingWriter(tmp_path / RING_NAME, header).close()

    assert read(tmp_path / PREVIOUS_RING_NAME)[0].core_boot_id == "first"
    assert read(tmp_path / RING_NAME)[0].core_boot_id == "third"
