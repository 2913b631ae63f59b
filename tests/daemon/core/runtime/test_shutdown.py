"""The wait at shutdown ends when all axes are at rest without power, or after its time."""

from types import SimpleNamespace

import pytest
from fresh_core import fresh
from safety_inputs import FEEDBACK, JOINT, LIMITS

from daemon.core.runtime import shutdown
from daemon.core.runtime.shutdown import PowerOff
from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_FRAME, SyncProducer, heartbeat_frame
from drives.errors import BusError
from drives.signals import PowerState


def axis(power_state, velocity_si=0.0, *, known=True):
    sensed = SimpleNamespace(
        feedback=FEEDBACK._replace(power_state=power_state) if power_state else None,
        joint=JOINT._replace(velocity_si=velocity_si, known=known),
    )
    return SimpleNamespace(sensed=sensed, limits=LIMITS, node_id=5)


OFF, ON = PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED


def waited(*axes):
    power_off = PowerOff()
    return next(cycle for cycle in range(1, 10_000) if power_off.is_over(axes))


@pytest.mark.parametrize(
    ("axes", "cycles"),
    [
        ((axis(OFF), axis(OFF)), 1),
        ((axis(OFF), axis(ON)), 51),
        ((axis(OFF), axis(OFF, velocity_si=1.0)), 151),
        ((axis(OFF), axis(OFF, velocity_si=1.0, known=False)), 1),
        ((axis(OFF), axis(None)), 1),
    ],
)
def test_the_wait_is_as_long_as_the_axes_need_but_limited(axes, cycles):
    assert waited(*axes) == cycles


@pytest.mark.parametrize(
    ("state", "may", "shows_none"), [(OFF, False, True), (ON, True, False), (None, False, False)]
)
def test_an_axis_shows_whether_it_has_power_or_shows_nothing(state, may, shows_none):
    assert shutdown.may_exert_torque([axis(OFF), axis(state)]) is may
    assert shutdown.shows_no_power(axis(state)) is shows_none


class Bus:
    """Line and clock at once; it fails after some sends."""

    def __init__(self, works_for=1000, *, is_open=True):
        self.sync, self.is_open, self.now = SyncProducer(), is_open, 0
        self.calls, self.slept, self.works_for = [], [], works_for

    def now_ns(self):
        return self.now

    def sleep_until(self, deadline_ns):
        self.now = deadline_ns
        self.slept.append(deadline_ns)

    def send_urgent(self, frames, deadline_ns):
        self.calls.append((*frames, deadline_ns))
        if len(self.calls) > self.works_for:
            raise BusError("can0", "it is down")


def test_the_watch_of_drives_ends_by_a_reset_of_their_communication():
    bus = Bus()

    shutdown.end_watch(bus, [axis(OFF)], 77)

    assert bus.calls == [(Frame(0x000, bytes((0x82, 5))), 77)]


MS = 1_000_000


@pytest.mark.parametrize("works_for", [1000, 2])
def test_after_a_bug_quick_stops_leave_for_half_a_second_unless_the_bus_is_lost(works_for):
    bus, core = Bus(works_for), fresh().core
    stop = Frame(0x201, b"stop")
    core.drives = SimpleNamespace(frames=lambda stops: [stop] * len(stops))
    settings = SimpleNamespace(period_ns=10 * MS, master_node_id=127)

    shutdown.stop_without_feedback(core, bus, bus, settings)

    sent = (SYNC_FRAME, heartbeat_frame(127), stop, stop)
    count = min(works_for + 1, 50)
    assert bus.calls == [(*sent, (10 * number - 0.5) * MS) for number in range(1, count + 1)]
    assert len(bus.slept) == min(works_for, 50)


@pytest.mark.parametrize(("is_open", "drives"), [(False, object()), (True, None)])
def test_without_bus_or_drives_there_is_nothing_to_stop(is_open, drives):
    bus, core = Bus(is_open=is_open), fresh().core
    core.drives = drives

    shutdown.stop_without_feedback(core, bus, bus, None)

    assert bus.calls == []
