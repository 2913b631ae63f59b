"""An exception in a cycle is a bug of ours: it stops the machine before it ends the process."""

from unittest import mock

from wire import rpdo1

from daemon.core.runtime.loop import STOP_WITHOUT_FEEDBACK_CYCLES
from daemon.core.runtime.loop_settings import ExitCode
from daemon.core.safety import checks

ENABLE = 0x0F
QUICK_STOP = 0x02


def test_an_exception_in_a_cycle_stops_both_drives_and_ends_as_our_bug(warm_guided_gait, guidance):
    stood = [drive.feedback.position_counts for drive in warm_guided_gait.core.axes]
    bus = warm_guided_gait.bus
    before = len(bus.sent)

    with mock.patch.object(checks, "check", side_effect=ZeroDivisionError("ours")):
        code = warm_guided_gait.loop.run(lambda: False)

    sent = bus.sent[before:]
    words = {
        int.from_bytes(frame.data[:2], "little") for frame in sent if frame.can_id in {0x205, 0x206}
    }
    truth = warm_guided_gait.truth.rows[-1]
    assert code == ExitCode.BUG
    assert isinstance(warm_guided_gait.loop.bug, ZeroDivisionError)
    assert words == {QUICK_STOP}
    for node, counts in zip((5, 6), stood, strict=True):
        told = rpdo1(sent, node)
        assert {one.mode for one in told} == {10 if guidance == "impedance" else 8}
        assert all(abs(one.target_counts - counts) < 200 for one in told)
    assert sum(frame.can_id == 0x080 for frame in sent) >= STOP_WITHOUT_FEEDBACK_CYCLES
    assert abs(truth.hip_velocity_rad_per_s) < 0.05
    assert abs(truth.slide_velocity_m_per_s) < 0.05
