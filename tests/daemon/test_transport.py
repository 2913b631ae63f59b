"""The ring of records and the two datagram sockets, without a core or a gateway."""

import mmap
import os
import select
import struct
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from gaitd_client import wire
from gaitd_names import (
    Cause,
    EventCode,
    Lapse,
    Outcome,
    ProgressCode,
    RefusalCode,
    SetpointRefusal,
    StopCategory,
)
from msgspec import inspect
from records import HEADER, drive, leg, record
from report_values import ENUMS

from daemon.gateway.requests import PAYLOADS
from daemon.ipc import starting, transport
from daemon.ipc.record import (
    TEXT_BYTES_MAX,
    AssistRecord,
    AxisRecord,
    AxisStrideRecord,
    EmergencyRecord,
    GatewayState,
    RequestResult,
    StrideRecord,
    Verdict,
)
from daemon.ipc.report import EVENTS_MAX, SAID_BYTES_MAX, Event, Progress, Refusal
from daemon.ipc.transport import (
    CoreChannel,
    GatewayChannel,
    RareNotice,
    RingError,
    RingReader,
    RingWriter,
)
from daemon.wire.report_fields import EVENT_FIELDS, REFUSAL_FIELDS
from drives.canopen.emcy import NEWS_COUNT
from drives.canopen.emcy_codes import Reaction
from drives.cia402.emergencies import TEXT_LENGTH_MAX


@dataclass
class Ends:
    core: CoreChannel
    gateway: GatewayChannel


@pytest.fixture
def ends(tmp_path: Path):
    gateway = GatewayChannel(tmp_path)
    core = CoreChannel(tmp_path, HEADER)
    yield Ends(core, gateway)
    core.close()
    gateway.close()


def test_what_the_core_writes_the_gateway_reads_in_order_and_once(ends):
    for seq in (1, 2, 3):
        ends.core.publish(record(seq))

    assert [one.seq for one in ends.gateway.records()] == [1, 2, 3]
    assert ends.gateway.records() == []
    assert ends.gateway.header == HEADER


def test_a_record_survives_the_ring_bit_for_bit(ends):
    sent = record(1)

    ends.core.publish(sent)

    assert msgspec.msgpack.encode(ends.gateway.records()[0]) == msgspec.msgpack.encode(sent)


def test_a_level_reaches_the_core_and_rubbish_is_counted_and_told(ends):
    level = GatewayState("boot", seq=1, for_cycle=7, stop_count=0)
    assert ends.core.take_notices() == []

    ends.gateway.send(level)
    ends.gateway._datagrams.send(b"rubbish")

    assert ends.core.receive() == [level]
    assert ends.core.refused_count == 1
    (told,) = ends.core.take_notices()
    assert (told.code, told.values) == (EventCode.STATES_REFUSED, (1,))
    assert "Expected `array`" in told.said


def test_the_ring_keeps_the_newest_records_and_knows_what_is_gone(ends, tmp_path):
    for seq in range(1, transport.SLOT_COUNT + 15):
        ends.core.publish(record(seq))

    reader = RingReader(tmp_path / transport.RING_NAME)

    late = [one.seq for one in ends.gateway.records()]
    assert late == list(range(115, transport.SLOT_COUNT + 15))  # the others are soon overwritten
    assert reader.newest_seq() == transport.SLOT_COUNT + 14
    assert reader.read(14) is None
    assert [one.seq for one in reader.since(0)] == list(range(15, transport.SLOT_COUNT + 15))


