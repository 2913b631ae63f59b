"""The masters are compared by what a third station hears; no time of this run is judged."""

import math
from pathlib import Path

import pytest

from gaitd_lab.benchmark import bus_times, peers
from gaitd_lab.benchmark.bus_times import Reaction, TimedFrame

CONFIGS = Path(__file__).parents[2] / "configs"
ENABLED = b"\x37\x12"
STOPPING = b"\x17\x12"


def cycle(start_us: float, *, last_tpdo_us: float = 300.0, commands_us: float = 900.0):
    return [
        TimedFrame(start_us, 0x080, b""),
        TimedFrame(start_us + 200, 0x185, ENABLED),
        TimedFrame(start_us + last_tpdo_us, 0x186, ENABLED),
        TimedFrame(start_us + commands_us - 50, 0x305, b"\0\0"),
        TimedFrame(start_us + commands_us, 0x306, b"\0\0"),
    ]


def test_jitter_is_that_of_the_intervals_and_not_of_a_grid():
    starts = [0.0, 10_100.0, 20_100.0, 30_000.0]

    found = bus_times.syncs([frame for start in starts for frame in cycle(start)])

    assert found.sync_count == 4
    assert found.jitter_worst_us == pytest.approx(100.0)
    assert found.jitter_std_us == pytest.approx(81.65, abs=0.01)


def test_the_answer_is_from_the_last_tpdo_to_the_last_command():
    found = bus_times.syncs([frame for start in range(5) for frame in cycle(start * 10_000.0)])

    assert found.answer_median_us == pytest.approx(600.0)
    assert found.without_command_ratio == 0.0


def test_a_cycle_in_which_one_drive_gets_nothing_has_no_command():
    frames = [frame for start in range(5) for frame in cycle(start * 10_000.0)]
    del frames[3]  # the hip's first

    assert bus_times.syncs(frames).without_command_ratio == pytest.approx(0.25)


def test_a_bus_without_sync_is_no_result():
    with pytest.raises(ValueError, match="SYNC"):
        bus_times.syncs(cycle(0.0)[1:])


def test_the_reaction_is_of_the_other_drive_and_only_after_an_error():
    frames = [
        TimedFrame(0.0, 0x206, b"\x02\x00"),  # before: not counted
        TimedFrame(10.0, 0x085, b"\0\0\0"),  # no error
        TimedFrame(20.0, 0x206, b"\x0f\x00"),
        TimedFrame(100.0, 0x085, b"\x10\x23\x01"),
        TimedFrame(150.0, 0x205, b"\x02\x00"),  # its own
        TimedFrame(180.0, 0x206, b"\x0f\x00"),
        TimedFrame(400.0, 0x206, b"\x02\x00"),
        TimedFrame(900.0, 0x186, ENABLED),
        TimedFrame(1900.0, 0x186, STOPPING),
    ]

    assert bus_times.reaction(frames, 0) == Reaction(300.0, 1800.0)
    assert bus_times.reaction(frames[:-1], 0) is None
    assert bus_times.reaction(frames[:3], 0) is None


@pytest.mark.parametrize(
    ("word", "stops"),
    [(0x02, True), (0x00, True), (0x0F, False), (0x06, False), (0x80, False), (0x1F, False)],
)
def test_a_quick_stop_is_read_from_its_bits(word, stops):
    assert bus_times.requests_stop(bytes((word, 0))) is stops


def test_held_means_both_enabled_now():
    frames = cycle(0.0)

    assert bus_times.held(frames)
    assert not bus_times.held([*frames, TimedFrame(1.0, 0x186, STOPPING)])
    assert not bus_times.held([one for one in frames if one.can_id != 0x186])


@pytest.fixture(scope="module")
def cell():
    """The peer, on the virtual drives, for a second: whatever this computer does meanwhile."""
    made = peers.Cell(peers.MASTERS[3].name, loaded=False)
    peers.measure_cell(made, peers.MASTERS[3], CONFIGS, seconds=1.0, emergency_count=1)
    return made


def test_the_peer_holds_both_drives_and_stops_the_other_one_after_an_emergency(cell):
    assert cell.syncs[0].sync_count > 10
    assert cell.cpu_ratio[0] > 0
    assert len(cell.reactions) + cell.unanswered_count == 1


def test_each_figure_of_ours_is_beside_that_of_the_peer_with_the_same_scheduling_and_load():
    ours = peers.Cell("gaitd, plain", loaded=True, reactions=[Reaction(1500.0, 9000.0)])
    theirs = peers.Cell("python-canopen, plain", loaded=True, reactions=[Reaction(1000.0, 4500.0)])

    figures = {one.what: one for one in peers.figures([ours, theirs])}

    assert len(figures) == len(peers.ROWS)
    commanded = figures["EMCY to the other's quick stop on the bus, median, plain, under load"]
    assert (commanded.value, commanded.ratio) == (1500.0, 1.5)
    assert figures["EMCY until the other drive shows it, worst, plain, under load"].ratio == 2.0
    assert math.isnan(figures["SYNC off 10 ms, worst, plain, under load"].value)
