from dataclasses import replace
from itertools import product

import msgspec
import numpy as np
import pytest
from empty_runs import (
    empty_run,
    random_friction,
    robot_file,
    shipped_friction,
)

from analysis.calibration import transmission
from analysis.calibration.advice import advice, slower_than_gait
from analysis.calibration.bristles import with_bristles
from analysis.calibration.fit import (
    AS_GIVEN,
    AS_GOOD_WITHOUT,
    OF_SPRING,
    SHAPED,
    STARTS,
    Fit,
    fitted_on,
)
from analysis.calibration.likelihood import Likelihood, scores
from analysis.calibration.motion import prepare
from analysis.calibration.process_noise import (
    law_uncertainty,
    process_noise,
    with_process_noise,
)
from analysis.calibration.quantities import (
    BRISTLES,
    CANDIDATES,
    LAW_SIZE,
    NOISE,
    OF_LAW_11,
    OFFSETS,
    QUANTITIES,
    SIZE,
    SLOPES,
    SPRINGS,
    TIMING,
    frame_of,
    value_of,
)
from analysis.calibration.session import Calibration, calibrate, middle_of
from analysis.calibration.transmission import (
    BACKLASHES,
    RIGID,
    STIFFER,
    STIFFNESSES,
    Found,
    GivesWay,
    of_joints,
    results_of,
    softness,
)
from analysis.calibration.verdict import disturbance, like_fitted, other_effect
from analysis.recording import Recording, RecordingError, recording
from analysis.replay import Source, filter_setup
from daemon.config.edits import replaced
from daemon.config.robot import friction_parameters
from daemon.config.settings import Robot
from observer.filter.status import Status, Validity
from observer.mechanism.friction import EVERYWHERE, FrictionParameters, OverPosition
from observer.offline import batch
from observer.offline.batch import Columns
from tests.observer.trainer import (
    HIP_BRISTLES,
    PROTOTYPE,
    SLIDE_BRISTLES,
    encoded,
    simulate,
)

DURATION_S = 10.0
WEAK_NM_PER_RAD = 16.0
"""The file says 20."""
SLOPE_PER_RAD = 0.3
OFFSET_NM = 1.0


def truth_of(f: FrictionParameters) -> tuple[float, ...]:
    return (f.coulomb, f.stribeck, f.viscous, *f[3:])


def levels(made: Calibration) -> list[list[float]]:
    """Coulomb, Stribeck and viscous friction of hip and slide."""
    return [[one.value for one in made.fit.results[first : first + 3]] for first in (0, LAW_SIZE)]


def file_off() -> Robot:
    """The shipped file, its friction 40 % off."""
    robot = robot_file()
    f = robot.friction
    off = msgspec.structs.replace(
        f,
        hip=msgspec.structs.replace(
            f.hip, coulomb_nm=3.6, stribeck_nm=4.2, viscous_nm_s_per_rad=1.2, edge_rad_per_s=0.045
        ),
        slide=msgspec.structs.replace(
            f.slide, coulomb_n=95.0, stribeck_n=110.0, viscous_n_s_per_m=33.0, peak_m_per_s=0.03
        ),
    )
    return msgspec.structs.replace(robot, friction=off)


def silent(_words: str, _share: float) -> None:
    """Progress that is not shown."""


