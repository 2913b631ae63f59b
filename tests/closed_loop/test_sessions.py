"""Whole sessions through CAN frames: modes, requests, and the same bits every time."""

import hashlib
from itertools import groupby

import msgspec
import pytest
from gaitd_names import Cause, EventCode, Mode, Outcome, RefusalCode, RequestKind, Stage, Trigger
from records import both
from sessions import new_session, reported

from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from drives.signals import PowerState

ENABLING = 0b1000
"""Bit 3 of the controlword: enable operation."""


def controlwords(session, node_id):
    """All controlwords that the master has sent to a node, with their time."""
    sent = session.bus.sent
    return [
        (frame.time_ns, int.from_bytes(frame.data[:2], "little"))
        for frame in sent
        if frame.can_id == 0x200 + node_id
    ]


def test_nothing_is_enabled_without_a_request(warm_ready):
    warm_ready.run(0.3)

    assert not any(word & ENABLING for node in (5, 6) for _, word in controlwords(warm_ready, node))
    states = {drive.power_state for drive in warm_ready.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}


def test_enable_holds_the_leg_where_it_is_and_disable_lets_it_go(warm_hold):
    held = both(warm_hold.record.legs[0], "measured_position")
    warm_hold.run(1.2)

    record = warm_hold.record
    assert both(record.legs[0], "measured_position") == pytest.approx(held, abs=2e-3)
    assert 0.75 * record.bus_load_ratio < record.bus.load_ratio < record.bus_load_ratio
    assert warm_hold.request(RequestKind.DISABLE).outcome == Outcome.DONE
    warm_hold.run(0.2)
    assert warm_hold.record.mode == Mode.READY
    states = {drive.power_state for drive in warm_hold.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}


def test_gait_is_announced_and_ends_in_hold_after_its_duration(warm_hold):
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=0.5, duration_s=1.0)

    warm_hold.execute(RequestKind.MODE, gait)
    assert warm_hold.record.mode == Mode.GAIT
    ended = warm_hold.run_until(lambda record: record.mode == Mode.HOLD, within_s=40)

    told = reported(warm_hold.records, EventCode.STAGE_CHANGED)
    told_stages = [Stage.APPROACHING, Stage.PLAYING, Stage.ENDING]
    assert [one.values[:2] for one in told][:3] == [(Mode.GAIT, stage) for stage in told_stages]
    changes = [one.values for one in reported(warm_hold.records, EventCode.MODE_CHANGED)]
    assert changes[-1] == (Mode.GAIT, Mode.HOLD, Trigger.EXERCISE_OVER)
    stages = [stage for stage, _ in groupby(one.stage for one in warm_hold.records)]
    gait_stages = [Stage.ANNOUNCING, Stage.APPROACHING, Stage.PLAYING, Stage.ENDING]
    assert stages[-6:] == [None, *gait_stages, None]
    assert ended.verdict.cause == Cause.NONE


def test_the_artificial_disturbance_is_refused_with_a_patient(warm_hold):
    wanted = ModeRequest(Mode.EXCITE, duration_s=25.0, scenario="paper")
    answer = warm_hold.request(RequestKind.MODE, wanted)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.PATIENT_CONFIGURED)


def digest(session):
    encoder = msgspec.msgpack.Encoder()
    total = hashlib.sha256()
    for record in session.records:
        total.update(encoder.encode(record))
    for frame in session.bus.sent:
        total.update(frame.can_id.to_bytes(4, "little") + frame.data)
    return total.hexdigest()


def test_the_same_session_gives_the_same_records_and_frames_bit_for_bit():
    first, second = (new_session().walk() for _ in range(2))

    assert digest(first) == digest(second)
