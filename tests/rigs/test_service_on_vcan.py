"""The whole service on a real SocketCAN interface, seen by can-utils and by its own records.

In the virtual machine time counts instructions, so what is measured there does not depend on the
host, and may be asserted. Its one processor is some nine times slower than the host's.
"""

import itertools
from statistics import median

import pytest
from gaitd_names import Cause, EventCode, Mode
from sessions import reported
from wire import QUICK_STOP_WORD, cycles, rpdo1

from drives.canopen.bus_state import BusCondition

pytestmark = [pytest.mark.rig_vcan, pytest.mark.timeout(3000)]

MS = 1_000_000
PERIOD_NS = 10 * MS
BUDGET_NS = 8 * MS
"""Window and work of one cycle (design, section 6)."""
SYNC = 0x080
OURS = {0x701, *(base + node for base in (0x200, 0x300) for node in (5, 6))}
DRIVES = {base + node for base in (0x180, 0x280, 0x380, 0x080, 0x700) for node in (5, 6)}
TPDOS = {base + node for base in (0x180, 0x280) for node in (5, 6)}
RPDOS = {base + node for base in (0x200, 0x300) for node in (5, 6)}
SDOS = {base + node for base in (0x600, 0x580) for node in (5, 6)}
TEMPERATURE = bytes.fromhex("01 32 01")
"""3201h:01 as an SDO names it: an EPOS4 cannot map it, so the service reads it in the cycle."""
HOUR_NS = 3_600_000_000_000
STEPS_NS = [HOUR_NS, -2 * HOUR_NS, HOUR_NS]


def frames_of(world, name):
    return [seen.frame for seen in world.frames(name) if not seen.frame.is_error]


def causes(records):
    return {record.verdict.cause for record in records}


def test_sync_leaves_every_10_ms(vcan_world):
    times_ns = [seen.time_ns for seen in vcan_world.frames("quiet") if seen.frame.can_id == SYNC]
    gaps_ns = [after - before for before, after in itertools.pairwise(times_ns)]

    assert len(gaps_ns) > 150
    assert median(gaps_ns) == pytest.approx(PERIOD_NS, abs=20_000)
    assert all(abs(gap_ns - PERIOD_NS) < MS for gap_ns in gaps_ns)


def test_each_sync_is_answered_by_all_tpdos_and_only_then_come_the_commands(vcan_world):
    for frames in list(cycles(frames_of(vcan_world, "quiet")))[:-1]:
        order = [frame.can_id for frame in frames if frame.can_id in TPDOS | RPDOS]

        assert set(order[:4]) == TPDOS
        assert set(order[4:]) == RPDOS
        assert len(order) == 8


def test_nothing_is_on_the_bus_but_our_frames_and_those_of_our_drives(vcan_world):
    frames = frames_of(vcan_world, "quiet")
    assert {frame.can_id for frame in frames} <= {SYNC} | OURS | DRIVES | SDOS
    assert {frame.data[1:4] for frame in frames if frame.can_id in SDOS} == {TEMPERATURE}
    assert vcan_world.records("quiet")[-1].bus.stray_count == 0


def test_window_and_work_of_a_cycle_fit_into_8_ms(vcan_world):
    records = vcan_world.records("quiet")

    assert {record.mode for record in records} == {Mode.GAIT}
    longest_ns = max(record.timing.collect_ns + record.timing.work_ns for record in records)
    assert longest_ns <= BUDGET_NS
    assert {record.timing.overrun_count for record in records} == {records[0].timing.overrun_count}


def test_the_load_that_we_measure_is_the_one_that_canbusload_measures(vcan_world):
    rows = [line.split() for line in vcan_world.facts["canbusload"].splitlines() if "@" in line]
    measured = max(int(row[2]) for row in rows) / 1e6
    ours = vcan_world.records("quiet")[-1].bus.load_ratio

    assert ours == pytest.approx(measured, rel=0.05)


def test_answers_are_known_by_the_kernels_stamps(vcan_world):
    timings = [record.timing for record in vcan_world.records("quiet")]

    assert all(0 < timing.answer_ns <= timing.collect_ns for timing in timings)


def steps_of(records):
    found = []
    for before, after in itertools.pairwise(records):
        moved_ns = after.sync_utc_ns - before.sync_utc_ns
        step_ns = moved_ns - (after.sync_mono_ns - before.sync_mono_ns)
        if abs(step_ns) > 100_000:
            found.append(step_ns)
    return found


