"""A bus that cannot be opened is tried again after a second."""

from types import SimpleNamespace

import pytest
from fresh_core import fresh
from gaitd_names import Cause, Mode

from daemon.core.runtime import bring_up
from daemon.core.runtime.bring_up import BringUp
from daemon.core.runtime.bus_link import Line
from daemon.ipc.record import Verdict
from drives.errors import BusError

RETRY_NS = 1_000_000_000


BEGUN_NS = 3_000_000_000


class Clock:
    now = BEGUN_NS

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
    verdict = built.core.verdict
    assert (verdict.cause, verdict.drive) == (Cause.BUS_DOWN, "")
    assert verdict.said == "can0: no such device"
    clock.now += RETRY_NS - 1
    assert not bring_up.is_due
    for _ in range(2):
        clock.now += 1
        assert bring_up.is_due
    for mode in (Mode.FAULT, Mode.READY):
        built.core.mode = mode
        assert not bring_up.is_due


class Bus:
    """A bus that opens and closes."""

    def __init__(self):
        self.closed_count = 0

    def close(self):
        self.closed_count += 1


@pytest.mark.parametrize("cause", [Cause.NONE, Cause.BUS_DOWN, Cause.BRING_UP_FAILED])
@pytest.mark.parametrize(("found", "reset_cycles"), [(True, 1), (False, 0)])
def test_a_bring_up_runs_with_cycles_between_its_steps_and_closes_a_bus_that_fails(
    monkeypatch, cause, found, reset_cycles
):
    clock, built, bus, calls = Clock(), fresh(), Bus(), []
    line = Line(lambda: bus, clock, 0, 127, 1_000_000)
    core = built.core
    monkeypatch.setattr(line, "port", lambda **asked: asked)
    core.reset_cycles_left = reset_cycles

    def steps(given, plans, port, settings):
        assert (given, plans, settings) == (core, built.plans.usual, built.cycle)
        assert port == {"requested": reset_cycles > 0, "meanwhile": meanwhile}
        yield 1
        yield 2
        core.drives = SimpleNamespace(bus_state=None) if found else None
        core.verdict = Verdict(cause=cause)

    def meanwhile():
        calls.append(clock.now)
        clock.now += 5

    monkeypatch.setattr(bring_up, "bring_up_core", steps)
    attempts = BringUp(core, built.plans, built.cycle, line, clock)

    assert attempts.run(meanwhile)
    assert calls == [BEGUN_NS, BEGUN_NS + 5]
    assert line.is_open is (cause is not Cause.BUS_DOWN)
    assert core.drives is None or core.drives.bus_state is line.bus_state
    assert (core.drives is not None) is found
    clock.now += RETRY_NS - 1
    assert not attempts.is_due
    clock.now += 1
    assert attempts.is_due


def test_a_bus_that_is_lost_is_closed_and_tried_again_after_a_second():
    clock, built, bus = Clock(), fresh(), Bus()
    line = Line(lambda: bus, clock, 0, 127, 1_000_000)
    line.open()
    attempts = BringUp(built.core, built.plans, built.cycle, line, clock)

    attempts.lose_bus(BusError("can0", "it is down"))

    assert (bus.closed_count, attempts.is_due) == (1, False)
    assert built.core.verdict.cause == Cause.BUS_DOWN
    assert built.core.verdict.said == "can0: it is down"
    clock.now += RETRY_NS - 1
    assert not attempts.is_due
    clock.now += 1
    assert attempts.is_due