def test_the_group_may_send_to_the_core_but_not_shorten_what_it_has_mapped(tmp_path):
    umask = os.umask(0o027)
    try:
        core = CoreChannel(tmp_path, HEADER)
    finally:
        os.umask(umask)

    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    core.close()

    assert modes == {transport.CORE_SOCKET_NAME: 0o660, transport.RING_NAME: 0o640}


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_record_that_is_overwritten_while_it_is_read_is_not_there(
    tmp_path, monkeypatch, is_whole
):
    path = tmp_path / transport.RING_NAME
    writer = RingWriter(path, HEADER)
    writer.write(record(1))
    newer = [record(1 + transport.SLOT_COUNT)]

    class Overtaken(mmap.mmap):
        """A mapping whose writer comes between the number of a record and its bytes."""

        def __getitem__(self, place):
            if newer and place.start >= transport.HEADER_SIZE:
                writer.write(newer.pop())
                if not is_whole:
                    spoil(tmp_path, place_of(1), struct.pack("<Q", 0))
            return super().__getitem__(place)

    monkeypatch.setattr(transport.mmap, "mmap", Overtaken)
    reader = RingReader(path)

    assert reader.read(1) is None
    assert newer == []
    assert reader.damaged_count == 0
    assert (reader.read(1 + transport.SLOT_COUNT) is not None) == is_whole


def test_a_slot_has_no_number_while_it_is_written(tmp_path, monkeypatch):
    numbers = []

    class Watched(mmap.mmap):
        """A mapping that shows what a reader would find between the bytes of a record."""

        def __setitem__(self, place, data):
            numbers.append(struct.unpack_from("<Q", self, place.start - 12)[0])
            super().__setitem__(place, data)

    monkeypatch.setattr(transport.mmap, "mmap", Watched)
    RingWriter(tmp_path / transport.RING_NAME, HEADER).write(record(2))

    assert numbers == [0]


def place_of(seq):
    return transport.HEADER_SIZE + seq % transport.SLOT_COUNT * transport.SLOT_SIZE


def spoil(folder, place, data):
    """Other bytes at a place of the core's ring."""
    with (folder / transport.RING_NAME).open("r+b") as file:
        file.seek(place)
        file.write(data)


@pytest.mark.parametrize(
    ("place", "data", "raw", "damaged_count"),
    [
        (0, struct.pack("<Q", 0), None, 0),  # it is being written
        (0, struct.pack("<Q", 1), None, 0),  # its number belongs into another slot
        (0, struct.pack("<Q", 5), None, 0),
        (8, struct.pack("<I", transport.SLOT_SIZE - 11), b"", 1),
        (8, struct.pack("<I", 0), b"", 1),
        (12, b"\xc1", b"\xc1", 1),
        (12, msgspec.msgpack.encode(record(1)), msgspec.msgpack.encode(record(1)), 1),
        (12, msgspec.msgpack.encode(record(3)), msgspec.msgpack.encode(record(3)), 1),
    ],
)
def test_a_slot_that_has_no_whole_record_is_left_out_and_one_that_is_damaged_is_counted(
    ends, tmp_path, place, data, raw, damaged_count
):
    for seq in (1, 2, 3):
        ends.core.publish(record(seq))
    spoil(tmp_path, place_of(2) + place, data)
    reader = RingReader(tmp_path / transport.RING_NAME)

    found = reader.raw(2)
    assert found == raw or (raw and found is not None and found.startswith(raw))
    assert reader.read(2) is None
    assert reader.damaged_count == damaged_count
    assert [one.seq for one in reader.since(0)] == [1, 3]
    assert [one.seq for one in reader.since(1)] == [3]
    assert reader.since(3) == []
    assert reader.newest_seq() == 3
    assert (reader.oldest_seq(2), reader.oldest_seq(transport.SLOT_COUNT + 5)) == (1, 6)
    assert [one.seq for one in ends.gateway.records()] == ([1, 3] if damaged_count else [1])
    assert ends.gateway.records() == []
    assert (ends.gateway.take_unread(), ends.gateway.take_unread()) == (damaged_count, 0)
    ends.core.publish(record(4))
    assert [one.seq for one in ends.gateway.records()] == ([4] if damaged_count else [3, 4])


