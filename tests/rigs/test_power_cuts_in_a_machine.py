"""Five kills of a virtual machine whose files are on an ext4 image: what the next start finds.

The machine runs virtual drives on a vcan, the service, `gaitd record`, and a program that keeps
sessions and keys (tests/support/cut_machine.py). QEMU is killed at a random moment of a phase. The
guest's page cache is lost with its memory, and of what its disk had not been told to flush a random
part (`LossyDisk`), as on a trainer whose mains fail. The next machine boots from what is left, and
its kernel replays the journal. The drives lose their power with everything else.

What a machine says to the host before its end is the measure: what was acknowledged must be there.
`make test-power-cuts` prints a line for each kill; `SEED` repeats its random choices, apart from
what the host's scheduling decides.
"""

import itertools
import json
import os
import random
import shutil
import signal
import sqlite3
import struct
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow.parquet as pq
import pytest
from cut_machine import DISK, LAST, PHASES, PROFILE, SETTLED_S
from gaitd_client.credentials import FILE, CredentialsFile
from gaitd_record import Event, Unfinished, finish_leftovers
from gaitd_record.finish import TORN
from gaitd_record.recording import MESSAGES, PART
from gaitd_session.store import INTERRUPTED, Store
from mcap.reader import make_reader

from daemon.core.runtime.state_file import StateFile
from daemon.ipc.ring_clip import FOLDER, clip_files
from daemon.ipc.transport import RingReader
from daemon.keys.folder import ISSUED, read_keys
from daemon.recorder.audit_file import fields_of, lines_of
from gaitd_lab.testing.rigs import PATH, SocketCan, prepare

SUPPORT = Path(__file__).parents[1] / "support"
SEED = 20261125
IMAGE_BYTES = 128 << 20
"""The recorder wants 64 MB of it free."""
LIFE_S = 1200.0
"""For a computer on which much else runs; two minutes on one that is free."""
POLL_S = 0.1
KILLED_WITHIN_S = {"starting": 9.0, "ready": 2.0, "hold": 4.0, "gait": 5.0, "stop": 0.8}
"""The machine's time after the begin of the phase; the host's is about ten times as much."""
CUTS_ELSEWHERE = 10
OK = ("ok",)
CREDENTIALS = msgspec.json.Decoder(CredentialsFile)
UNSEEN_S = 3.0
"""The host's time between the choice of a moment and the kill."""
RECORDER_LOSES_S = 1.0
"""docs/recording.md."""
ENDED = {"finished", "deleted", "unfinished"}
REST_SI = 1e-3
"""A leg without power rests."""
SCRIPT = """
modprobe vcan; modprobe can-raw; modprobe ext4
ip link add dev vcan0 type vcan; ip link set vcan0 up; ip link set lo up
mkdir -p {disk}
mount -t ext4 -o errors=remount-ro /dev/vda {disk}
export NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=$PWD/numba PYTHONPATH={support}
python {support}/cut_machine.py {phase}
"""
pytestmark = [
    pytest.mark.rig_vcan,
    pytest.mark.thorough,  # six boots of a machine
    pytest.mark.timeout(7 * LIFE_S),
]


# --- the disk -------------------------------------------------------------------------------------
#
# A virtual machine's disk with a write cache that a power cut empties, in parts.
#
# Killing QEMU loses the guest's memory and with it its page cache. It loses nothing that the guest
# has handed to its disk, because the host keeps that: such a disk would have no cache of its own.
# So QEMU writes a log of all writes and flushes as well (blklogwrites, in the format of Linux'
# dm-log-writes), and `cut` makes the image of the next boot from the image of the boot before and
# from this log: everything up to the last flush, and of the writes after it a random part, as a
# disk may write its cache in any order. A flush that the service forgets is seen in that way;
# without one the data is lost at every second cut.

SECTOR = 512
MAGIC = 0x6A736677736872
SUPER = struct.Struct("<QQQI")
ENTRY = struct.Struct("<QQQQ")
FLUSH, FUA, DISCARD = 1, 2, 4
LOG_BYTES = 4 << 30
"""Sparse: a boot writes some megabytes."""


class Write(NamedTuple):
    """An entry of the log."""

    begin: int
    data: bytes
    flags: int


