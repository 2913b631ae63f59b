"""Golden traces, hand-made from the standards: R lines are fed, T lines expected to the byte."""

import struct

import pytest
from candump import read_trace
from drive_files import CYCLE, HIP_LIMITS, TRACES, drive
from memory_bus import ManualClock

from drives.bringup import objects
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.bringup.steps import StepKind
from drives.canopen.nmt import SYNC_FRAME
from drives.cia402.drive import Drive, DriveGroup
from drives.errors import BringUpRefused
from drives.signals import DriveCommand, OperationMode, PowerRequest, PowerState

HIP = plan(drive("hip_epos4"), HIP_LIMITS, CYCLE)


class TraceBus:
    """Answers as the trace says, and only to what the trace expects."""

    def __init__(self, name, clock):
        self.lines = read_trace(TRACES / f"{name}.candump")
        self.clock = clock

    def send_urgent(self, frames, deadline_ns, clock):
        for frame in frames:
            line = self.lines.pop(0)
            assert line.sent, f"nothing was expected, {frame} was sent"
            assert frame[:2] == line.frame[:2]
        return 0

    def receive_until(self, deadline_ns, clock):
        frames = []
        while self.lines and not self.lines[0].sent:
            frames.append(self.lines.pop(0).frame)
        if not frames:
            self.clock.time_ns = deadline_ns
        return frames


def play(name, steps):
    """Run the steps of the plan that a trace shows; True if nothing of the trace is left."""
    clock = ManualClock()
    bus = TraceBus(name, clock)
    target = objects.SdoTarget(Configurator(bus, clock), "right/hip", 5)
    for step in steps:
        match step.kind:
            case StepKind.SWITCH_OFF:
                objects.switch_off(step, target)
            case StepKind.WRITE:
                objects.write(step, target, step.value)
            case StepKind.CLEAR:
                objects.clear(step, target)
            case _:
                objects.examine(step, target)
    return not bus.lines


def test_every_trace_can_be_read_and_runs_forward_in_time():
    for path in TRACES.glob("*.candump"):
        lines = read_trace(path)

        assert lines
        assert [line.time_ns for line in lines] == sorted(line.time_ns for line in lines)


def test_the_identity_of_node_5_is_read():
    steps = [step for step in HIP.steps if step.index == 0x1018]

    assert play("the_identity_of_node_5_is_read", steps)


def test_tpdo1_of_node_5_is_mapped():
    steps = [step for step in HIP.steps if step.index in (0x1800, 0x1A00)]

    assert play("tpdo1_of_node_5_is_mapped", steps)


def test_a_mapping_entry_is_refused():
    steps = [step for step in HIP.steps if (step.index, step.sub) == (0x1A00, 1)]

    with pytest.raises(BringUpRefused, match="cannot be mapped") as caught:
        play("a_mapping_entry_is_refused", steps)
    assert caught.value.place == "1A00h:01"


@pytest.mark.parametrize(
    ("name", "request_", "end"),
    [
        ("enabling_walks_through_every_state", PowerRequest.ENABLE, PowerState.OPERATION_ENABLED),
        (
            "a_quick_stop_from_ready_to_switch_on_never_energises",
            PowerRequest.QUICK_STOP,
            PowerState.SWITCH_ON_DISABLED,
        ),
        (
            "a_quick_stop_while_enabled_holds_in_quick_stop_active",
            PowerRequest.QUICK_STOP,
            PowerState.QUICK_STOP_ACTIVE,
        ),
        (
            "a_fault_reset_is_one_edge_and_ends_in_switch_on_disabled",
            PowerRequest.FAULT_RESET,
            PowerState.SWITCH_ON_DISABLED,
        ),
        (
            "a_fault_whose_cause_is_still_there_gets_one_edge",
            PowerRequest.FAULT_RESET,
            PowerState.FAULT,
        ),
    ],
)
def test_a_held_request_sends_what_the_standard_asks_for(name, request_, end):
    lines = read_trace(TRACES / f"{name}.candump")
    group = DriveGroup([Drive(drive("hip_epos4"), 0)])
    feedback = None
    cycle = 0

    while lines:
        assert lines.pop(0).frame[:2] == SYNC_FRAME[:2]
        cycle += 1
        received = taken(lines, sent=False)
        group.feed([line.frame for line in received], cycle)
        feedback = group.end_of_window(cycle, cycle)[0]
        (target,) = struct.unpack("<i", lines[0].frame.data[3:])
        command = DriveCommand(request_, OperationMode.CYCLIC_SYNC_TORQUE, target, 0)

        expected = [line.frame[:2] for line in taken(lines, sent=True)]
        assert [frame[:2] for frame in group.frames([command])] == expected

    assert feedback is not None
    assert feedback.power_state is end


def taken(lines, *, sent):
    """Take the lines of one direction from the front, up to the next SYNC."""
    found = []
    while lines and lines[0].sent == sent and lines[0].frame.can_id != SYNC_FRAME.can_id:
        found.append(lines.pop(0))
    return found
