"""What innovations show beyond the filter's covariance: jerks that it cannot follow, and a walk."""

import numpy as np
import pytest

from observer.filter.considered import Drives, Variant
from observer.filter.leg_filter import OUT_SIZE, advance
from observer.filter.leg_memory import MISFIT_FULL, new_memory
from observer.filter.leg_model import LegModel
from observer.filter.leg_observer import setup_of
from observer.filter.status import Validity
from observer.filter.surprise import (
    MISFIT_MAX,
    doubt_of_stiffness,
    follow_surprise,
)
from observer.filter.transmission import ENVELOPE_S, LIKELY_COMPLIANCE, hide
from observer.offline.batch import Columns, begun_memory, prepared, run
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
GIVES_WAY = SHIPPED._replace(compliance=(1.0 / 800.0, 0.0))
ALMOST_SURE = Variant(PATIENT, HIP, SLIDE_FRICTION, Drives(effort_offset_hip_nm=1e-9))
"""Without a parameter that is not sure, sigma is the filter's alone."""
CYCLES = 1600
SETTLED_S = 4.0
JERK_NM = 30.0
JERK_HZ = 20.0
JERK_FADES_S = 0.1


def jerky(time_s, ends_s=np.inf):
    """A swing at the hip once a second, as of a shaft against its joint."""
    since_s = np.mod(time_s, 1.0)
    swing = np.exp(-since_s / JERK_FADES_S) * np.sin(2.0 * np.pi * JERK_HZ * since_s)
    return active(time_s) + np.column_stack((JERK_NM * swing * (time_s < ends_s), 0.0 * swing))


def walked(patient, cadence_hz=0.25):
    path = gait(PATIENT, (np.arange(CYCLES) + 1) * 0.01, cadence_hz)
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


@pytest.mark.parametrize(("estimates_of", "largest_ratio"), [(run, 1.1), (run_smoothed, 1.5)])
def test_sigma_holds_swings_that_the_filter_cannot_follow(swings, estimates_of, largest_ratio):
    truth, columns = swings

    for variants, missed_min, missed_max in (((), 0.1, 1.0), ([ALMOST_SURE], 0.0, 0.025)):
        found = seen(columns, variants, estimates_of)
        rows = valid(columns, found)
        error, std = (found.state - truth.state)[rows, 6], found.std[rows, 6]
        assert missed_min <= np.mean(np.abs(error) > 3.0 * std) <= missed_max
        assert rms(std) < largest_ratio * rms(error)


def added_to(columns, estimates_of=run):
    """Variances of friction, patient and net of both axes beyond those of the filter alone."""
    own = seen(columns, (), estimates_of)
    wide = seen(columns, [ALMOST_SURE], estimates_of, GIVES_WAY)
    for name in ("state", "net", "innovation", "nis", "status", "validity"):
        np.testing.assert_array_equal(getattr(wide, name), getattr(own, name))
    np.testing.assert_array_equal(wide.std[:, :4], own.std[:, :4])
    states = (wide.std**2 - own.std**2)[:, 4:]
    return np.column_stack((states, wide.net_std**2 - own.net_std**2))


def told_by(columns):
    """Hidden friction, hidden and shown net of the memory after each row, (3, n, 2)."""
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, GIVES_WAY, [ALMOST_SURE])
    return kept_by(columns, setup, "hidden_friction", "hidden_net", "shown_net")


def kept_by(columns, setup, *names):
    """What the memory has of each axis after each row, (names, n, 2)."""
    memory, points = begun_memory(setup, columns)
    steps_s = prepared(columns).steps_s.tolist()
    out, told = np.empty(OUT_SIZE), []
    for step_s, position, effort in zip(steps_s, columns.position, columns.effort, strict=True):
        given = tuple(position), tuple(effort), (0.0, 0.0), step_s, 0
        advance(setup, memory, points, *given, out)
        told.append([memory[0][name].copy() for name in names])
    return np.array(told).swapaxes(0, 1)


def sums(friction, hidden_net, shown_net):
    """Variances that are added to those of friction, patient and net."""
    net = np.maximum(hidden_net, shown_net)
    return np.column_stack((friction, friction + net, net))