def in_few_steps(run: Source, robot: Robot) -> Calibration:
    """A calibration whose few searches end early; those of the thorough tests go on."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analysis.calibration.fit.STEPS_MAX", 6)
        patch.setattr("analysis.calibration.fit.FINE_SUBSTEPS", 5)
        patch.setattr("analysis.calibration.fit.START_ENCODERS", (1.0,))
        patch.setattr("analysis.calibration.fit.STARTS", STARTS[:1])
        return calibrate([run], robot)


@pytest.fixture(scope="module")
def windups():
    """What the calibration of `shipped` has found of its transmissions, each time it looked."""
    return []


@pytest.fixture(scope="module")
def shipped(windups):
    """A machine with one spring weak, a glitch, a hole; a calibration that begins 40 % off.

    The hip's friction rises along it, and its drive shows a torque at none.
    """
    weak = replaced(robot_file(), {"springs.hip.stiffness_nm_per_rad": WEAK_NM_PER_RAD})
    run = empty_run(
        shipped_friction(),
        robot=weak,
        duration_s=12.0,
        over=(OverPosition(SLOPE_PER_RAD, weak.friction_over_position.hip.middle_rad), EVERYWHERE),
        offset=(OFFSET_NM, 0.0),
    )
    rows = np.column_stack((run.recording.time_s, run.recording.position, run.recording.effort))
    rows[500, 1] += 0.3
    rows[900:903, 2] = np.nan
    run = run._replace(recording=recording("glitch.csv", rows))

    def looked(*words):
        windups.append(softness(*words))
        return windups[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analysis.calibration.session.softness", looked)
        return run, in_few_steps(run, file_off())


@pytest.fixture(scope="module")
def again(shipped):
    """A calibration that begins with what another one has found."""
    run, made = shipped
    return calibrate([run], made.robot)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 3])
def test_friction_levels_of_any_machine_are_found_within_two_percent(seed):
    truth = random_friction(seed)

    made = calibrate([empty_run(truth, seed=seed, duration_s=40.0)], robot_file())

    assert levels(made) == [pytest.approx(truth_of(law)[:3], rel=0.02) for law in truth]


def test_a_start_far_off_a_glitch_and_missing_samples_do_no_harm(shipped):
    _, made = shipped

    assert levels(made) == [
        pytest.approx(truth_of(law)[:3], rel=0.02) for law in shipped_friction()
    ]
    assert not made.refused


def bristled_run(*, slide: bool, duration_s: float) -> Source:
    """A machine with bristles instead of eq. (11), moved from sticking to fast."""
    time_s = np.arange(round(duration_s / 0.01)) * 0.01
    louder = np.where(time_s > duration_s / 2, 1.15, 1.0)[:, None]
    drive = np.column_stack(
        (10.2 * np.sin(2 * np.pi * 0.3 * time_s), -97.5 * slide * np.sin(2 * np.pi * 0.2 * time_s))
    )
    truth = simulate(PROTOTYPE, len(time_s), drive=drive * louder, lugre=True)
    made = encoded(truth)
    values = np.column_stack((made.time_s, made.position, made.effort))
    return Source(recording("bristles.csv", values), None, "", None)


@pytest.fixture(scope="module")
def resting():
    """A calibration of a machine with bristles whose slide does not move; the file has none."""
    return in_few_steps(bristled_run(slide=False, duration_s=DURATION_S), robot_file())


@pytest.fixture(params=[1, pytest.param(2, marks=pytest.mark.thorough)])
def bristled(request):
    """Number of moving axes, and a calibration."""
    if request.param == 1:
        return 1, request.getfixturevalue("resting")
    return 2, calibrate([bristled_run(slide=True, duration_s=20.0)], robot_file())


def test_bristles_are_found_from_a_file_that_has_none(bristled):
    count, made = bristled
    found = friction_parameters(made.robot)

    assert not made.refused
    assert not made.needless
    assert made.after.loss_per_sample < made.before.loss_per_sample - 0.4
    assert made.after.hip_rms_nm < 0.5 * made.before.hip_rms_nm
    assert made.bristled
    assert made.other_law is not None
    assert made.after.loss_per_sample < made.other_law.loss_per_sample
    assert made.other_law.loss_per_sample < made.before.loss_per_sample
    before = {one.quantity.key: one.before for one in made.fit.results}
    assert before["friction.hip.bristle_stiffness_nm_per_rad"] == 0.0
    for law, truth, _ in zip(found, (HIP_BRISTLES, SLIDE_BRISTLES), range(count), strict=False):
        assert law.coulomb == pytest.approx(truth.coulomb, rel=0.02)
        assert law.viscous == pytest.approx(truth.viscous, rel=0.05)
        assert law.bristle_stiffness == pytest.approx(truth.stiffness, rel=0.15)
        assert law.bristle_damping == pytest.approx(truth.damping, rel=0.4)
    assert made.tuning == {"observer.integrator": "semi_implicit", "observer.substeps": 10}
    assert set(made.values("x")) >= {*made.tuning, "friction.hip.bristle_stiffness_nm_per_rad"}


@pytest.fixture(scope="module")
def plants_bristles():
    """The likelihood of a motion on bristles as a function of their values, and the plant's."""
    given, _ = with_bristles(robot_file(), (0, 1))
    motion = prepare([bristled_run(slide=True, duration_s=12.0).recording])
    frame = frame_of(given, middle_of(motion))
    likelihood = Likelihood(frame, motion, ~motion.held_out)
    true = frame.natural.copy()
    for place, law in ((0, HIP_BRISTLES), (LAW_SIZE, SLIDE_BRISTLES)):
        true[[place, place + 2]] = law.coulomb, law.viscous
        true[place + BRISTLES.start : place + LAW_SIZE] = law.stiffness, law.damping
    true = like_fitted(frame, true, motion)
    return lambda natural: likelihood.surprises(frame.free(natural)).loss, true


