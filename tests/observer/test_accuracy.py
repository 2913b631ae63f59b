"""How near the estimates come to the truth of a plant that the filter does not share.

Bounds follow observer.md 3.2; the plant takes 0.1 ms steps, encoders are quantised and noisy. What
is measured stands beside each bound.
"""

import dataclasses

import numpy as np
import pytest

from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import setup_of
from observer.filter.status import Status, Validity
from observer.offline import batch
from tests.observer.trainer import (
    HIP,
    MID_POSE,
    PATIENT,
    PROTOTYPE,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    moving,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
HIP_DISTURBANCE, SLIDE_DISTURBANCE = 4.0, 30.0
SETTLED = 50
"""Rows that a filter may take after its start."""


def estimated(leg, truth, tuning=TUNING, columns=None, slide=SLIDE_FRICTION, hip=HIP):
    setup = setup_of(leg, hip, slide, tuning)
    return batch.run(setup, encoded(truth) if columns is None else columns)


def paper_scenario(lugre=False, seconds=30.0, hip_from=15.0, slide_from=10.0, slide_to=18.0):
    """Figs 4 and 5: hip torque from 2 s, slide force from 0, disturbances at the given times."""
    cycles = int(seconds * 100)
    time_s = (np.arange(cycles) + 0.5) * 0.01

    def held(t):
        """Disturbances as the artificial ones are: constant over each cycle."""
        t = (np.floor(t / 0.01) + 0.5) * 0.01
        hip = HIP_DISTURBANCE * np.sin(2 * np.pi * 0.35 * (t - hip_from))
        slide = np.where((t > slide_from) & (t < slide_to), SLIDE_DISTURBANCE, 0.0)
        return np.column_stack((np.where(t > hip_from, hip, 0.0), slide))

    hip = np.where(time_s < 2.4, 11.0, 10.0 * np.sin(2 * np.pi * 0.3 * time_s))
    hip = np.where(time_s < 2.0, 0.0, hip)
    applied = np.column_stack((hip, 95.0 * np.sin(2 * np.pi * 0.2 * time_s)))
    return simulate(PROTOTYPE, cycles, drive=applied - held(time_s), patient=held, lugre=lugre)


@pytest.fixture(scope="module")
def matched():
    truth = paper_scenario()
    return truth, estimated(PROTOTYPE, truth)


@pytest.fixture(scope="module")
def bristled():
    truth = paper_scenario(lugre=True)
    return truth, estimated(PROTOTYPE, truth)


def errors(truth, estimates):
    return (estimates.state - truth.state)[SETTLED:]


def errors_moving(truth, estimates, states):
    """RMS of two states' errors, each while its axis moves."""
    open_gate = moving(truth)[SETTLED:]
    error = errors(truth, estimates)[:, states]
    return np.array([rms(error[open_gate[:, axis], axis]) for axis in range(2)])


# --- the paper's scenario ---------------------------------------------------------------------


def test_positions_are_known_to_half_an_encoder_quantum(matched):
    assert np.all(rms(errors(*matched)[:, :2]) <= (5e-5, 2.5e-5))  # 4.7e-5 rad, 2.0e-5 m


def test_velocities_are_three_times_better_than_differences_of_positions(matched):
    truth, estimates = matched
    differences = np.diff(encoded(truth).position, axis=0) / 0.01
    naive = rms((differences - truth.state[1:, 2:4])[SETTLED:])

    velocity = rms(errors(truth, estimates)[:, 2:4])
    assert np.all(velocity <= (4e-3, 2e-3))  # 3.6e-3 rad/s, 1.8e-3 m/s
    assert np.all(naive >= 2.0 * velocity)


def test_friction_in_motion_is_known_to_a_percent_at_the_hip_and_three_at_the_slide(matched):
    hip, slide = errors_moving(*matched, slice(4, 6))

    assert hip <= 0.01 * HIP.coulomb  # 0.032 N m
    assert slide <= 0.035 * SLIDE_FRICTION.coulomb  # 2.0 N, nearly all after the 30 N steps


def test_a_disturbance_in_motion_is_known_to_five_percent_of_its_peak(matched):
    hip, slide = errors_moving(*matched, slice(6, 8))

    assert hip <= 0.05 * HIP_DISTURBANCE  # 0.16 N m
    assert slide <= 0.09 * SLIDE_DISTURBANCE  # 2.3 N, with the steps of 30 N at reversals


def test_the_net_effort_is_known_also_at_rest(matched):
    truth, estimates = matched
    net = truth.state[:, 6:8] - truth.state[:, 4:6]

    assert np.all(rms((estimates.net - net)[SETTLED:]) <= (0.2, 2.0))  # 0.15 N m, 1.5 N


@pytest.mark.parametrize(
    ("lugre", "draws_count"),
    [(False, 30), pytest.param(True, 30, marks=pytest.mark.thorough)],
)
def test_the_gate_costs_no_net_effort_at_rest_or_in_motion(lugre, draws_count):
    """Draws of noise and of the disturbances' times, which meet the leg in any motion."""
    draws = np.random.default_rng(1)
    squares = np.zeros((2, 2, 2))  # without and with gate; rest and motion; axis
    for seed in range(draws_count):
        hip_from, slide_from, slide_to = draws.uniform((14.0, 7.5, 15.5), (16.0, 12.5, 20.5))
        truth = paper_scenario(lugre, 30.0, hip_from, slide_from, slide_to)
        net = truth.state[:, 6:8] - truth.state[:, 4:6]
        for gated, tuning in enumerate((SHIPPED._replace(velocity_gated=False), SHIPPED)):
            made = estimated(PROTOTYPE, truth, tuning, encoded(truth, seed))
            error = (made.net - net)[SETTLED:]
            for motion, rows in enumerate((~moving(truth)[SETTLED:], moving(truth)[SETTLED:])):
                squares[gated, motion] += np.sum(np.square(error) * rows, axis=0)

    assert np.all(squares[1] <= squares[0])


def test_innovations_are_as_large_as_the_filter_says(matched):
    _, estimates = matched

    assert 1.5 <= np.nanmean(estimates.nis) <= 2.2  # 1.75, ideally 2
    assert not np.any(estimates.status & Status.INCONSISTENT)
    assert not np.any(estimates.validity == Validity.BAD)


def test_against_bristles_errors_stay_within_their_bounds(bristled):
    friction = errors_moving(*bristled, slice(4, 6))
    disturbance = errors_moving(*bristled, slice(6, 8))

    assert np.all(friction <= (0.6, 2.5))  # 0.49 N m, 1.7 N
    assert np.all(disturbance <= (0.6, 3.0))  # 0.50 N m, 2.2 N
    assert not np.any(bristled[1].validity == Validity.BAD)


def test_a_step_of_torque_from_rest_is_seen_in_velocity_without_lag(matched):
    truth, estimates = matched
    step = slice(200, 245)
    peak = int(np.argmax(truth.state[step, 2]))

    assert abs(int(np.argmax(estimates.state[step, 2])) - peak) <= 1
    assert estimates.state[step, 2].max() == pytest.approx(truth.state[step, 2].max(), rel=0.02)


def test_a_disturbance_that_came_at_rest_is_transferred_once_the_leg_moves(matched):
    """30 N at 10 s into a slide at rest: some cycles after it breaks loose, friction has let go."""
    truth, estimates = matched
    onset = 1000 + int(np.argmax(np.abs(truth.state[1000:, 3]) > SLIDE_FRICTION.edge))

    settled = slice(onset + 10, onset + 60)
    assert rms((estimates.state - truth.state)[settled, 7]) <= 4.0


def test_both_integrators_reach_the_same_accuracy(matched):
    truth, _ = matched
    semi_implicit = TUNING._replace(integrator=Integrator.SEMI_IMPLICIT)
    other = estimated(PROTOTYPE, truth, semi_implicit)

    assert np.all(errors_moving(truth, other, slice(6, 8)) <= (0.2, 2.8))
    assert 1.5 <= np.nanmean(other.nis) <= 2.2


# --- disturbance steps in motion --------------------------------------------------------------


def in_steady_motion(patient):
    """Guided at constant speed on both axes, so that nothing else happens."""
    time_s = np.arange(1, 171) * 0.01
    path = MID_POSE + np.outer(np.maximum(time_s - 0.2, 0.0), (0.10, 0.14))
    return simulate(PROTOTYPE, 170, reference=path, patient=patient)


def response_to(push):
    """Estimated efforts of the patient with less those without a push, mean of ten encoders."""
    pushed, calm = in_steady_motion(push), in_steady_motion(None)
    differences = [
        estimated(PROTOTYPE, pushed, columns=encoded(pushed, seed)).state[100:, 6:8]
        - estimated(PROTOTYPE, calm, columns=encoded(calm, seed)).state[100:, 6:8]
        for seed in range(10)
    ]
    return np.mean(differences, axis=0)


@pytest.mark.parametrize(
    ("axis", "size", "rows", "overshoot", "cross_talk"),
    [
        (0, 12.0, 6, 1.13, 2.0),  # rejected first: 50 ms, 1.5 N
        (1, 30.0, 7, 1.08, 0.25),  # 60 ms, 0.1 N m
    ],
)
def test_a_step_in_motion_is_seen_at_once_and_hardly_on_the_other_axis(
    axis, size, rows, overshoot, cross_talk
):
    def push(t):
        effort = np.zeros((len(t), 2))
        effort[t > 1.0, axis] = size
        return effort

    response = response_to(push)

    assert int(np.argmax(response[:, axis] >= 0.9 * size)) + 1 <= rows
    assert response[:, axis].max() <= overshoot * size
    assert np.abs(response[:, 1 - axis]).max() <= cross_talk


def test_a_push_while_a_joint_slows_down_is_the_patients_also_with_the_gate():
    """The estimated velocity is zero before the slide is, and friction seems beyond breakaway.

    To take the excess for the patient at that moment makes the patient's error 1.5 times as large.
    """
    drive = np.tile((0.0, -85.5), (140, 1))

    def patient(t):
        return np.column_stack((0.0 * t, -30.0 * (t > 0.80)))  # at -0.008 m/s

    truth = simulate(PATIENT, 140, drive=drive, patient=patient)
    worst = np.zeros(2)
    for seed in range(10):
        for gated in range(2):
            tuning = SHIPPED._replace(velocity_gated=gated == 1)
            made = estimated(PATIENT, truth, tuning, encoded(truth, seed))
            error = (made.state - truth.state)[83:, 7]
            worst[gated] = max(worst[gated], rms(error))

    assert worst[1] <= 1.05 * worst[0]  # 6.5 N of 6.6


# --- gait -------------------------------------------------------------------------------------


def walking(cadence_hz, patient=None, lugre=False, strides=3):
    cycles = int(strides / cadence_hz * 100) + 300
    time_s = np.arange(1, cycles + 1) * 0.01
    path = gait(PATIENT, np.maximum(time_s - 2.0, 0.0), cadence_hz)
    truth = simulate(PATIENT, cycles, reference=path, start=path[0], patient=patient, lugre=lugre)
    return truth, slice(300, None)


def effort_over_the_stride(cadence_hz):
    def patient(t):
        turns = 2 * np.pi * cadence_hz * t
        return (
            np.column_stack((8.0 * np.sin(turns), 40.0 * np.sin(turns + 1.0))) * (t > 2.0)[:, None]
        )

    return patient


def activity_error(truth, estimates, rows):
    open_gate = moving(truth)[rows]
    error = (estimates.state - truth.state)[rows, 6:8]
    return np.array([rms(error[open_gate[:, axis], axis]) for axis in range(2)])


@pytest.mark.parametrize(
    ("lugre", "hip", "slide"),
    [(False, 0.1, 1.0), (True, 0.7, 5.0)],  # 0.085 N m, 0.68 N; 0.57 N m, 2.7 N
)
def test_without_a_patient_there_is_no_activity(lugre, hip, slide):
    truth, rows = walking(0.25, lugre=lugre)

    assert np.all(activity_error(truth, estimated(PATIENT, truth), rows) <= (hip, slide))


def test_a_patient_of_8_nm_and_40_n_is_followed():
    truth, rows = walking(0.5, effort_over_the_stride(0.5))
    estimates = estimated(PATIENT, truth)

    assert np.all(activity_error(truth, estimates, rows) <= (0.96, 4.0))  # 0.86 N m, 3.3 N
    for axis in range(2):
        known = estimates.validity[rows, axis] == Validity.OK
        pair = estimates.state[rows, 6 + axis][known], truth.state[rows, 6 + axis][known]
        assert np.corrcoef(*pair)[0, 1] >= 0.98


def test_the_papers_model_sees_coriolis_as_a_patient():
    """observer.md, fact 2: 0.96 N m at 0.25 Hz, 3.75 N m at 0.5 Hz, 0.08 N m with the terms."""
    paper = TUNING._replace(coriolis=False)
    slow, rows = walking(0.25)
    fast, _ = walking(0.5)

    assert activity_error(slow, estimated(PATIENT, slow, paper), rows)[0] == pytest.approx(
        0.98, rel=0.1
    )
    assert activity_error(fast, estimated(PATIENT, fast, paper), rows)[0] == pytest.approx(
        3.9, rel=0.15
    )
    assert activity_error(fast, estimated(PATIENT, fast), rows)[0] <= 0.1


def test_friction_levels_that_are_wrong_by_a_fifth_show_as_that_friction():
    """observer.md, fact 5: 1.2 N m and 13 N. Calibration matters more than the filter."""
    truth = paper_scenario()
    wrong_hip = HIP._replace(stribeck=0.8 * HIP.stribeck, coulomb=0.8 * HIP.coulomb)
    wrong_slide = SLIDE_FRICTION._replace(stribeck=60.0, coulomb=52.0)
    estimates = estimated(PROTOTYPE, truth, hip=wrong_hip, slide=wrong_slide)

    hip, slide = errors_moving(truth, estimates, slice(6, 8))
    assert hip == pytest.approx(1.25, rel=0.15)
    assert slide == pytest.approx(13.3, rel=0.15)


# --- rest -------------------------------------------------------------------------------------


def at_rest(velocity_gated):
    truth = simulate(PROTOTYPE, 6000, drive=np.zeros((6000, 2)))
    tuning = TUNING._replace(velocity_gated=velocity_gated)
    return truth, estimated(PROTOTYPE, truth, tuning)


def test_a_minute_at_rest_moves_the_net_effort_by_no_more_than_its_sigma():
    truth, estimates = at_rest(velocity_gated=False)
    net = (truth.state[:, 6:8] - truth.state[:, 4:6])[SETTLED:]

    assert np.all(np.abs(estimates.net[SETTLED:] - net) <= 4.5 * estimates.net_std[SETTLED:])
    assert np.all(estimates.validity[SETTLED:] == Validity.SPLIT_UNOBSERVABLE)


def test_a_disturbance_at_rest_is_within_sigma_at_once_and_found_when_the_leg_moves():
    """Fig. 5: 30 N at 10 s into a slide that rests. It creeps from 10.08 s, is loose at 10.36."""
    truth = paper_scenario(seconds=12.0)
    estimates = estimated(PROTOTYPE, truth, TUNING._replace(velocity_gated=True))
    after, std = estimates.state[1000:, 7], estimates.std[1000:, 7]
    onset = int(np.argmax(np.abs(truth.state[1000:, 3]) > SLIDE_FRICTION.edge))

    assert np.all(np.abs(after - 30.0) <= 3.0 * std)
    assert np.all(estimates.validity[1000:1025, 1] == Validity.SPLIT_UNOBSERVABLE)
    assert int(np.argmax(after > 27.0)) <= onset + 10
    assert rms(after[onset + 10 : onset + 60] - 30.0) <= 3.0  # 1.3 N


# --- loss, jitter, delay ----------------------------------------------------------------------


def with_gaps(columns, share, seed=4):
    lost = np.random.default_rng(seed).random(len(columns.time_s)) < share
    lost[:SETTLED] = False
    position = columns.position.copy()
    position[lost] = np.nan
    return dataclasses.replace(columns, position=position)


def test_a_fifth_of_the_samples_lost_costs_little(matched):
    """Each of ten draws of noise and loss; friction up to 0.038 N m, disturbance 0.15 N m of 0.14.

    observer.md 3.2: disturbance 0.173 -> 0.185 N m. An earlier prototype had friction at 0.043 N m.
    """
    truth, _ = matched
    clean = estimated(PROTOTYPE, truth, SHIPPED)
    found = []
    for seed in range(10):
        columns = with_gaps(encoded(truth, seed), 0.2, seed + 100)
        lossy = estimated(PROTOTYPE, truth, SHIPPED, columns)
        found.append(
            [errors_moving(truth, lossy, states)[0] for states in (slice(4, 6), slice(6, 8))]
        )
        assert np.isfinite(lossy.state).all()

    assert np.max(found, axis=0)[0] <= 0.043
    assert np.mean(found, axis=0)[1] <= 1.15 * errors_moving(truth, clean, slice(6, 8))[0]


@pytest.mark.parametrize("cycles", [10, 30])
def test_in_a_gap_the_position_stays_within_three_sigma(cycles):
    """With nothing unforeseen in it: a passive leg in gait. 2.4 sigma, 3e-4 m after 300 ms."""
    truth, _ = walking(0.25)
    columns = encoded(truth)
    for start in range(300, 1400, 67):
        gap = slice(start, start + cycles)
        position = columns.position.copy()
        position[gap] = np.nan
        estimates = estimated(
            PATIENT, truth, columns=dataclasses.replace(columns, position=position)
        )
        error = np.abs(estimates.state - truth.state)[gap, :2]
        assert np.all(error <= 3.0 * estimates.std[gap, :2])
        assert np.all(estimates.std[gap, :2][-1] > estimates.std[gap, :2][0])


def jittered(sigma_ms):
    """Samples at times that scatter, in steps of 0.1 ms, and the truth at these times."""
    cycles = 900
    late = np.random.default_rng(3).normal(size=cycles) * sigma_ms * 10
    late = np.clip(np.round(late), -45, 45).astype(int)
    time_s = np.arange(1, cycles + 1) * 0.01
    path = gait(PATIENT, np.maximum(time_s - 2.0, 0.0), 0.25)
    steps = 100 + np.diff(np.concatenate(([0], late)))
    truth = simulate(
        PATIENT,
        cycles,
        reference=path,
        start=path[0],
        patient=effort_over_the_stride(0.25),
        steps=steps,
    )
    return truth, time_s


def test_jitter_costs_nothing_when_samples_carry_their_times_and_alarms_when_not():
    punctual, _ = jittered(0.0)
    truth, time_s = jittered(1.0)
    rows = slice(300, None)
    stamped = estimated(PATIENT, truth)
    assumed = estimated(PATIENT, truth, columns=dataclasses.replace(encoded(truth), time_s=time_s))

    clean = activity_error(punctual, estimated(PATIENT, punctual), rows)
    assert np.all(activity_error(truth, stamped, rows) <= 1.05 * clean)
    assert not np.any(stamped.status & Status.INCONSISTENT)
    assert np.mean((assumed.status[rows] & Status.INCONSISTENT) > 0) > 0.5


def test_torque_that_is_counted_one_cycle_late_costs_accuracy_and_no_alarm():
    """observer.md, test 31: NIS does not see it, so the timing has to be right by construction."""
    truth, rows = walking(0.25, effort_over_the_stride(0.25))
    columns = encoded(truth)
    late = dataclasses.replace(columns, effort=np.roll(columns.effort, 1, axis=0))
    right, wrong = estimated(PATIENT, truth), estimated(PATIENT, truth, columns=late)

    assert activity_error(truth, wrong, rows)[1] > 1.5 * activity_error(truth, right, rows)[1]
    assert not np.any(wrong.status[rows] & Status.INCONSISTENT)


def test_an_end_stop_looks_like_a_patient_so_the_caller_must_say_near_limit():
    """Driven against the lower stop of the slide: its force is what a patient's would be."""
    drive = np.tile((0.0, -250.0), (300, 1))
    truth = simulate(PATIENT, 300, drive=drive, start=(0.3, 0.15))
    estimates = estimated(PATIENT, truth)

    assert truth.state[-1, 1] < 0.0
    assert estimates.net[-1, 1] > 40.0
    assert np.isfinite(estimates.state).all()
