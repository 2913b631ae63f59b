"""Commands leave while their cycle lasts; those that stop a drive leave however late it is."""

from dataclasses import dataclass, field

import pytest

from daemon.core.runtime.commands import Commands
from drives.canopen.bus import Frame
from drives.canopen.nmt import NmtCommand, nmt_frame

END_NS = 10_000_000
LATEST_NS = 9_500_000
COMMAND = [Frame(0x201, b"\1")]
STOP = nmt_frame(NmtCommand.STOP, 1)


@dataclass
class Wire:
    """Line and clock at once; it keeps what is sent in which way."""

    now: int = 0
    is_full: bool = False
    calls: list[tuple] = field(default_factory=list)

    def now_ns(self):
        return self.now

    def send(self, frames):
        self.calls.append(("send", *frames))

    def drop(self, frames):
        self.calls.append(("drop", *frames))

    def send_urgent(self, frames, deadline_ns):
        self.calls.append(("urgent", *frames, deadline_ns))
        return not self.is_full


@pytest.mark.parametrize(("now_ns", "way"), [(LATEST_NS, "send"), (LATEST_NS + 1, "drop")])
def test_a_command_leaves_until_the_margin_before_the_next_sync(now_ns, way):
    wire = Wire(now_ns)
    Commands(wire, wire).send(COMMAND, (), END_NS, urgent=False)

    assert wire.calls == [(way, *COMMAND)]


def test_a_command_that_stops_a_drive_leaves_however_late():
    wire = Wire(END_NS)
    Commands(wire, wire).send(COMMAND, (), END_NS, urgent=True)

    assert wire.calls == [("urgent", *COMMAND, LATEST_NS)]


def test_nmt_stop_leaves_once_and_again_after_a_bring_up():
    wire = Wire()
    commands = Commands(wire, wire)
    for _ in range(2):
        commands.send(COMMAND, (1,), END_NS, urgent=False)
    commands.send(COMMAND, (1, 2), END_NS, urgent=False)
    commands.reset()
    commands.send(COMMAND, (1,), END_NS, urgent=False)

    stop, usual = ("urgent", STOP, LATEST_NS), ("send", *COMMAND)
    second = ("urgent", nmt_frame(NmtCommand.STOP, 2), LATEST_NS)
    assert wire.calls == [usual, stop, usual, usual, second, usual, stop]


def test_nmt_stop_that_met_a_full_queue_is_repeated():
    wire = Wire(is_full=True)
    commands = Commands(wire, wire)
    for _ in range(2):
        commands.send(COMMAND, (1,), END_NS, urgent=False)

    assert [call[0] for call in wire.calls] == ["send", "urgent", "send", "urgent"]
