"""What innovations show beyond the filter's covariance: jerks that it cannot follow, and a walk."""

import numpy as np
import pytest

from observer.filter.considered import Drives, Variant
from observer.filter.leg_filter import OUT_SIZE, advance
from observer.filter.leg_observer import setup_of
from observer.filter.status import Validity
from observer.offline.batch import Columns, begun_memory, run
from observer.offline.smooth_batch import run_smoothed
from observer.smoother import LAG
from tests.observer.trainer import (
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    active,
    encoded,
    gait,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
ALMOST_SURE = Variant(PATIENT, HIP, SLIDE_FRICTION, Drives(effort_offset_hip_nm=1e-9))
"""Without a parameter that is not sure, sigma is the filter's alone."""
CYCLES = 1600
SETTLED_S = 4.0
JERK_NM = 30.0
JERK_HZ = 20.0
JERK_FADES_S = 0.1


def jerky(time_s):
    """A swing at the hip once a second, as of a shaft against its joint."""
    since_s = np.mod(time_s, 1.0)
    swing = np.exp(-since_s / JERK_FADES_S) * np.sin(2.0 * np.pi * JERK_HZ * since_s)
    return active(time_s) + np.column_stack((JERK_NM * swing, 0.0 * swing))


def walked(patient):
    path = gait(PATIENT, (np.arange(CYCLES) + 1) * 0.01, 0.25)
    return simulate(PATIENT, CYCLES, reference=path, patient=patient)


def seen(columns, variants, estimates_of=run, tuning=SHIPPED):
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, tuning, variants)
    return estimates_of(setup, columns)


def valid(columns, found):
    return (columns.time_s > SETTLED_S) & (found.validity == Validity.OK).all(axis=1)


@pytest.fixture(scope="module")
def swings():
    truth = walked(jerky)
    return truth, encoded(truth)


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_sigma_holds_swings_that_the_filter_cannot_follow(swings, estimates_of):
    truth, columns = swings

    for variants, missed_min, missed_max in (((), 0.1, 1.0), ([ALMOST_SURE], 0.0, 0.025)):
        found = seen(columns, variants, estimates_of)
        rows = valid(columns, found)
        error, std = (found.state - truth.state)[rows, 6], found.std[rows, 6]
        assert missed_min <= np.mean(np.abs(error) > 3.0 * std) <= missed_max
        assert rms(std) < 1.1 * rms(error)


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_patient_and_net_of_that_axis_are_less_sure_and_nothing_else(swings, estimates_of):
    _, columns = swings
    own, wide = seen(columns, (), estimates_of), seen(columns, [ALMOST_SURE], estimates_of)

    for name in ("state", "net", "innovation", "nis", "status", "validity"):
        np.testing.assert_array_equal(getattr(wide, name), getattr(own, name))
    np.testing.assert_allclose(wide.std[:, :6], own.std[:, :6], rtol=1e-9)
    rows = valid(columns, own)
    patient, net = wide.std**2 - own.std**2, wide.net_std**2 - own.net_std**2
    np.testing.assert_allclose(patient[rows, 6], net[rows, 0], rtol=1e-6, atol=1e-9)
    assert patient[rows, 6].max() > 1.0
    assert rms(wide.std[rows, 7]) == pytest.approx(rms(own.std[rows, 7]), rel=0.02)


def test_the_smoother_holds_the_largest_of_all_cycles_that_revise_its_own(swings):
    _, columns = swings
    shown, revised = (
        (seen(columns, [ALMOST_SURE], how).std ** 2 - seen(columns, (), how).std ** 2)[:, 6]
        for how in (run, run_smoothed)
    )

    rows = np.flatnonzero(columns.time_s > SETTLED_S)[:-LAG]
    largest = [shown[row : row + LAG + 1].max() for row in rows]
    np.testing.assert_allclose(revised[rows], largest, rtol=1e-6, atol=1e-8)
    assert np.mean(revised[rows] > 2.0 * shown[rows] + 0.1) > 0.1


def test_what_comes_after_a_gap_does_not_count_for_the_smoothed_estimate_before_it(swings):
    _, columns = swings
    gap = int(np.argmax(seen(columns, [ALMOST_SURE]).std[600:, 6])) + 600 - 5
    time_s = columns.time_s + np.where(np.arange(len(columns.time_s)) >= gap, 10.0, 0.0)
    columns = Columns(time_s, columns.position, columns.effort)
    shown, revised = (
        (seen(columns, [ALMOST_SURE], how).std ** 2 - seen(columns, (), how).std ** 2)[:, 6]
        for how in (run, run_smoothed)
    )

    before = range(gap - LAG, gap)
    largest = [shown[row:gap].max() for row in before]
    np.testing.assert_allclose(revised[list(before)], largest, rtol=1e-6, atol=1e-8)
    assert shown[gap : gap + LAG].max() > 2.0 * max(largest) + 0.1


def test_what_the_transmission_hides_already_is_not_added_again(swings):
    _, columns = swings
    hides = SHIPPED._replace(compliance=(1.0 / 800.0, 0.0))
    own, wide = (seen(columns, some, tuning=hides) for some in ((), [ALMOST_SURE]))
    _, rigid = (seen(columns, some) for some in ((), [ALMOST_SURE]))

    rows = valid(columns, own)
    added = (wide.std**2 - own.std**2)[rows, 6]
    assert rms(wide.std[rows, 6]) >= rms(rigid.std[rows, 6])
    assert rms(added) < rms(rigid.std[rows, 6] ** 2)


def test_sigma_of_a_machine_that_is_as_its_file_says_is_as_it_was():
    columns = encoded(walked(active))
    own, wide = seen(columns, ()), seen(columns, [ALMOST_SURE])

    rows = valid(columns, own)
    assert np.mean(wide.std[rows] > 1.001 * own.std[rows]) < 0.005
    assert rms(wide.std[rows, 6:8]) == pytest.approx(rms(own.std[rows, 6:8]), rel=1e-3)


def test_after_a_restart_nothing_of_a_swing_is_left(swings):
    _, columns = swings
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED, [ALMOST_SURE])
    memory, points = begun_memory(setup, columns)
    effort, position = columns.effort.tolist(), columns.position.tolist()
    out = np.empty(OUT_SIZE)
    for row in range(520):
        advance(
            setup,
            memory,
            points,
            tuple(position[row]),
            tuple(effort[row]),
            (0.0, 0.0),
            0.01,
            0,
            out,
        )
    assert memory[0]["unexplained"][0] > 0.1

    advance(
        setup, memory, points, tuple(position[520]), tuple(effort[520]), (0.0, 0.0), 10.0, 0, out
    )
    assert memory[0]["unexplained"][0] == memory[0]["surprise"][0] == 0.0
