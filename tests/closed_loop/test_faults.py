"""Stops of both axes by faults that tests/faults does not play, and the way back from a stop."""

from itertools import pairwise

import pytest
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind, StopCategory
from sessions import reaches_rest_in_fault

from daemon.ipc.report import Refusal
from drives.canopen.frame import Frame
from drives.signals import PowerState


def stopped_by(session, line):
    """Give this line to the machine; the record in which the stop begins."""
    session.command(line)
    return session.run_until(lambda record: not record.mode.active, within_s=2)


def test_a_drive_that_turns_out_to_be_wired_the_wrong_way_round_is_stopped_at_once(warm_gait):
    """It is named and loses its power."""
    drive = "right/slide"
    warm_gait.run(0.8)
    begun_ns = warm_gait.record.sync_mono_ns

    stopped = stopped_by(warm_gait, f"encoder_reversed {drive}")
    warm_gait.run(0.1)

    assert stopped.sync_mono_ns - begun_ns < 500_000_000
    verdict = stopped.verdict
    assert (verdict.cause, verdict.drive) == (Cause.SIGN_WRONG, drive)
    assert verdict.category == StopCategory.S0
    states = {one.name: one.power_state for one in warm_gait.record.drives}
    assert states.pop(drive) == PowerState.SWITCH_ON_DISABLED
    assert set(states.values()) == {PowerState.QUICK_STOP_ACTIVE}
    reaches_rest_in_fault(warm_gait)


@pytest.mark.parametrize(
    ("fault", "drive"),
    [("ignores_quick_stop {}", "right/hip"), ("slow_state {} - 30", "right/slide")],
)
def test_a_drive_that_stops_badly_stops_all_the_same(warm_gait, fault, drive):
    warm_gait.command(fault.format(drive))

    stopped_by(warm_gait, f"hand_switch_open {drive}")

    reaches_rest_in_fault(warm_gait)


def test_a_reset_while_the_hand_switch_is_open_is_refused_with_the_reason(warm_gait):
    stopped_by(warm_gait, "hand_switch_open right/hip")
    reaches_rest_in_fault(warm_gait)

    answer = warm_gait.request(RequestKind.RESET)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.HAND_SWITCH_OPEN)


def test_a_drive_that_dies_at_rest_is_looked_for_again_and_found(warm_ready):
    warm_ready.command("silent right/hip 2")

    lost = warm_ready.run_until(lambda record: record.mode == Mode.OFF, within_s=1)
    found = warm_ready.run_until(lambda record: record.mode == Mode.READY, within_s=20)

    assert lost.verdict.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST, Cause.DRIVE_REBOOTED}
    assert found.verdict.cause == Cause.NONE


def test_one_reset_is_one_edge_also_of_a_drive_whose_cause_lasts(warm_hold):
    stopped_by(warm_hold, "emcy right/hip - 0x2310")
    warm_hold.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    begun = len(warm_hold.bus.sent)

    warm_hold.request(RequestKind.RESET)
    warm_hold.run(0.5)

    words = [
        int.from_bytes(frame.data[:2], "little")
        for frame in warm_hold.bus.sent[begun:]
        if frame.can_id == 0x205
    ]
    rises = sum(new & ~old & 0x80 != 0 for old, new in pairwise(words))
    assert rises == 1


class OtherMaster:
    """Enables node 5 behind our master: whatever it says last before a SYNC counts."""

    def __init__(self, world):
        self.world, self.words = world, iter((0x06, 0x07))
        self.receive, world.receive = world.receive, self.hear

    def hear(self, frame):
        self.receive(frame)
        if frame.can_id == 0x205:
            word = next(self.words, 0x0F)
            self.receive(Frame(0x205, word.to_bytes(2, "little") + frame.data[2:]))


def test_a_drive_that_another_master_enables_is_told_and_latched(warm_ready):
    OtherMaster(warm_ready.machine.world)

    warm_ready.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)

    record = warm_ready.record
    assert record.verdict.cause == Cause.UNEXPECTED_ENABLE
    assert record.verdict.drive == "right/hip"
    assert warm_ready.request(RequestKind.ENABLE).outcome == Outcome.REFUSED
