"""What the observer of a leg is fed with, and what it returns: inputs in, a slice out, no core."""

import math
from types import SimpleNamespace

import pytest
from fresh_core import fresh, has_been_sent, show
from gaitd_names import EventCode
from msgspec.structs import replace
from safety_inputs import JOINT

from daemon.core.safety.soft_limits import SoftZone
from daemon.core.slices import Estimated, Monitored
from daemon.core.steps import estimation
from daemon.core.steps.estimation import ObserverInputs, cleared, estimate
from daemon.core.tick import Tick
from daemon.ipc.cycle_timing import CycleTiming
from observer.drift import NO_DRIFT
from observer.filter.considered import NOTHING_KNOWN
from observer.filter.leg_observer import PoseError
from observer.filter.status import Status, Validity

SAMPLED = ObserverInputs(
    joints=(JOINT, JOINT._replace(position_si=0.5, effort_si=20.0)),
    referenced=True,
    origin_moved=False,
    artificial=(0.0, 0.0),
    is_artificial=False,
    effort_std=(0.0, 0.0),
    saturated=False,
    near_limit=False,
    dt_s=0.01,
    late=False,
    known=NOTHING_KNOWN,
)
RUNS = Estimated(estimate=object(), bad_cycles=2, stride_count=7)


class Spy:
    """Observers that answer as a test says, and keep what they are fed with."""

    def __init__(self, *validity):
        self.started, self.fed = [], []
        self.friction, self.observer, self.strides = (None, None), self, self
        self.smoother = SimpleNamespace(add=lambda *_: self.smoothed)
        self.smoothed, self.stride = None, None
        self.found = SimpleNamespace(validity=validity, status=Status.ARTIFICIAL)
        self.known = NOTHING_KNOWN

    def reset(self, measured):
        self.started.append(measured)

    def take_baseline(self, known):
        self.known = known

    def step(self, *fed, **flags):
        self.fed.append((*fed, flags))
        return self.found

    def add(self, _):
        return self.stride


@pytest.fixture
def spy():
    return Spy(Validity.OK, Validity.OK)


def test_a_sample_that_is_missing_is_not_a_number_and_the_artificial_part_is_taken_away(spy):
    hip, slide = SAMPLED.joints
    inputs = replace(
        SAMPLED, joints=(hip, slide._replace(fresh=False)), artificial=(3.0, -4.0), late=True
    )

    found = estimate(spy, RUNS, inputs)

    ((measured, efforts, dt_s, flags),) = spy.fed
    assert (measured[0], math.isnan(measured[1]), efforts, dt_s) == (0.2, True, (7.0, 24.0), 0.01)
    assert flags["late"]
    assert not flags["unreferenced"]
    assert (found.effort_used, found.artificial) == (efforts, (3.0, -4.0))


def test_a_baseline_is_in_force_from_the_cycle_on_in_which_it_is_given(spy):
    known = NOTHING_KNOWN._replace(taken=True)

    estimate(spy, RUNS, replace(SAMPLED, known=known))

    assert spy.known is known


@pytest.mark.parametrize(
    "missing",
    [
        {"referenced": False},
        {"joints": (JOINT._replace(fresh=False), JOINT)},
        {"joints": (JOINT, JOINT._replace(fresh=False))},
    ],
)
def test_it_starts_at_a_known_pose_only(spy, missing):
    waiting = estimate(spy, Estimated(), replace(SAMPLED, **missing))

    assert (waiting.estimate, spy.started, spy.fed) == (None, [], [])
    assert estimate(spy, waiting, SAMPLED).estimate is spy.found
    assert spy.started == [(0.2, 0.5)]


def test_at_an_impossible_pose_it_does_not_start(spy):
    def refuse(_):
        raise PoseError("no such pose")

    spy.reset = refuse

    assert estimate(spy, Estimated(), SAMPLED).estimate is None
    assert spy.fed == []


def test_where_an_origin_has_moved_it_starts_anew_and_counts_on(spy):
    found = estimate(spy, RUNS, replace(SAMPLED, origin_moved=True))

    assert spy.started == [(0.2, 0.5)]
    assert (found.bad_cycles, found.stride_count) == (0, 7)


