"""An exception in a cycle is a bug of ours: it stops the machine before it ends the process."""

from unittest import mock

import pytest
from sessions import Session, changed_configs, position_guidance
from wire import rpdo1

from daemon.core import cycle
from daemon.core.loop import BLIND_STOP_CYCLES
from daemon.core.loop_settings import ExitCode

ENABLE = 0x0F
QUICK_STOP = 0x02


@pytest.mark.parametrize(("guided", "mode"), [(changed_configs, 10), (position_guidance, 8)])
def test_an_exception_in_a_cycle_stops_both_drives_and_ends_as_our_bug(tmp_path, guided, mode):
    session = Session(guided(tmp_path)).walking(warm_s=2)
    stood = [drive.feedback.position_counts for drive in session.lockstep.core.axes]
    bus = session.lockstep.bus
    before = len(bus.sent)

    with mock.patch.object(cycle, "judge", side_effect=ZeroDivisionError("ours")):
        code = session.lockstep.loop.run(lambda: False)

    sent = bus.sent[before:]
    words = {
        int.from_bytes(frame.data[:2], "little") for frame in sent if frame.can_id in {0x205, 0x206}
    }
    truth = session.truth.rows[-1]
    assert code == ExitCode.BUG
    assert isinstance(session.lockstep.loop.bug, ZeroDivisionError)
    assert words == {QUICK_STOP}
    for node, counts in zip((5, 6), stood, strict=True):
        told = rpdo1(sent, node)
        assert {one.mode for one in told} == {mode}
        assert all(abs(one.target_counts - counts) < 200 for one in told)
    assert sum(frame.can_id == 0x080 for frame in sent) >= BLIND_STOP_CYCLES
    assert abs(truth.hip_velocity_rad_per_s) < 0.05
    assert abs(truth.slide_velocity_m_per_s) < 0.05
