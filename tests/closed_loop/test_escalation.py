"""A stop that is not obeyed goes further, step by step, by drives that ignore more and more."""

from collections import defaultdict, deque

import pytest
from gaitd_names import Cause, Mode
from wire import SYNC, change_what_drives_hear

from daemon.core.safety.stop_sequence import Step
from drives.canopen.frame import Frame

HIP = 5
NMT = 0x000
NMT_STOP = 0x02
ENABLED_WORD = 0x000F
QUICK_STOP_WORD = 0x0002
DISABLE_VOLTAGE_WORD = 0x0000


def ignoring(words, *, nmt):
    """The hip drive takes these controlwords for operation enabled, and NMT stop for nothing."""

    def change(frame: Frame) -> Frame:
        if frame.can_id == 0x200 + HIP and int.from_bytes(frame.data[:2], "little") in words:
            return Frame(frame.can_id, ENABLED_WORD.to_bytes(2, "little") + frame.data[2:])
        if nmt and frame.can_id == NMT and frame.data[:2] == bytes((NMT_STOP, HIP)):
            return Frame(0x7E0, b"")
        return frame

    return change


QS, OFF = QUICK_STOP_WORD, DISABLE_VOLTAGE_WORD


@pytest.mark.parametrize(
    ("ignored", "nmt", "reached"),
    [
        ((QS,), False, Step.DISABLE),
        ((QS, OFF), True, Step.SILENCE),
    ],
    ids=["quick stop", "disable voltage and NMT stop, too"],
)
def test_what_a_drive_ignores_takes_it_one_step_further_and_no_further(
    session, ignored, nmt, reached
):
    change_what_drives_hear(session, ignoring(set(ignored), nmt=nmt))

    session.command("hand_switch_open *")
    session.run(3.0)

    stops = [axis.stop for axis in session.core.axes]
    assert stops[0] is not None
    assert stops[0].step == reached
    record = session.record
    assert record.mode == Mode.FAULT
    assert record.verdict.cause == Cause.STOP_NOT_OBEYED
    last = session.bus.sent[-1].time_ns
    silent = session.bus.now_ns - last > 1_000_000_000
    assert silent == (reached == Step.SILENCE)
    # However deaf it was: in the end its own detection, or one of the steps, has stopped it.
    # Asked of the plant itself: the log of the truth has no row without a SYNC.
    assert max(map(abs, session.machine.trainers["right"].truth().velocity)) < 0.05
    assert any(frame.can_id == SYNC for frame in session.bus.sent)


COMMANDS_OF_THE_SLIDE = {0x206, 0x306}
OVERCURRENT = 0x2310
LATE_CYCLES = 2
BEFORE_PHASE = 0.65
"""Before the slide of the gait gains most of its speed."""


def hears_late(session):
    """The slide's drive hears its commands so late, which is within its time to obey."""
    heard = defaultdict(lambda: deque(maxlen=LATE_CYCLES + 1))

    def change(frame: Frame) -> Frame:
        if frame.can_id not in COMMANDS_OF_THE_SLIDE:
            return frame
        heard[frame.can_id].append(frame)
        return heard[frame.can_id][0]

    change_what_drives_hear(session, change)


def test_a_drive_whose_joint_gains_speed_until_it_obeys_has_obeyed(warm_fast_gait):
    session = warm_fast_gait
    session.run_until(lambda record: 0 <= record.gait_phase - BEFORE_PHASE < 0.01, within_s=3.0)
    hears_late(session)
    session.run(0.04)

    session.command(f"emcy right/hip - {OVERCURRENT}")
    session.until(Mode.FAULT, within_s=3.0)

    stopped = [record for record in session.records if record.mode == Mode.STOPPING]
    speeds_si = [abs(record.drives[1].velocity) for record in stopped]
    assert max(speeds_si) > 1.2 * speeds_si[0]
    assert {record.verdict.cause for record in stopped} == {Cause.EMERGENCY}
