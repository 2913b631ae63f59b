"""The black box follows real rings in simulated time; its disk is a real thread and folder."""

import contextlib
import os
from dataclasses import dataclass, field
from unittest import mock

import msgspec
import pytest
from gaitd_names import Cause, Mode, StopCategory
from power_cuts import check
from records import HEADER
from traced_calls import mark

from daemon.ipc.record import Verdict
from daemon.ipc.ring_clip import FOLDER, ClipFile, ClipWriter, clip_files
from daemon.ipc.transport import PREVIOUS_RING_NAME, CoreChannel, GatewayChannel, Kept, RingReader
from daemon.recorder.black_box import AFTER_NS, BEFORE_NS, BlackBox
from daemon.recorder.clip_store import ClipStore, surplus
from daemon.recorder.disk import Disk
from daemon.recorder.ring_follower import RecordHeader, header_of

MS = 1_000_000
PERIOD_NS = 10 * MS
OPEN = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip")
BEFORE, AFTER = BEFORE_NS // PERIOD_NS, AFTER_NS // PERIOD_NS


@dataclass
class Heard:
    cores: list[tuple[str, bool]] = field(default_factory=list)
    glances: list[RecordHeader] = field(default_factory=list)

    def core(self, boot_id, present):
        self.cores.append((boot_id, present))

    def record(self, glance):
        self.glances.append(glance)


def header(core_boot_id="boot-a"):
    return msgspec.structs.replace(HEADER, core_boot_id=core_boot_id)


class Room:
    """A core's end and a gateway's, of which either can go and come again."""

    def __init__(self, runtime, record):
        self.runtime, self._record = runtime, record
        self.folder = runtime / "state" / FOLDER
        self.now_ns = 1_000 * MS
        self.heard = Heard()
        self.disk = Disk()
        self.seam = self.core = self.box = None
        self.seq = 0

    def start_core(self, boot_id="boot-a"):
        self.core = CoreChannel(self.runtime, header(boot_id))
        self.seq = 0

    def start_gateway(self):
        self.seam = GatewayChannel(self.runtime)
        self.box = BlackBox(self.runtime, ClipStore(self.folder), self.disk, self.heard)

    def write(self, count, **changes):
        """Records, with a turn of the gateway after each if there is one."""
        for _ in range(count):
            self.seq += 1
            self.core.publish(self._record(self.seq, **changes))
            self.wait(1)

    def wait(self, turns):
        for _ in range(turns):
            self.now_ns += PERIOD_NS
            if self.seam is not None:
                self.seam.records()
                self.box.turn(self.seam.ring, self.now_ns)

    def kill_gateway(self):
        self.seam.close()
        self.seam = None

    def files(self):
        self.disk.settle()
        return clip_files(self.folder)

    def only(self):
        (file,) = self.files()
        return file

    def close(self):
        self.disk.close()
        for end in (self.seam, self.core):
            if end is not None:
                end.close()


@pytest.fixture
def room(runtime, make_record):
    with contextlib.closing(Room(runtime, make_record)) as made:
        yield made


def seqs(file):
    with contextlib.closing(RingReader(file.path)) as ring:
        return [record.seq for record in ring.since(0)]


def test_a_verdict_newly_latched_is_kept_with_its_seconds_before_and_after(room):
    room.start_core()
    room.start_gateway()
    room.write(2000, mode=Mode.GAIT)
    room.write(AFTER + 200, mode=Mode.STOPPING, verdict=OPEN)
    room.wait(30)

    file = room.only()

    assert (file.kept.cause, file.kept.drive) == ("hand_switch_open", "right/hip")
    assert file.kept.stop_seq == 2001
    assert seqs(file) == list(range(2001 - BEFORE, 2001 + AFTER + 1))
    assert file.kept.active
    assert file.core_boot_id == "boot-a"
    assert "hand_switch_open" in file.path.name


def test_records_of_a_kept_file_are_those_of_the_ring_byte_for_byte(room, make_record):
    room.start_core()
    room.start_gateway()
    room.write(50, mode=Mode.GAIT)
    room.write(AFTER + 50, verdict=OPEN)
    room.wait(30)

    with contextlib.closing(RingReader(room.only().path)) as kept:
        for seq in range(1, 51):
            assert kept.raw(seq) == room.seam.ring.raw(seq)


def test_a_second_stop_within_the_seconds_after_goes_into_the_same_file(room):
    room.start_core()
    room.start_gateway()
    room.write(100, mode=Mode.GAIT)
    room.write(AFTER - 20, verdict=OPEN)
    room.write(2 * AFTER, verdict=Verdict(StopCategory.S0, Cause.STOP_NOT_OBEYED))
    room.wait(30)

    file = room.only()

    assert file.kept.also == ("stop_not_obeyed",)
    assert file.kept.last_seq == 100 + AFTER - 20 + 1 + AFTER


