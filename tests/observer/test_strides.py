"""Strides: how many there are, what was done in them, and how sure that is."""

import math

import numpy as np
import pytest

from gaitd_lab.patients import Gait, clonic
from observer.filter.leg_observer import setup_of
from observer.filter.status import Status, Validity
from observer.offline.smooth_batch import run_smoothed
from observer.smoother import (
    SMOOTH_COVARIANCE,
    SMOOTH_CYCLE_DATA,
    SMOOTH_SIZE,
    SMOOTH_UNSURE,
)
from observer.strides import (
    DURATION_MIN_S,
    SWING_RAD,
    StrideCounter,
    cycle_data_of,
    strides_of,
)
from tests.observer.trainer import (
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
DT = 0.01
AMPLITUDE = 0.3
FIGURES = (
    "work_positive_j",
    "work_negative_j",
    "assist_mean",
    "assist_peak",
    "power_mean_w",
    "power_peak_w",
)


def sample(hip_rad, speed, patient, *, effort=(0.0, 0.0), std=0.0, known=(0, 0), status=1):
    """One smoothed sample: slide moves with the hip, at a tenth of its speed."""
    row = np.zeros(SMOOTH_SIZE)
    row[0], row[1] = hip_rad, 0.5
    row[2:4] = speed
    row[6:8] = patient
    for state in (6, 7):
        row[SMOOTH_COVARIANCE + state * (state + 1) // 2 + state] = std**2
    row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(DT, effort, status, known)
    return row


def swing(cadence_hz, seconds, patient=lambda phase: (0.0, 0.0), begin_rad=0.2, **more):
    """Samples of a leg that swings; the patient's effort by phase of the swing."""
    for k in range(int(seconds / DT)):
        turn = 2 * math.pi * cadence_hz * k * DT
        speed = AMPLITUDE * 2 * math.pi * cadence_hz * math.cos(turn)
        hip_rad = begin_rad + AMPLITUDE * math.sin(turn)
        yield sample(hip_rad, (speed, 0.1 * speed), patient(turn), **more)


def passive(turn):
    return 2.0 + 1.5 * math.sin(turn), 10.0 * math.cos(2 * turn)


def counted(samples):
    counter = StrideCounter()
    return [done for row in samples if (done := counter.add(row))]


# --- how many ----------------------------------------------------------------------------------


@pytest.mark.parametrize("cadence_hz", [0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("strides", [3, 8])
def test_each_swing_is_one_stride_of_its_length(cadence_hz, strides):
    # The first rise begins at the start, before anything was lower: it opens no stride.
    found = counted(swing(cadence_hz, (strides + 1.1) / cadence_hz))

    assert len(found) == strides
    for stride in found[1:]:
        assert stride.duration_s == pytest.approx(1.0 / cadence_hz, rel=0.05)
        assert stride.cadence_hz == pytest.approx(cadence_hz, rel=0.05)
        assert stride.sample_count == pytest.approx(100.0 / cadence_hz, rel=0.05)


def test_a_leg_at_rest_makes_no_stride():
    assert not counted(sample(0.2, (0.0, 0.0), (3.0, 20.0)) for _ in range(6000))


def test_a_leg_that_trembles_makes_no_stride():
    random = np.random.default_rng(1)
    tremor = 0.2 + 0.4 * SWING_RAD * np.sin(2 * np.pi * 5.0 * np.arange(6000) * DT)
    tremor += 0.1 * SWING_RAD * random.normal(size=6000)

    assert not counted(sample(hip_rad, (0.1, 0.0), (3.0, 0.0)) for hip_rad in tremor)


def test_what_is_quicker_than_a_leg_can_be_is_no_stride():
    assert not counted(swing(1.2 / DURATION_MIN_S, 20.0))


def test_a_stride_that_never_ends_is_given_up():
    walk = list(swing(0.25, 9.0))
    rest = [sample(0.2, (0.0, 0.0), (0.0, 0.0)) for _ in range(3000)]

    found = counted([*walk, *rest, *swing(0.25, 13.0)])

    assert all(stride.duration_s < 6.0 for stride in found)
    assert len(found) == 1 + 2


def test_a_slow_drift_of_the_pose_changes_no_count():
    drifting = (
        sample(row[0] + 0.01 * k * DT, row[2:4], row[6:8])
        for k, row in enumerate(swing(0.25, 44.4))
    )

    assert len(counted(drifting)) == 10


# --- what was done -----------------------------------------------------------------------------


def test_work_with_the_motion_and_against_it_are_the_whole_work():
    """F = A cos(turn + phase), v = V cos(turn): the net work is A V T cos(phase) / 2."""
    cadence_hz, phase = 0.25, 0.7

    found = counted(
        swing(cadence_hz, 16.4, lambda turn: (8.0 * math.cos(turn + phase), 40.0 * math.cos(turn)))
    )

    for stride in found[1:]:
        speed = AMPLITUDE * 2 * math.pi * cadence_hz
        hip_j = 8.0 * speed / cadence_hz * math.cos(phase) / 2.0
        slide_j = 40.0 * 0.1 * speed / cadence_hz / 2.0
        hip, slide = stride.hip, stride.slide
        assert hip.work_positive_j + hip.work_negative_j == pytest.approx(hip_j, rel=0.01)
        assert slide.work_positive_j == pytest.approx(slide_j, rel=0.01)
        assert slide.work_negative_j == pytest.approx(0.0, abs=1e-3)
        assert hip.work_negative_j < -0.1
        whole = hip.work_positive_j + slide.work_positive_j
        assert stride.work_positive_j == pytest.approx(whole)
        assert hip.power_mean_w == pytest.approx(hip_j * stride.cadence_hz, rel=0.01)
        assert hip.coverage_ratio == pytest.approx(1.0)


def test_assist_is_signed_by_the_motion():
    pushing = counted(swing(0.25, 16.4, lambda turn: (5.0 * math.copysign(1, math.cos(turn)), 0.0)))
    braking = counted(
        swing(0.25, 16.4, lambda turn: (-5.0 * math.copysign(1, math.cos(turn)), 0.0))
    )

    assert pushing[-1].hip.assist_mean == pytest.approx(5.0, rel=0.02)
    assert pushing[-1].hip.assist_peak == pytest.approx(5.0)
    assert braking[-1].hip.assist_mean == pytest.approx(-5.0, rel=0.02)
    assert braking[-1].hip.power_peak_w == pytest.approx(-5.0 * AMPLITUDE * math.pi / 2, rel=0.01)


def test_the_share_is_that_of_who_works_with_the_motion():
    shared = counted(
        swing(0.25, 16.4, lambda turn: (6.0 * math.copysign(1, math.cos(turn)), 0.0), effort=(0, 0))
    )
    assert shared[-1].hip.share_ratio == pytest.approx(1.0)

    def both(row):
        effort = (2.0 * math.copysign(1, row[2]), 0.0)
        row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(DT, effort, 1, (0, 0))
        return row

    walk = swing(0.25, 16.4, lambda turn: (6.0 * math.copysign(1, math.cos(turn)), 0.0))
    assert counted(map(both, walk))[-1].hip.share_ratio == pytest.approx(0.75, abs=0.01)


def test_where_next_to_nothing_is_done_there_is_no_share():
    found = counted(swing(0.25, 16.4))[-1]

    assert found.hip.share_ratio is None
    assert found.share_ratio is None
    assert found.hip.work_positive_j == 0.0


def test_what_was_not_known_is_missing_and_said():
    def blind(k, row):
        if 300 <= k % 400 < 400:
            row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(
                DT, (0, 0), 1, (Validity.SPLIT_UNOBSERVABLE, 0)
            )
        return row

    walk = swing(0.25, 20.4, lambda turn: (8.0 * math.cos(turn), 0.0))
    found = counted(blind(k, row) for k, row in enumerate(walk))

    for stride in found[1:]:
        assert stride.hip.coverage_ratio == pytest.approx(0.75, abs=0.02)
        assert stride.slide.coverage_ratio == pytest.approx(1.0)


def test_a_gap_lowers_the_coverage_of_its_stride_alone():
    bad = (Validity.BAD, Validity.BAD)

    def lost(k, row):
        if 1000 <= k < 1050:
            row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(
                DT, (0, 0), Status.PREDICT_ONLY, bad
            )
        return row

    found = counted(lost(k, row) for k, row in enumerate(swing(0.25, 24.4)))
    coverage = [stride.hip.coverage_ratio for stride in found]

    assert sorted(coverage)[0] == pytest.approx(0.875, abs=0.01)
    assert sorted(coverage)[1] == pytest.approx(1.0)
    assert sum(Status.PREDICT_ONLY in stride.status for stride in found) == 1


def with_a_step(walk, begin, count):
    """Without the samples of a gap; the next one says how long it was."""
    bad = (Validity.BAD, Validity.BAD)
    for k, row in enumerate(walk):
        if k == begin + count:
            row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of((count + 1) * DT, (0, 0), 1, bad)
        if not begin <= k < begin + count:
            yield row


@pytest.mark.parametrize("begin", [1155, 1170, 1188])
def test_a_gap_over_the_cut_is_shared_by_both_strides_and_lowers_their_coverage(begin):
    found = counted(with_a_step(swing(0.25, 24.4), begin, 40))

    assert len(found) == len(counted(swing(0.25, 24.4)))
    for stride in found[1:]:
        assert stride.duration_s == pytest.approx(4.0, abs=0.06)
    missing_s = [stride.duration_s * (1.0 - stride.hip.coverage_ratio) for stride in found[1:]]
    assert sum(missing_s) == pytest.approx(0.41, abs=0.02)
    assert sum(stride.hip.coverage_ratio < 0.999 for stride in found[1:]) == 2


@pytest.mark.parametrize("begin", [1000, 1100, 1190])
def test_rows_that_are_missing_for_long_give_the_stride_up(begin):
    """Else a gap that hides a crossing would make a stride of any length, wholly covered."""
    found = counted(with_a_step(swing(0.25, 28.4), begin, 250))

    for stride in found:
        assert stride.duration_s == pytest.approx(4.0, abs=0.3)
        assert stride.hip.coverage_ratio == pytest.approx(1.0)


def test_a_gap_changes_the_work_but_not_the_share():
    """Patient and drive are compared over the same samples."""

    def half_blind(k, row):
        known = (Validity.SPLIT_UNOBSERVABLE, 0) if k % 200 < 100 else (0, 0)
        effort = (2.0 * math.copysign(1, row[2]), 0.0)
        row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(DT, effort, 1, known)
        return row

    walk = swing(0.25, 16.4, lambda turn: (6.0 * math.copysign(1, math.cos(turn)), 0.0))
    stride = counted(half_blind(k, row) for k, row in enumerate(walk))[-1]

    assert stride.hip.coverage_ratio == pytest.approx(0.5, abs=0.02)
    assert stride.hip.share_ratio == pytest.approx(0.75, abs=0.01)


def test_an_axis_with_a_bad_sample_has_no_figures_in_its_stride_alone():
    bad = (Validity.OK, Validity.BAD)
    push = swing(0.25, 24.4, lambda turn: (8.0 * math.cos(turn), 40.0 * math.cos(turn)))

    def lost(k, row):
        if k == 1010:
            row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(DT, (0, 0), 1, bad)
        return row

    found = counted(lost(k, row) for k, row in enumerate(push))

    (hurt,) = [stride for stride in found if math.isnan(stride.work_positive_j)]
    *figures, coverage_ratio = hurt.slide
    assert all(figure is None or math.isnan(figure) for figure in figures)
    assert coverage_ratio == pytest.approx(399 / 400, abs=1e-4)
    assert math.isnan(hurt.work_negative_j_std)
    assert hurt.share_ratio is None
    assert hurt.hip.work_positive_j == pytest.approx(found[-1].hip.work_positive_j, rel=1e-3)
    assert hurt.hip.coverage_ratio == 1.0


@pytest.mark.parametrize(
    ("lost", "sign", "begin"),
    [
        (Status.PREDICT_ONLY, 1.0, 985),
        (Status.PREDICT_ONLY, -1.0, 1194),
        (Status.VALID, -1.0, 985),
        (Status.VALID, 1.0, 1198),
    ],
)
def test_what_a_gap_hides_is_in_each_sigma(lost, sign, begin):
    """In the gap the patient pushes or brakes once more as hard as else, which is not seen.

    The samples were predicted, or the split was not observable. The gap is within a stride, or over
    its end and the begin of the next one.
    """
    gap, pushes = range(begin, begin + 10), (range(900, 950), range(1300, 1350))
    known = 0 if lost is Status.PREDICT_ONLY else Validity.SPLIT_UNOBSERVABLE

    def walk(*, seen):
        for k, row in enumerate(swing(0.25, 24.4)):
            pushed = any(k in push for push in pushes) or (k in gap and not seen)
            row[6:8] = sign * np.array((6.0, 30.0)) * pushed * np.sign(row[2:4])
            if k in gap and seen:
                row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(
                    DT, (0, 0), lost, (known, known)
                )
            yield row

    found, true = counted(walk(seen=True)), counted(walk(seen=False))

    off = 0
    for one, real in zip(found, true, strict=True):
        for axis, real_axis in ((one.hip, real.hip), (one.slide, real.slide)):
            for name in FIGURES:
                error = abs(getattr(axis, name) - getattr(real_axis, name))
                assert error <= 3.0 * getattr(axis, f"{name}_std") + 1e-9, name
                off += error > 0.01
    assert off >= 6


def test_a_peak_may_be_among_the_samples_that_do_not_count():
    """At mid swing the estimate shows 6 N m where 2 is the largest that counts."""

    def walk():
        for k, row in enumerate(swing(0.25, 24.4, lambda _: (2.0, 0.0))):
            if 1000 <= k < 1010:
                row[6] = 6.0
                known = (Validity.SPLIT_UNOBSERVABLE, 0)
                row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(DT, (0, 0), 1, known)
            yield row

    hip = max((stride.hip for stride in counted(walk())), key=lambda one: one.assist_peak_std)

    assert (abs(hip.assist_peak), hip.assist_peak_std) == pytest.approx((2.0, 4.0))
    speed = AMPLITUDE * 2 * math.pi * 0.25
    assert abs(hip.power_peak_w) == pytest.approx(2.0 * speed, rel=0.01)
    assert hip.power_peak_w_std == pytest.approx(4.0 * speed, rel=0.02)


def test_the_sample_of_a_longer_step_does_not_count():
    def walk():
        for k, row in enumerate(swing(0.25, 24.4, lambda turn: (8.0 * math.cos(turn), 0.0))):
            if k == 1009:
                row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(10 * DT, (0, 0), 1, (0, 0))
            if not 1000 <= k < 1009:
                yield row

    stride = min(counted(walk()), key=lambda one: one.hip.coverage_ratio)
    whole = counted(swing(0.25, 24.4, lambda turn: (8.0 * math.cos(turn), 0.0)))[-1]

    assert stride.hip.coverage_ratio == pytest.approx(390 / 400, abs=1e-3)
    missing_j = whole.hip.work_positive_j - stride.hip.work_positive_j
    assert missing_j == pytest.approx(8.0 * AMPLITUDE * math.pi / 2 * 0.1, rel=0.03)
    assert stride.hip.work_positive_j_std == pytest.approx(missing_j, rel=0.03)


def test_a_long_loss_gives_the_stride_up():
    bad = (Validity.BAD, Validity.BAD)

    def lost(k, row):
        if 1000 <= k < 1150:
            row[SMOOTH_CYCLE_DATA:SMOOTH_UNSURE] = cycle_data_of(
                DT, (0, 0), Status.PREDICT_ONLY, bad
            )
        return row

    found = counted(lost(k, row) for k, row in enumerate(swing(0.25, 24.4)))

    assert len(found) == len(counted(swing(0.25, 24.4))) - 2
    assert all(stride.hip.coverage_ratio == pytest.approx(1.0) for stride in found)


def test_all_bits_of_a_stride_are_in_its_status():
    found = counted(swing(0.25, 16.4, status=Status.VALID | Status.ARTIFICIAL))

    assert all(stride.status == Status.VALID | Status.ARTIFICIAL for stride in found)


def test_two_counters_share_nothing():
    one, other = StrideCounter(), StrideCounter()
    alone = counted(swing(0.25, 16.4, lambda turn: (8.0 * math.cos(turn), 0.0)))
    found = []
    walk = swing(0.25, 16.4, lambda turn: (8.0 * math.cos(turn), 0.0))
    for mine, yours in zip(walk, swing(0.4, 16.4), strict=True):
        other.add(yours)
        if done := one.add(mine):
            found.append(done)

    assert found == alone


def test_strides_say_that_a_baseline_was_taken_off():
    bare = counted(swing(0.25, 12.4, passive))[-1]
    clean = counted(swing(0.25, 12.4, passive, status=Status.VALID | Status.BASELINE))[-1]

    assert (bare.baseline_subtracted, clean.baseline_subtracted) == (False, True)


# --- sigma -------------------------------------------------------------------------------------


def walked(seed, patient, cadence_hz=0.5, lost=()):
    cycles = 1700
    time_s = np.arange(1, cycles + 1) * DT
    path = gait(PATIENT, np.maximum(time_s - 1.0, 0.0), cadence_hz)
    truth = simulate(PATIENT, cycles, reference=path, start=path[0], patient=patient)
    columns = encoded(truth, seed)
    for gap in lost:
        columns.position[gap] = np.nan
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED)
    found = strides_of(run_smoothed(setup, columns), columns)
    return truth, found


def pushing(t):
    turns = 2 * np.pi * 0.5 * t
    efforts = np.column_stack((8.0 * np.sin(turns), 40.0 * np.sin(turns + 1.0)))
    return efforts * (t > 1.0)[:, None]


@pytest.fixture(scope="module")
def pushed():
    return walked(1, pushing)


def true_work(truth, first, stride, sign=1.0):
    rows = slice(first, first + stride.sample_count)
    power = truth.state[rows, 6:8] * truth.state[rows, 2:4]
    return sign * np.sum(np.maximum(sign * power, 0.0), axis=0) * DT


def test_work_of_a_stride_is_right_within_one_percent(pushed):
    truth, found = pushed

    assert len(found) == 7
    for first, stride in found[1:]:
        works = (stride.hip.work_positive_j, stride.slide.work_positive_j)
        assert works == pytest.approx(true_work(truth, first, stride), rel=0.01)


def test_the_true_work_is_within_three_sigma_and_sigma_is_small(pushed):
    """Measured: the error is 0.2 to 0.8 of sigma, which is 1 to 2 % of the work."""
    truth, found = pushed

    for first, stride in found[1:]:
        for axis, true_j in zip(
            (stride.hip, stride.slide), true_work(truth, first, stride), strict=True
        ):
            assert abs(axis.work_positive_j - true_j) <= 3.0 * axis.work_positive_j_std
            assert axis.work_positive_j_std <= 0.03 * true_j


def test_a_patient_who_does_nothing_works_within_a_few_sigma_of_nothing():
    _, found = walked(1, None)

    for _, stride in found[1:]:
        for axis in (stride.hip, stride.slide):
            assert axis.work_positive_j <= 3.0 * axis.work_positive_j_std
            assert -axis.work_negative_j <= 3.0 * axis.work_negative_j_std
        assert stride.work_positive_j <= 1.5


def test_errors_over_many_runs_are_no_larger_than_sigma_says():
    """30 seeds: rms error is 0.1 to 0.8 of sigma, for the sum of both works up to 1.03."""
    of_sigma = []
    for seed in range(8):
        truth, found = walked(seed, pushing)
        for first, stride in found[1:]:
            for axis, plus_j, minus_j in zip(
                (stride.hip, stride.slide),
                true_work(truth, first, stride),
                true_work(truth, first, stride, -1.0),
                strict=True,
            ):
                plus, minus = axis.work_positive_j - plus_j, axis.work_negative_j - minus_j
                plus_std, minus_std = axis.work_positive_j_std, axis.work_negative_j_std
                net = (plus + minus) / math.hypot(plus_std, minus_std)
                of_sigma.append((plus / plus_std, minus / minus_std, net))
    by_axis = np.array(of_sigma).reshape(-1, 2, 3)

    rms = np.sqrt(np.mean(by_axis**2, axis=0))
    assert np.all(rms <= 1.5)
    assert np.all(rms >= 0.05)


def in_clonus(t):
    """The laboratory's patient, without the lag of muscles."""
    nothing = np.zeros(2)
    feelings = (Gait(x, 0.0, *4 * (nothing,), pose=nothing) for x in (t - 1.0).tolist())
    return np.array([clonic(felt) for felt in feelings]) * (t > 1.0)[:, None]


def in_spasm(t):
    """As the plant's programme `spasm`, once, at 9 s."""
    rise = np.interp(t, [9.0, 9.06, 10.2, 11.0], [0.0, 1.0, 1.0, 0.0])
    return -rise[:, None] * np.array([30.0, 150.0])


@pytest.mark.parametrize(
    ("patient", "cadence_hz", "count"),
    [
        (in_clonus, 0.4, 8),
        (in_spasm, 0.4, 8),
        (pushing, 0.3, 15),
    ],
)
def test_no_published_work_is_farther_from_the_truth_than_three_sigma(patient, cadence_hz, count):
    """Up to 10 lost samples are predicted, and the estimate stays valid; 15 make it BAD."""
    random = np.random.default_rng(1)
    lost = [slice(k, k + count) for k in random.integers(200, 1640, 8 if count < 10 else 2)]
    truth, found = walked(1, patient, cadence_hz, lost)
    judged = 0
    for first, stride in found[1:]:
        plus_j, minus_j = (true_work(truth, first, stride, sign) for sign in (1.0, -1.0))
        for index, axis in enumerate((stride.hip, stride.slide)):
            if math.isnan(axis.work_positive_j):
                continue
            judged += 1
            for figure, std, true_j in (
                (axis.work_positive_j, axis.work_positive_j_std, plus_j[index]),
                (axis.work_negative_j, axis.work_negative_j_std, minus_j[index]),
            ):
                assert abs(figure - true_j) <= 3.0 * std
    assert judged >= len(found) - 1 > 1
