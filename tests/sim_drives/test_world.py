"""Lock-step: time is what it is told, and the same seed and frames give the same trace (S20)."""

import struct

import pytest
from drive_bench import CONFIGS, HIP, MS, SLIDE, Bench, FakePlant, settings

from drives.canopen.frame import Frame
from sim_drives.canopen.dictionary import read_eds
from sim_drives.canopen.timers import NEVER, Timers
from sim_drives.one_leg import Leg
from sim_drives.world import World


def session(seed):
    """A bring-up, some motion, a fault."""
    bench = Bench(seed=seed)
    bench.boot()
    for node_id in (5, 6):
        bench.go_operational(node_id)
        bench.write(0x1017, 0, 30, 2, node_id)
    bench.enable(10, 0, 100)
    bench.cycles(30, 0x0F, 10, 0, 100)
    bench.world.command("emcy right/slide 0.1 0x2310")
    bench.cycles(30, 0x0F, 10, 0, -100)
    return bench.trace


def test_the_same_seed_and_frames_give_the_same_trace_byte_for_byte():
    assert session(7) == session(7)


def test_another_seed_changes_when_answers_come_and_not_what_they_say():
    one, other = session(7), session(8)

    assert one != other
    said, said_there = ([(t.can_id, t.data) for t in trace] for trace in (one, other))
    assert sorted(said) == sorted(said_there)


def test_how_time_is_cut_into_steps_changes_nothing_on_the_bus():
    def beats(step_ms):
        bench = Bench()
        bench.boot()
        bench.write(0x1017, 0, 7, 2)
        bench.send(0x080)
        for _ in range(round(140 / step_ms)):
            bench.run_ms(step_ms)
        return bench.trace

    assert beats(140) == beats(1) == beats(20)


def test_frames_come_out_in_the_order_of_their_times(bench):
    for node_id in (5, 6):
        bench.go_operational(node_id)
        bench.write(0x1017, 0, 3, 2, node_id)
    bench.forget()

    bench.cycles(20)

    times = [timed.time_ns for timed in bench.trace]
    assert times == sorted(times)


def test_time_never_goes_back(bench):
    with pytest.raises(ValueError, match="cannot go back"):
        bench.world.advance_to(bench.world.now_ns - 1)


def test_the_next_event_is_known_ahead():
    bench = Bench()

    assert bench.world.next_event_ns() == 100 * MS
    bench.boot()
    assert bench.world.next_event_ns() == NEVER
    bench.write(0x1017, 0, 50, 2)
    assert bench.world.next_event_ns() == bench.world.now_ns + 50 * MS


def test_each_sync_is_counted_and_reported_with_the_plant_at_its_time():
    plant, seen = FakePlant(), []
    drives = settings(HIP), settings(SLIDE)
    entries = [read_eds(CONFIGS / drive.eds, drive.node_id) for drive in drives]
    leg = Leg("right", plant, drives[0], entries[0], drives[1], entries[1])
    world = World([leg], seed=1, on_sync=lambda count: seen.append((count, plant.now_ns)))

    for at_ms in (500, 510, 520):
        world.advance_to(at_ms * MS)
        world.receive(Frame(0x080, b""))

    assert seen == [(1, 500 * MS), (2, 510 * MS), (3, 520 * MS)]


def test_two_legs_live_on_one_bus_and_by_themselves():
    def leg(name, first_id):
        drives = settings(HIP, node_id=first_id), settings(SLIDE, node_id=first_id + 1)
        entries = [read_eds(CONFIGS / drive.eds, drive.node_id) for drive in drives]
        return Leg(name, FakePlant(), drives[0], entries[0], drives[1], entries[1])

    world = World([leg("right", 5), leg("left", 7)], seed=1)

    sent = world.advance_to(500 * MS)

    assert sorted(timed.can_id for timed in sent) == [0x705, 0x706, 0x707, 0x708]
    assert world.drives == ("right/hip", "right/slide", "left/hip", "left/slide")


def test_deadlines_run_in_their_order_also_those_that_others_start():
    timers, ran = Timers(), []
    timers.start("late", 30, lambda: ran.append("late"))
    timers.start("first", 10, lambda: timers.start("between", 20, lambda: ran.append("between")))
    timers.start("never", 99, lambda: ran.append("never"))

    timers.run_due(30)

    assert ran == ["between", "late"]
    assert timers.next_ns == 99


def test_a_heartbeat_survives_a_busy_bus(bench):
    bench.write(0x1016, 1, 1 << 16 | 100, 4)
    bench.go_operational()
    for number in range(100):
        if number % 2 == 0:
            bench.send(0x701, b"\x05")
        bench.send(0x205, struct.pack("<Hbi", 0x06, 0, 0))
        bench.cycle()

    assert bench.frames(0x085) == []