@pytest.mark.parametrize("seq", [0, 2 + transport.SLOT_COUNT])
def test_a_slot_of_another_record_has_no_such_record_whatever_its_length(tmp_path, seq):
    path = tmp_path / transport.RING_NAME
    RingWriter(path, HEADER).close()
    spoil(tmp_path, place_of(2), struct.pack("<QI", seq, transport.SLOT_SIZE))

    assert RingReader(path).raw(2) is None
    spoil(tmp_path, place_of(0), struct.pack("<Q", 1))
    assert RingReader(path).newest_seq() == (seq and 2 + transport.SLOT_COUNT)


def test_records_between_damaged_slots_are_all_read(ends, tmp_path):
    for seq in range(1, 7):
        ends.core.publish(record(seq))
    for seq in (3, 5):
        spoil(tmp_path, place_of(seq), struct.pack("<Q", 0))
    found = [[one.seq for one in ends.gateway.records()]]
    for seq in (7, 8):
        ends.core.publish(record(seq))
        found.append([one.seq for one in ends.gateway.records()])

    assert found == [[1, 2], [4], [6, 7, 8]]


@pytest.mark.parametrize("spoiled", [(4,), (3, 4)])
def test_a_record_that_is_not_there_yet_is_waited_for(ends, tmp_path, spoiled):
    for seq in (1, 2, 3):
        ends.core.publish(record(seq))
    assert len(ends.gateway.records()) == 3
    ends.core.publish(record(4))
    for seq in spoiled:
        spoil(tmp_path, place_of(seq), struct.pack("<Q", 0))
    assert ends.gateway.records() == []
    spoil(tmp_path, place_of(4), struct.pack("<Q", 4))
    ends.core.publish(record(5))

    assert [one.seq for one in ends.gateway.records()] == [4, 5]


def test_the_file_has_the_layout_that_other_readers_know(tmp_path):
    path = tmp_path / transport.RING_NAME
    writer = RingWriter(path, HEADER)
    writer.write(record(3001))
    writer.close()
    data, text, slot = path.read_bytes(), *map(msgspec.msgpack.encode, (HEADER, record(3001)))

    assert len(data) == 16384 + 3000 * 7488
    assert data.startswith(struct.pack("<8sIII", b"GAITDRB2", 7488, 3000, len(text)) + text)
    assert data[16384 + 7488 :].startswith(struct.pack("<QI", 3001, len(slot)) + slot)


@pytest.mark.parametrize("too_long", [False, True])
def test_a_header_that_does_not_fit_is_a_bug_of_ours(tmp_path, too_long):
    room = transport.HEADER_SIZE - 20 - len(msgspec.msgpack.encode(HEADER))
    version = "x" * (room + 3 + too_long)  # a text of five bytes has one byte of length, this three
    header = msgspec.structs.replace(HEADER, version=version)
    if too_long:
        with pytest.raises(ValueError, match="header of 16365 bytes does not fit 16384"):
            RingWriter(tmp_path / transport.RING_NAME, header)
        return
    RingWriter(tmp_path / transport.RING_NAME, header).close()
    assert RingReader(tmp_path / transport.RING_NAME).header == header


def test_a_notice_is_due_at_the_first_time_and_at_each_tenfold_count():
    notice = RareNotice()
    counts = (0, 1, 2, 10, 11, 110, 111, 5, 50, 51)

    assert [count for count in counts if notice.due(count)] == [1, 11, 111, 51]


def test_a_gateway_waits_for_a_core_and_for_its_ring(tmp_path):
    ring = tmp_path / transport.RING_NAME
    ring.write_bytes(b"no ring")
    gateway = GatewayChannel(tmp_path)
    with pytest.raises(RingError, match="too few"):
        gateway.records()
    ring.unlink()

    assert (gateway.records(), gateway.header, gateway.ring) == ([], None, None)
    assert (gateway.take_unread(), gateway.starting) == (0, False)
    assert not gateway.send(GatewayState("boot", 1, 1, 0))
    with starting.said(tmp_path):
        assert gateway.starting
    gateway.close()
    assert [path.name for path in tmp_path.iterdir()] == [starting.STARTING_NAME]


