"""The minute with a passive patient: which strides count, when it is over, what is then known."""

from types import SimpleNamespace

import numpy as np
import pytest
from gaitd_names import EventCode, Finding, Mode, Stage
from msgspec.structs import replace

from daemon.core.slices import Estimated, Passive
from daemon.core.steps import passive
from daemon.core.steps.passive import AGE_STEP_S, MINUTE_S, advance, begun, from_file, news
from daemon.ipc.report import Event
from observer.baseline import (
    FADE_S,
    LONG_AGO,
    Baseline,
    NotPassiveError,
    Since,
    Unfit,
    known,
)
from observer.filter.considered import NOTHING_KNOWN
from observer.strides import COLUMNS, HIP

TAKEN = Baseline(np.ones(2), np.eye(2), (0.2, 1.5), (False, True), 9, 0.25, 0.5)
ROWS = np.zeros((2, COLUMNS))
ROWS[1, HIP] = TAKEN.swing_rad
STRIDE = SimpleNamespace(duration_s=4.0, cadence_hz=0.25)
CYCLES_PER_STEP = round(AGE_STEP_S / 0.01)


class Strides:
    """Strides of a minute that gives what a test says."""

    def __init__(self, duration_s=0.0, gives=TAKEN):
        self.duration_s, self.gives, self.added = duration_s, gives, []

    def add(self, stride, rows):
        self.added.append((stride, rows))

    def result(self):
        if isinstance(self.gives, Exception):
            raise self.gives
        return self.gives


def leg_with(
    stride=STRIDE,
    stage=Stage.PLAYING,
    *,
    origin_moved=False,
    guidance_ratio=0.8,
    temperatures_degc=(30.0, 40.0),
):
    def axis(name, temperature_degc, *, moved):
        feedback = SimpleNamespace(temperature_degc=temperature_degc)
        if temperature_degc == "no answer yet":
            feedback = None
        sensed = SimpleNamespace(origin_moved=moved, feedback=feedback)
        return SimpleNamespace(name=f"right/{name}", sensed=sensed)

    return SimpleNamespace(
        name="right",
        estimated=Estimated(stride=stride),
        exercise=None if stage is None else SimpleNamespace(stage=stage),
        observers=SimpleNamespace(
            strides=SimpleNamespace(completed=ROWS), frictional=(False, True)
        ),
        axes=(
            axis("hip", temperatures_degc[0], moved=False),
            axis("slide", temperatures_degc[1], moved=origin_moved),
        ),
        guidance_ratio=guidance_ratio,
    )


@pytest.mark.parametrize(("ramp_strides", "growing"), [(1.0, 1), (1.5, 2), (2.0, 2)])
def test_a_minute_begins_without_knowledge_and_without_the_strides_in_which_the_gait_grows(
    ramp_strides, growing
):
    minute = begun(leg_with(), ramp_strides)

    assert (minute.known, minute.baseline) == (NOTHING_KNOWN, None)
    assert (minute.strides.stride_count, minute.growing_strides) == (0, growing)


def test_strides_of_a_grown_gait_that_plays_are_of_the_minute_and_no_others():
    strides = Strides()
    minute = Passive(strides=strides, growing_strides=3)

    for stage in (Stage.APPROACHING, Stage.PREPARING, None):
        assert advance(leg_with(stage=stage), minute, Mode.GAIT, 5) is minute
    assert advance(leg_with(None), minute, Mode.GAIT, 5) is minute
    grown = minute
    for growing in (2, 1, 0):
        grown = advance(leg_with(), grown, Mode.GAIT, 6)
        assert (grown.growing_strides, strides.added) == (growing, [])
    assert advance(leg_with(None), grown, Mode.GAIT, 7) is grown
    assert advance(leg_with(), grown, Mode.GAIT, 8) is grown
    assert strides.added == [(STRIDE, ROWS)]


