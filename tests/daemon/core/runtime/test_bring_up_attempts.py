"""A bus that cannot be opened is tried again after a second."""

from fresh_core import fresh
from gaitd_names import Cause, Mode

from daemon.core.runtime.bring_up import RETRY_NS, BringUp
from daemon.core.runtime.bus_link import Line
from drives.errors import BusError


class Clock:
    now = 0

    def now_ns(self):
        return self.now


def no_bus():
    raise BusError("can0", "no such device")


def test_the_next_attempt_is_due_a_second_after_the_last():
    clock, built = Clock(), fresh()
    line = Line(no_bus, clock, 0, 127, 1_000_000)
    bring_up = BringUp(built.core, built.plans, built.cycle, line, clock)
    assert bring_up.is_due

    assert not bring_up.run(meanwhile=lambda: None)
    assert built.core.verdict.cause == Cause.BUS_DOWN
    clock.now = RETRY_NS - 1
    assert not bring_up.is_due
    clock.now = RETRY_NS
    assert bring_up.is_due
    built.core.mode = Mode.READY
    assert not bring_up.is_due