def test_each_end_is_woken_by_the_other_and_takes_no_other_datagram_for_it(ends):
    def woken():
        return select.select(ends_by_number, [], [], 0)[0]

    ends_by_number = [ends.core.fileno(), ends.gateway.fileno()]
    assert woken() == []
    assert ends.core.publish(record(1))
    assert woken() == [ends.gateway.fileno()]
    assert len(ends.gateway.records()) == 1
    assert ends.gateway.ring is not None
    assert ends.gateway.send(GatewayState("boot", 1, 1, 0))
    assert woken() == [ends.core.fileno()]
    assert len(ends.core.receive()) == 1
    ends.core._ring.write(record(2))
    for rubbish in (b"rubbish", b"rubbish of nine", b""):
        assert ends.core._datagrams.send(rubbish)
    assert ends.gateway.records() == []
    ends.gateway.close()
    assert not ends.core.publish(record(3))


def test_the_ring_has_all_its_room_before_the_first_record(tmp_path):
    writer = RingWriter(tmp_path / transport.RING_NAME, HEADER)
    found = (tmp_path / transport.RING_NAME).stat()
    writer.close()

    assert found.st_blocks * 512 >= found.st_size
    assert found.st_size == transport.HEADER_SIZE + transport.SLOT_COUNT * transport.SLOT_SIZE


@pytest.mark.parametrize(("owner", "name"), [(os, "posix_fallocate"), (Path, "open")])
def test_a_ring_that_finds_no_room_leaves_nothing(tmp_path, monkeypatch, owner, name):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(owner, name, full)

    with pytest.raises(OSError, match="No space left"):
        RingWriter(tmp_path / transport.RING_NAME, HEADER)
    assert not list(tmp_path.iterdir())


def test_a_ring_that_is_closed_is_neither_written_nor_read(tmp_path):
    path = tmp_path / transport.RING_NAME
    writer = RingWriter(path, HEADER)
    reader = RingReader(path)
    writer.close()
    reader.close()

    for end in (writer, reader):
        with pytest.raises(ValueError, match="closed"):
            end._map[0]


def test_a_ring_is_set_aside_until_it_is_taken_and_no_later_one_replaces_it(tmp_path):
    path = tmp_path / transport.RING_NAME
    for boot_id in ("first", "second", "third"):
        RingWriter(path, msgspec.structs.replace(HEADER, core_boot_id=boot_id)).close()

    paths = tmp_path / transport.PREVIOUS_RING_NAME, path
    assert [RingReader(one).header.core_boot_id for one in paths] == ["first", "third"]


def test_the_ring_outlives_its_writer(tmp_path):
    core = CoreChannel(tmp_path, HEADER)
    core.publish(record(1))
    gateway = GatewayChannel(tmp_path)
    for end in (core, gateway):
        end.close()

        assert end.fileno() == -1
        with pytest.raises(ValueError, match="closed"):
            end._ring._map[0]
    assert RingReader(tmp_path / transport.RING_NAME).since(0)[0].seq == 1


def test_a_file_of_the_black_box_may_have_no_number():
    place = dict.fromkeys(("stop_seq", "stop_utc_ns", "first_seq", "last_seq"), 1)

    kept = msgspec.convert({"cause": "", "drive": "", "active": False} | place, transport.Kept)

    assert kept.number == 0


def test_the_gateway_follows_a_core_that_starts_anew_and_reads_it_from_its_beginning(
    ends, tmp_path
):
    ends.core.publish(record(1))
    ends.gateway.records()
    ends.core.close()
    again = CoreChannel(tmp_path, msgspec.structs.replace(HEADER, core_boot_id="second"))
    for seq in (1, 2):
        again.publish(record(seq))

    found = ends.gateway.records()

    assert [one.seq for one in found] == [1, 2]
    assert ends.gateway.header is not None
    assert ends.gateway.header.core_boot_id == "second"
    again.close()