@pytest.mark.parametrize("axis", [0, 1], ids=["hip", "slide"])
def test_the_bristles_of_the_plant_explain_its_motion_best(axis, plants_bristles):
    """Both axes count, without a search. Less damping than the plant's is hardly told from it."""
    loss_of, true = plants_bristles
    loss = loss_of(true)

    stiffness, damping = range(axis * LAW_SIZE, (axis + 1) * LAW_SIZE)[BRISTLES]
    for place, factor in ((stiffness, 0.4), (stiffness, 2.5), (damping, 2.5)):
        other = true.copy()
        other[place] *= factor
        assert loss_of(other) > loss + 1.0


def test_bristles_are_tried_and_not_used_where_the_plant_has_the_paper_s_law(shipped):
    _, made = shipped

    assert not made.bristled
    assert made.why_eq_11
    assert made.other_law is not None
    assert made.after.loss_per_sample < made.before.loss_per_sample
    assert not [key for key in made.values("x") if "bristle" in key]
    assert not made.tuning


@pytest.mark.thorough
def test_a_file_with_bristles_can_be_calibrated_while_one_axis_rests():
    given, _ = with_bristles(robot_file(), (0, 1))

    made = calibrate([bristled_run(slide=False, duration_s=12.0)], given)

    found = {one.quantity.key: one for one in made.fit.results}
    assert not made.refused
    assert found["friction.hip.bristle_stiffness_nm_per_rad"].value == pytest.approx(
        HIP_BRISTLES.stiffness, rel=0.15
    )
    assert not found["friction.slide.bristle_stiffness_n_per_m"].calibrated
    assert made.robot.friction.slide == given.friction.slide


def test_the_given_law_is_compared_with_the_noise_that_serves_it_best(shipped):
    _, made = shipped
    frame = frame_of(file_off(), middle_of(made.motion))
    likelihood = Likelihood(frame, made.motion, ~made.motion.held_out)

    best = like_fitted(frame, made.fit.natural, made.motion)

    assert best[:NOISE] == pytest.approx(frame.natural[:NOISE])
    loss = likelihood.surprises(frame.free(best)).loss
    for effort, friction in product((1 / 8, 0.5, 1.0, 2.0, 8.0), repeat=2):
        other = best.copy()
        other[NOISE + 2 : TIMING] *= (effort, effort, friction, friction)
        assert likelihood.surprises(frame.free(other)).loss >= loss - 0.1


def test_the_uncertainty_of_a_wrong_law_covers_its_error_on_rows_that_were_held_out(shipped):
    _, made = shipped
    motion = made.motion
    true = with_process_noise(made.robot, process_noise(made.robot, motion, made.fit.natural))
    f = true.friction
    wrong = msgspec.structs.replace(
        true,
        friction=msgspec.structs.replace(
            f,
            hip=msgspec.structs.replace(f.hip, stribeck_nm=8.5),
            slide=msgspec.structs.replace(f.slide, stribeck_n=95.0),
        ),
    )

    def covered(robot: Robot, axis: int) -> float:
        columns = Columns(motion.time_s, motion.position, motion.effort)
        seen = batch.run(filter_setup(robot), columns)
        law = friction_parameters(robot)[axis]
        rows = motion.held_out & motion.settled & (seen.validity[:, axis] == Validity.OK)
        rows &= np.abs(motion.velocity[:, axis]) < law.transition + law.peak
        patient = 6 + axis
        return float(np.mean(np.abs(seen.state[rows, patient]) <= 3.0 * seen.std[rows, patient]))

    found = law_uncertainty(wrong, motion)
    little = law_uncertainty(true, motion)

    for axis, key in enumerate(("hip.law_nm", "slide.law_n")):
        assert little[key] < 0.1 * found[key]
        assert covered(wrong, axis) < 0.95
        assert covered(with_process_noise(wrong, found), axis) > 0.99


