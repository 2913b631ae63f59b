"""The reference controller with patients of each kind, on the real observer and core.

Simulated time, and a plant whose patient reacts to the gait (`gaitd_lab/patients.py`). All with
the settings that are shipped, from full stiffness and no assist.
"""

import math

import numpy as np
import pytest
from assisted import SHIPPED, TRANSPARENCY, Answers, Fixed, Gym, shipped
from gaitd_assist import parse_settings
from sessions import elsewhere

from daemon.ipc.record import Cause, Mode
from daemon.wire.refusals import SetpointRefusal
from gaitd_lab.patients import Slacking, of_ability, resisting, spastic, tiring
from sim_drives.plant.settings import FrictionLaw

CAP = np.array([20.0, 150.0])
NEAR = np.array([math.radians(5.0), 0.075])
"""5 degrees at the hip, and what that is at the knee."""
LATE_CYCLES = 12
"""More than setpoint_age_max_cycles."""


def controller():
    return shipped().controller()


@pytest.fixture(scope="session")
def warm_gym():
    return Gym()


@pytest.fixture(scope="session")
def warm_lugre_gym():
    return Gym(law=FrictionLaw.LUGRE)


def stiffness(walk):
    return [line.state["stiffness_ratio"] for line in walk.answers.lines]


def assist_nm(walk):
    return [line.assist_mean_nm for line in walk.answers.lines]


def share(walk):
    return np.mean([line.share_ratio for line in walk.answers.lines[-2:]])


def goes_on_unrefused(walk):
    record = walk.session.record
    assert (record.mode, record.verdict.cause) == (Mode.GAIT, Cause.NONE)
    assert set(record.assist.refused_count) == {0}
    assert record.assist.lapse_count == 0


def stays_near(walk, begin=0):
    assert (np.abs(walk.errors(begin)).max(axis=0) < NEAR).all()


def is_left_alone(walk, forgetting_ratio):
    """At most 2 % of the cap at any time, from the first stride to some at the floor."""
    goes_on_unrefused(walk)
    counts = np.arange(1, len(walk.answers.lines) + 1)
    assert stiffness(walk) == pytest.approx(list(np.maximum(forgetting_ratio**counts, 0.1)))
    assert stiffness(walk)[-2] == 0.1
    assert (np.abs(walk.assist()).max(axis=0) <= 0.02 * CAP).all()


def soon_at_the_floor():
    return Answers(shipped(("forgetting_ratio = 0.85", "forgetting_ratio = 0.5")).controller())


def test_a_passive_patient_is_carried_and_stays_near_the_gait(warm_gym):
    walk = warm_gym.walk(of_ability(0.0), 4)

    goes_on_unrefused(walk)
    stays_near(walk)
    assert stiffness(walk)[-1] > 0.55
    assert assist_nm(walk)[-1] > 1.0
    assert all(np.diff(assist_nm(walk)) > 0)


def test_a_patient_who_does_half_gets_less_help_than_a_passive_one(warm_gym):
    walk = warm_gym.walk(of_ability(0.5), 4)

    goes_on_unrefused(walk)
    stays_near(walk)
    assert 0.4 < stiffness(walk)[-1] < 0.55
    assert assist_nm(walk)[-1] < 0.3


def test_an_able_patient_is_left_alone(warm_gym):
    is_left_alone(warm_gym.walk(of_ability(1.0), 6, soon_at_the_floor()), 0.5)


def test_friction_that_is_estimated_wrong_brings_no_assist(warm_lugre_gym):
    """The observer takes several newtons of LuGre friction for the patient."""
    is_left_alone(warm_lugre_gym.walk(of_ability(1.0), 5, soon_at_the_floor()), 0.5)


def test_a_resisting_patient_is_guided_and_not_pushed_hard(warm_gym):
    walk = warm_gym.walk(resisting, 3)

    goes_on_unrefused(walk)
    assert stiffness(walk)[-1] > 0.85
    assert (np.abs(walk.assist()).max(axis=0) < 0.6 * CAP).all()


