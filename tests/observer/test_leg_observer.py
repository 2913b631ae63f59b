"""What the observer says about itself, cycle by cycle: bits, levels, refusals, and no damage."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.filter.considered import NOTHING_KNOWN, Variant
from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import LegObserver, PoseError, TuningError
from observer.filter.states import FRICTION, POSITION, STATE_COUNT, STATE_NAMES, VELOCITY
from observer.filter.states import PATIENT as PATIENT_STATES
from observer.filter.status import (
    GATED_MAX_IN_A_ROW,
    HOLD_AFTER_CYCLES,
    PREDICTED_MAX_CYCLES,
    WARM_UP_CYCLES,
    Status,
    Validity,
)
from observer.mechanism.mechanism import WorkspaceError, gravity, singularity_ratio
from tests.observer.trainer import (
    ENTIRE,
    HIP,
    MID_POSE,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    simulate,
)

POSE = tuple(MID_POSE)
NONE = (math.nan, math.nan)
DT = 0.01


def observer(tuning=TUNING, **more):
    return LegObserver(PATIENT, HIP, SLIDE_FRICTION, tuning, **more)


def resting(cycles=30, tuning=TUNING, **more):
    """An observer whose leg has been at rest in balance for a while."""
    one = observer(tuning, **more)
    one.reset(POSE)
    for _ in range(cycles):
        one.step(POSE, HOLDING, DT)
    return one


HOLDING = tuple(gravity(PATIENT, MID_POSE))


def walking(cycles=250):
    """Samples of a leg that is guided through the normative gait: positions and efforts."""
    path = gait(PATIENT, np.maximum(np.arange(1, cycles + 1) * DT - 0.3, 0.0), 0.25)
    recorded = encoded(simulate(PATIENT, cycles, reference=path, start=path[0]))
    return recorded.position, recorded.effort


WALK = walking()


FIRMER = Variant(PATIENT, HIP, SLIDE_FRICTION._replace(coulomb=1.1 * SLIDE_FRICTION.coulomb))


def walk(one, begin=0, end=200):
    """The estimate after these samples."""
    for position, effort in zip(*(column[begin:end] for column in WALK), strict=True):
        estimate = one.step(position, effort, DT)
    return estimate


def walked(cycles=200, tuning=TUNING):
    one = observer(tuning)
    return one, walk(one, end=cycles)


def finite(estimate):
    return all(map(math.isfinite, (*estimate.state, *estimate.std, *estimate.covariance)))


# --- shape ------------------------------------------------------------------------------------


def test_an_estimate_has_the_states_in_their_order_and_a_covariance_that_agrees():
    _, estimate = walked()
    matrix = np.zeros((STATE_COUNT, STATE_COUNT))
    matrix[np.tril_indices(STATE_COUNT)] = estimate.covariance
    matrix += np.tril(matrix, -1).T

    assert len(estimate.state) == len(STATE_NAMES) == STATE_COUNT
    assert estimate.std == pytest.approx(np.sqrt(np.diag(matrix)), rel=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    net = np.array(estimate.state[PATIENT_STATES]) - estimate.state[FRICTION]
    assert estimate.net == pytest.approx(net)
    for axis in range(2):
        pick = np.zeros(STATE_COUNT)
        pick[[4 + axis, 6 + axis]] = -1.0, 1.0
        assert estimate.net_std[axis] == pytest.approx(math.sqrt(pick @ matrix @ pick), rel=1e-9)


def test_in_motion_both_axes_are_valid():
    _, estimate = walked()

    assert estimate.status == Status.VALID
    assert estimate.validity == (Validity.OK, Validity.OK)
    assert 0.0 < estimate.nis < 60.0


# --- begin ------------------------------------------------------------------------------------


def test_reset_begins_at_the_pose_at_rest_with_warm_up():
    one = observer()
    one.reset(POSE)

    estimate = one.step(POSE, HOLDING, DT)

    assert estimate.state[POSITION] == pytest.approx(POSE, abs=1e-6)
    assert estimate.state[VELOCITY] == pytest.approx((0.0, 0.0), abs=1e-3)
    assert Status.WARM_UP in estimate.status


def test_warm_up_ends():
    one = observer()
    one.reset(POSE)
    bits = [Status.WARM_UP in one.step(POSE, HOLDING, DT).status for _ in range(40)]

    assert bits == [True] * WARM_UP_CYCLES + [False] * (40 - WARM_UP_CYCLES)


@pytest.mark.parametrize(
    ("pose", "why"),
    [
        ((math.radians(-20.0), 0.9), "out of reach"),
        ((math.radians(-20.0), 0.64), "the knee bent backwards: the wrong branch"),
        ((math.nan, 0.5), "not a number"),
        ((0.2, math.inf), "not finite"),
        ((None, 0.5), "missing"),
        ((14.0, 0.59), "degrees for radians"),
        ((0.244, 590.0), "millimetres for metres"),
    ],
)
def test_reset_refuses_a_pose_that_no_leg_has(pose, why):
    one = resting()
    before = one.step(POSE, HOLDING, DT)

    with pytest.raises(PoseError):
        one.reset(pose)

    after = one.step(POSE, HOLDING, DT)
    assert after.state == pytest.approx(before.state, abs=1e-3), why
    assert issubclass(PoseError, WorkspaceError)


def test_without_reset_the_first_complete_possible_sample_begins():
    one = observer()
    missing = one.step((math.nan, 0.5), HOLDING, DT)
    impossible = one.step((math.radians(-20.0), 0.9), HOLDING, DT)
    begun = one.step(POSE, HOLDING, DT)

    for nothing in (missing, impossible):
        assert nothing.validity == (Validity.BAD, Validity.BAD)
        assert Status.VALID not in nothing.status
        assert all(map(math.isnan, (*nothing.state, *nothing.std, *nothing.net)))
    assert Status.OUT_OF_WORKSPACE in impossible.status
    assert Status.OUT_OF_WORKSPACE not in missing.status
    assert begun.state[POSITION] == POSE
    assert Status.VALID in begun.status


# --- refusals of parameters -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"process_std": (1e-6, 1e-6, 1e-3, 0.0, 0.1, 1.0, 0.1, 1.0)}, "process_std"),
        ({"process_std": (1e-6,) * 7}, "8 positive"),
        ({"measurement_std": (0.0, 2.5e-5)}, "measurement_std"),
        ({"measurement_std": (5e-5, math.nan)}, "measurement_std"),
        ({"gate_nis": -1.0}, "gate_nis"),
        ({"substeps": 0}, "substeps = 0"),
    ],
)
def test_noise_and_numbers_that_give_no_honest_estimate_are_refused(change, words):
    with pytest.raises(TuningError, match=words):
        observer(TUNING._replace(**change))


def test_friction_whose_hump_turns_over_is_refused_with_the_least_value():
    with pytest.raises(TuningError, match=r"friction of the slide: stribeck = 65\.0 must exceed"):
        LegObserver(PATIENT, HIP, SLIDE_FRICTION._replace(stribeck=65.0), TUNING)


def test_too_few_substeps_for_the_friction_are_refused():
    steep = SLIDE_FRICTION._replace(time_constant_s=0.002, transition=8e-4, edge=2.4e-3)
    for integrator in Integrator:
        tuning = TUNING._replace(integrator=integrator, substeps=1)
        with pytest.raises(TuningError, match="this friction needs"):
            LegObserver(PATIENT, HIP, steep, tuning)


# --- standstill -------------------------------------------------------------------------------


@pytest.mark.parametrize("velocity_gated", [False, True])
def test_standstill_shows_within_one_sample_and_ends_the_split_after_100_ms(velocity_gated):
    """The leg walks for two seconds and then holds still."""
    path = gait(PATIENT, np.minimum(np.arange(1, 301) * DT, 2.0), 0.25)
    truth = simulate(PATIENT, 300, reference=path, start=path[0])
    recorded = encoded(truth)
    one = observer(TUNING._replace(velocity_gated=velocity_gated))
    rows = [
        one.step(position, effort, DT)
        for position, effort in zip(recorded.position, recorded.effort, strict=True)
    ]
    walked = 150
    stopped = next(k for k in range(walked, 300) if abs(truth.state[k, 2]) < 0.83 * HIP.edge)
    shown = next(k for k in range(walked, 300) if Status.STANDSTILL_HIP in rows[k].status)

    assert abs(shown - stopped) <= 1
    for row in rows[shown : shown + 9]:
        assert row.validity[0] is Validity.OK
    for row in rows[shown + 11 :]:  # a twitch of 30 ms in between does not bring it back
        assert row.validity[0] is Validity.SPLIT_UNOBSERVABLE
        assert Status.VALID in row.status


def test_one_axis_at_rest_leaves_the_others_split_alone():
    cycles = 150
    time_s = np.arange(1, cycles + 1) * DT
    path = np.column_stack(
        (np.full(cycles, MID_POSE[0]), MID_POSE[1] + 0.1 * (1 - np.cos(2 * time_s)))
    )
    recorded = encoded(simulate(PATIENT, cycles, reference=path))
    one = observer()
    rows = [
        one.step(position, effort, DT)
        for position, effort in zip(recorded.position, recorded.effort, strict=True)
    ]

    assert rows[100].validity == (Validity.SPLIT_UNOBSERVABLE, Validity.OK)
    assert Status.STANDSTILL_HIP in rows[100].status
    assert Status.STANDSTILL_SLIDE not in rows[100].status


def test_at_rest_only_the_net_effort_is_observable():
    """The split grows uncertain like a random walk, the net effort stays as it was."""
    early = resting(300).step(POSE, HOLDING, DT)
    late = resting(6000).step(POSE, HOLDING, DT)

    for state in (4, 5, 6, 7):
        assert late.std[state] > 3.0 * early.std[state]
    assert late.net_std == pytest.approx(early.net_std, rel=0.02)
    assert late.net_std[0] < 0.3
    assert late.net_std[1] < 2.6


def test_at_rest_friction_and_patient_are_nearly_one():
    """Rank 6 of 8 at rest: what distinguishes the two of an axis has almost no information."""
    estimate = resting(6000).step(POSE, HOLDING, DT)
    matrix = np.zeros((STATE_COUNT, STATE_COUNT))
    matrix[np.tril_indices(STATE_COUNT)] = estimate.covariance

    for axis in range(2):
        friction, patient = 4 + axis, 6 + axis
        correlation = matrix[patient, friction] / (estimate.std[friction] * estimate.std[patient])
        assert correlation > 0.96


# --- missing samples --------------------------------------------------------------------------


def test_a_missing_sample_is_predicted_over_and_shows():
    one, _ = walked()
    estimate = one.step(NONE, WALK[1][200], DT)

    assert Status.PREDICT_ONLY in estimate.status
    assert estimate.validity == (Validity.OK, Validity.OK)
    assert math.isnan(estimate.nis)
    assert all(map(math.isnan, estimate.innovation))
    assert estimate.state[POSITION] == pytest.approx(WALK[0][200], abs=2e-4)


@pytest.mark.parametrize("axis", [0, 1])
def test_with_one_axis_missing_the_other_still_corrects(axis):
    one, _ = walked()
    sample = list(WALK[0][200])
    sample[axis] = math.nan
    estimate = one.step(sample, WALK[1][200], DT)

    assert Status.PREDICT_ONLY in estimate.status
    assert math.isnan(estimate.innovation[axis])
    assert math.isfinite(estimate.innovation[1 - axis])
    assert math.isfinite(estimate.nis)
    assert estimate.std[axis] > 1.5 * estimate.std[1 - axis] * (
        5.8 / 2.5 if axis == 0 else 2.5 / 5.8
    )


def test_more_than_ten_missing_cycles_are_bad_and_end_with_the_next_sample():
    one, _ = walked()
    levels = [one.step(NONE, HOLDING, DT).validity for _ in range(PREDICTED_MAX_CYCLES + 2)]

    assert Validity.BAD not in levels[PREDICTED_MAX_CYCLES - 1]
    assert levels[PREDICTED_MAX_CYCLES] == (Validity.BAD, Validity.BAD)


def test_an_axis_that_is_missing_for_long_is_bad_alone():
    one, _ = walked()
    for position, effort in zip(*(column[200:212] for column in WALK), strict=True):
        estimate = one.step((math.nan, position[1]), effort, DT)

    assert estimate.validity == (Validity.BAD, Validity.OK)
    assert Status.VALID not in estimate.status


def test_the_positions_uncertainty_grows_while_nothing_is_measured():
    one, estimate = walked()
    for effort in WALK[1][200:230]:
        later = one.step(NONE, effort, DT)
        assert all(b >= a for a, b in zip(estimate.std[:2], later.std[:2], strict=True))
        estimate = later


def test_after_half_a_second_without_samples_the_filter_begins_anew():
    one, _ = walked(60)
    for _ in range(HOLD_AFTER_CYCLES + 30):
        held = one.step(NONE, HOLDING, DT)
    back = [one.step(POSE, HOLDING, DT) for _ in range(WARM_UP_CYCLES + 40)]

    assert finite(held)
    assert held.validity == (Validity.BAD, Validity.BAD)
    assert Status.INCONSISTENT in back[0].status
    assert Status.VALID in back[-1].status


# --- numbers that are none --------------------------------------------------------------------

NO_NUMBERS = pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, None])


@NO_NUMBERS
@pytest.mark.parametrize("place", range(4))
def test_what_is_not_a_number_is_predicted_over_without_damage(bad, place):
    one, _ = walked()
    clean, _ = walked()
    sample = [*WALK[0][200], *WALK[1][200]]
    sample[place] = bad

    estimate = one.step(sample[:2], sample[2:], DT)
    clean.step(*(column[200] for column in WALK), DT)

    assert Status.PREDICT_ONLY in estimate.status
    assert finite(estimate)
    for position, effort in zip(*(column[201:206] for column in WALK), strict=True):
        estimate, expected = one.step(position, effort, DT), clean.step(position, effort, DT)
    assert estimate.status == Status.VALID
    difference = np.abs(np.subtract(estimate.state, expected.state))
    assert np.all(difference <= np.array(expected.std) * 0.5)


@given(
    samples=st.lists(
        st.tuples(
            *(st.one_of(st.floats(), st.floats(-1.0, 1.0)) for _ in range(4)),
            st.one_of(st.floats(), st.sampled_from([0.01, 0.0, -0.01, 0.02, 1.0])),
        ),
        max_size=25,
    )
)
@settings(derandomize=True, deadline=None, max_examples=100)
def test_no_input_whatever_gives_a_number_that_is_none(samples):
    one = resting(3, TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0))
    for hip, slide, torque, force, dt_s in samples:
        estimate = one.step((hip, slide), (torque, force), dt_s)
        assert finite(estimate)
        assert all(std >= 0.0 for std in estimate.std)
        assert all(map(math.isfinite, (*estimate.net, *estimate.net_std)))
        if Status.VALID not in estimate.status:
            assert Validity.BAD in estimate.validity


# --- time -------------------------------------------------------------------------------------


@pytest.mark.parametrize("unsure", [False, True])
@pytest.mark.parametrize("dt_s", [0.0, -0.01, math.nan, -math.inf])
def test_a_duplicate_or_a_step_back_in_time_is_flagged_and_changes_nothing(dt_s, unsure):
    one = observer(considered=[FIRMER] if unsure else [])
    one.take_baseline(ENTIRE if unsure else NOTHING_KNOWN)
    before = walk(one)
    estimate = one.step(WALK[0][199], WALK[1][199], dt_s)

    assert Status.LATE in estimate.status
    assert Status.PREDICT_ONLY in estimate.status
    assert estimate.state == before.state
    assert estimate.covariance == before.covariance
    assert finite(one.step(WALK[0][200], WALK[1][200], DT))


def test_a_baseline_that_is_taken_in_motion_is_no_change_of_friction():
    known, unknown = observer(considered=[FIRMER]), observer(considered=[FIRMER])
    for one, theta in ((known, ENTIRE.theta), (unknown, 0.0 * ENTIRE.theta)):
        walk(one)
        one.take_baseline(ENTIRE._replace(theta=theta))

    taken = walk(known, 200, 201)
    assert np.abs(taken.passive[:2]).max() > 1.0
    assert taken.std == walk(unknown, 200, 201).std


def test_a_cycle_that_was_missed_is_bridged_and_flagged():
    one, _ = walked()
    estimate = one.step(WALK[0][202], WALK[1][202], 0.03)

    assert Status.LATE in estimate.status
    assert Status.GATED not in estimate.status
    assert estimate.state[POSITION] == pytest.approx(WALK[0][202], abs=2e-4)
    assert estimate.validity == (Validity.OK, Validity.OK)


@pytest.mark.parametrize("dt_s", [0.11, 5.0, 1e9, math.inf])
def test_a_clock_that_jumps_makes_the_filter_begin_anew(dt_s):
    one, _ = walked()
    estimate = one.step(WALK[0][201], WALK[1][201], dt_s)

    assert Status.LATE | Status.WARM_UP | Status.INCONSISTENT in estimate.status
    assert estimate.validity == (Validity.BAD, Validity.BAD)
    assert estimate.state[POSITION] == tuple(WALK[0][201])


def test_process_noise_grows_with_time():
    """Twice 5 ms leave as much uncertainty as once 10 ms."""
    once, twice = resting(), resting()
    one = once.step(NONE, HOLDING, 0.01)
    twice.step(NONE, HOLDING, 0.005)
    two = twice.step(NONE, HOLDING, 0.005)

    assert two.std[4:] == pytest.approx(one.std[4:], rel=5e-3)
    assert two.std[:4] == pytest.approx(one.std[:4], rel=2e-2)


# --- gate -------------------------------------------------------------------------------------


@pytest.mark.parametrize("glitch", [0.003, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_glitch_of_an_encoder_is_gated_and_leaves_no_trace(glitch, axis):
    one, _ = walked()
    clean, _ = walked()
    sample = WALK[0][200].copy()
    sample[axis] += glitch
    estimate = one.step(sample, WALK[1][200], DT)
    clean.step(*(column[200] for column in WALK), DT)

    assert Status.GATED | Status.PREDICT_ONLY in estimate.status
    assert estimate.nis > TUNING.gate_nis
    worst = np.zeros(2)
    for position, effort in zip(*(column[201:250] for column in WALK), strict=True):
        estimate, expected = one.step(position, effort, DT), clean.step(position, effort, DT)
        worst = np.maximum(worst, np.abs(np.subtract(estimate.state, expected.state))[6:])
        assert Status.GATED not in estimate.status
    assert worst[0] <= 0.4
    assert worst[1] <= 4.0


@pytest.mark.parametrize("offset", [0.05, -0.05])
def test_an_offset_that_stays_is_believed_after_five_rejections_and_shows(offset):
    one = resting()
    moved = (POSE[0] + offset, POSE[1])
    rows = [one.step(moved, HOLDING, DT) for _ in range(GATED_MAX_IN_A_ROW + 1 + WARM_UP_CYCLES)]

    for row in rows[:GATED_MAX_IN_A_ROW]:
        assert Status.GATED in row.status
        assert row.state[0] == pytest.approx(POSE[0], abs=0.01)
    begun = rows[GATED_MAX_IN_A_ROW]
    assert Status.WARM_UP | Status.INCONSISTENT in begun.status
    assert begun.state[POSITION] == moved
    assert all(row.validity == (Validity.BAD, Validity.BAD) for row in rows[GATED_MAX_IN_A_ROW:-1])
    assert Status.VALID in one.step(moved, HOLDING, DT).status


def test_a_push_that_no_model_foresaw_is_followed_within_three_samples():
    """200 N for a tenth of a second: at each edge one sample is rejected, then all are believed.

    Their split counts again after four T1 of motion, 80 ms.
    """
    cycles = 160
    recorded = encoded(
        simulate(
            PATIENT,
            cycles,
            drive=np.tile(HOLDING, (cycles, 1)),
            patient=lambda t: np.column_stack((0 * t, np.where((t > 1) & (t < 1.1), 200.0, 0.0))),
        )
    )
    one = observer()
    rows = [
        one.step(position, effort, DT)
        for position, effort in zip(recorded.position, recorded.effort, strict=True)
    ]

    assert [k for k, row in enumerate(rows) if Status.GATED in row.status] == [100, 110]
    assert all(Status.VALID in row.status for row in rows)
    for row in rows[103:110]:
        assert row.state[7] == pytest.approx(200.0, rel=0.1)
    for row in rows[114:]:
        assert row.state[7] == pytest.approx(0.0, abs=10.0)
    invalid = [k for k in range(109, 130) if rows[k].validity[1] is not Validity.OK]
    assert invalid == [*range(110, 117)]


def test_what_comes_all_the_time_is_no_glitch():
    """An encoder ten times noisier than configured: BAD as it should be, and hardly rejected."""
    random = np.random.default_rng(2)
    one = observer()
    one.reset(POSE)
    rows = [
        one.step(POSE + random.normal(size=2) * (5.8e-4, 2.5e-4), HOLDING, DT) for _ in range(600)
    ]

    assert Status.INCONSISTENT in rows[-1].status
    assert rows[-1].validity == (Validity.BAD, Validity.BAD)
    assert sum(Status.GATED in row.status for row in rows[200:]) < 40


# --- workspace and bits of the caller ----------------------------------------------------------


def test_near_the_singularity_a_bit_warns():
    stretched = (math.radians(40.0), 0.99)
    assert 0.15 < singularity_ratio(PATIENT, np.array(stretched)) < 0.3
    one = observer()
    one.reset(stretched)

    assert Status.NEAR_SINGULAR in one.step(stretched, HOLDING, DT).status
    assert Status.NEAR_SINGULAR not in resting().step(POSE, HOLDING, DT).status


@pytest.mark.parametrize(
    ("argument", "bit", "is_bad"),
    [
        ("late", Status.LATE, False),
        ("unreferenced", Status.UNREFERENCED, True),
        ("artificial", Status.ARTIFICIAL, False),
        ("input_saturated", Status.INPUT_SATURATED, False),
        ("near_limit", Status.NEAR_LIMIT, False),
    ],
)
def test_what_the_caller_knows_is_a_bit_for_that_cycle(argument, bit, is_bad):
    one, _ = walked()
    told = one.step(WALK[0][200], WALK[1][200], DT, **{argument: True})
    after = one.step(WALK[0][201], WALK[1][201], DT)

    assert bit in told.status
    assert bit not in after.status
    assert (told.validity == (Validity.BAD, Validity.BAD)) == is_bad
    assert after.status == Status.VALID


def test_uncalibrated_friction_is_bad_in_every_cycle():
    estimate = resting(calibrated=False).step(POSE, HOLDING, DT)

    assert Status.UNCALIBRATED in estimate.status
    assert estimate.validity == (Validity.BAD, Validity.BAD)


def test_status_bits_have_the_values_that_recordings_hold():
    assert [bit.name for bit in Status] == [
        *("VALID", "WARM_UP", "PREDICT_ONLY", "GATED", "STANDSTILL_HIP", "STANDSTILL_SLIDE"),
        *("NEAR_SINGULAR", "OUT_OF_WORKSPACE", "LATE", "INCONSISTENT", "UNREFERENCED"),
        *("ARTIFICIAL", "INPUT_SATURATED", "NEAR_LIMIT", "UNCALIBRATED", "BASELINE"),
    ]
    assert [bit.value for bit in Status] == [1 << k for k in range(16)]


# --- sameness ---------------------------------------------------------------------------------


def test_the_same_samples_give_the_same_bits():
    first, second = walked()[1], walked()[1]

    assert first == second


def test_two_legs_share_nothing():
    alone, _ = walked(120)
    expected = alone.step(WALK[0][120], WALK[1][120], DT)
    right, left = observer(), observer()
    for k in range(121):
        estimate = right.step(WALK[0][k], WALK[1][k], DT)
        left.step((math.nan, 1e9), (1e9, math.inf), 5.0)
        left.step(POSE, (100.0, -300.0), DT)

    assert estimate == expected
