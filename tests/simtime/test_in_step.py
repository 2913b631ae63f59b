"""The core waits for its gateway: at a breakpoint without end, stopped by a signal not at all."""

import os
from types import SimpleNamespace

import pytest
from records import record

from daemon.ipc.record import GatewayState
from simtime import in_step
from simtime.in_step import InStepChannel
from simtime.processes import IN_A_DEBUGGER, STOPPED

BREAKPOINT_LOOKS = 40
HANGS = "S"


class Seam:
    """To a gateway that says what it is told to."""

    def __init__(self):
        self._reader, self._writer = os.pipe()
        self.found = []

    def say(self, level):
        self.found.append(level)
        os.write(self._writer, b"0")

    def fileno(self):
        return self._reader

    def publish(self, published):
        return True

    def receive(self):
        found, self.found = self.found, []
        return found


def level(cycle):
    return GatewayState("boot", 1, cycle, 0)


@pytest.mark.parametrize(
    ("state", "checks", "waited"),
    [
        (IN_A_DEBUGGER, BREAKPOINT_LOOKS, True),
        (STOPPED, in_step.STOPPED_CHECKS, False),
        (HANGS, 5, False),
    ],
)
def test_a_silent_gateway_is_waited_for_as_its_process_deserves(
    tmp_path, monkeypatch, state, checks, waited
):
    monkeypatch.setattr(in_step, "CHECK_MS", 1)
    monkeypatch.setattr(in_step, "TIMEOUT_CHECKS", 5)
    seam, looked, said_here = Seam(), [], []

    def look(pid):
        looked.append(pid)
        if len(looked) == BREAKPOINT_LOOKS:
            seam.say(level(10))
        return state if len(looked) <= BREAKPOINT_LOOKS else HANGS

    monkeypatch.setattr(in_step, "process_state", look)
    (tmp_path / "lock").write_text("4711")
    seat = SimpleNamespace(is_in_step=True, send_alive=lambda: said_here.append(len(looked)))
    held = InStepChannel(seam, "boot", tmp_path / "lock", seat)
    seam.found.append(level(1))
    held.receive()
    held.publish(record(10))

    levels = held.receive()

    assert looked[:checks] == [4711] * checks
    assert [one.for_cycle for one in levels] == ([10] if waited else [])
    assert bool(said_here) == waited
    if not waited:
        assert len(looked) == checks
