"""Tremor stands out of the patient's effort, or nothing is said of it."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from daemon.gateway.tremor import (
    AMPLITUDE_MIN,
    HOP,
    KEPT_CYCLES,
    REMEMBERED_CYCLES,
    WINDOW,
    AxisTremor,
    LegTremor,
    Tremor,
)
from tests.daemon.gateway.test_strides import stride

TIME_S = np.arange(600) * 0.01
GAIT = 8.0 * np.sin(np.pi * TIME_S) + 3.0 * np.sin(3.0 * np.pi * TIME_S)
"""A patient who works at 0.5 Hz, N·m."""


def noise(seed: int) -> np.ndarray:
    """Noise of an estimate: white, and slow as a person's effort varies."""
    white = np.random.default_rng(seed).normal(size=(2, len(TIME_S)))
    slow = np.zeros(len(TIME_S))
    for row in range(1, len(TIME_S)):
        slow[row] = slow[row - 1] + 0.12 * (1.2 * white[0, row] - slow[row - 1])
    return slow + 0.1 * white[1]


def wave(frequency_hz: float, amplitude: float) -> np.ndarray:
    return amplitude * np.sin(2.0 * np.pi * frequency_hz * TIME_S + 0.7)


def fed(efforts: np.ndarray, begin: int = 0) -> AxisTremor:
    axis = AxisTremor(AMPLITUDE_MIN["hip"])
    for cycle, effort in enumerate(efforts.tolist(), begin):
        axis.add(cycle, effort)
    return axis


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude"), [(3.4, 2.6), (5.0, 0.8), (5.0, 2.6), (7.7, 0.8), (11.6, 0.8)]
)
def test_frequency_and_amplitude_are_those_of_a_least_squares_fit(frequency_hz, amplitude):
    """The fit of a gait's harmonics and one wave, by scipy, over the same six seconds."""
    efforts = GAIT + wave(frequency_hz, amplitude) + noise(1)

    def model(time_s, frequency, sine, cosine, *gait):
        waves = [
            part * of(np.pi * order * time_s)
            for order, part, of in zip((1, 1, 2, 2, 3, 3), gait, (np.sin, np.cos) * 3, strict=True)
        ]
        angle = 2.0 * np.pi * frequency * time_s
        return sine * np.sin(angle) + cosine * np.cos(angle) + sum(waves)

    (fitted_hz, *parts), _ = curve_fit(model, TIME_S, efforts, (frequency_hz, *8 * (1.0,)))

    found = fed(efforts).now

    assert found is not None
    assert found.frequency_hz == pytest.approx(fitted_hz, abs=0.1)
    assert found.amplitude == pytest.approx(np.hypot(*parts[:2]), rel=0.1)


CATCH = np.exp(-0.5 * ((TIME_S % 2.0 - 1.0) / 0.08) ** 2)
BURSTS = np.where(TIME_S % 2.0 < 0.7, 10.0 * np.sin(12.0 * np.pi * (TIME_S % 2.0)), 0.0)
CHIRP = 3.0 * np.sin(2.0 * np.pi * (3.5 * TIME_S + 1.2 * TIME_S**2))


@pytest.mark.parametrize(
    "efforts",
    [
        *(pytest.param(GAIT + noise(seed), id=f"works, seed {seed}") for seed in range(10)),
        pytest.param(noise(3), id="passive"),
        pytest.param(np.zeros(len(TIME_S)), id="nothing"),
        pytest.param(30.0 * (TIME_S > 2.0), id="a spasm that begins"),
        pytest.param(-10.0 * CATCH, id="a catch in each stride"),
        pytest.param(GAIT + BURSTS, id="clonus in bursts"),
        pytest.param(GAIT + wave(2.2, 2.0), id="too slow"),
        pytest.param(GAIT + wave(12.6, 2.0), id="too fast"),
        pytest.param(wave(5.0, 0.9 * AMPLITUDE_MIN["hip"]), id="too weak"),
        pytest.param(CHIRP, id="ever faster"),
    ],
)
def test_what_does_not_tremble_is_said_to_have_none(efforts):
    axis = AxisTremor(AMPLITUDE_MIN["hip"])
    for cycle, effort in enumerate(efforts.tolist()):
        axis.add(cycle, effort)
        assert axis.now is None
    assert axis.end_stride() is None