class Cut(NamedTuple):
    """What a cut has left."""

    written_count: int
    """Writes and flushes since the boot."""
    unflushed_count: int
    """Those after the last flush."""
    lost_count: int
    """Those of them that are not on the disk."""


class LossyDisk:
    """An image, and the log of the boot that is under way."""

    def __init__(self, image: Path, size_bytes: int) -> None:
        self.image = image
        self._before, self._log = image.with_suffix(".before"), image.with_suffix(".log")
        with image.open("xb") as file:
            file.truncate(size_bytes)

    def begin(self) -> str:
        """Begin a boot; QEMU's options."""
        shutil.copyfile(self.image, self._before)
        with self._log.open("wb") as file:
            file.truncate(LOG_BYTES)
        # The host keeps its power: it need not flush, and a flush does not wait for its disk.
        file = "-blockdev driver=file,cache.no-flush=on"
        return (
            f" {file},node-name=image,filename={self.image}"
            f" {file},node-name=log,filename={self._log}"
            " -blockdev driver=blklogwrites,node-name=disk,file=image,log=log"
            f",log-sector-size={SECTOR} -device virtio-blk-pci,drive=disk"
        )

    def written_count(self) -> int:
        """Writes and flushes since the boot."""
        return sum(1 for _ in self._writes())

    def cut(self, chance: random.Random, at_write: int | None = None) -> Cut:
        """The power is cut: make the image of what the disk has then.

        Args:
            chance: chooses what is lost.
            at_write: so many writes after the boot; None: at the end of the log.
        """
        writes = list(self._writes())[:at_write]
        flushed = max((n for n, one in enumerate(writes, 1) if one.flags & FLUSH), default=0)
        # The kill may have torn the last entry.
        last = len(writes) - 1
        lost = {
            number
            for number in range(flushed, len(writes))
            if number == last or (not writes[number].flags & FUA and chance.random() < 0.5)
        }
        shutil.copyfile(self._before, self.image)
        with self.image.open("r+b") as file:
            for number, one in enumerate(writes):
                if number not in lost:
                    file.seek(one.begin)
                    file.write(one.data)
        return Cut(len(writes), len(writes) - flushed, len(lost))

    def _writes(self) -> Iterator[Write]:
        """The log's entries; the count in its head may be older than the last ones."""
        with self._log.open("rb") as log:
            magic, _, _, sector_bytes = SUPER.unpack(log.read(SUPER.size))
            assert (magic, sector_bytes) == (MAGIC, SECTOR)
            log.seek(SECTOR)
            while True:
                begin, count, flags, _ = ENTRY.unpack(log.read(SECTOR)[: ENTRY.size])
                if not count and not flags:
                    return
                data = b"" if flags & DISCARD else log.read(count * SECTOR)
                yield Write(begin * SECTOR, data, flags)


# --- the machines ---------------------------------------------------------------------------------


class Life(NamedTuple):
    """A machine from its boot to its end, and what its disk has then."""

    phase: str
    said: list[dict[str, Any]]
    cut: Cut | None
    """None: it ended in order."""
    disk: Path
    """A copy of its files."""
    checked: str
    """What e2fsck finds beyond a journal to replay; empty: nothing."""
    elsewhere: list[str]
    """What would have been wrong after cuts at other writes of this life."""

    def all(self, name: str) -> list[Any]:
        return [one[name] for one in self.said if name in one]

    def one(self, name: str) -> dict[str, Any]:
        (found,) = (one for one in self.said if name in one)
        return found

    @property
    def pulses(self) -> list[dict[str, Any]]:
        return [one for one in self.said if "pulse" in one]

    @property
    def end_s(self) -> float:
        """When it was last heard of; the kill came later."""
        return self.said[-1]["at_s"]


class InAMachine(SocketCan):
    """The rig as a virtual machine, also where this kernel has SocketCAN; with a disk."""

    options = ""

    def native(self) -> bool:
        return False

    def command(self, script: Path, folder: Path, also: Sequence[Path] = ()) -> list[str]:
        words = super().command(script, folder, also)
        return [w + self.options if w.startswith("--qemu-opts=") else w for w in words]