def test_a_wall_clock_that_is_set_while_the_leg_walks_stops_nothing_and_ages_no_sample(vcan_world):
    records = vcan_world.records("wall_clock")
    steps_ns = steps_of(records)
    far = [step_ns for step_ns in steps_ns if abs(step_ns) > 60_000 * MS]

    # `date` adds to what it has read some time before it sets the clock.
    assert far == [pytest.approx(step_ns, abs=100 * MS) for step_ns in STEPS_NS]
    assert len(steps_ns) > len(far)
    assert {record.mode for record in records} == {Mode.GAIT}
    assert causes(records) == {Cause.NONE}
    assert {drive.sample_age_cycles for record in records for drive in record.drives} == {0}
    late = {tuple(drive.late_count for drive in record.drives) for record in records}
    assert len(late) == 1


def test_an_injected_fault_stops_both_drives_between_the_same_two_syncs(vcan_world):
    frames = frames_of(vcan_world, "fault")
    emergency = next(
        index for index, frame in enumerate(frames) if frame.can_id == 0x085 and any(frame.data)
    )
    after = list(cycles(frames[emergency:]))
    until_sync = frames[emergency : emergency + frames[emergency:].index(after_sync(frames))]
    answers = [until_sync, *after]
    first = next(part for part in answers if any(words_of(part, node) for node in (5, 6)))

    assert all(QUICK_STOP_WORD in words_of(first, node) for node in (5, 6))
    assert vcan_world.records("fault")[-1].verdict.cause in {Cause.EMERGENCY, Cause.DRIVE_FAULT}


def after_sync(frames):
    return next(frame for frame in frames if frame.can_id == SYNC)


def words_of(frames, node):
    return [told.controlword for told in rpdo1(frames, node)]


def test_error_frames_of_the_kernel_are_told_and_only_bus_off_stops(vcan_world):
    records = vcan_world.records("error_frames")

    for code in (
        EventCode.CAN_WARNING,
        EventCode.CAN_PASSIVE,
        EventCode.CAN_ACTIVE,
        EventCode.CAN_OFF,
    ):
        assert reported(records, code), code.name
    before = [record for record in records if record.bus.bus_off_count == 0]
    assert {record.mode for record in before} == {Mode.GAIT}
    assert {BusCondition.PASSIVE.value, BusCondition.WARNING.value} <= {
        record.bus.condition for record in before
    }
    assert records[-1].verdict.cause == Cause.BUS_OFF


def test_while_the_controller_is_bus_off_nothing_of_ours_is_on_the_bus(vcan_world):
    seen = [one.frame for one in vcan_world.frames("error_frames")]
    begin = next(index for index, frame in enumerate(seen) if frame.can_id == 0x20000040)
    end = next(index for index, frame in enumerate(seen) if frame.can_id == 0x20000100)
    sent = [frame.can_id for frame in seen[begin:end] if frame.can_id in OURS | {SYNC}]

    # What had left before the report was read may still stand behind it.
    assert len(sent) <= len(OURS) + 1
    assert sent.count(SYNC) <= 1
    assert vcan_world.facts["bus_after_reset"] == BusCondition.ACTIVE.value


def test_a_transmit_queue_that_stays_full_drops_commands_and_ends_in_a_stop(vcan_world):
    records = vcan_world.records("queue_full")

    assert records[-1].tx_dropped_count > records[0].tx_dropped_count
    assert records[-1].mode == Mode.FAULT
    assert records[-1].verdict.cause != Cause.NONE


def test_a_cable_that_is_out_is_a_fault_that_a_reset_leaves_and_no_end_of_the_core(vcan_world):
    records = vcan_world.records("cable")

    assert records[-1].mode == Mode.FAULT
    assert Cause.BUS_DOWN in causes(records)
    assert vcan_world.facts["same_core"]
    assert vcan_world.facts["sim_without_bus"] == 4


def test_sigterm_while_the_leg_walks_brakes_switches_off_and_ends_with_0(vcan_world):
    frames = frames_of(vcan_world, "end")

    assert vcan_world.facts["core_exit"] == 0
    assert vcan_world.records("end")[-1].verdict.cause == Cause.SHUTDOWN
    last = {node: words_of(frames, node) for node in (5, 6)}
    assert all(QUICK_STOP_WORD in words for words in last.values())
    assert all(words[-1] in {0x0000, QUICK_STOP_WORD, 0x0006} for words in last.values())
