"""What the observer of a leg is fed with, and what it returns: inputs in, a slice out, no core."""

import math
from types import SimpleNamespace

import pytest
from gaitd_names import EventCode
from msgspec.structs import replace
from safety_inputs import JOINT
from step_inputs import a_leg, an_axis, now_shows, was_sent

from daemon.core.safety.soft_limits import SoftZone
from daemon.core.slices import NO_ADVICE, Advice, Estimated, Monitored
from daemon.core.steps import estimation
from daemon.core.steps.estimation import ObserverInputs, cleared, estimate
from daemon.core.tick import Tick
from daemon.ipc.cycle_timing import CycleTiming
from drives.cia402.torque import TorqueSampling
from observer.drift import NO_DRIFT, Drift
from observer.filter.considered import NOTHING_KNOWN
from observer.filter.leg_observer import PoseError
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters

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
RUNS = Estimated(estimate=object(), bad_cycles=3, stride_count=7)


class Spy:
    """Observers that answer as a test says, and keep what they are fed with."""

    def __init__(self, *validity):
        self.started, self.fed = [], []
        self.friction, self.observer, self.strides = (None, None), self, self
        self.slope_std = None
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

    ((measured, efforts, dt_s, _),) = spy.fed
    assert (measured[0], math.isnan(measured[1]), efforts, dt_s) == (0.2, True, (7.0, 24.0), 0.01)
    assert (found.effort_used, found.artificial) == (efforts, (3.0, -4.0))


def test_a_baseline_is_in_force_from_the_cycle_on_in_which_it_is_given(spy):
    known = NOTHING_KNOWN._replace(taken=True)

    estimate(spy, RUNS, replace(SAMPLED, known=known))

    assert spy.known is known
    estimate(spy, RUNS, SAMPLED)
    assert spy.known is NOTHING_KNOWN


@pytest.mark.parametrize(
    "name", ["late", "unreferenced", "artificial", "input_saturated", "near_limit"]
)
def test_the_observer_is_told_what_is_particular_to_a_sample(spy, name):
    fields = {
        "unreferenced": ("referenced", False),
        "artificial": ("is_artificial", True),
        "input_saturated": ("saturated", True),
    }
    field, value = fields.get(name, (name, True))

    estimate(spy, RUNS, replace(SAMPLED, effort_std=(1.0, 2.0), **{field: value}))

    ((*_, flags),) = spy.fed
    assert flags.pop("effort_std") == (1.0, 2.0)
    assert [one for one in flags if flags[one]] == [name]


@pytest.mark.parametrize(
    "missing",
    [
        {"referenced": False},
        {"joints": (JOINT._replace(fresh=False), JOINT)},
        {"joints": (JOINT, JOINT._replace(fresh=False))},
    ],
)
def test_it_starts_at_a_known_pose_only(spy, missing):
    inputs = replace(SAMPLED, **missing)

    waiting = estimate(spy, Estimated(), inputs)

    assert (waiting.estimate, spy.started, spy.fed) == (None, [], [])
    assert waiting.effort_used == tuple(one.effort_si for one in inputs.joints)
    assert [math.isnan(one) for one in waiting.measured] == [not one.fresh for one in inputs.joints]
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

    assert worse.bad_cycles == 4
    assert estimate(spy, worse, SAMPLED).bad_cycles == 0


def test_a_stride_is_there_in_the_cycle_that_completes_it(spy):
    spy.smoothed = spy.stride = object()
    completed = estimate(spy, RUNS, SAMPLED)
    spy.stride = None

    assert (completed.stride, completed.stride_count) == (spy.smoothed, 8)
    after = estimate(spy, completed, SAMPLED)
    assert (after.stride, after.stride_count) == (None, 8)
    spy.smoothed, spy.stride = None, object()
    assert estimate(spy, completed, SAMPLED).stride is None


def test_without_drives_there_is_no_estimate_but_what_was_learnt_stays():
    learnt = replace(RUNS, advice=(Advice(friction=True), NO_ADVICE), drifts=(NO_DRIFT, Drift(1.0)))

    left = cleared(learnt)

    assert (left.estimate, left.bad_cycles, left.stride) == (None, 0, None)
    assert (left.stride_count, left.advice) == (7, learnt.advice)
    assert left.drifts == learnt.drifts


LAW = FrictionParameters(8.0, 5.0, 0.0, 0.02, 0.05, 0.01, 0.1)
EVERY = Advice(friction=True, offset=True, slope=True)