def test_efforts_that_act_later_are_explained_by_their_timing_alone(shipped):
    _, made = shipped
    motion, frame, late_s = made.motion, made.fit.frame, 2e-3
    early = replace(motion, effort=motion.effort + late_s * motion.effort_rate)
    natural = made.fit.natural.copy()
    true = Likelihood(frame, motion, ~motion.held_out).surprises(frame.free(natural)).loss
    shifted = Likelihood(frame, early, ~motion.held_out)

    untimed = shifted.surprises(frame.free(natural)).loss
    natural[TIMING:] += late_s
    timed = shifted.surprises(frame.free(natural)).loss

    assert untimed > true + 100.0
    assert timed - true < 0.05 * (untimed - true)


def test_what_was_fitted_is_as_sure_as_its_interval_and_friction_as_another_day(shipped):
    _, made = shipped
    results = {one.quantity.key: one for one in made.fit.results}
    spring = results["springs.slide.stiffness_n_per_m"]
    written = {key: value for key, (value, _) in made.values("x").items()}

    assert written["uncertainty.slide.spring_ratio"] == pytest.approx(
        spring.half_interval / 1.96 / spring.value, rel=1e-3
    )
    assert not [key for key in written if "friction_ratio" in key or "viscous_ratio" in key]


def test_a_held_out_part_without_the_accelerations_of_a_gait_judges_no_inertia(shipped):
    motion = shipped[1].motion
    every = np.ones(len(motion.time_s), dtype=np.bool_)

    assert "accelerates the slide by" in " ".join(slower_than_gait(motion, ~every))
    quick = replace(motion, smooth=motion.smooth * 10.0)
    assert not slower_than_gait(quick, every)


def test_springs_that_changed_are_found(shipped):
    _, made = shipped

    assert made.fit.results[SPRINGS].value == pytest.approx(WEAK_NM_PER_RAD, rel=0.02)


def test_friction_that_rises_along_an_axis_is_found_and_none_where_there_is_none(shipped):
    _, made = shipped
    hip, slide = (made.fit.results[index] for index in SLOPES)
    written = made.values("x")

    assert abs(hip.value - SLOPE_PER_RAD) <= hip.half_interval < 0.1
    std, _ = written["uncertainty.hip.friction_slope_per_rad"]
    assert std == pytest.approx(hip.half_interval / 1.96, rel=1e-3)
    assert written[hip.quantity.key][0] == hip.value
    assert slide.reason == AS_GIVEN
    assert slide.value == 0.0
    assert slide.quantity.key not in written
    assert not [line for line in advice(made.motion, made.fit.results) if "position" in line]


def test_an_offset_beside_a_spring_is_in_the_spring_s_rest(shipped):
    _, made = shipped
    offset, rest = made.fit.results[OFFSETS[0]], made.fit.results[SPRINGS + 1]
    shifted_rad = robot_file().springs.hip.rest_rad - OFFSET_NM / WEAK_NM_PER_RAD

    assert offset.reason == OF_SPRING
    assert (offset.value, rest.value) == (0.0, pytest.approx(shifted_rad, abs=rest.half_interval))


def test_a_rigid_machine_keeps_the_transmissions_of_its_file(shipped, windups):
    _, made = shipped

    assert windups == [{}]
    assert [one.reason for one in made.transmission] == [AS_GIVEN] * 4
    assert made.robot.transmission == file_off().transmission
    assert not [key for key in made.values("x") if "transmission" in key]


def test_a_search_that_cannot_begin_finds_nothing(shipped, monkeypatch):
    _, made = shipped

    def no_motion(*_):
        raise RecordingError("no motion can be computed")

    monkeypatch.setattr(transmission, "fitted_on", no_motion)

    assert softness(made.fit, made.motion, made.robot, silent) == {}


def shafts_of(joints, robot, way):
    """What the encoders show where the slide's transmission gives way."""
    shafts = of_joints(joints, robot, (RIGID[0], GivesWay(*(-value for value in way))))
    in_gaps = np.isnan(shafts.position)
    return replace(shafts, position=np.where(in_gaps, shafts.smooth[:, :2], shafts.position))


