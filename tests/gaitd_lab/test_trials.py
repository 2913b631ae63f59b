"""Trials: recordings of the virtual machine beside the truth."""

import dataclasses

import msgspec
import numpy as np
import pytest

from gaitd_lab.trial import (
    Trial,
    on_the_grid,
    with_glitches,
    with_jitter,
    with_late_efforts,
    with_ripple,
)
from gaitd_lab.trials import TrialError, Trials, balanced

ENCODER_NOISE = np.array([5e-5, 2e-5])
QUANTUM = np.array([2 * np.pi / (4 * 1024 * 100), 0.15 / (4 * 512 * 6)])
LATCH_S = 30e-6
MID_POSE = (np.radians(13.98), 0.5905)


@pytest.fixture(scope="module")
def trials(soon) -> Trials:
    return Trials(soon / "demo.toml")


def test_recording_and_truth_are_of_the_same_instants(walk):
    """In every row, though the hip moves by 100 quanta in a cycle."""
    wrong = np.abs(walk.recording.position - walk.truth[:, :2])
    allowed = QUANTUM + 6 * ENCODER_NOISE + LATCH_S * np.abs(walk.truth[:, 2:4])
    measured = np.isfinite(wrong)

    assert np.abs(np.diff(walk.truth[walk.judged, 0])).max() > 100 * QUANTUM[0]
    assert measured[1:].all()
    assert (wrong <= allowed)[measured].all()


def test_velocities_of_the_truth_are_those_of_its_positions(walk):
    slope = np.gradient(walk.truth[:, :2], walk.recording.time_s, axis=0)[1:-1]

    assert np.abs(slope - walk.truth[1:-1, 2:4])[walk.judged[1:-1]].max() < 0.05


def test_the_rows_to_judge_are_those_of_the_gait(walk):
    assert walk.ended == ""
    assert 6.0 < walk.judged.sum() * 0.01 <= 8.1
    assert walk.moving[walk.judged].mean() > 0.8
    assert np.abs(walk.truth[walk.judged, 6]).max() > 6.0


def test_an_artificial_disturbance_counts_as_a_patient(trials):
    trial = trials.excite("paper", 10.6)

    assert trial.robot.patient is None
    assert set(np.round(trial.truth[trial.judged, 7])) == {0.0, 30.0}


def test_at_rest_nothing_moves_and_all_is_judged(trials):
    told: list[float] = []
    trial = trials.rest(4.0, told.append)

    assert told == sorted(told)
    assert told[-1] == 1.0
    assert trial.judged.sum() * 0.01 > 2.5
    assert not trial.moving[trial.judged].any()
    assert not trial.truth[trial.judged, 6:].any()


def test_an_unknown_scenario_says_why(trials):
    with pytest.raises(TrialError, match="nowhere"):
        trials.excite("nowhere", 5.0)


def test_another_patient_is_carried_by_the_springs_at_mid_pose(trials, soon):
    patient = msgspec.structs.replace(trials.robot.patient, mass_kg=110.0)
    sagging = msgspec.structs.replace(trials.robot, patient=patient)
    heavy = balanced(sagging, MID_POSE)

    def effort_of(robot):
        return np.abs(Trials(soon / "demo.toml", robot).rest(2.0).recording.effort[-50:]).max()

    assert effort_of(heavy) < 8.0 < effort_of(sagging)


def test_ripple_has_its_size_and_its_seed(walk):
    one, same, other = (with_ripple(walk, (0.1, 16.0), seed) for seed in (1, 1, 2))
    noise = one.recording.effort - walk.recording.effort

    assert np.array_equal(one.recording.effort, same.recording.effort)
    assert not np.array_equal(one.recording.effort, other.recording.effort)
    assert noise.std(axis=0) == pytest.approx([0.1, 16.0], rel=0.1)


def test_late_efforts_stand_a_row_earlier_than_they_act(walk):
    late = with_late_efforts(walk, 1)

    assert np.array_equal(late.recording.effort[:-1], walk.recording.effort[1:])


def test_glitches_hit_single_samples_of_both_encoders(walk):
    spoiled = with_glitches(walk, 0.5, (0.01, 0.1), seed=3)
    height = np.abs(spoiled.recording.position - walk.recording.position)
    hit = np.nan_to_num(height) > 0

    assert hit.sum() == pytest.approx(walk.recording.duration_s / 0.5, abs=1)
    assert hit.any(axis=0).all()
    assert (height[hit] > 0.0099).all()
    assert (height[hit] < 0.1001).all()


def test_jittered_samples_lie_on_the_true_motion_at_their_true_times(walk):
    jittered = with_jitter(walk, 1e-3, (0.0, 0.0), (1e-9, 1e-9), seed=4)
    off_s = jittered.recording.time_s - walk.recording.time_s
    nominal = on_the_grid(jittered, walk)

    assert off_s.std() == pytest.approx(1e-3, rel=0.1)
    assert (np.diff(jittered.recording.time_s) > 0).all()
    moved = jittered.recording.position - walk.truth[:, :2]
    expected = off_s[:, None] * walk.truth[:, 2:4]
    assert np.abs(moved - expected)[walk.judged].max() < 1e-4
    assert np.array_equal(nominal.recording.time_s, walk.recording.time_s)


def test_jitter_keeps_the_impulse_of_the_efforts(walk):
    jittered = with_jitter(walk, 1e-3, (0.0, 0.0), (1e-9, 1e-9), seed=4)

    def impulse(trial: Trial) -> np.ndarray:
        steps_s = np.diff(trial.recording.time_s)
        return (trial.recording.effort[1:] * steps_s[:, None]).sum(axis=0)

    assert impulse(jittered) == pytest.approx(impulse(walk), abs=1e-6)


def test_a_trial_is_left_as_it_is_by_what_is_done_to_a_copy(walk):
    before = dataclasses.replace(walk)
    with_ripple(walk, (1.0, 1.0), 1)
    with_glitches(walk, 1.0, (0.1, 0.2), 1)

    assert np.array_equal(before.recording.position, walk.recording.position, equal_nan=True)