@pytest.fixture(scope="module")
def lives(vcan_rig, compiled_for_any_processor, tmp_path_factory):
    """Six machines one after the other on one disk; the first five are killed."""
    rig = InAMachine()
    if lack := rig.lacks():
        pytest.skip(f"a virtual machine: {lack}")
    shared, folder = tmp_path_factory.mktemp("shared"), tmp_path_factory.mktemp("power")
    compiled_for_any_processor(shared)
    disk, chance = LossyDisk(folder / "disk.img", IMAGE_BYTES), random.Random(SEED)
    run("mkfs.ext4", "-q", str(disk.image))
    lives: list[Life] = []
    for phase in (*PHASES, LAST):
        lives.append(lived(rig, phase, shared, disk, chance))
        if len(lives) > 1:
            print(f"\n{told(*lives[-2:])}", end="", flush=True)
    return lives


def run(*words: str) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def lived(
    rig: InAMachine, phase: str, shared: Path, disk: LossyDisk, chance: random.Random
) -> Life:
    """One machine, from its boot to the kill in its phase, or to its end."""
    pid_file, log = shared / "qemu.pid", shared / "log"
    for file in (pid_file, log):
        file.unlink(missing_ok=True)
    rig.options = f"{disk.begin()} -pidfile {pid_file}"
    script = prepare(SCRIPT.format(disk=DISK, support=SUPPORT, phase=phase), shared)
    output = shared / f"{phase}.rig"
    with output.open("wb") as file:
        machine = subprocess.Popen(
            rig.command(script, shared),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env={"PATH": PATH, "HOME": str(shared)},
            start_new_session=True,
        )
    try:
        delay_s = chance.uniform(0.0, KILLED_WITHIN_S.get(phase, 0.0))
        end_s = time.monotonic() + LIFE_S
        while machine.poll() is None and not is_due(heard(log), phase, delay_s):
            assert time.monotonic() < end_s, f"{phase}: not reached\n{words(log, output)}"
            time.sleep(POLL_S)
        assert (machine.poll() is None) == (phase != LAST), (
            f"{phase}: its end\n{words(log, output)}"
        )
        if phase != LAST:
            # Else each kill would follow what the machine has just said, and so what it has synced.
            time.sleep(chance.uniform(0.0, UNSEEN_S))
            os.kill(int(pid_file.read_text()), signal.SIGKILL)
            machine.wait(LIFE_S)
    finally:
        if machine.poll() is None:
            os.killpg(machine.pid, signal.SIGKILL)
    said = heard(log)
    log.rename(shared / f"{phase}.log")
    place = disk.image.with_name(phase)
    # The files of the first life are only being made.
    elsewhere = [] if phase in {PHASES[0], LAST} else wrong_elsewhere(disk, place, chance)
    cut = None if phase == LAST else disk.cut(chance)
    return Life(phase, said, cut, *looked_at(disk.image, place), elsewhere)


def wrong_elsewhere(disk: LossyDisk, place: Path, chance: random.Random) -> list[str]:
    """Cut the power at other writes of this life as well; what cannot be read then."""
    wrong: list[str] = []
    count = disk.written_count()
    for at_write in chance.sample(range(1, count), CUTS_ELSEWHERE):
        cut = disk.cut(chance, at_write)
        files, checked = looked_at(disk.image, place.with_name("elsewhere"))
        wrong += [f"{place.name}, {cut}: {one}" for one in (checked, *unreadable(files)) if one]
        shutil.rmtree(files)
    return wrong


def unreadable(disk: Path) -> Iterator[str]:
    """What a start could not read; a gateway's last line may be torn, recordings are finished."""
    yield from (clip.trouble for clip in clip_files(disk / "state" / FOLDER))
    for line, after in itertools.pairwise(map(fields_of, lines_of(disk / "state"))):
        if line is None and (after or {}).get("kind") != "start":
            yield "a line of the request log"
    if StateFile(disk / "state").persistent.damaged:
        yield "the state file"
    with closing(sqlite3.connect(disk / "sessions.db")) as database:
        yield from (str(row) for row in database.execute("PRAGMA integrity_check") if row != OK)
    for client in read_keys(disk / "keys").register.clients:
        file = disk / "keys" / ISSUED / client.name / FILE
        if CREDENTIALS.decode(file.read_bytes()).password != client.password:
            yield f"{file} is of another key"
    events: list[Event] = []
    finish_leftovers(disk / "recordings", events.append)
    yield from (str(event) for event in events if isinstance(event, Unfinished))