def test_stops_that_go_on_longer_than_a_ring_lasts_come_into_several_files_and_none_is_lost(room):
    room.start_core()
    room.start_gateway()
    causes = (Cause.HAND_SWITCH_OPEN, Cause.STO_ACTIVE, Cause.DRIVE_SILENT, Cause.EMERGENCY)
    room.write(2000, mode=Mode.GAIT)
    for cause in causes:
        room.write(AFTER - 50, verdict=Verdict(StopCategory.S1, cause))
    room.write(2 * AFTER, verdict=Verdict(StopCategory.S0, Cause.STOP_NOT_OBEYED))
    room.wait(60)

    files = room.files()

    said = [cause for file in files for cause in (file.kept.cause, *file.kept.also)]
    assert set(causes) | {"stop_not_obeyed"} == set(said)
    assert max(file.kept.last_seq for file in files) == 2000 + 4 * (AFTER - 50) + 1 + AFTER


def test_a_core_that_falls_silent_leaves_its_last_records(room):
    room.start_core()
    room.start_gateway()
    room.write(300, mode=Mode.GAIT)
    room.wait(800)

    file = room.only()

    assert (file.kept.cause, file.kept.last_seq, file.kept.active) == ("core_silent", 300, True)
    assert room.heard.cores == [("boot-a", True), ("boot-a", False)]


def test_a_core_that_hung_for_two_seconds_is_kept_with_what_came_after(room):
    room.start_core()
    room.start_gateway()
    room.write(300, mode=Mode.GAIT)
    room.wait(200)
    room.write(2 * AFTER, mode=Mode.GAIT)
    room.wait(30)

    file = room.only()

    assert file.kept.stop_seq == 300
    assert 300 + AFTER - 200 < file.kept.last_seq <= 300 + AFTER


def test_both_died_and_the_next_gateway_keeps_what_it_finds_once(room):
    room.start_core()
    room.start_gateway()
    room.write(300, mode=Mode.GAIT)
    room.kill_gateway()
    room.core.close()
    assert room.files() == []

    for _ in range(2):
        room.start_gateway()
        room.wait(100)
        assert (room.only().kept.cause, room.only().kept.last_seq) == ("core_ended", 300)
        room.wait(800)
        room.kill_gateway()

    assert len(room.files()) == 1


def test_both_died_and_the_core_came_back_first_its_ring_was_put_aside_and_is_kept(room):
    room.start_core("boot-a")
    room.write(300, mode=Mode.GAIT)
    room.core.close()
    room.start_core("boot-b")
    room.write(20, mode=Mode.READY)
    assert (room.runtime / PREVIOUS_RING_NAME).exists()

    room.start_gateway()
    room.write(100, mode=Mode.READY)

    file = room.only()
    assert file.core_boot_id == "boot-a"
    assert (file.kept.cause, file.kept.last_seq) == ("core_ended", 300)
    assert not (room.runtime / PREVIOUS_RING_NAME).exists()


def test_a_stop_while_the_gateway_was_away_is_found_in_the_ring(room):
    room.start_core()
    room.write(500, mode=Mode.GAIT)
    room.write(AFTER + 100, verdict=OPEN)

    room.start_gateway()
    room.write(50, verdict=OPEN)

    assert room.only().kept.stop_seq == 501


def test_a_stop_that_was_latched_before_a_core_began_is_no_new_one(room):
    room.start_core()
    room.start_gateway()
    room.write(AFTER + 200, mode=Mode.FAULT, verdict=OPEN)

    assert room.files() == []


def test_a_core_that_is_replaced_at_once_is_kept_from_the_ring_that_was_open(room):
    room.start_core("boot-a")
    room.start_gateway()
    room.write(300, mode=Mode.GAIT)
    room.core.close()
    room.start_core("boot-b")
    room.write(100, mode=Mode.OFF)

    file = room.only()
    assert (file.core_boot_id, file.kept.last_seq) == ("boot-a", 300)
    assert not (room.runtime / PREVIOUS_RING_NAME).exists()


def test_a_ring_put_aside_that_could_not_be_kept_stays_for_the_next_gateway(room):
    room.start_core("boot-a")
    room.write(300, mode=Mode.GAIT)
    room.core.close()
    room.start_core("boot-b")
    with mock.patch.object(os, "fsync", side_effect=OSError(28, "No space left on device")):
        room.start_gateway()
        room.write(100, mode=Mode.OFF)
        assert room.files() == []

    assert (room.runtime / PREVIOUS_RING_NAME).exists()
    assert room.disk.failed_count == 1
    room.kill_gateway()
    room.start_gateway()
    room.write(100, mode=Mode.OFF)
    assert room.only().core_boot_id == "boot-a"


def test_a_gateway_that_ends_keeps_what_it_waits_for(room):
    room.start_core()
    room.start_gateway()
    room.write(300, mode=Mode.GAIT)
    room.write(20, mode=Mode.STOPPING, verdict=OPEN)

    room.box.close(room.now_ns)

    assert (room.only().kept.stop_seq, room.only().kept.last_seq) == (301, 320)


def test_a_ring_aside_that_cannot_be_read_is_removed(room):
    (room.runtime / PREVIOUS_RING_NAME).write_bytes(b"rubbish")
    room.start_core()
    room.start_gateway()
    room.write(10)
    room.disk.settle()

    assert not (room.runtime / PREVIOUS_RING_NAME).exists()


