"""Bytes from outside are refused and counted, whatever they are: nothing else ever comes of them.

Each decoder gets what it knows with some bytes exchanged, noise, nesting without end, text that is
no UTF-8 and integers of thousands of digits. Drawn from a seed, so it is the same every time.
"""

import contextlib
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from gaitd_client import wire
from gaitd_names import EventCode, RequestKind, SetpointRefusal
from gaitd_texts import Reader, catalogue
from gaitd_toml import ConfigError, load_toml
from records import HEADER, cut_out, record

from analysis.recording import COLUMNS, RecordingError, read_csv
from analysis.replay import read, read_ring
from analysis.stop_recording import about, read_stop
from daemon.config.settings import Robot
from daemon.core.modes import latched_stop
from daemon.core.modes.persistent_state import PersistentState, StoredAxis, StoredVerdict
from daemon.core.runtime.state_file import StateFile
from daemon.gateway.requests import PAYLOADS, BadPayloadError, decode_payload
from daemon.gateway.setpoints import Arrival, SetpointStore
from daemon.ipc import transport
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import (
    AxisSetpoint,
    CycleRecord,
    GatewayState,
    ModeRequest,
    Request,
    Setpoint,
    Verdict,
)
from daemon.ipc.ring_clip import clip_file, trimmed
from daemon.ipc.state_file import NAME
from daemon.ipc.transport import CoreChannel, GatewayChannel, RingError, RingReader
from daemon.recorder.audit_file import fields_of
from daemon.recorder.audit_log import _fields_of_query
from daemon.recorder.ring_follower import RingFollower
from drives.cia402.axis_file import AxisFile

PROJECT = Path(__file__).parents[2]
CONFIGS = PROJECT / "configs"
COUNT = 2000
FILE_COUNT = 60
"""Count for files: each is written and read."""

LEVEL = msgspec.msgpack.encode(
    GatewayState(
        "boot",
        7,
        6,
        0,
        Request(3, RequestKind.MODE, 5, ModeRequest(scenario="paper")),
        (Setpoint(1, 2, 3, AxisSetpoint(4.0), AxisSetpoint(5.0), "right"),),
        1,
    )
)
SETPOINT = (
    b'{"lease": 7, "seq": 1, "for_cycle": 4, "hip": {"assist": 3.5},'
    b' "slide": {"assist": -20.0}, "stiffness_ratio": 0.5}'
)
QUERY = b'{"client": "display", "for_cycle": 12, "mode": "gait", "cadence_hz": 0.25}'
NOTES = msgspec.json.encode(
    PersistentState(
        axes={"right/hip": StoredAxis(0.3, 1_700_000_000_000_000_000)},
        latched=StoredVerdict(
            "S1", "EMERGENCY", "right/hip", 1.0, 2.0, "EMCY", "x", 1_700_000_000_000_000_000
        ),
    )
)
LINE = msgspec.json.encode({"kind": "start", "version": "0.1.0"})
CSV = (",".join(COLUMNS) + "\n" + "0.01,0.2,0.5,1.0,2.0\n0.02,,0.5,1.0,2.0\n" * 20).encode()

NASTY = (
    b"",
    b"\0",
    b"\xff\xfe\xfd",
    b'"\xff"',
    b"[" * 100_000,
    b'{"a":' * 50_000,
    b"\x91" * 100_000,
    b"\x81\xa1a" * 50_000,
    b"1" * 5000,
    b"a=" + b"[" * 100_000,
    b"a=" + b"1" * 5000,
    b"a=0x" + b"F" * 5000,
    b"a." * 1000 + b"a=1",
    b'{"client": "\\ud800 x"}',
    b'{"for_cycle": 1' + b"0" * 400 + b"}",
    b"\xdd\xff\xff\xff\xff",
    b"\xc1" * 40,
)


def shaken(good: bytes, count: int, from_byte: int = 0) -> Iterator[bytes]:
    """What is known to be good, with bytes exchanged, lost or added; and noise."""
    dice = random.Random(good)
    for _ in range(count):
        made = bytearray(good)
        for _ in range(dice.choice((1, 1, 2, 8))):
            at = dice.randrange(from_byte, len(made))
            made[at] = dice.randrange(256)
        if dice.random() < 0.1:
            del made[dice.randrange(from_byte, len(made)) :]
        yield bytes(made) if dice.random() < 0.9 else dice.randbytes(dice.randrange(300))