def words(log: Path, output: Path) -> str:
    """What the machine has printed; what its rig has where it did not come so far."""
    return (log if log.exists() else output).read_text(errors="replace")


def heard(log: Path) -> list[dict[str, Any]]:
    """All that the machine has said so far; the last line may not be whole yet."""
    lines = log.read_text().splitlines(keepends=True) if log.exists() else []
    said = [json.loads(line) for line in lines if line[:1] == "{" and line[-1:] == "\n"]
    trouble = [one for one in said if "trouble" in one]
    assert not trouble, "\n".join(str(text) for one in trouble for text in one.values())
    return said


def is_due(said: list[dict[str, Any]], phase: str, delay_s: float) -> bool:
    """Whether the phase began so long ago, by the machine's clock."""
    sign = "started" if phase == "starting" else "phase"
    begins = [n for n, one in enumerate(said) if sign in one]
    if phase == "stop" and begins:
        stopping = {"STOPPING", "FAULT"}
        begins = [n for n in range(begins[0], len(said)) if said[n].get("pulse") in stopping]
    return bool(begins) and said[-1]["at_s"] >= said[begins[0]]["at_s"] + delay_s


def looked_at(image: Path, place: Path) -> tuple[Path, str]:
    """The files on an image after the journal is replayed, and what e2fsck has against them."""
    place.mkdir()
    replayed = place.with_suffix(".replayed")
    shutil.copyfile(image, replayed)
    said = subprocess.run(
        ("e2fsck", "-fp", str(replayed)), capture_output=True, text=True, check=False
    )
    again = subprocess.run(
        ("e2fsck", "-fn", str(replayed)), capture_output=True, text=True, check=False
    )
    run("debugfs", "-R", f"rdump / {place}", str(replayed))
    replayed.unlink()
    is_clean = said.returncode in {0, 1} and again.returncode == 0
    return place, "" if is_clean else said.stdout + again.stdout


def told(killed: Life, after: Life) -> str:
    """One line: the kill, and what the next start has made of it."""
    last, next_start = killed.pulses[-1:], after.one("found")
    mode = last[0]["pulse"].lower() if last else "no record yet"
    assert killed.cut is not None
    written, unflushed, lost = killed.cut
    return (
        f"killed in {killed.phase} ({mode}; of {written} writes {unflushed} were not flushed, and"
        f" {lost} of these are lost): the next start is {next_start['found'].lower()}, cause"
        f" {next_start['verdict']}"
    )


def pairs(lives: list[Life]) -> list[tuple[Life, Life]]:
    """Each kill with the start after it."""
    return list(itertools.pairwise(lives))


def lasted_s(life: Life, *modes: str) -> float:
    """For how long the last modes before the kill had been these; 0: they were not."""
    pulses = life.pulses
    other = max((n for n, one in enumerate(pulses, 1) if one["pulse"] not in modes), default=0)
    return pulses[-1]["at_s"] - pulses[other]["at_s"] if other < len(pulses) else 0.0


def test_the_file_system_is_whole_after_each_kill_and_its_journal_is_replayed(lives):
    for life in lives:
        assert life.checked == "", life.phase
    for _, after in pairs(lives):
        assert any("recovery complete" in line for line in after.one("mounted")["mounted"])


def test_a_cut_at_any_other_write_leaves_files_that_can_be_read(lives):
    assert [one for life in lives for one in life.elsewhere] == []


def causes_after(life: Life) -> set[str]:
    """What the next start may find; for a while that of an older page of the state file."""
    match life.phase:
        case "starting":
            return {"NONE"}
        case "ready":
            settled = lasted_s(life, "READY") > SETTLED_S
            return {"NONE"} if settled else {"NONE", "LAST_END_UNKNOWN"}
        case "stop":
            settled = lasted_s(life, "STOPPING", "FAULT") > SETTLED_S
            return {"STOP_REQUESTED"} if settled else {"STOP_REQUESTED", "LAST_END_UNKNOWN"}
        case _:
            return {"LAST_END_UNKNOWN"}


def test_the_next_start_says_how_the_last_one_ended(lives):
    for killed, after in pairs(lives):
        next_start = after.one("found")
        assert next_start["cause"] in causes_after(killed), told(killed, after)
        assert (next_start["found"] == "FAULT") == (next_start["cause"] != "NONE")