@pytest.mark.parametrize(
    "way",
    [pytest.param(GivesWay(1.0 / 1e5), marks=pytest.mark.thorough), GivesWay(1.0 / 1e5, 1e-3)],
)
def test_a_transmission_that_gives_way_is_found_by_its_windup(way, monkeypatch):
    """The joints move as rigid axes do, and the shaft of the slide is ahead of its joint."""
    if way.backlash_si:
        monkeypatch.setattr(transmission, "START_RATIOS", transmission.START_RATIOS[1:])
    robot = robot_file()
    joints = prepare([empty_run(shipped_friction(), seed=2, duration_s=DURATION_S).recording])
    shafts = shafts_of(joints, robot, way)
    frame = frame_of(robot, middle_of(joints))
    bristles = [axis * LAW_SIZE + at for axis in (0, 1) for at in range(LAW_SIZE)[BRISTLES]]
    # The hip stays as it is in the file: it moves as the file says.
    hip = (*range(LAW_SIZE), *range(SPRINGS, SPRINGS + 3), *range(NOISE, SIZE, 2))
    # So do the slide's spring and the shape of its friction, whose search is that of `shipped`.
    slide = (*range(SPRINGS + 3, SPRINGS + 6), *(LAW_SIZE + at for at in SHAPED))
    fixed = frozenset((*CANDIDATES, *bristles, *hip, *slide))
    start = Fit(frame, frame.natural, (), 0.0, 0, fixed, str)

    likelihood = Likelihood(frame, shafts, ~shafts.held_out)
    free = fitted_on(start, likelihood, silent, frame.free(frame.natural))
    found = softness(replace(start, natural=frame.from_free(free)), shafts, robot, silent)

    assert list(found) == [1]
    found_way, half = map(np.array, found[1])
    assert found_way[0] == pytest.approx(way.compliance_si, rel=0.15 if way.backlash_si else 0.1)
    assert found_way[1] == pytest.approx(way.backlash_si, rel=0.35)
    assert abs(found_way[1] - way.backlash_si) <= half[1]


@pytest.mark.parametrize(("beside", "half"), [(0.9, 0.5e-3), (1.1, 0.1e-3)])
def test_an_interval_holds_the_other_optimum_that_explains_a_recording_as_well(beside, half):
    def end(backlash_si, loss_per_sample):
        found = Found(GivesWay(1e-5, backlash_si), GivesWay(1e-6, 0.1e-3))
        return transmission.End(found, loss_per_sample)

    ends = [end(1.5e-3, 2.0 + beside * transmission.EQUAL_PER_SAMPLE), end(1e-3, 2.0)]

    found = transmission.best_of(ends)

    assert found.way == GivesWay(1e-5, 1e-3)
    assert found.half == pytest.approx((1e-6, half))


@pytest.mark.thorough
@pytest.mark.timeout(1800)
def test_a_loose_slide_gets_its_backlash_and_its_friction():
    way, robot = GivesWay(1.0 / 1e5, 1e-3), robot_file()
    run = empty_run(shipped_friction(), duration_s=60.0)
    joints = prepare([run.recording])
    seen = replace(run.recording, position=shafts_of(joints, robot, way).position)

    made = calibrate([run._replace(recording=seen)], file_off())

    assert not made.refused
    assert made.behind_gap == ("slide",)
    (backlash,) = (one for one in made.transmission if one.quantity == BACKLASHES[1])
    assert abs(backlash.value - way.backlash_si) <= backlash.half_interval
    for one in made.fit.results[LAW_SIZE:][: OF_LAW_11.stop]:
        assert (
            not one.calibrated
            or abs(one.value - value_of(robot, one.quantity.key)) <= one.half_interval
        )


SOFT = Found(GivesWay(1 / 900.0, 2e-3), GivesWay(3e-4, 6e-4))


@pytest.mark.parametrize(
    ("given", "found", "as_good", "value", "reason"),
    [
        ((5e4, 0.0), SOFT, False, (900.0, 2e-3), ("", "")),
        ((5e4, 0.0), SOFT, True, (5e4, 0.0), (AS_GOOD_WITHOUT, AS_GOOD_WITHOUT)),
        ((800.0, 1.5e-3), SOFT, False, (800.0, 1.5e-3), (AS_GIVEN, AS_GIVEN)),
        ((800.0, 5e-3), SOFT, False, (800.0, 2e-3), (AS_GIVEN, "")),
        ((800.0, 2e-3), None, False, (800.0, 2e-3), (STIFFER, STIFFER)),
        ((5e4, 0.0), None, False, (5e4, 0.0), (AS_GIVEN, AS_GIVEN)),
    ],
)
def test_a_transmission_that_the_recording_does_not_contradict_stays(
    shipped, given, found, as_good, value, reason
):
    _, made = shipped
    hip = {STIFFNESSES[0].key: given[0], BACKLASHES[0].key: given[1]}

    results = results_of(
        replaced(made.robot, hip), made.fit, {0: found} if found else {}, as_good=as_good
    )

    assert tuple(one.before for one in results[:2]) == given
    assert [one.value for one in results[:2]] == pytest.approx(value)
    assert tuple(one.reason for one in results[:2]) == reason