class Kind(NamedTuple):
    good: bytes
    take: Callable[[bytes], object]


def query(payload: bytes) -> None:
    for name in (*PAYLOADS, "enable"):
        with contextlib.suppress(BadPayloadError):
            decode_payload(name, payload)
    said = _fields_of_query(payload)
    msgspec.json.encode({"kind": "asked", **said})


def setpoint(payload: bytes) -> None:
    refusal = SetpointStore().receive(Arrival("right", payload), ["right"], 7)
    assert refusal is None or isinstance(refusal, SetpointRefusal)


def line(data: bytes) -> None:
    assert isinstance(fields_of(data), dict | None)


BYTES = {
    "setpoint": Kind(SETPOINT, setpoint),
    "query": Kind(QUERY, query),
    "line of the request log": Kind(LINE, line),
}


@pytest.mark.parametrize("kind", BYTES.values(), ids=BYTES)
def test_any_bytes_are_a_struct_or_refused(kind):
    for data in (*NASTY, *shaken(kind.good, COUNT)):
        kind.take(data)


def test_any_datagram_is_a_level_or_counted_and_told_more_and_more_rarely(tmp_path):
    core, gateway = CoreChannel(tmp_path, HEADER), GatewayChannel(tmp_path)
    present, sent, told = 0, 0, []

    for data in (*NASTY, *shaken(LEVEL, COUNT)):
        sent += gateway._datagrams.send(data)
        gateway_states = core.receive()
        present += len(gateway_states)
        told += core.take_notices()
        for level in gateway_states:
            assert gateway.send(level)  # what was taken can be said again
            assert len(core.receive()) == 1

    assert sent > COUNT
    assert present + core.refused_count == sent
    assert present > 100
    assert 3 <= len(told) <= 4
    assert {event.code for event in told} == {EventCode.STATES_REFUSED}
    assert (told[0].values, bool(told[0].said)) == ((1,), True)
    core.close()
    gateway.close()


def ring_of(path: Path, count: int = 40) -> bytes:
    robot = msgspec.to_builtins(load_toml(CONFIGS / "robot.toml", Robot))
    header = msgspec.structs.replace(HEADER, robot=robot)
    kept = transport.Kept("emergency", "right/hip", 20, 1_700_000_000_000_000_000, 1, count, True)
    with contextlib.closing(cut_out(map(record, range(1, count + 1)))) as cutting:
        pieces = trimmed(msgspec.structs.replace(header, kept=kept), cutting)
        path.write_bytes(b"".join(pieces))
    return path.read_bytes()


def look(path: Path) -> None:
    """Everything that reads a ring from a disk."""
    clip_file(path)
    with contextlib.suppress(RecordingError):
        read_ring(path)
    with contextlib.suppress(RingError), contextlib.closing(RingReader(path)) as ring:
        follower = RingFollower.starting_at(ring, live=False)
        assert len(list(follower.advance(100))) <= ring.slot_count
        for stop in filter(None, (follower.end(),)):
            assert isinstance(stop.utc_ns, int)
        assert len(ring.since(0)) + ring.damaged_count <= ring.slot_count


@pytest.mark.parametrize(
    "from_byte", [0, transport.HEADER_SIZE], ids=["anywhere", "in its records"]
)
def test_any_ring_is_read_as_far_as_it_can_be_or_refused(tmp_path, from_byte):
    good = ring_of(tmp_path / "good.ring")
    path = tmp_path / "some.ring"

    for data in (*NASTY, *shaken(good, FILE_COUNT, from_byte)):
        path.write_bytes(data)
        look(path)


def test_any_head_of_a_ring_is_read_or_refused(tmp_path):
    """The head is a small part of the file, so it is shaken by itself."""
    good = ring_of(tmp_path / "good.ring", count=2)
    length = 20 + int.from_bytes(good[16:20], "little")
    path = tmp_path / "some.ring"

    for head in shaken(good[:length], FILE_COUNT):
        path.write_bytes(head + good[len(head) :])
        look(path)