def test_a_full_disk_is_said_once_and_counted_and_said_when_it_is_well_again(room):
    room.start_core()
    room.start_gateway()

    def stop_once():
        room.write(AFTER + 20, verdict=OPEN)
        room.write(20)
        room.disk.settle()

    with mock.patch.object(os, "write", side_effect=OSError(28, "No space left on device")):
        room.write(20)
        stop_once()
        stop_once()
        said = room.disk.errors()
    stop_once()

    assert [(one.what, one.reason) for one in said] == [("black box", "No space left on device")]
    assert room.disk.failed_count == 2
    assert [one.reason for one in room.disk.errors()] == [""]
    assert len(room.files()) == 1
    assert [path.suffix for path in room.folder.iterdir()] == [".ring"]


def test_a_gateway_that_slept_for_longer_than_the_ring_lasts_goes_on_with_what_is_there(room):
    room.start_core()
    room.start_gateway()
    room.write(100, mode=Mode.GAIT)
    ipc, room.seam = room.seam, None
    room.write(7000, mode=Mode.GAIT)
    room.seam = ipc
    room.write(100, mode=Mode.GAIT)
    room.wait(100)
    room.write(200, mode=Mode.GAIT, verdict=OPEN)

    assert "hand_switch_open" not in {file.kept.cause for file in room.files()}
    room.write(AFTER, mode=Mode.FAULT, verdict=OPEN)
    room.wait(30)
    stops = {cause for file in room.files() for cause in (file.kept.cause, *file.kept.also)}
    assert "hand_switch_open" in stops


def test_a_glance_reads_the_first_fields_of_a_record(make_record):
    made = make_record(7, verdict=OPEN, mode=Mode.GAIT)

    seen = header_of(msgspec.msgpack.encode(made))

    for name in RecordHeader.__struct_fields__:
        assert getattr(seen, name) == getattr(made, name)
    assert type(made).__struct_fields__[: len(RecordHeader.__struct_fields__)] == (
        RecordHeader.__struct_fields__
    )


# --- the shelf ------------------------------------------------------------------------------------


def file_of(tmp_path, name, *, active, size=10):
    kept = Kept("cause", "", 1, 0, 1, 2, active)
    return ClipFile.of(tmp_path / name, size, msgspec.structs.replace(header(), kept=kept))


def test_what_was_driven_stays_longest_and_the_newest_always(tmp_path):
    files = [
        file_of(tmp_path, "1", active=True),
        file_of(tmp_path, "2", active=False),
        file_of(tmp_path, "3", active=True),
        file_of(tmp_path, "4", active=False),
        file_of(tmp_path, "5", active=False),
    ]

    def left(count, size=10**6):
        gone = surplus(files, count, size)
        return [file.path.name for file in files if file not in gone]

    assert left(5) == ["1", "2", "3", "4", "5"]
    assert left(3) == ["1", "3", "5"]
    assert left(2) == ["3", "5"]
    assert left(0) == ["5"]
    assert left(9, size=25) == ["3", "5"]
    assert left(9, size=1) == ["5"]


def test_a_folder_that_cannot_be_used_is_a_trouble_and_no_error(tmp_path):
    folder = tmp_path / FOLDER
    folder.mkdir()
    (folder / "1.ring").touch()

    with mock.patch.object(type(folder), "is_file", side_effect=PermissionError(13, "no access")):
        clips = ClipStore(folder)

    assert str(folder) in clips.trouble
    assert not clips.covers("boot-a", 1)


def clip(store, stop_utc_ns, seq):
    """A file of two records, whose stop was at a time that the clock showed."""
    with contextlib.closing(ClipWriter(2048)) as records:
        records.add(seq, b"a" * 700)
        records.add(seq + 1, b"b" * 700)
        kept = Kept("cause", "", seq, stop_utc_ns, seq, seq + 1, False)
        return store.write(header(), kept, records).name


def test_the_newest_file_stays_although_the_clock_has_lost_its_time(tmp_path):
    day_ns = 86_400_000_000_000
    for number, day in enumerate((5, 6, 0, 1)):
        newest = clip(ClipStore(tmp_path, files_max=2), day * day_ns, 10 * number + 1)
        assert newest in {file.path.name for file in clip_files(tmp_path)}

    assert [file.kept.stop_utc_ns // day_ns for file in clip_files(tmp_path)] == [0, 1]


def test_after_a_power_cut_a_file_that_was_kept_is_whole(tmp_path):
    folder = tmp_path / "state" / FOLDER

    def scenario():
        store = ClipStore(folder, files_max=2)
        for seq in (1, 11, 21):
            clip(store, seq, seq)
            mark(str(seq))

    def recover(marks):
        store = ClipStore(folder, files_max=2)
        assert store.damaged == []
        assert all(store.covers("boot-a", int(seq)) for seq in marks[-1:])
        clip(store, 31, 31)
        assert len(clip_files(folder)) <= 2
        assert not list(folder.glob("*.part"))

    check(tmp_path, scenario, recover)
