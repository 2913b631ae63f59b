"""`gaitd import-candump`: what the service saw comes out of the frames alone, to the last bit."""

import json
import math
import struct

import can
import numpy as np
import pytest
from bus_recorder import Wiretap
from candump import read_trace
from command_line import gaitd
from hypothesis import given
from hypothesis import strategies as st
from sessions import CONFIGS, new_session

from analysis.recording import read_csv
from analysis.stop_recording import inputs_of
from daemon.preflight.load import load
from drives.service.bus_recording import BusFrame, RecordedBusError, read_bus

TRAINER = CONFIGS / "demo.toml"
LEG = load(TRAINER).legs[0]
HIP, SLIDE = 5, 6
OF_NODE_7 = (0x187, 0x207, 0x587, 0x607, 0x707)
"""Frames of another node, and to it."""


@pytest.fixture(scope="module")
def walk():
    """From power-on to a gait with a patient: the session and all its frames."""
    session = new_session()
    wire = Wiretap(session.machine.world)
    session.walk(duration_s=3.0)
    return session, wire


@pytest.fixture
def dump(walk, tmp_path):
    """As another program writes it: can-utils' format by python-can."""
    path = tmp_path / "walk.log"
    with can.Logger(path) as logger:
        for line in walk[1].lines:
            for can_id in (line.frame.can_id, *OF_NODE_7):
                logger(
                    can.Message(
                        timestamp=1.7e9 + line.time_ns / 1e9,
                        arbitration_id=can_id,
                        data=line.frame.data,
                        is_extended_id=False,
                        channel="can0",
                    )
                )
    return path


def test_rows_are_what_the_service_gave_its_observer(walk, dump, tmp_path):
    written = tmp_path / "walk.csv"

    ended = gaitd("import-candump", dump, "--config", TRAINER, "--output", written)

    assert ended.code == 0, ended.err
    assert "mapping in the file" in ended.out
    recording = read_csv(written)
    legs = [record.legs[0] for record in walk[0].records if record.legs]
    inputs = np.array([inputs_of(leg) for leg in legs])
    seen = inputs[~np.isnan(inputs[:, :2]).any(axis=1)]
    count = min(len(seen), len(recording.time_s))
    assert count > 300
    offset = len(recording.time_s) - count
    np.testing.assert_array_equal(recording.position[offset:], seen[-count:, :2])
    np.testing.assert_array_equal(recording.effort[offset:], seen[-count:, 2:])
    np.testing.assert_allclose(np.diff(recording.time_s[offset:]), 0.01, atol=2e-6)


def test_the_trace_has_every_frame_of_drives_and_master_with_its_direction(walk, dump, tmp_path):
    trace = tmp_path / "trace.log"

    ended = gaitd(
        *("import-candump", dump, "--config", TRAINER, "--json"),
        *("--output", tmp_path / "walk.csv", "--trace", trace),
    )

    assert json.loads(ended.out)["leg"] == LEG.name
    made = [(line.frame, line.sent) for line in read_trace(trace)]
    assert made == [(line.frame, line.sent) for line in walk[1].lines]


# --- another master ------------------------------------------------------------------------------


def sdo(node, index, sub, value, *, confirmed=True):
    """A download of four bytes, and its answer; an odd sub-index without its size, as allowed."""
    place = struct.pack("<HB", index, sub)
    yield 0x600 + node, (b"\x22" if sub % 2 else b"\x23") + place + struct.pack("<I", value)
    yield 0x580 + node, (b"\x60" if confirmed else b"\x80") + place + bytes(4)


def foreign(confirmed=True):
    """Torque before position in TPDO4, on its own identifier; a refused change does not count."""
    for node, description in ((HIP, LEG.hip), (SLIDE, LEG.slide)):
        source = description.profile.torque_source
        torque = source.index << 16 | source.sub << 8 | source.bits
        yield from sdo(node, 0x1A03, 1, torque)
        yield from sdo(node, 0x1A03, 2, 0x60640020)
        yield from sdo(node, 0x1A03, 0, 2)
        yield from sdo(node, 0x1803, 1, 0x400 + node)
        yield from sdo(node, 0x1A03, 2, 0x606C0020, confirmed=not confirmed)
        for number in (1, 2, 3):
            yield from sdo(node, 0x17FF + number, 1, 1 << 31 | 0x80 + 0x100 * number + node)
    for cycle in range(3):
        yield 0x080, b""
        for node, description in ((HIP, LEG.hip), (SLIDE, LEG.slide)):
            width = description.profile.torque_source.bits // 8
            torque = (-7 * cycle).to_bytes(width, "little", signed=True)
            if not (cycle == 1 and node == SLIDE):
                yield 0x400 + node, torque + struct.pack("<i", 1000 * node + cycle)