def test_damaged_records_are_left_out_of_a_replay_and_counted(tmp_path):
    path = tmp_path / "some.ring"
    good = ring_of(path)
    whole = read_ring(path)
    slot_size = int.from_bytes(good[8:12], "little")
    image = bytearray(good)
    for slot, at_byte in ((7, 12), (9, 8), (21, 40)):
        begin = transport.HEADER_SIZE + slot * slot_size + at_byte
        image[begin : begin + 20] = b"\xff" * 20
    path.write_bytes(image)

    source = read_ring(path)

    assert len(whole.recording.time_s) == 40
    assert len(source.recording.time_s) == 37
    assert ("damaged", "3 records, left out") in source.about
    assert ("damaged", "3 records, left out") in about(
        read_stop(path), catalogue(Reader.OPERATOR, "en")
    )
    assert not [title for title, _ in whole.about if title == "damaged"]


def test_any_state_file_is_believed_whole_or_latched_as_unreadable(tmp_path):
    huge = NOTES.replace(b"1700000000000000000", b"1" + b"0" * 30)
    for data in (huge, *NASTY, *shaken(NOTES, FILE_COUNT)):
        (tmp_path / NAME).write_bytes(data)
        state_file = StateFile(tmp_path)
        latched = state_file.persistent.latched
        assert latched is None or isinstance(latched_stop.verdict_of(latched), Verdict)
        state_file.write(state_file.persistent, 0)
        state_file.close()


@pytest.mark.parametrize(
    ("name", "kind"), [("robot.toml", Robot), ("drives/hip_epos4.toml", AxisFile)]
)
def test_any_configuration_file_is_read_or_refused_by_its_name(tmp_path, name, kind):
    path = tmp_path / "some.toml"

    for data in (*NASTY, *shaken((CONFIGS / name).read_bytes(), 40)):
        path.write_bytes(data)
        try:
            load_toml(path, kind)
        except ConfigError as error:
            assert str(path) in str(error)


def test_any_csv_is_a_recording_or_refused(tmp_path):
    path = tmp_path / "some.csv"

    for data in (*NASTY, *shaken(CSV, FILE_COUNT)):
        path.write_bytes(data)
        with contextlib.suppress(RecordingError):
            read_csv(path)


def test_what_is_refused_is_counted_and_says_why():
    decoder = Decoder(msgspec.msgpack.Decoder(CycleRecord).decode)

    with pytest.raises(RefusedError, match="utf-8"):
        Decoder(msgspec.json.Decoder(wire.Ask).decode).decode(b'{"client": "\xff"}')
    for data in NASTY:
        with pytest.raises(RefusedError, match=r"."):
            decoder.decode(data)

    assert decoder.refused_count == len(NASTY)


@pytest.mark.parametrize(
    "metadata",
    [
        {b"gaitd": b"\xff"},
        {b"gaitd": b"[" * 100_000},
        {b"gaitd.end": b'{"ended": "torn", "lost": "{", "stops": "[]"}'},
        {b"gaitd.end": b'{"ended": "torn", "lost": "{}", "stops": "[7]"}'},
    ],
)
def test_metadata_of_a_recording_that_are_nonsense_are_refused_with_the_file(tmp_path, metadata):
    file = tmp_path / "right.recording.parquet"
    table = pa.table({name: [0.0, 0.01] for name in COLUMNS})
    pq.write_table(table.replace_schema_metadata(metadata), file)

    with pytest.raises(RecordingError, match=r"right\.recording\.parquet: its metadata"):
        read(file)


def test_nothing_of_the_service_decodes_but_by_that_one_function():
    own = re.compile(
        r"msgspec\.(json|msgpack|toml)\.decode\(|(?<!Decoder\()msgspec\.\w+\.Decoder\("
    )
    found = {
        file.relative_to(PROJECT).as_posix()
        for package in ("daemon", "analysis")
        for file in (PROJECT / package).rglob("*.py")
        if own.search(file.read_text(encoding="utf-8"))
    }

    assert not found