def test_encoder_noise_is_that_of_quantum_and_noise_together(shipped):
    _, made = shipped

    assert made.fit.results[NOISE].value == pytest.approx(np.hypot(1e-4 / 12**0.5, 5e-5), rel=0.1)
    assert made.fit.results[NOISE + 1].value == pytest.approx(
        np.hypot(5e-5 / 12**0.5, 2e-5), rel=0.1
    )


def test_what_was_not_fitted_gets_better(shipped):
    _, made = shipped

    assert made.after.loss_per_sample < made.before.loss_per_sample
    assert made.after.hip_rms_nm < 0.1 * made.before.hip_rms_nm
    assert made.after.slide_rms_n < 0.1 * made.before.slide_rms_n


@pytest.mark.thorough
def test_the_same_recording_gives_the_same_bits(shipped, again):
    run, made = shipped

    once_more = calibrate([run], made.robot)

    assert np.array_equal(again.fit.natural, once_more.fit.natural)


@pytest.mark.thorough
def test_a_file_that_is_right_already_is_not_made_worse(again):
    assert not again.refused
    assert again.needless or again.after.loss_per_sample < again.before.loss_per_sample


@pytest.mark.thorough
def test_intervals_of_the_levels_cover_the_truth_about_as_often_as_they_say():
    covered: list[bool] = []
    for seed in range(3):
        made = calibrate([empty_run(shipped_friction(), seed=seed)], robot_file())
        for axis, law in enumerate(shipped_friction()):
            for one, truth in zip(
                made.fit.results[LAW_SIZE * axis :], truth_of(law)[:3], strict=False
            ):
                covered.append(abs(one.value - truth) <= one.half_interval)

    assert np.mean(covered) >= 0.75


def test_an_axis_that_does_not_move_is_named_with_what_to_record_instead(resting):
    slide = [one for one in resting.fit.results if one.quantity.key.startswith("friction.slide")]
    assert not any(one.calibrated for one in slide)
    assert all(one.value == one.before for one in slide)
    hip = [one for one in resting.fit.results if one.quantity.label == "hip coulomb"]
    assert hip[0].value == pytest.approx(6.0, rel=0.02)
    assert "record excite friction_slide" in " ".join(advice(resting.motion, resting.fit.results))


@pytest.fixture(scope="module")
def pushed():
    def push(time_s):
        return np.column_stack((5.0 * np.sin(2.2 * time_s), 40.0 * np.sin(1.3 * time_s)))

    return empty_run(shipped_friction(), disturbance=push)


def test_a_push_from_outside_is_no_friction(pushed, shipped):
    _, made = shipped
    motion = prepare([pushed.recording])

    said = other_effect(disturbance(made.robot, motion), made.fit.natural, motion, made.robot)

    assert "empty, undisturbed machine" in said


def test_effort_after_reversals_of_the_load_is_that_of_a_gap(shipped):
    run, made = shipped
    motion = prepare([run.recording])
    rotor_nm = made.robot.hip.drive_inertia_kg_m2 * motion.smooth[:, 4]
    pushed = motion.smooth_effort[:, 0] > rotor_nm
    after = np.convolve(np.append(0, np.diff(pushed)), np.ones(10))[: len(pushed)] > 0
    seen = disturbance(made.robot, motion)
    patient = np.column_stack((12.0 * after, seen.patient[:, 1]))

    said = other_effect(replace(seen, patient=patient), made.fit.natural, motion, made.robot)

    assert "a gap of its transmission" in said
    assert "transmission.hip.backlash_rad" in said


@pytest.mark.thorough
def test_a_push_from_outside_is_fitted_by_no_friction(pushed):
    try:
        said = calibrate([pushed], robot_file()).refused
    except RecordingError as error:
        said = str(error)
    assert "empty, undisturbed machine" in said