def mapped(entry):
    """One object in TPDO1 of the hip."""
    return (*sdo(HIP, 0x1A00, 1, entry), *sdo(HIP, 0x1A00, 0, 1))


def timed(frames):
    return [BusFrame(0.01 * number, *frame) for number, frame in enumerate(frames)]


def test_another_master_s_mapping_is_taken_from_its_sdo_traffic():
    found = read_bus(timed(foreign()), LEG.hip, LEG.slide)

    assert len(found.rows) == 3
    assert found.missing == (0, 1)
    assert math.isnan(found.rows[1].slide_position_m)
    steps = np.diff([row.hip_angle_rad for row in found.rows])
    assert steps[0] == pytest.approx(steps[1])
    assert abs(steps[0]) > 0
    assert found.rows[0].hip_torque_nm == 0
    assert found.rows[2].hip_torque_nm == pytest.approx(2 * found.rows[1].hip_torque_nm)
    assert found.rows[1].hip_torque_nm != 0


def test_an_object_that_the_new_mapping_lacks_is_named():
    with pytest.raises(
        RecordedBusError, match=r"node 5: 6064h:00, the position, is in no synchronous TPDO"
    ):
        read_bus(timed(foreign(confirmed=False)), LEG.hip, LEG.slide)


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([(0x185, bytes(7))], "no SYNC"),
        ([(0x080, b"")], "1 SYNCs, 0 frames of node 5, 0 frames of node 6"),
        ([(0x080, b""), (0x185, bytes(5))], r"TPDO1 of node 5 \(185h\) at 0.010000 s has 5 bytes"),
        (
            [*sdo(HIP, 0x1A00, 0, 1 << 31), (0x080, b"")],
            "6064h:00, the position, is in no synchronous TPDO",
        ),
        (
            [*mapped(0x60640000), (0x080, b""), (0x185, b"")],
            "6064h:00, the position, is in no sync",
        ),
        ([*foreign(), *sdo(HIP, 0x6076, 0, 0)], "node 5: 6076h:00 is 0 in the file"),
        ([*sdo(HIP, 0x1803, 2, 255), *foreign()], "mapped in the file, transmission type 255"),
    ],
)
def test_frames_that_give_no_recording_are_refused(frames, words):
    with pytest.raises(RecordedBusError, match=words):
        read_bus(timed(frames), LEG.hip, LEG.slide)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0x080, 0x185, 0x286, 0x385, 0x585, 0x605, 0x606, 0x586, 0x7FF]),
            st.binary(max_size=8),
        ),
        max_size=40,
    )
)
def test_nonsense_on_the_bus_ends_in_rows_or_in_an_error_of_its_own(frames):
    try:
        found = read_bus(timed(frames), LEG.hip, LEG.slide)
    except RecordedBusError as error:
        assert str(error)
    else:
        assert found.rows


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("torn.log", "(1.0) can0 080#\n(1.1) can0 18", "none with samples of both drives"),
        ("back.log", "(2.0) can0 080#\n(1.0) can0 080#\n", "frame 2: time goes back to 1.000000 s"),
        (
            "two.log",
            "(1.0) can0 080#\n(1.1) can1 080#\n",
            "frame 2: it is of can1, the one before of can0",
        ),
        ("walk.txt", "", "must end in .asc, .blf, .csv, .log, .trc"),
        ("none.log", None, "No such file"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, text, words):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)

    ended = gaitd("import-candump", path, "--config", TRAINER, "--output", tmp_path / "out.csv")

    assert ended.code == 2
    assert words in ended.err
    assert name in ended.err
    assert "Traceback" not in ended.err
    assert not (tmp_path / "out.csv").exists()


def test_a_leg_that_the_trainer_has_not_is_refused(dump, tmp_path):
    ended = gaitd(
        *("import-candump", dump, "--config", TRAINER, "--leg", "left"),
        *("--output", tmp_path / "out.csv"),
    )

    assert ended.code == 2
    assert "--leg: left" in ended.err
