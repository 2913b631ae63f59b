"""A soak judges what it sees: by its table, by the records, and by nothing else."""

import pytest
from msgspec.structs import replace
from records import record as any_record

from daemon.ipc.record import Cause, CycleRecord, Mode, StopCategory, Verdict
from gaitd_lab.soak import memory
from gaitd_lab.soak.fault_generator import SOURCES, ActiveFault, Actor, FaultGenerator
from gaitd_lab.soak.operator import Operator, Situation
from gaitd_lab.soak.record_monitor import Classification, RecordMonitor
from sim_drives.faults.script import parse_command

DRIVES = ("right/hip", "right/slide")
EMERGENCY = Verdict(StopCategory.S1, Cause.EMERGENCY, "right/hip")
SILENT = Verdict(StopCategory.S1, Cause.DRIVE_SILENT, "right/hip")


def drawn(seed: int, count: int = 300, *, deaths: bool = True) -> list[ActiveFault]:
    chances = FaultGenerator(seed, DRIVES)
    return [chances.next(deaths=deaths) for _ in range(count)]


def named(name: str) -> ActiveFault:
    return next(one for one in drawn(0, 5000) if one.name == name)


def walking(*verdicts: Verdict, **changes: object) -> list[CycleRecord]:
    """Records of a gait, with these verdicts at the end."""
    calm = [replace(any_record(seq), mode=Mode.GAIT, verdict=Verdict()) for seq in range(1, 41)]
    last = [
        replace(any_record(41 + n), mode=Mode.FAULT, verdict=verdict, **changes)
        for n, verdict in enumerate(verdicts)
    ]
    return calm + last


def the_stop(records: list[CycleRecord], happening: ActiveFault | None):
    sniffer = RecordMonitor()
    sniffer.process(records, 1.0, happening)
    (stop,) = sniffer.tally.stops
    return stop


def test_a_seed_draws_the_same_troubles_again_however_often_the_leg_walked_between_them():
    chances = FaultGenerator(7, DRIVES)
    found: list[ActiveFault] = []
    for number in range(100):
        for _ in range(number % 3):
            chances.walk()
        found.append(chances.next(deaths=True))

    assert found == drawn(7, 100)
    assert found != drawn(8, 100)


def test_every_trouble_of_the_table_is_drawn_and_the_virtual_drives_know_its_words():
    found = drawn(1, 5000)

    assert {one.name for one in found} == set(SOURCES)
    for one in found:
        if one.actor is Actor.DRIVE:
            for line in one.words.splitlines():
                assert parse_command(line).drive == one.drive


def test_no_process_is_killed_once_memory_is_told():
    assert not [one for one in drawn(1, 2000, deaths=False) if one.actor is Actor.KILL]


def test_a_stop_is_expected_if_the_matrix_names_its_cause_for_what_went_wrong():
    assert the_stop(walking(EMERGENCY), named("emcy_2xxx_fault")).judged is Classification.EXPECTED


@pytest.mark.parametrize("happening", [None, named("hand_switch"), named("patient_active")])
def test_a_stop_that_nothing_explains_is_unexpected(happening):
    assert the_stop(walking(EMERGENCY), happening).judged is Classification.UNEXPECTED


def test_one_unexpected_cause_that_follows_makes_the_stop_unexpected():
    overrun = Verdict(StopCategory.S1, Cause.CYCLE_OVERRUN)

    stop = the_stop(walking(EMERGENCY, overrun), named("emcy_2xxx_fault"))

    assert stop.causes == [Cause.EMERGENCY, Cause.CYCLE_OVERRUN]
    assert stop.judged is Classification.UNEXPECTED


def test_nothing_that_the_computer_did_excuses_a_stop():
    late = replace(any_record(1).timing, lateness_ns=60_000_000, overrun_count=9)
    records = walking(SILENT, timing=late)
    missing = tuple(replace(drive, fresh=False) for drive in records[-1].drives)

    assert the_stop(records, None).judged is Classification.UNEXPECTED
    assert the_stop(walking(SILENT, drives=missing), None).judged is Classification.UNEXPECTED


def test_of_an_unexpected_stop_by_the_observer_it_is_kept_what_it_said():
    invalid = Verdict(StopCategory.S2, Cause.OBSERVER_INVALID)

    assert "mean NIS" in the_stop(walking(invalid), None).evidence
    assert not the_stop(walking(SILENT), None).evidence