def short(run: Source, rows: slice) -> Source:
    made = run.recording
    values = np.column_stack((made.time_s, made.position, made.effort))[rows]
    return run._replace(recording=recording("short.csv", values))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (slice(0, 800), "too short"),
        (slice(0, 10), "10 rows are too short"),
        (slice(None, None, 5), "a row every 50 ms"),
    ],
)
def test_a_recording_that_is_too_short_or_too_coarse_is_refused(shipped, rows, said):
    run, _ = shipped

    with pytest.raises(RecordingError, match=said):
        calibrate([short(run, rows)], robot_file())


def test_a_patient_or_an_artificial_disturbance_is_refused_by_what_the_ring_says(shipped):
    run, _ = shipped
    with_patient = load_patient()
    bits = np.zeros(len(run.recording.time_s), dtype=np.int64)
    bits[100] = Status.ARTIFICIAL

    with pytest.raises(RecordingError, match="with a patient"):
        calibrate([run._replace(robot=with_patient)], robot_file())
    with pytest.raises(RecordingError, match="artificial disturbance"):
        calibrate([run._replace(caller_bits=bits)], robot_file())
    with pytest.raises(RecordingError, match=r"\[patient\]"):
        calibrate([run], with_patient)


def load_patient():
    from empty_runs import ROBOT_FILE
    from gaitd_toml import load_toml

    from daemon.config.settings import Robot

    return load_toml(ROBOT_FILE.with_name("robot.toml"), Robot)


def test_free_and_natural_values_are_the_same_numbers():
    frame = frame_of(robot_file(), (0.24, 0.59))

    assert frame.from_free(frame.free(frame.natural)) == pytest.approx(frame.natural, rel=1e-9)
    assert len(QUANTITIES) + 6 == SIZE


def test_the_gradient_is_the_slope_of_the_likelihood(shipped):
    run, made = shipped
    motion = prepare([run.recording])
    frame = frame_of(made.robot, middle_of(motion))
    likelihood = Likelihood(frame, motion, ~motion.held_out)
    free = frame.free(made.fit.natural)
    free[NOISE + 2 :] += np.log(30.0)  # louder is smoother
    which = np.arange(SIZE)

    each, _ = scores(*likelihood.derivatives(free, which))

    for index in (0, 2, 5, LAW_SIZE + 2, SPRINGS, SPRINGS + 2, NOISE, NOISE + 3):
        up, down = free.copy(), free.copy()
        up[index] += 1e-4
        down[index] -= 1e-4
        slope = (likelihood.surprises(up).loss - likelihood.surprises(down).loss) / 2e-4
        assert each.sum(axis=0)[index] == pytest.approx(slope, rel=0.05, abs=5.0)


def test_innovations_of_the_truth_are_as_large_as_they_are_said_to_be(shipped):
    run, made = shipped
    motion = prepare([run.recording], hold_out=False)
    frame = frame_of(made.robot, middle_of(motion))

    base = Likelihood(frame, motion, ~motion.held_out).surprises(frame.free(made.fit.natural))

    assert np.mean(base.z**2 / base.s) == pytest.approx(1.0, abs=0.15)


@pytest.mark.thorough
def test_a_short_contact_is_left_out_of_the_judgement_and_said():
    def touch(time_s):
        pushed = np.where((time_s > 20.0) & (time_s < 20.4), 10.0, 0.0)
        return np.column_stack((pushed, 0.0 * time_s))

    worn = tuple(
        f._replace(stribeck=1.3 * f.stribeck, coulomb=1.3 * f.coulomb) for f in shipped_friction()
    )
    made = calibrate([empty_run(worn, disturbance=touch)], robot_file())

    assert not made.refused
    assert len(made.contact_s) > 0
    assert 18.0 < made.contact_s.min() <= made.contact_s.max() < 24.0
    assert made.fit.results[0].value == pytest.approx(worn[0].coulomb, rel=0.02)


def test_ten_seconds_may_lack_a_row_at_each_end():
    made = empty_run(shipped_friction(), duration_s=10.0).recording

    def cut(rows: int) -> list[Recording]:
        parts = made.time_s[:rows], made.position[:rows], made.effort[:rows]
        return [Recording("a.csv", *parts)]

    assert prepare(cut(999)).duration_s == pytest.approx(9.98)
    with pytest.raises(RecordingError, match=r"9\.9 s are too short to calibrate from"):
        prepare(cut(991))