@pytest.mark.parametrize("bad", [(Validity.BAD, Validity.OK), (Validity.OK, Validity.BAD)])
def test_cycles_with_a_bad_axis_are_counted_until_both_are_good(spy, bad):
    worse = estimate(Spy(*bad), RUNS, SAMPLED)

    assert worse.bad_cycles == 3
    assert estimate(spy, worse, SAMPLED).bad_cycles == 0


def test_a_stride_is_there_in_the_cycle_that_completes_it(spy):
    spy.smoothed = spy.stride = object()
    completed = estimate(spy, RUNS, SAMPLED)
    spy.stride = None

    assert (completed.stride, completed.stride_count) == (spy.smoothed, 8)
    after = estimate(spy, completed, SAMPLED)
    assert (after.stride, after.stride_count) == (None, 8)


def test_without_drives_there_is_no_estimate_but_what_was_learnt_stays():
    learnt = replace(RUNS, calibration_advised=(True, False), drifts=(NO_DRIFT, (1.0,) * 5))

    left = cleared(learnt)

    assert (left.estimate, left.bad_cycles, left.stride) == (None, 0, None)
    assert (left.stride_count, left.calibration_advised) == (7, (True, False))
    assert left.drifts == learnt.drifts


def test_a_calibration_is_advised_once_for_each_axis():
    leg = SimpleNamespace(axes=(SimpleNamespace(name="hip"), SimpleNamespace(name="slide")))
    asked = replace(RUNS, calibration_advised=(False, True))

    (event,) = estimation.news(leg, RUNS, asked)

    assert (event.code, event.subject) == (EventCode.CALIBRATION_ADVISED, "slide")
    assert list(estimation.news(leg, asked, asked)) == []


def test_the_observer_reads_what_either_axis_or_the_exercise_says_of_the_leg():
    core = fresh().core
    (leg,) = core.legs
    hip, slide = leg.axes
    tick = Tick(1, 0, 0, 0.011, CycleTiming(0, 0, 0, 0), late=True)
    leg.monitored = Monitored(zone=SoftZone(mechanism_depth_ratio=0.1))
    for axis in leg.axes:
        show(axis, referenced=True, joint=JOINT._replace(position_si=axis.node_id))

    found = estimation.inputs_of(leg, tick)

    assert (found.joints, found.referenced, found.origin_moved) == (
        *((hip.sensed.joint, slide.sensed.joint), True, False),
    )
    assert (found.artificial, found.is_artificial, found.effort_std) == (
        *((0.0, 0.0), False, (0.0, 0.0)),
    )
    assert (found.dt_s, found.late, found.saturated, found.near_limit) == (0.011, True, False, True)
    show(slide, referenced=False, origin_moved=True)
    has_been_sent(hip, effort_si=hip.limits.effort_max_si)
    leg.exercise = SimpleNamespace(artificial_si=(1.0, 2.0), is_artificial=True)
    other = estimation.inputs_of(leg, tick)
    assert (other.referenced, other.origin_moved, other.saturated) == (False, True, True)
    assert (other.artificial, other.is_artificial) == ((1.0, 2.0), True)
    show(hip, origin_moved=True, referenced=False)
    show(slide, origin_moved=False, referenced=True)
    assert estimation.inputs_of(leg, tick).origin_moved
    assert not estimation.inputs_of(leg, tick).referenced


def test_a_drift_that_has_changed_is_judged_anew_for_its_axis(spy, monkeypatch):
    changed = NO_DRIFT._replace(**{NO_DRIFT._fields[0]: 1.0})
    learnt = [changed, None]
    monkeypatch.setattr(
        estimation.friction_monitor, "update", lambda before, law, found, index, dt_s: learnt[index]
    )
    monkeypatch.setattr(estimation, "asks_for_calibration", lambda drift, law: drift is changed)

    hip = estimate(spy, RUNS, SAMPLED)
    learnt[:] = None, changed
    slide = estimate(spy, hip, SAMPLED)

    assert (hip.drifts, hip.calibration_advised) == ((changed, NO_DRIFT), (True, False))
    assert (slide.drifts, slide.calibration_advised) == ((changed, changed), (True, True))