@pytest.mark.parametrize("count", [1, 3])
def test_what_a_new_core_writes_goes_before_what_is_left_of_the_one_before(ends, tmp_path, count):
    ends.core.publish(record(1))
    ends.gateway.records()
    ends.core.publish(record(2))
    ends.core.close()
    again = CoreChannel(tmp_path, HEADER)
    seqs = list(range(1, count + 1))
    for seq in seqs:
        again.publish(record(seq))

    assert [one.seq for one in ends.gateway.records()] == seqs
    again.close()


@pytest.mark.parametrize("step", [-1, 1])
def test_a_ring_with_another_inode_is_another_one(ends, step):
    ends.core.publish(record(1))
    ends.gateway.records()
    before = ends.gateway.ring
    before.inode += step

    ends.gateway.records()

    assert ends.gateway.ring is not before


def test_a_gateway_that_comes_late_begins_with_the_newest_record(tmp_path):
    core = CoreChannel(tmp_path, HEADER)
    for seq in range(1, 100):
        core.publish(record(seq))
    gateway = GatewayChannel(tmp_path)

    core.publish(record(100))

    assert [one.seq for one in gateway.records()] == [100]
    core.close()
    gateway.close()


def test_a_core_without_a_gateway_writes_on_where_another_one_has_left_its_socket(tmp_path):
    (tmp_path / transport.CORE_SOCKET_NAME).touch()
    core = CoreChannel(tmp_path, HEADER)
    for seq in range(1, 50):
        core.publish(record(seq))
    core.close()

    assert RingReader(tmp_path / transport.RING_NAME).newest_seq() == 49


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"short", "too few"),
        (b"GAITDRB2" + bytes(16384 - 9), "16383 bytes are too few"),
        (struct.pack("<8sIII", b"GAITDRB2", 12, 1, 1) + bytes(16384 - 20), "shorter"),
        (b"NOTARING" + bytes(transport.HEADER_SIZE), "begins with"),
        (b"GAITDRB1" + bytes(transport.HEADER_SIZE), "begins with b'GAITDRB1'"),
        (
            struct.pack("<8sIII", transport.MAGIC, 4096, 3000, 4) + bytes(transport.HEADER_SIZE),
            "shorter",
        ),
        *(
            (
                struct.pack("<8sIII", transport.MAGIC, size, count, 1)
                + bytes(transport.HEADER_SIZE - 20 + size * count - 1),
                "shorter",
            )
            for size, count in ((12, 1), (100, 3), (8192, 2))
        ),
        (
            struct.pack("<8sIII", transport.MAGIC, 11, 1, 1) + bytes(transport.HEADER_SIZE),
            "no room",
        ),
        (
            struct.pack("<8sIII", transport.MAGIC, 12, 0, 1) + bytes(transport.HEADER_SIZE),
            "its header says 0 slots, so it has no room",
        ),
        (
            struct.pack("<8sIII", transport.MAGIC, 12, 1, 1) + bytes(transport.HEADER_SIZE),
            "header cannot be read: Expected",
        ),
    ],
)
def test_a_file_that_is_no_ring_is_refused_by_name(tmp_path, content, words):
    path = tmp_path / "some.ring"
    path.write_bytes(content)

    with pytest.raises(RingError, match=words) as refused:
        RingReader(path)
    assert "some.ring" in str(refused.value)


LONGEST = "x" * TEXT_BYTES_MAX
_AXIS = AxisStrideRecord(*[1.1] * 15)
STRIDE = StrideRecord(10**6, 10**18, 1.1, 0.9, 200, _AXIS, _AXIS, *[1.1] * 6, 0xFFFF, True)
SAID = "x" * SAID_BYTES_MAX


def longest(names):
    """The longest values of a report: numbers of nine bytes, or names."""
    return tuple(max(ENUMS[name], key=len) if name in ENUMS else 1e300 for name in names)


def size(report):
    return len(msgspec.msgpack.encode(report))


