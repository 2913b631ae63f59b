"""Halt (controlword bit 8) from our table to the virtual drives, in both cyclic modes."""

import pytest
from wire import rpdo1

from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_FRAME, heartbeat_frame
from drives.signals import DriveCommand, OperationMode, PowerRequest, PowerState

PERIOD_NS = 10_000_000
HALT_WORD, ENABLE_WORD = 0x010F, 0x000F
FOLLOWS, REACHED = 0x1000, 0x0400
SPEED_COUNTS = 20
"""Step of the target per cycle, in position mode: 0.12 rad/s."""
CSP, CST = OperationMode.CYCLIC_SYNC_POSITION, OperationMode.CYCLIC_SYNC_TORQUE


class ByHand:
    """The drives of an enabled session without the core: frames of `drives/` alone."""

    def __init__(self, session):
        self.bus = session.bus
        self.group = session.core.drives
        self.commands = [
            DriveCommand(
                PowerRequest.ENABLE,
                axis.sent.mode,
                axis.sensed.feedback.position_counts,
                round(axis.sent.effort_si * axis.scaling.permille_per_effort_si),
            )
            for axis in session.core.axes
        ]
        self.feedbacks = ()
        self.cycle = session.record.cycle

    def run(self, cycles, hip=PowerRequest.ENABLE, moved_counts=0, permille=0):
        """Some cycles: the hip drive is asked for this, its target goes on by so much in each."""
        for _ in range(cycles):
            self.cycle += 1
            self.bus.send([SYNC_FRAME, heartbeat_frame(1)])
            self.bus.let_pass(self.bus.now_ns + PERIOD_NS)
            self.group.feed(self.bus.drain(), self.bus.now_ns)
            self.feedbacks = self.group.end_of_window(self.cycle, self.bus.now_ns)
            first, second = self.commands
            first = first._replace(
                power=hip,
                target_position_counts=first.target_position_counts + moved_counts,
                target_torque_permille=first.target_torque_permille + permille,
            )
            permille = 0
            self.commands = [first, second]
            self.bus.send(self.group.frames(self.commands))
        return self.feedbacks[0]


@pytest.fixture
def warm_enabled(request, kind):
    return request.getfixturevalue(f"warm_{kind}_hold")


def set_halt_option(session, option):
    """605Dh of the hip drive by an expedited SDO download."""
    session.bus.send([Frame(0x605, bytes((0x2B, 0x5D, 0x60, 0, option, 0, 0, 0)))])


@pytest.mark.parametrize(
    ("kind", "option", "mode"),
    [("position", None, CSP), ("generic", 2, CST)],
)
def test_a_halt_brakes_holds_in_operation_enabled_and_goes_on_when_released(
    warm_enabled, option, mode
):
    if option is not None:
        set_halt_option(warm_enabled, option)
    hand = ByHand(warm_enabled)
    push = 0 if mode is CSP else 300
    step = SPEED_COUNTS if mode is CSP else 0
    before = hand.run(1).position_counts
    moving = hand.run(20, moved_counts=step, permille=push)
    assert abs(moving.position_counts - before) > 50
    sent = len(hand.bus.sent)

    halted = hand.run(60, PowerRequest.HALT)
    stood = halted.position_counts
    halted = hand.run(40, PowerRequest.HALT)

    words = {told.controlword for told in rpdo1(hand.bus.sent[sent:], 5)}
    assert words == {HALT_WORD}
    assert abs(halted.position_counts - stood) <= 3
    assert halted.power_state is PowerState.OPERATION_ENABLED
    assert halted.statusword & (FOLLOWS | REACHED) == REACHED
    assert hand.feedbacks[1].power_state is PowerState.OPERATION_ENABLED

    gone_on = hand.run(20, moved_counts=step)

    assert rpdo1(hand.bus.sent, 5)[-1].controlword == ENABLE_WORD
    assert gone_on.statusword & FOLLOWS
    assert abs(gone_on.position_counts - stood) > 50