def test_friction_patient_and_net_are_less_sure_and_nothing_else(swings):
    _, columns = swings
    added, told = added_to(columns), told_by(columns)

    rows = columns.time_s > SETTLED_S
    np.testing.assert_allclose(added[rows], sums(*told)[rows], rtol=1e-6, atol=1e-6)
    assert (told[:, rows, 0].max(axis=1) > 1.0).all()
    assert (told[:, rows, 1].max(axis=1) == 0.0).tolist() == [True, False, True]


def test_the_smoother_holds_the_largest_of_all_cycles_that_revise_its_own(swings):
    _, columns = swings
    revised, (friction, net, shown) = added_to(columns, run_smoothed), told_by(columns)

    rows = np.flatnonzero(columns.time_s > SETTLED_S)[:-LAG]
    largest = np.array([shown[row : row + LAG + 1].max(axis=0) for row in rows])
    expected = sums(friction[rows], net[rows], largest)
    np.testing.assert_allclose(revised[rows], expected, rtol=1e-6, atol=1e-6)
    assert np.mean(largest > 2.0 * shown[rows] + 0.1) > 0.05


def test_what_comes_after_a_gap_does_not_count_for_the_smoothed_estimate_before_it(swings):
    _, columns = swings
    gap = 1200  # where a swing begins
    time_s = columns.time_s + np.where(np.arange(len(columns.time_s)) >= gap, 10.0, 0.0)
    columns = Columns(time_s, columns.position, columns.effort)
    revised, (friction, net, shown) = added_to(columns, run_smoothed), told_by(columns)

    before = np.arange(gap - LAG, gap)
    largest = np.array([shown[row:gap].max(axis=0) for row in before])
    expected = sums(friction[before], net[before], largest)
    np.testing.assert_allclose(revised[before], expected, rtol=1e-6, atol=1e-6)
    assert shown[gap : gap + LAG].max() > 10.0 + largest.max()


@pytest.mark.parametrize(
    ("misfit", "share"), [(0.0, 0), (MISFIT_MAX, 0), (1.25, 0.5), (MISFIT_FULL, 1), (9.0, 1)]
)
def test_a_misfit_leaves_a_share_of_doubt(misfit, share):
    memory, _ = new_memory()
    memory["misfit"][0, 0] = misfit

    assert doubt_of_stiffness(memory[0]) == pytest.approx(share)


def test_a_transmission_may_be_soft_until_a_stride_has_shown_that_it_is_not():
    columns = encoded(walked(active))
    wide, rigid = (seen(columns, some).std for some in ([ALMOST_SURE], ()))
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED, [ALMOST_SURE])
    misfit = kept_by(columns, setup, "misfit")[0, :, 0]

    early = columns.time_s < 1.0
    assert misfit[0] == MISFIT_FULL
    assert rms(wide[early, 4]) > 1.5 * rms(rigid[early, 4])
    np.testing.assert_allclose(wide[:, [5, 7]], rigid[:, [5, 7]], rtol=1e-3)
    assert misfit[columns.time_s > SETTLED_S].max() < MISFIT_MAX


def test_friction_that_has_just_changed_may_be_of_a_joint_that_has_not_yet_turned():
    memory, _ = new_memory()
    memory["mean"][0, 2], memory["mean"][0, 4] = 0.5, 5.0
    memory["usual_friction"][0] = -3.0
    model = LegModel(PATIENT, HIP, SLIDE_FRICTION, 1.0, 0.0)

    def hidden(doubt, stated=0.0):
        copied = memory.copy()
        hide(model, (stated, 0.0), doubt, (0.0, 0.0), copied[0], 0.01)
        return copied["hidden_friction"][0]

    away = 8.0 * np.exp(-0.01 / ENVELOPE_S)
    np.testing.assert_allclose(hidden(1.0), (away**2, 0.0), rtol=1e-9)
    np.testing.assert_allclose(hidden(0.5), (away**2 / 4.0, 0.0), rtol=1e-9)
    np.testing.assert_allclose(
        hidden(1.0, 0.25 * LIKELY_COMPLIANCE), ((0.75 * away) ** 2, 0.0), rtol=1e-9
    )
    for stated in (0.0, 2.0 * LIKELY_COMPLIANCE):
        np.testing.assert_allclose(hidden(0.0, stated), (0.0, 0.0), atol=1e-12)