def test_a_catch_in_each_stride_neither_stops_the_gait_nor_is_fought(warm_gym):
    walk = warm_gym.walk(spastic, 4)

    goes_on_unrefused(walk)
    stays_near(walk)
    assert (np.abs(walk.assist()).max(axis=0) < 0.6 * CAP).all()


def test_help_comes_back_as_a_patient_tires(warm_gym):
    walk = warm_gym.walk(tiring(12.0), 6)

    goes_on_unrefused(walk)
    assert assist_nm(walk)[0] < 0.1
    assert assist_nm(walk)[-1] > 1.2
    assert stiffness(walk)[-1] > 1.2 * 0.85**6
    assert (np.abs(walk.errors()).max(axis=0) < 1.35 * NEAR).all()


def test_a_slacking_patient_does_more_than_under_fixed_guidance(warm_gym):
    def share_under(kind):
        return elsewhere(warm_gym, lambda gym: share(gym.walk(Slacking(), 5, kind(controller()))))

    assert share_under(Answers) > 1.1 * share_under(Fixed)


@pytest.mark.parametrize("how", ["killed", "frozen", "late"])
def test_a_controller_that_fails_leaves_a_leg_that_is_braked_and_held(warm_gym, how):
    session, steering, *_ = warm_gym.walk(of_ability(0.0), 1)
    answer = steering.setpoint
    if how == "killed":
        session.gateway.end_lease()
    elif how == "frozen":
        steering.running = False
    else:
        steering.setpoint = lambda _, leg: answer(session.records[-LATE_CYCLES], leg)
    session.run_until(lambda record: record.mode == Mode.HOLD, within_s=0.5)
    session.run(1.0)

    record = session.record
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert record.assist.legs[0].assist == (0.0, 0.0)
    assert all(abs(drive.velocity_si) < 0.03 for drive in record.drives)
    assert (record.assist.refused_count[SetpointRefusal.STALE] > 0) == (how == "late")


@pytest.mark.thorough
@pytest.mark.parametrize("ability", [0.0, 1.0])
def test_friction_fed_forward_on_the_whole_leg_disturbs_no_gait(warm_lugre_gym, ability):
    settings = parse_settings(SHIPPED.read_text() + TRANSPARENCY, SHIPPED)
    walk = warm_lugre_gym.walk(of_ability(ability), 4, Answers(settings.controller()))

    goes_on_unrefused(walk)
    stays_near(walk)
    assert (np.abs(walk.assist()).max(axis=0) > (3.0, 30.0)).all()


@pytest.mark.thorough
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", range(2, 12))
def test_with_ten_other_seeds_help_falls_as_the_patient_works(seed):
    gym = Gym(seed=seed)

    def walked(ability, strides_count):
        def figures(one):
            walk = one.walk(of_ability(ability), strides_count)
            if ability == 1.0:
                is_left_alone(walk, 0.85)
            else:
                goes_on_unrefused(walk)
                stays_near(walk)
            return stiffness(walk)[11], assist_nm(walk)[11]

        return elsewhere(gym, figures)

    passive, half, able = walked(0.0, 12), walked(0.5, 12), walked(1.0, 20)
    assert passive[0] > half[0] > able[0]
    assert passive[1] > half[1] > able[1]


@pytest.mark.thorough
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", [1, 2])
def test_help_follows_a_patient_who_tires_over_twenty_minutes(seed):
    """Able at the beginning, without any strength after twenty minutes."""
    walk = Gym(seed=seed).walk(tiring(1200.0), 30)
    peaks, strayed = [], []
    for _ in range(12):
        goes_on_unrefused(walk)
        peaks.append(np.abs(walk.assist()).max(axis=0) / CAP)
        strayed.append(np.abs(walk.errors()).max(axis=0) / NEAR)
        del walk.session.records[:-1]  # of twenty minutes they would be gigabytes
        walk.session.run(100.0)

    # In the first minutes little help, in the last ones much, and near the gait all the time.
    assert np.max(peaks[:2]) <= 0.02
    assert np.min(peaks[-2:]) > 0.2
    assert np.max(strayed) < 1.0
