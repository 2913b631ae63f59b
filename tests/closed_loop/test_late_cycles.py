"""A cycle whose work takes too long: what stops a drive leaves all the same, and nothing is fed."""

from unittest import mock

import pytest
from gaitd_names import Mode
from supervised import watched
from wire import rpdo1

from daemon.core import cycle

MS = 1_000_000
QUICK_STOP = 0x02


def late_where(session, is_so, until_ms):
    """From now on, work that ends so long after the SYNC of each cycle whose record is so."""
    step, bus = cycle.step, session.bus

    def slow(core, frames, gateway_states, tick):
        outgoing, record = step(core, frames, gateway_states, tick)
        if is_so(record):
            bus.let_pass(tick.sync_ns + round(until_ms * MS))
        return outgoing, record

    return mock.patch.object(cycle, "step", slow)


@pytest.mark.parametrize("until_ms", [9.8, 14.0])
def test_a_stop_leaves_in_the_cycle_that_found_it_however_late(warm_gait, until_ms):
    found = []

    def is_first(record):
        found.extend([record] if record.mode == Mode.STOPPING else [])
        return len(found) == 1 and record is found[0]

    with late_where(warm_gait, is_first, until_ms):
        warm_gait.command("hand_switch_open right/hip")
        warm_gait.run_until(lambda record: record.mode == Mode.STOPPING, within_s=1)

    stopping = found[0]
    since_ns = stopping.sync_mono_ns
    sent = [frame for frame in warm_gait.bus.sent if frame.time_ns >= since_ns]
    for node in (5, 6):
        (told, *_) = rpdo1(sent, node)
        assert told.controlword == QUICK_STOP
    assert sent[-1].time_ns < since_ns + (until_ms + 0.5) * MS


def test_a_cycle_whose_work_took_longer_than_its_period_is_not_fed(warm_hold):
    session = watched(warm_hold)
    session.systemd.forget()
    begun = session.record
    late = begun.cycle + 20

    with late_where(session, lambda record: record.cycle == late, 14.0):
        session.run(0.4)

    now = session.record
    missed = now.timing.overrun_count - begun.timing.overrun_count
    assert missed == 1
    turns = now.seq - begun.seq
    assert len(session.systemd.fed_ns) == turns - 1