@pytest.mark.parametrize(
    ("duration_s", "mode", "over"),
    [
        (59.5, Mode.GAIT, False),
        (60.0, Mode.GAIT, True),
        (60.5, Mode.GAIT, True),
        (40.0, Mode.FAULT, True),
        (40.0, Mode.HOLD, True),
        (0.0, Mode.STOPPING, True),
    ],
)
def test_a_minute_is_over_after_its_time_or_with_the_gait(duration_s, mode, over):
    minute = Passive(strides=Strides(duration_s))

    after = advance(leg_with(None), minute, mode, 70)

    assert (after.strides is None) is over
    assert (after.baseline, after.taken_cycle) == ((TAKEN, 70) if over else (None, None))
    if over:
        np.testing.assert_array_equal(after.known.root, known(TAKEN, Since()).root)
        assert (after.guidance_ratio, after.temperatures_degc) == (0.8, (30.0, 40.0))
        assert list(news(leg_with(), minute, after)) == [
            Event(EventCode.BASELINE_TAKEN, "right", (9, 0.2, 1.5))
        ]


@pytest.mark.parametrize(
    ("why", "axis", "finding", "name"),
    [
        (Unfit.FEW_STRIDES, 0, Finding.FEW_STRIDES, "right/hip"),
        (Unfit.FEW_SAMPLES, 1, Finding.FEW_SAMPLES, "right/slide"),
        (Unfit.NOT_PASSIVE, 1, Finding.NOT_PASSIVE, "right/slide"),
        (Unfit.IMPLAUSIBLE, 0, Finding.IMPLAUSIBLE, "right/hip"),
    ],
)
def test_a_minute_that_gives_nothing_says_why_and_nothing_is_known(why, axis, finding, name):
    minute = Passive(strides=Strides(gives=NotPassiveError(why, axis, 7.0, 4.0)))

    after = advance(leg_with(None), minute, Mode.HOLD, 70)

    assert (after.known, after.baseline, after.strides) == (NOTHING_KNOWN, None, None)
    (event,) = news(leg_with(), minute, after)
    assert event == Event(EventCode.BASELINE_REFUSED, name, (finding, 7.0, 4.0))


def test_a_minute_or_a_baseline_without_an_end_of_a_minute_is_no_news():
    minute, taken = Passive(strides=Strides()), Passive(baseline=TAKEN)

    assert not list(news(leg_with(), minute, minute))
    assert not list(news(leg_with(), taken, replace(taken, since=Since(other_gait=True))))
    assert not list(news(leg_with(), minute, Passive()))


@pytest.mark.parametrize("before", [Passive(baseline=TAKEN), Passive(strides=Strides())])
def test_a_homing_ends_what_is_known(before):
    assert advance(leg_with(origin_moved=True), before, Mode.GAIT, 5) == Passive()


@pytest.mark.parametrize(
    ("before", "found", "kept"),
    [
        ((0, 0), (7, 8), True),
        ((7, 8), (7, 8), True),
        ((7, 8), (7, 9), False),
        ((7, 8), (0, 8), False),
    ],
)
def test_another_drive_ends_what_is_known(before, found, kept):
    leg = leg_with()
    leg.passive = Passive(baseline=TAKEN)
    for axis, number in zip(leg.axes, before, strict=True):
        axis.serial_number = number

    assert (passive.with_drives(leg, found) is leg.passive) is kept


