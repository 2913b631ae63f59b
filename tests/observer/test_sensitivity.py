"""The derivative of the estimate by a parameter, beside two observers of their own.

The patient by parameters other than those of friction is in `test_considered.py`.
"""

import numpy as np
import pytest

from observer.filter.considered import NOTHING_KNOWN, Drives, Slopes, Variant
from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import LegObserver, setup_of, with_baseline
from observer.filter.status import Status, Validity
from observer.leg_smoother import LegSmoother
from observer.mechanism.friction import OverPosition
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from tests.observer.trainer import (
    ENTIRE,
    HIP,
    HIP_BRISTLES,
    MID_POSE,
    PATIENT,
    SLIDE_BRISTLES,
    SLIDE_FRICTION,
    TUNING,
    active,
    encoded,
    gait,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(
    velocity_gated=True, patient_noise_max_ratio=20.0, integrator=Integrator.SEMI_IMPLICIT
)
FOR_BRISTLES = SHIPPED._replace(substeps=10)
CYCLES = 1200
SETTLED_S = 2.0
BEGINS_S = 2.0
MORE = 1.02


def rougher(friction):
    """The same law on a level that is two percent higher."""
    return friction._replace(stribeck=MORE * friction.stribeck, coulomb=MORE * friction.coulomb)


def on_bristles(friction, bristles):
    return friction._replace(bristle_stiffness=bristles.stiffness, bristle_damping=bristles.damping)


OWN = Variant(PATIENT, HIP, SLIDE_FRICTION)
BRISTLED = Variant(
    PATIENT, on_bristles(HIP, HIP_BRISTLES), on_bristles(SLIDE_FRICTION, SLIDE_BRISTLES)
)
PAIRS = {
    "level of the hip": (OWN, OWN._replace(hip=rougher(OWN.hip)), SHIPPED),
    "level of the slide": (OWN, OWN._replace(slide=rougher(OWN.slide)), SHIPPED),
    "viscous friction of the slide": (
        OWN,
        OWN._replace(slide=OWN.slide._replace(viscous=MORE * OWN.slide.viscous)),
        SHIPPED,
    ),
    "slope along the slide": (OWN, OWN._replace(slopes=Slopes(slide_per_m=MORE - 1.0)), SHIPPED),
    "level of the slide's bristles": (
        BRISTLED,
        BRISTLED._replace(slide=rougher(BRISTLED.slide)),
        FOR_BRISTLES,
    ),
}


def walked(*, bristles: bool):
    """Twelve seconds of gait at 0.25 Hz with a patient who works."""
    path = gait(PATIENT, (np.arange(CYCLES) + 1) * 0.01, 0.25)
    return encoded(simulate(PATIENT, CYCLES, reference=path, patient=active, lugre=bristles))


@pytest.fixture(scope="module")
def walks():
    return {bristles: walked(bristles=bristles) for bristles in (False, True)}


def changes(estimates_of, pair, columns: Columns):
    """Change of friction and patient of both axes: by the derivative, and between two observers."""
    own, other, tuning = pair
    setup = setup_of(*own[:3], tuning, [other])
    right = estimates_of(with_baseline(setup, NOTHING_KNOWN), columns)
    told = right.state - estimates_of(with_baseline(setup, ENTIRE), columns).state
    over = tuple(OverPosition(slope, 0.0) for slope in other.slopes)
    of_other = setup_of(*other[:3], tuning._replace(friction_over_position=over))
    found = estimates_of(of_other, columns).state - right.state
    rows = (columns.time_s > SETTLED_S) & (right.validity == Validity.OK).all(axis=1)
    return told[rows, 4:], found[rows, 4:]


def assert_close(told, found, ratio):
    """What is left of the change is at most `ratio` of it, and hardly any of the other axis."""
    axis = int(rms(found)[1] > rms(found)[0])
    assert (rms(told - found)[axis::2] < ratio * rms(found)[axis::2]).all()
    assert (rms(told - found)[1 - axis :: 2] < 0.01 * rms(found)[axis]).all()


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
@pytest.mark.parametrize("name", PAIRS)
def test_it_is_the_difference_to_an_observer_with_a_little_more_friction(walks, name, estimates_of):
    assert_close(*changes(estimates_of, PAIRS[name], walks["bristles" in name]), 0.06)


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_samples_that_are_missing_or_rejected_correct_nothing_of_it(walks, estimates_of):
    whole = walks[False]
    position = whole.position.copy()
    position[np.arange(CYCLES) % 4 > 0, 0] = np.nan
    position[250::90] += (0.1, 0.05)
    position[800:1000:2, 1] = np.nan
    columns = Columns(whole.time_s, position, whole.effort)

    own = run(setup_of(*OWN[:3], SHIPPED), columns)
    assert np.count_nonzero(own.status & Status.GATED) >= 5
    assert_close(*changes(estimates_of, PAIRS["level of the slide"], columns), 0.07)


def test_a_joint_at_rest_whose_friction_holds_no_more_has_the_breakaway_of_the_other_law():
    count = 300
    slide_n = np.linspace(0.0, 2.0 * SLIDE_FRICTION.stribeck, count)
    effort = np.column_stack((np.zeros(count), np.minimum(slide_n, 1.5 * SLIDE_FRICTION.stribeck)))
    columns = Columns((np.arange(count) + 1) * 0.01, np.tile(MID_POSE, (count, 1)), effort)
    own, other, tuning = PAIRS["level of the slide"]
    setup = setup_of(*own[:3], tuning, [other])

    clean = run(with_baseline(setup, ENTIRE), columns).state[-1, 5::2]
    told = run(setup, columns).state[-1, 5::2] - clean
    assert told == pytest.approx(other.slide.stribeck - own.slide.stribeck, rel=0.1)


@pytest.mark.parametrize(
    "tuning",
    [
        SHIPPED._replace(ripple=(0.1, 5.0)),
        SHIPPED._replace(velocity_gated=False),
        SHIPPED._replace(integrator=Integrator.RK4),
    ],
    ids=["ripple", "not gated", "RK4"],
)
def test_it_is_so_with_ripple_without_a_gate_and_with_the_other_map(walks, tuning):
    own, other, _ = PAIRS["level of the slide"]

    assert_close(*changes(run, (own, other, tuning), walks[False]), 0.08)


def test_a_derivative_that_is_no_number_begins_anew_also_in_the_smoother(walks):
    own, other, tuning = PAIRS["level of the slide"]
    leg = LegObserver(*own[:3], tuning, [other])
    smoother = LegSmoother(leg)
    memory, _ = leg.buffers
    leg.reset(walks[False].position[0])
    samples = zip(walks[False].position[:100], walks[False].effort[:100], strict=True)
    for number, (position, effort) in enumerate(samples):
        if number == 50:
            memory[0]["sensitivity"][0, :] = np.nan
        estimate = leg.step(position, effort, 0.01)
        smooth = smoother.add(estimate, effort, 0.01)
        assert np.isfinite(estimate.std).all()
        assert smooth is None or np.isfinite(smooth).all()


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
@pytest.mark.parametrize(
    "other",
    [
        OWN._replace(leg=PATIENT._replace(thigh_moment_re=1.1 * PATIENT.thigh_moment_re)),
        OWN._replace(drives=Drives(effort_offset_slide_n=5.0)),
    ],
    ids=["mass", "offset"],
)
def test_an_error_of_a_mass_or_an_offset_is_in_net_at_rest_in_motion_and_after_a_jump(
    other, estimates_of
):
    times_s = (np.arange(CYCLES) + 1) * 0.01
    path = gait(PATIENT, np.maximum(times_s - BEGINS_S, 0.0), 0.25)
    walk = encoded(simulate(PATIENT, CYCLES, reference=path, start=path[0], patient=active))
    walk.position[800:812] += (0.1, 0.05)
    setup = setup_of(*OWN[:3], SHIPPED, [other])
    right = estimates_of(setup, walk)
    told = right.net - estimates_of(with_baseline(setup, ENTIRE), walk).net
    effort = walk.effort + np.array(other.drives[2:4])
    shown = Columns(walk.time_s, walk.position, effort)
    found = estimates_of(setup_of(*other[:3], SHIPPED), shown).net - right.net

    assert (right.status[800:830] & Status.WARM_UP).any()
    for phase in (slice(20, 200), slice(220, 800), slice(850, CYCLES)):
        left = rms((found - told)[phase])
        assert (left < 0.03 * rms(found[phase]) + (0.02, 0.1)).all()
        assert (rms(found[phase]) > (1.0, 4.0)).any()


def test_what_has_faded_is_nothing_and_no_number_that_slows_a_processor():
    """An error of the hip reaches the slide less in each cycle."""
    path = gait(PATIENT, (np.arange(4000) + 1) * 0.01, 0.25)
    walk = encoded(simulate(PATIENT, len(path), reference=path))
    leg = LegObserver(*OWN[:3], SHIPPED, [OWN._replace(drives=Drives(effort_offset_hip_nm=1.0))])
    memory, _ = leg.buffers
    leg.reset(walk.position[0])
    was_there = np.zeros(memory[0]["sensitivity"].shape, dtype=bool)
    for position, effort in zip(walk.position, walk.effort, strict=True):
        leg.step(position, effort, 0.01)
        sizes = np.abs(memory[0]["sensitivity"])
        was_there |= sizes > 0.0
        assert not ((sizes > 0.0) & (sizes < np.finfo(float).tiny)).any()
    assert (was_there & (sizes == 0.0)).any()
