"""What can be wrong with the service's end of the lock-step bus, and with its time."""

import pytest
from sessions import new_session

from drives.canopen.bus import Frame
from drives.errors import BusError

MS = 1_000_000
FRAME = Frame(0x080, b"")


@pytest.fixture(scope="module")
def warm_bench():
    session = new_session()
    session.run(0.02)
    return session


def test_a_full_queue_drops_at_once_and_keeps_what_is_urgent_until_its_deadline(warm_bench):
    bus, before, now_ns = warm_bench.bus, len(warm_bench.bus.sent), warm_bench.bus.now_ns
    bus.trouble.queue_full = True
    bus.at(now_ns + 3 * MS, lambda: setattr(bus.trouble, "queue_full", False))

    assert bus.send([FRAME, FRAME]) == 2
    assert bus.send_urgent([FRAME], now_ns + 2 * MS, warm_bench.clock) == 1
    assert bus.now_ns == now_ns + 2 * MS
    assert bus.send_urgent([FRAME], now_ns + 9 * MS, warm_bench.clock) == 0
    assert len(bus.sent) == before + 1


def test_a_controller_that_is_off_neither_sends_nor_hears(warm_bench):
    bus, before = warm_bench.bus, len(warm_bench.bus.sent)
    bus.drain()
    bus.trouble.is_off = True

    assert bus.send([FRAME]) == 0
    bus.let_pass(bus.now_ns + 200 * MS)

    assert len(bus.sent) == before
    assert bus.drain() == []


def test_an_interface_that_is_gone_cannot_be_used_or_opened(warm_bench):
    warm_bench.bus.trouble.is_gone = True

    for use in (warm_bench.bus.open, warm_bench.bus.drain, lambda: warm_bench.bus.send([FRAME])):
        with pytest.raises(BusError):
            use()


def test_a_sync_that_waits_is_on_the_wire_later_and_nothing_else_is(warm_bench):
    bus = warm_bench.bus
    bus.trouble.sync_delay_ns = 2 * MS
    at_ns = bus.now_ns

    bus.send([FRAME, Frame(0x701, b"\x05")])
    bus.let_pass(at_ns + 5 * MS)

    assert [(one.can_id, one.time_ns - at_ns) for one in bus.sent[-2:]] == [
        (0x701, 0),
        (0x080, 2 * MS),
    ]


def test_a_service_that_is_held_finds_the_world_and_its_clock_farther_on(warm_bench):
    bus, world = warm_bench.bus, warm_bench.machine.world
    begun_ns = world.now_ns

    bus.at(begun_ns + 1 * MS, lambda: bus.hold(35 * MS))
    bus.let_pass(begun_ns + 5 * MS)

    assert world.now_ns == bus.now_ns == begun_ns + 36 * MS


def test_a_machine_that_was_suspended_finds_the_world_farther_on_and_its_clock_where_it_was(
    warm_bench,
):
    bus, world = warm_bench.bus, warm_bench.machine.world
    begun_ns = world.now_ns

    bus.at(begun_ns + 1 * MS, lambda: bus.pause(1000 * MS))
    bus.let_pass(begun_ns + 5 * MS)

    assert bus.now_ns == begun_ns + 5 * MS
    assert world.now_ns == begun_ns + 1005 * MS
    assert bus.behind_ns == 1000 * MS


def test_a_wall_clock_that_is_set_moves_no_deadline(warm_bench):
    now_ns, utc_ns = warm_bench.clock.now_ns(), warm_bench.clock.utc_ns()

    warm_bench.clock.utc_stepped_ns = -3_600_000 * MS

    assert warm_bench.clock.now_ns() == now_ns
    assert warm_bench.clock.utc_ns() == utc_ns - 3_600_000 * MS