REFUSALS = [
    Refusal(code, "right/slide", longest(REFUSAL_FIELDS[code]), SAID) for code in REFUSAL_FIELDS
]
LARGEST_REFUSAL = max(REFUSALS, key=size)
REFUSED = longest(EVENT_FIELDS[EventCode.REQUEST_REFUSED]) + LARGEST_REFUSAL.values
EVENTS = [Event(code, "right/slide", longest(EVENT_FIELDS[code]), SAID) for code in EVENT_FIELDS]
LARGEST_EVENT = max(
    *EVENTS, Event(EventCode.REQUEST_REFUSED, "right/slide", REFUSED, SAID), key=size
)


def test_the_largest_record_of_two_legs_fits_its_slot(tmp_path):
    came = EmergencyRecord(
        code=0xFFFF,
        error_register=0xFF,
        vendor_bytes="ff" * 5,
        text="x" * TEXT_LENGTH_MAX,
        reaction=max((one.value for one in Reaction), key=len),
        alarm=True,
        loses_reference=True,
        repeated=True,
    )
    drives = [
        msgspec.structs.replace(
            drive(f"right/slide{n}"),
            late_count=10**9,
            emergency_code=0xFFFF,
            emergency_text=came.text,
            emergency_count=10**9,
            emergencies=(came,) * NEWS_COUNT,
        )
        for n in range(4)
    ]
    one = AxisRecord(**dict.fromkeys(AxisRecord.__struct_fields__, 1.1) | {"validity": 2})
    refused = dict.fromkeys(SetpointRefusal, 2**53)
    assist = AssistRecord(2**53, refused, 2**53, Lapse.STALE)
    largest = msgspec.structs.replace(
        record(10**6),
        assist=assist,
        verdict=Verdict(StopCategory.S1, Cause.BUS_OFF, "right/slide", 1.1, 2.2, said=LONGEST),
        events=(LARGEST_EVENT,) * EVENTS_MAX,
        request=RequestResult(2**63 - 1, Outcome.REFUSED, LARGEST_REFUSAL),
        progress=Progress(ProgressCode.SETTING_UP, "right/slide", (1e300, 1e300)),
        drives=tuple(drives),
        legs=tuple(
            msgspec.structs.replace(
                leg(name), hip=one, slide=one, setpoint_seq=2**53 - 1, stride=STRIDE, mean_nis=1.1
            )
            for name in ("right", "left")
        ),
    )
    writer = RingWriter(tmp_path / transport.RING_NAME, HEADER)

    writer.write(largest)

    writer.close()
    read = RingReader(tmp_path / transport.RING_NAME).read(10**6)
    assert msgspec.msgpack.encode(read) == msgspec.msgpack.encode(largest)


@pytest.mark.parametrize("words", ["x" * 7000, "\N{GRINNING FACE}" * 1700, "\ud83d"])
def test_a_record_whose_words_have_no_room_or_no_bytes_is_written_without_them_and_told(
    ends, words
):
    whole = record(1)
    came = EmergencyRecord(0x8130, 0x11, "", words, "stop", True, False, False)
    drives = [
        msgspec.structs.replace(one, emergency_text=words, emergencies=(came,))
        for one in whole.drives
    ]
    ends.core.publish(
        msgspec.structs.replace(
            whole,
            drives=tuple(drives),
            legs=(msgspec.structs.replace(whole.legs[0], stride=STRIDE),),
            verdict=Verdict(StopCategory.S1, Cause.BUS_OFF, said=words),
            request=RequestResult(
                7, Outcome.REFUSED, Refusal(RefusalCode.NO_SUCH_AXIS, said=words)
            ),
            events=(Event(EventCode.STOPPED, "right/hip", (1.0, 2.0), words),),
        )
    )

    (read,) = ends.gateway.records()
    told = ends.core.take_notices()
    assert (read.drives, read.legs[0].stride) == (whole.drives, None)
    assert read.verdict == Verdict(StopCategory.S1, Cause.BUS_OFF)
    assert read.request == RequestResult(7, Outcome.REFUSED, Refusal(RefusalCode.NO_SUCH_AXIS))
    assert read.events == (Event(EventCode.STOPPED, "right/hip", (1.0, 2.0)),)
    assert told == [Event(EventCode.RECORDS_SHORTENED, values=(1,))]
    ends.core.publish(record(2))
    assert ends.core.take_notices() == []