@pytest.mark.parametrize(
    ("kind", "code", "values"),
    [
        ("friction", EventCode.CALIBRATION_ADVISED, (0.5, -0.5 / math.sqrt(0.39))),
        ("offset", EventCode.OFFSET_FOUND, (-0.1, 3.0 * 0.2)),
        ("slope", EventCode.SLOPE_FOUND, (0.2 / 5.0, 3.0 * 0.2)),
    ],
)
def test_a_calibration_is_advised_once_for_each_axis_and_reason(kind, code, values):
    leg = a_leg()
    leg.observers = SimpleNamespace(slope_std=(0.1, 0.2), friction=(LAW, LAW))
    drift = Drift(motion_s=10.0, product_s=-5.0, patient_s=1.0, square_s=4.0, variance_s=0.4)
    drift = drift._replace(place_square_s=10.0, patient_along_place_s=-2.0)
    asked = replace(RUNS, advice=(NO_ADVICE, Advice(**{kind: True})), drifts=(NO_DRIFT, drift))

    (event,) = estimation.news(leg, RUNS, asked)

    assert (event.code, event.subject) == (code, "right/slide")
    assert event.values == pytest.approx(values)
    assert list(estimation.news(leg, asked, asked)) == []
    every = replace(asked, advice=(NO_ADVICE, EVERY))
    assert len(list(estimation.news(leg, asked, every))) == 2
    assert list(estimation.news(leg, every, asked)) == []


def test_the_observer_reads_what_either_axis_or_the_exercise_says_of_the_leg(monkeypatch):
    monkeypatch.setattr(estimation, "effort_std", lambda leg: (leg.name, 2.0))
    leg = a_leg(monitored=Monitored(zone=SoftZone(mechanism_depth_ratio=0.1)))
    hip, slide = leg.axes
    now_shows(slide, joint=JOINT._replace(position_si=0.5))
    tick = Tick(1, 0, 0, 0.011, CycleTiming(0, 0, 0, 0), late=True)

    found = estimation.inputs_of(leg, tick)

    assert found == ObserverInputs(
        joints=(hip.sensed.joint, slide.sensed.joint),
        referenced=True,
        origin_moved=False,
        artificial=(0.0, 0.0),
        is_artificial=False,
        effort_std=("right", 2.0),
        saturated=False,
        near_limit=True,
        dt_s=0.011,
        late=True,
        known=NOTHING_KNOWN,
    )
    was_sent(hip, effort_si=hip.limits.effort_max_si)
    leg.exercise = SimpleNamespace(artificial_si=(1.0, 2.0), is_artificial=True)
    other = estimation.inputs_of(leg, tick)
    assert (other.saturated, other.artificial, other.is_artificial) == (True, (1.0, 2.0), True)
    leg.exercise.is_artificial = False
    assert not estimation.inputs_of(leg, tick).is_artificial


@pytest.mark.parametrize("index", [0, 1])
def test_an_axis_without_a_reference_or_with_a_new_origin_is_one_of_the_leg_s(index):
    kind = TorqueSampling.FILTERED
    axes = [an_axis(name, torque_sampling=kind) for name in ("right/hip", "right/slide")]
    now_shows(axes[index], referenced=False, origin_moved=True)

    found = estimation.inputs_of(a_leg(*axes), Tick(1, 0, 0, 0.01, CycleTiming(0, 0, 0, 0)))

    assert (found.referenced, found.origin_moved) == (False, True)


@pytest.mark.parametrize("empty", [True, False])
@pytest.mark.parametrize("changed", [Drift(0.5), Drift(3.0)])
def test_a_drift_that_has_changed_is_judged_anew_for_its_axis(spy, monkeypatch, changed, empty):
    of_hip, of_slide, kept = Drift(1.0), Drift(2.0), Advice(friction=True)
    before = replace(RUNS, drifts=(of_hip, of_slide), advice=(NO_ADVICE, kept))
    spy.friction, spy.slope_std = ("hip's", "slide's"), (0.1, 0.2) if empty else None
    given, learnt, judged = [], [changed, None], []

    def update(drift, law, found, index, dt_s):
        given.append((drift, law, found, index, dt_s))
        return learnt[index]

    def asks(*given):
        judged.append(given)
        return True

    monkeypatch.setattr(estimation.friction_monitor, "update", update)
    for name in ("asks_for_calibration", "is_offset", "is_sloped"):
        monkeypatch.setattr(estimation, name, asks)
    advised = Advice(friction=True, offset=empty, slope=empty)

    hip = estimate(spy, before, SAMPLED)

    assert given == [
        (of_hip, "hip's", spy.found, 0, 0.01),
        (of_slide, "slide's", spy.found, 1, 0.01),
    ]
    assert (hip.drifts, hip.advice) == ((changed, of_slide), (advised, kept))
    of_empty = [(changed,), (changed, "hip's", 0.1)] if empty else []
    assert judged == [(changed, "hip's"), *of_empty]
    learnt[:] = None, changed
    slide = estimate(spy, before, SAMPLED)
    assert (slide.drifts, slide.advice) == ((of_hip, changed), (NO_ADVICE, advised))
    learnt[:] = None, None
    assert estimate(spy, before, SAMPLED).advice == before.advice