def test_after_a_kill_nothing_has_power_or_moves_until_a_reset(lives):
    for _, after in pairs(lives):
        next_start = after.one("found")
        assert next_start["modes"] == [next_start["found"]]
        assert "OPERATION_ENABLED" not in next_start["powers"]
        assert max(next_start["path_si"]) < REST_SI
        if next_start["found"] == "FAULT":
            refused = next(one for one in after.said if one.get("asked") == "enable")
            assert refused["outcome"] == "refused"


def test_after_each_kill_the_machine_can_be_used_again(lives):
    for _, after in pairs(lives):
        assert "HOLD" in after.all("pulse"), after.phase
    ends = {one["ended"]: one["exit_code"] for one in lives[-1].said if "ended" in one}
    assert ends == dict.fromkeys(("record", "core", "gateway", "sim"), 0)


def test_what_was_answered_is_in_the_log_of_requests(lives):
    for life in lives:
        logged = [fields_of(line) for line in lines_of(life.disk / "state")]
        begin = max(
            (n for n, one in enumerate(logged) if one and one["kind"] == "start"), default=0
        )
        found = (
            (one["name"], one["outcome"])
            for one in logged[begin:]
            if one and one["kind"] == "answered"
        )
        settled = [
            (one["asked"], one["outcome"])
            for one in life.said
            if "asked" in one and one["at_s"] < life.end_s - SETTLED_S
        ]
        assert all(one in found for one in settled), life.phase  # in this order


def test_every_clip_that_was_there_is_whole(lives):
    for life in lives:
        clips = clip_files(life.disk / "state" / FOLDER)
        assert [clip.trouble for clip in clips] == [""] * len(clips), life.phase
        settled = [one["clips"] for one in life.pulses if one["at_s"] < life.end_s - SETTLED_S]
        assert {name for names in settled for name in names} <= {clip.path.name for clip in clips}
        for clip in clips:
            ring = RingReader(clip.path)
            assert clip.kept is not None
            assert len(ring.since(0)) == clip.kept.last_seq - clip.kept.first_seq + 1
            assert ring.damaged_count == 0
    assert any(one["clips"] for life in lives[:-1] for one in life.pulses)


def test_what_the_recorder_had_not_finished_is_finished_and_lacks_a_second(lives):
    for killed, after in pairs(lives):
        events = after.all("recorder")[0]
        told = {Path(one["path"]).name: one for one in events if one["event"] in ENDED}
        for part in (killed.disk / "recordings").glob(f"*{PART}"):
            name = part.name.removesuffix(PART)
            assert {name, part.name} & set(told), f"{killed.phase}: {part.name} is not mentioned"
        for name, event in told.items():
            if event["event"] == "finished":
                assert_whole(after.disk / "recordings" / name, event)
        if "recorder" in {key for one in killed.said for key in one}:
            (torn,) = (one for one in told.values() if one["event"] == "finished")
            assert torn["ended"] == TORN
            lost_s = (killed.pulses[-1]["utc_ns"] - torn["end_utc_ns"]) / 1e9
            print(f"\n{killed.phase}: the recording lacks {lost_s:.2f} s", end="")
            assert lost_s < RECORDER_LOSES_S
    assert not list((lives[-1].disk / "recordings").glob(f"*{PART}"))


def assert_whole(recording: Path, event: dict[str, Any]) -> None:
    with (recording / MESSAGES).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    estimates = [pq.read_table(file).num_rows for file in recording.glob("*.estimates.parquet")]
    assert summary.statistics.message_count + sum(estimates) == event["message_count"]


def test_sessions_and_keys_that_were_acknowledged_are_there(lives):
    strides: set[int] = set()
    clients: set[str] = set()
    for life in lives:
        before = [one for one in life.said if "strides" in one]
        if before:
            assert strides <= set(before[0]["strides"]), life.phase
            assert clients <= set(before[0]["clients"]), life.phase
        strides |= set(life.all("stride"))
        clients |= set(life.all("client"))
    assert strides and clients
    with Store(lives[-1].disk / "sessions.db", is_writer=False) as store:
        assert strides <= {row[8] for row in store.strides(PROFILE)}
        ends = [summary.end for summary in store.summaries(PROFILE)]
    assert set(ends[:-1]) == {INTERRUPTED}