def test_what_is_known_is_computed_anew_in_another_gait_and_as_it_fades_and_only_then():
    taken = advance(leg_with(None), Passive(strides=Strides(MINUTE_S)), Mode.GAIT, 100)
    faster = leg_with(SimpleNamespace(duration_s=3.0, cadence_hz=0.33))

    assert advance(leg_with(None), taken, Mode.GAIT, 9000) is taken
    assert advance(leg_with(), taken, Mode.GAIT, 99 + CYCLES_PER_STEP) is taken
    other = advance(faster, taken, Mode.GAIT, 500)
    older = advance(leg_with(), taken, Mode.GAIT, 100 + CYCLES_PER_STEP)
    faded_cycle = 100 + round(FADE_S / 0.01)
    faded = advance(leg_with(), taken, Mode.GAIT, faded_cycle)

    assert advance(leg_with(), faded, Mode.GAIT, faded_cycle + CYCLES_PER_STEP) is faded
    for found, since in (
        (other, Since(other_gait=True)),
        (older, Since(AGE_STEP_S)),
        (faded, Since(FADE_S)),
    ):
        assert found.since == since
        expected = known(TAKEN, since)
        np.testing.assert_array_equal(found.known.kept_std, expected.kept_std)
        np.testing.assert_array_equal(found.known.root, expected.root)
    assert advance(leg_with(), other, Mode.GAIT, 600).since == Since()


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        ({"guidance_ratio": 0.75}, Since()),
        ({"guidance_ratio": 0.7}, Since(other_gait=True)),
        ({"guidance_ratio": 0.9}, Since(other_gait=True)),
        ({"temperatures_degc": (40.0, 50.0)}, Since()),
        ({"temperatures_degc": (20.0, 30.0)}, Since()),
        ({"temperatures_degc": (40.1, 40.0)}, Since(other_day=True)),
        ({"temperatures_degc": (30.0, 29.9)}, Since(other_day=True)),
        ({"temperatures_degc": (None, 45.0)}, Since()),
        ({"temperatures_degc": ("no answer yet", 55.0)}, Since(other_day=True)),
    ],
)
def test_other_guidance_is_another_gait_and_another_temperature_another_day(now, expected):
    taken = advance(leg_with(None), Passive(strides=Strides(MINUTE_S)), Mode.GAIT, 100)

    found = advance(leg_with(**now), taken, Mode.GAIT, 500)

    assert found.since == expected
    assert (found is taken) is (expected == Since())
    np.testing.assert_array_equal(found.known.root, known(TAKEN, expected).root)
    np.testing.assert_array_equal(found.known.kept_std, known(TAKEN, expected).kept_std)


def test_a_drive_that_was_warmer_is_so_until_it_says_otherwise():
    taken = advance(leg_with(None), Passive(strides=Strides(MINUTE_S)), Mode.GAIT, 100)
    warm = advance(leg_with(temperatures_degc=(30.0, 55.0)), taken, Mode.GAIT, 500)

    assert advance(leg_with(temperatures_degc=(30.0, None)), warm, Mode.GAIT, 600) is warm
    assert advance(leg_with(), warm, Mode.GAIT, 600).since == Since()


def test_a_drive_whose_temperature_was_not_known_is_not_compared():
    unknown = leg_with(None, temperatures_degc=(None, "no answer yet"))
    taken = advance(unknown, Passive(strides=Strides(MINUTE_S)), Mode.GAIT, 100)

    assert taken.temperatures_degc == (None, None)
    assert advance(leg_with(), taken, Mode.GAIT, 500) is taken


def test_four_hours_later_it_is_another_day():
    taken = advance(leg_with(None), Passive(strides=Strides(MINUTE_S)), Mode.GAIT, 100)
    next_cycle = 100 + 4 * 3600 * 100

    assert not advance(leg_with(), taken, Mode.GAIT, next_cycle - 1).since.other_day
    for cycle in (next_cycle, 2 * next_cycle):
        assert advance(leg_with(), taken, Mode.GAIT, cycle).since == Since(FADE_S, other_day=True)


def test_a_baseline_from_a_file_is_of_another_day_and_stays_so():
    shown = from_file(TAKEN)
    faster = leg_with(SimpleNamespace(duration_s=3.0, cadence_hz=0.33))

    np.testing.assert_array_equal(shown.known.root, known(TAKEN, LONG_AGO).root)
    assert advance(leg_with(guidance_ratio=0.1), shown, Mode.GAIT, 1) is shown
    assert advance(faster, shown, Mode.GAIT, 1).since == LONG_AGO._replace(other_gait=True)
    assert from_file(None) == Passive()


def test_without_baseline_and_minute_nothing_is_done():
    nothing = Passive()

    assert passive.advance(leg_with(), nothing, Mode.GAIT, 1) is nothing