@pytest.mark.parametrize("too_long", [False, True])
def test_a_record_is_whole_while_it_fits_its_slot(ends, too_long):
    def said(size):
        verdict = Verdict(StopCategory.S1, Cause.BUS_OFF, said="x" * size)
        return msgspec.structs.replace(record(1), verdict=verdict)

    room = 7488 - 12 - len(msgspec.msgpack.encode(said(1000)))

    ends.core.publish(said(1000 + room + too_long))

    (read,) = ends.gateway.records()
    assert bool(read.verdict.said) == (not too_long)
    assert len(ends.core.take_notices()) == too_long


def test_a_number_that_has_no_bytes_costs_its_record_and_not_the_core(ends):
    whole = record(1)
    beyond = msgspec.structs.replace(whole.drives[0], late_count=2**64)
    ends.core.publish(msgspec.structs.replace(whole, drives=(beyond, whole.drives[1])))
    ends.core.publish(record(2))

    assert [one.seq for one in ends.gateway.records()] == [2]
    assert len(ends.core.take_notices()) == 1


def integers_and_texts(kind, place=""):
    """Each integer and each text inside a type, as msgspec sees it."""
    match kind:
        case inspect.StructType(fields=fields):
            for field in fields:
                yield from integers_and_texts(field.type, f"{place}.{field.name}")
        case inspect.Metadata(type=inner):
            yield from integers_and_texts(inner, place)
        case inspect.UnionType(types=kinds):
            for one in kinds:
                yield from integers_and_texts(one, place)
        case inspect.VarTupleType(item_type=item) | inspect.ListType(item_type=item):
            yield f"{place}[]", kind
            yield from integers_and_texts(item, place)
        case inspect.DictType(key_type=key, value_type=value):
            yield f"{place}{{}}", kind
            yield from integers_and_texts(key, f"{place} key")
            yield from integers_and_texts(value, f"{place}[key]")
        case inspect.IntType() | inspect.StrType():
            yield place, kind


@pytest.mark.parametrize("kind", [GatewayState, wire.SetpointMessage, wire.Ask, *PAYLOADS.values()])
def test_what_another_process_may_write_has_a_bound(kind):
    found_in_it = list(integers_and_texts(inspect.type_info(kind)))

    assert len(found_in_it) >= 2
    for place, found in found_in_it:
        match found:
            case inspect.IntType(ge=low, le=high):
                assert low is not None, place
                assert high <= 2**63 - 1, place
            case (
                inspect.StrType(max_length=most)
                | inspect.VarTupleType(max_length=most)
                | inspect.DictType(max_length=most)
            ):
                assert most is not None, place
                assert most <= (wire.MARK_LENGTH_MAX if place == ".text" else 64), place
            case _:
                pytest.fail(f"{place} has no bound")


def test_a_datagram_is_read_up_to_its_largest_size(ends):
    assert ends.gateway._datagrams.send(bytes(8193))

    assert [len(data) for data in ends.core._datagrams.drain()] == [8192]


class Endless:
    """A socket whose sender never rests."""

    def recv(self, _size):
        return msgspec.msgpack.encode(GatewayState("boot", 1, 1, 0))

    def close(self):
        """Nothing to let go of."""


def test_who_sends_without_end_does_not_hold_the_cycle_and_is_told(tmp_path):
    core = CoreChannel(tmp_path, HEADER)
    core._datagrams._socket.close()
    core._datagrams._socket = Endless()

    gateway_states = core.receive()

    assert len(gateway_states) == 128
    assert core.take_notices() == [Event(EventCode.STATES_CROWDED, values=(1,))]
    core.close()