def test_what_is_lost_is_counted_apart_in_calm_and_in_trouble():
    sniffer = RecordMonitor()
    records = walking()
    lost = [
        replace(one, drives=(replace(one.drives[0], fresh=False), one.drives[1]))
        for one in records[:3]
    ]

    sniffer.process(lost, 0.0, None)
    sniffer.process(lost[:1], 0.0, named("silent"))

    tally = sniffer.tally.missed["right/hip"]
    assert (tally.calm_count, tally.trouble_count) == (3, 1)
    assert sniffer.tally.missed["right/slide"].calm_count == 0


def test_a_core_that_says_nothing_does_not_walk():
    sniffer = RecordMonitor()
    sniffer.process(walking(), 1.0, None)
    assert sniffer.walks

    sniffer.process([], 2.0, None)

    assert not sniffer.walks
    assert sniffer.newest is None


def test_the_operator_resets_once_more_where_an_axis_is_not_referenced():
    operator = Operator(lambda: {"mode": "gait"})
    refused = "not referenced: right/slide (its encoder is in error)"
    steps = (
        (1.0, None, ""),
        (2.0, None, ""),
        (2.1, "refused", refused),
        (4.0, None, ""),
        (4.1, "done", ""),
        (6.0, None, ""),
    )

    asked = [
        operator.next(Situation(now_s, Mode.READY, True, outcome, reason, referenced=False))
        for now_s, outcome, reason in steps
    ]

    assert [ask.name for ask in asked if ask] == ["enable", "reset", "enable"]


def test_the_operator_asks_for_what_is_next_and_again_after_a_refusal():
    operator = Operator(lambda: {"mode": "gait"})
    asked: list[str] = []
    steps = (
        (0.0, Mode.FAULT, False, None),  # the trouble is still there
        (1.0, Mode.FAULT, True, None),
        (1.1, Mode.FAULT, True, None),  # outstanding
        (1.2, Mode.READY, True, "done"),
        (2.2, Mode.READY, True, None),
        (2.4, Mode.READY, True, "refused"),
        (2.6, Mode.READY, True, None),  # a while after a refusal
        (3.5, Mode.READY, True, None),
        (3.6, Mode.HOLD, True, "done"),
        (4.7, Mode.HOLD, True, None),
        (4.8, Mode.GAIT, True, "done"),
        (9.0, Mode.GAIT, True, None),
    )
    for now_s, mode, clear, outcome in steps:
        ask = operator.next(Situation(now_s, mode, clear, outcome, "it moves"))
        if ask:
            asked.append(f"{now_s:g} {ask.name}")

    assert asked == ["1 reset", "2.2 enable", "3.5 enable", "4.7 mode"]
    assert operator.outcomes["enable refused: it moves"] == 1
    assert operator.outcomes["enable done"] == 1


def test_growth_is_the_slope_of_a_process_own_pages_after_its_warm_up():
    samples = [
        memory.Sample(float(t), 7, 100.0 + own, own, 5.0, t / 10)
        for t in range(0, 3600, 5)
        for own in [50.0 + min(t, 600) / 60 + t / 3600]
    ]

    (life,) = memory.lives("core", samples)

    assert life.growth_mb_per_h == pytest.approx(1.0)
    assert life.cpu_ratio == pytest.approx(0.1)
    assert life.ring_mb == 5.0


@pytest.mark.parametrize(("steps", "growth_mb_per_h"), [((1900,), 0.0), (range(0, 3600, 300), 6.0)])
def test_one_step_is_no_growth_and_a_step_again_and_again_is(steps, growth_mb_per_h):
    samples = [
        memory.Sample(float(t), 7, own, own, 5.0, 0.0)
        for t in range(0, 3600, 5)
        for own in [20.0 + 0.5 * sum(t >= step for step in steps)]
    ]

    (life,) = memory.lives("gateway", samples)

    assert life.growth_mb_per_h == pytest.approx(growth_mb_per_h, abs=0.3)


def test_a_process_that_was_started_anew_is_another_life():
    samples = [memory.Sample(float(t), pid, 9, 9, 0, 0) for pid in (1, 2) for t in range(20)]

    assert [life.pid for life in memory.lives("gateway", samples)] == [1, 2]
    assert memory.lives("gateway", samples)[0].growth_mb_per_h is None