def test_innovations_count_as_misfit_from_a_while_after_a_rest_or_a_reversal_on():
    memory, _ = new_memory()
    memory["misfit"], memory["whitened"] = 1.0, 2.0

    def counted(cycles, velocity, rest_s=0.0, predicted=0.0):
        memory["mean"][0, 3], memory["rest_s"][0, 1] = velocity, rest_s
        memory["predicted"][0, 1] = predicted
        before = []
        for _ in range(cycles):
            before.append(memory["misfit"][0, 1])
            follow_surprise(memory[0], 0.011)
        return np.flatnonzero(np.diff([*before, memory["misfit"][0, 1]])).tolist()

    assert counted(21, 0.1) == [18, 19, 20]
    assert counted(3, 0.1, predicted=1.0) == []
    assert counted(3, 0.1) == [0, 1, 2]
    assert counted(21, -0.1) == [18, 19, 20]
    assert counted(50, -0.1, rest_s=0.01) == []
    assert counted(21, -0.1) == [18, 19, 20]


def test_swings_that_last_are_of_a_transmission_that_gives_way_until_they_have_ended():
    columns = encoded(walked(lambda time_s: jerky(time_s, ends_s=8.0)))
    wide, rigid = (seen(columns, some).std[:, 4:6] for some in ([ALMOST_SURE], ()))
    given = SHIPPED._replace(compliance=(LIKELY_COMPLIANCE, 0.0))
    soft = seen(columns, (), tuning=given).std[:, 4:6]

    shown = (columns.time_s > 7.0) & (columns.time_s < 9.0)
    assert (wide[shown] > (1.0 - 1e-6) * soft[shown]).all()
    assert rms(wide[shown, 0]) < 1.5 * rms(soft[shown, 0])
    assert rms(soft[shown, 0]) > 1.5 * rms(rigid[shown, 0])
    over = columns.time_s > 14.5
    np.testing.assert_allclose(wide[over], rigid[over], rtol=0.01)


def test_a_wrong_friction_level_shows_at_reversals_and_is_no_transmission_that_gives_way():
    columns = encoded(walked(active, cadence_hz=0.4))
    level = SLIDE_FRICTION.coulomb * 0.2
    friction = SLIDE_FRICTION._replace(
        coulomb=SLIDE_FRICTION.coulomb + level, stribeck=SLIDE_FRICTION.stribeck + level
    )
    unsure = ALMOST_SURE._replace(slide=friction)
    setup = setup_of(PATIENT, HIP, friction, SHIPPED, [unsure])

    whitened, misfit = kept_by(columns, setup, "whitened", "misfit")[:, columns.time_s > SETTLED_S]

    assert np.mean(whitened[:, 1] ** 2) > MISFIT_FULL
    assert misfit.max() < MISFIT_MAX


def test_a_file_that_states_a_softer_transmission_is_believed(swings):
    _, columns = swings
    softer = SHIPPED._replace(compliance=(2.0 * LIKELY_COMPLIANCE, 0.0))
    own, wide = (seen(columns, some, tuning=softer).std[:, 4] for some in ((), [ALMOST_SURE]))

    np.testing.assert_allclose(wide, own, rtol=1e-6)


def test_what_the_transmission_hides_already_is_not_added_again(swings):
    _, columns = swings
    own, wide = (seen(columns, some, tuning=GIVES_WAY) for some in ((), [ALMOST_SURE]))
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


def test_after_a_restart_nothing_of_a_swing_is_left_but_the_misfit_of_the_machine(swings):
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
    assert memory[0]["shown_net"][0] > 0.1
    misfit = memory[0]["misfit"][0]
    assert misfit > MISFIT_MAX

    advance(
        setup, memory, points, tuple(position[520]), tuple(effort[520]), (0.0, 0.0), 10.0, 0, out
    )
    assert memory[0]["shown_net"][0] == memory[0]["surprise"][0] == 0.0
    assert memory[0]["misfit"][0] == misfit
    assert memory[0]["usual_friction"].tolist() == memory[0]["mean"][4:6].tolist()