def test_nothing_is_said_while_the_estimate_is_not_valid_and_it_is_known_again_after_it():
    efforts = wave(5.0, 2.6)
    axis = fed(efforts)
    known = axis.now

    axis.interrupt()
    meanwhile = axis.now
    axis.add(len(efforts), 0.0)

    assert known is not None
    assert meanwhile is None
    assert axis.now == known


def test_a_tremor_that_has_not_been_seen_for_long_is_forgotten():
    efforts = wave(5.0, 2.6)
    axis = fed(efforts)

    axis.interrupt()
    axis.add(len(efforts) + KEPT_CYCLES, 0.0)

    assert axis.now is None


def test_windows_of_before_a_long_pause_do_not_count():
    efforts = wave(5.0, 2.6)
    axis = fed(efforts)

    axis.interrupt()
    begin = len(efforts) + REMEMBERED_CYCLES
    for cycle, effort in enumerate(efforts[: WINDOW + HOP].tolist(), begin):
        axis.add(cycle, effort)

    assert axis.now is None


def test_a_tremor_is_known_where_an_axis_rests_in_each_stride():
    efforts = wave(5.0, 2.6)[: WINDOW + 2 * HOP].tolist()
    axis = fed(np.array([]))

    for begin in (0, 250, 500, 750):
        axis.interrupt()
        for cycle, effort in enumerate(efforts, begin):
            axis.add(cycle, effort)

    assert axis.now is not None
    assert axis.now.frequency_hz == pytest.approx(5.0, abs=0.2)


def test_a_stride_has_the_mean_of_its_windows_if_most_of_them_have_it():
    axis = fed(wave(5.0, 2.6))
    for cycle, effort in enumerate(wave(5.0, 2.0).tolist(), len(TIME_S)):
        axis.add(cycle, effort)
    both = axis.end_stride()
    for cycle in range(2 * len(TIME_S), 3 * len(TIME_S)):
        axis.add(cycle, 0.0)

    assert both == pytest.approx(Tremor(5.0, 2.3), abs=0.1)
    assert axis.end_stride() is None
    assert axis.end_stride() is None


def of_leg(cycle: int, effort: float) -> dict:
    return {"cycle": cycle, "hip": {"patient": effort}, "slide": {"patient": None}}


@pytest.mark.parametrize(("missing", "expected"), [(0, True), (1, False)])
def test_a_missing_cycle_begins_a_new_window(missing, expected):
    efforts = wave(5.0, 2.6).tolist()
    leg = LegTremor()
    for begin in range(0, 600, 100):
        for cycle in range(begin, begin + 100):
            leg.add(of_leg(cycle + missing * begin // 100, efforts[cycle]))

    assert (leg.now["hip"] is not None) == expected
    assert leg.now["slide"] is None


def test_estimate_activity_and_stride_have_the_tremor_of_a_core_and_not_of_the_next(
    bench, make_leg
):
    for effort in wave(5.0, 2.6)[:400].tolist():
        bench.cycle(legs=(make_leg(hip={"patient": effort}),))
    bench.cycle(legs=(make_leg(stride=stride(), slide={"validity": 1}),))
    messages = [bench.outlet.on(f"right/{name}")[-1] for name in ("estimate", "activity", "stride")]
    bench.replace_core("boot-b")
    bench.cycle()
    bench.cycle()

    for message in messages:
        assert message.hip.tremor_frequency_hz == pytest.approx(5.0, abs=0.1)
        assert message.hip.tremor_amplitude == pytest.approx(2.6, rel=0.1)
        assert message.slide.tremor_frequency_hz is None
    assert bench.outlet.on("right/estimate")[-1].core_boot_id == "boot-b"
    assert bench.outlet.on("right/estimate")[-1].hip.tremor_frequency_hz is None
