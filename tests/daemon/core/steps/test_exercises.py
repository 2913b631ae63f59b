"""The exercise of each leg: begun by a request, advanced once a cycle, ended in a hold."""

from types import SimpleNamespace

import pytest
from gaitd_names import EventCode, Failure, Mode, ProgressCode, Stage
from safety_inputs import FEEDBACK, JOINT, LIMITS
from step_inputs import a_core, a_leg, an_axis, now_shows, was_sent

from daemon.core.exercises.exercise import LegSample, LegStart, Reference
from daemon.core.exercises.hold import Hold
from daemon.core.steps import exercises
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Event, Progress
from drives.signals import OperationMode

CST, CSP = OperationMode.CYCLIC_SYNC_TORQUE, OperationMode.CYCLIC_SYNC_POSITION
OF_SLIDE = LIMITS._replace(quick_stop_deceleration_si_per_s2=30.0)
GUIDED = Reference((0.3, 0.6), (0.7, -0.1), (0.0, 0.0), guided=True)
POSE, SPEEDS = (0.2, 0.5), (1.0, -2.0)


def a_moving_leg(name="right", **changes):
    """A leg at 0.2 rad and 0.5 m that moves with 1 rad/s and -2 m/s."""
    axes = [
        an_axis(
            f"{name}/{axis}",
            joint=JOINT._replace(position_si=position_si, velocity_si=velocity_si),
            limits=limits,
        )
        for axis, position_si, velocity_si, limits in zip(
            ("hip", "slide"), POSE, SPEEDS, (LIMITS, OF_SLIDE), strict=True
        )
    ]
    observers = SimpleNamespace(over="slopes", effort_offset="offsets")
    own = {"parameters": "leg", "shape": "gait", "friction": "laws", "phase_offset_strides": 0.5}
    own["observers"] = observers
    return a_leg(*axes, name=name, **{**own, **changes})


@pytest.fixture
def core():
    config = SimpleNamespace(by_position=False, period_s=0.01)
    return a_core(a_moving_leg(), config=config)


def braked(start=POSE, velocity=SPEEDS):
    return Hold.braking(start, velocity, (LIMITS, OF_SLIDE))


# --- what is published ----------------------------------------------------------------------------


def plays(stage, *, in_turn=False, elapsed_s=1.0):
    return SimpleNamespace(
        stage=stage,
        legs_in_turn=in_turn,
        progress=lambda: Progress(ProgressCode.EXERCISING, "", (elapsed_s,)),
    )


def of_legs(*played):
    return SimpleNamespace(legs=[SimpleNamespace(exercise=one) for one in played])


FIRST, SECOND = (Progress(ProgressCode.EXERCISING, "", (one,)) for one in (1.0, 2.0))


@pytest.mark.parametrize(
    ("played", "progress", "stage", "is_over"),
    [
        ((None,), None, None, False),
        ((plays(None),), None, None, False),
        ((plays(Stage.PLAYING),), FIRST, Stage.PLAYING, False),
        ((plays(Stage.OVER), plays(Stage.PLAYING)), FIRST, Stage.PLAYING, True),
        (
            (plays(Stage.OVER, in_turn=True), plays(Stage.PLAYING, in_turn=True, elapsed_s=2.0)),
            *(SECOND, Stage.PLAYING, False),
        ),
        ((plays(Stage.PREPARING, in_turn=True), None), FIRST, Stage.PREPARING, False),
        (
            (plays(Stage.PREPARING, in_turn=True), plays(Stage.PLAYING, elapsed_s=2.0)),
            *(SECOND, Stage.PREPARING, False),
        ),
        ((plays(Stage.OVER), plays(Stage.PLAYING, in_turn=True)), FIRST, Stage.PLAYING, True),
        ((None, plays(Stage.OVER)), None, None, True),
        ((plays(Stage.ENDING), plays(Stage.PLAYING)), FIRST, Stage.ENDING, False),
        ((plays(Stage.OVER, in_turn=True), plays(Stage.OVER)), FIRST, Stage.OVER, True),
    ],
)
def test_progress_stage_and_end_are_those_of_the_leg_that_plays(played, progress, stage, is_over):
    core = of_legs(*played)

    assert (exercises.progress(core), exercises.stage(core)) == (progress, stage)
    assert exercises.is_over(core) is is_over


# --- begin and advance ----------------------------------------------------------------------------


class Walks:
    """An exercise that keeps what it is begun with."""

    continues_effort = True
    may_begin = staticmethod(lambda *given: given)
    begin = staticmethod(lambda *given: [(leg.name, *given[1:]) for leg in given[0]])


@pytest.mark.parametrize("reference", [None, GUIDED._replace(guided=False), GUIDED])
def test_an_exercise_begins_at_the_reference_of_a_guided_leg(core, monkeypatch, reference):
    monkeypatch.setattr(exercises, "rules_of", lambda mode: SimpleNamespace(exercise=Walks))
    core.legs[0].reference = reference

    (start,), config = exercises.refusal(core, Mode.GAIT)

    assert config is core.config
    assert start == LegStart(
        name="right",
        axis_names=("right/hip", "right/slide"),
        parameters="leg",
        shape="gait",
        limits=(LIMITS, OF_SLIDE),
        friction="laws",
        over="slopes",
        effort_offset="offsets",
        phase_offset_strides=0.5,
        pose=(0.3, 0.6) if reference is GUIDED else POSE,
    )


@pytest.mark.parametrize("mode", [Mode.GAIT, Mode.TORQUE])
@pytest.mark.parametrize("continues", [True, False])
def test_a_requested_exercise_begins_with_every_leg(monkeypatch, mode, continues):
    monkeypatch.setattr(exercises, "rules_of", lambda mode: SimpleNamespace(exercise=Walks))
    monkeypatch.setattr(Walks, "continues_effort", continues)
    core = a_core(a_moving_leg(), a_moving_leg("left"), config="settings")
    wanted = ModeRequest(mode)

    exercises.begin(core, wanted)

    assert [leg.exercise for leg in core.legs] == [
        (name, wanted, "settings") for name in ("right", "left")
    ]
    assert [leg.takes_over for leg in core.legs] == [continues] * 2


def test_a_mode_without_an_exercise_is_refused_before(core):
    assert exercises.refusal(core, Mode.READY) is None
    with pytest.raises(RuntimeError, match="READY has no exercise"):
        exercises.begin(core, ModeRequest(Mode.READY))


@pytest.mark.parametrize("continues", [True, False])
def test_a_new_stage_is_told_with_its_leg_and_may_continue_the_effort(continues):
    core = a_core(a_moving_leg("left"), a_moving_leg(), config=SimpleNamespace(period_s=0.01))
    none, leg = core.legs
    core.mode = Mode.GAIT
    given = []

    def at(stage, after=None):
        one = SimpleNamespace(
            stage=stage, failure=Failure.NONE, continues_effort_at_stages=continues
        )
        one.advance = lambda *of_cycle: given.append(of_cycle) or after or one
        return one

    leg.exercise = at(Stage.PREPARING, at(Stage.PLAYING))
    for _ in range(2):
        exercises.advance(core, ["of left", "of right"])

    values = Mode.GAIT, Stage.PLAYING, Failure.NONE
    assert core.events == [Event(EventCode.STAGE_CHANGED, "right", values)]
    assert given == [("of right", 0.01)] * 2
    assert (none.exercise, none.takes_over, leg.takes_over) == (None, False, continues)
    exercises.has_taken_over(core)
    assert not leg.takes_over
    leg.takes_over, leg.exercise = True, at(Stage.PLAYING, at(Stage.OVER))
    exercises.advance(core, [None, None])
    assert leg.takes_over
    leg.exercise = at(Stage.OVER, at(None))
    exercises.advance(core, [None, None])
    assert (leg.exercise.stage, len(core.events)) == (None, 2)


def test_a_reference_is_that_of_the_exercise(core):
    (leg,) = core.legs
    leg.exercise = SimpleNamespace(targets=lambda sample: (GUIDED, sample))
    exercises.update_references(core, ["shown"])
    assert leg.reference == (GUIDED, "shown")

    leg.exercise = None
    exercises.update_references(core, ["shown"])
    assert leg.reference is None


# --- hold -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reference", "ratio", "by_position", "start"),
    [
        (None, 1.0, False, (POSE, SPEEDS)),
        (GUIDED, 1.0, False, ((0.3, 0.6), (0.7, -0.1))),
        (GUIDED, 1.0, True, ((0.3, 0.6), (0.7, -0.1))),
        (GUIDED, 0.5, False, (POSE, SPEEDS)),
        (GUIDED._replace(guided=False), 1.0, False, (POSE, SPEEDS)),
    ],
)
def test_hold_begins_as_the_end_of_what_was_before(core, reference, ratio, by_position, start):
    (leg,) = core.legs
    leg.reference, leg.guidance_ratio = reference, ratio
    leg.exercise, core.config.by_position = "walks", by_position

    exercises.begin(core, ModeRequest(Mode.HOLD))

    assert leg.exercise == braked(*start)
    assert leg.takes_over is not by_position


@pytest.mark.parametrize(
    ("is_held", "call", "exercise", "takes_over"),
    [
        (False, exercises.brake, braked(), False),
        (True, exercises.brake, "holds", False),
        (False, exercises.brake_and_hold, braked(), True),
        (True, exercises.brake_and_hold, braked(), True),
        (False, exercises.hold_here, braked(velocity=(0.0, 0.0)), False),
        (False, exercises.clear, None, False),
        (False, exercises.reset, None, False),
    ],
)
def test_a_leg_that_stops_brakes_from_where_it_is(core, is_held, call, exercise, takes_over):
    (leg,) = core.legs
    leg.exercise, leg.is_held, leg.reference = "holds", is_held, GUIDED

    call(core)

    assert (leg.exercise, leg.takes_over) == (exercise, takes_over)
    assert leg.reference is (None if call is exercises.reset else GUIDED)


# --- what an exercise reads -----------------------------------------------------------------------


def test_a_sample_has_what_the_legs_raw_values_say(core):
    hip, slide = core.axes
    now_shows(hip, gravity_si=4.0)
    now_shows(slide, gravity_si=7.0, joint=slide.sensed.joint._replace(effort_si=20.0, fresh=False))

    assert exercises.samples_of(core, mode_changing=True) == [
        LegSample(POSE, SPEEDS, (6.0, 13.0), (True, False), True, True)
    ]
    assert not exercises.samples_of(core, mode_changing=False)[0].mode_changing


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize(
    ("sent", "shown", "is_torque"),
    [(CST, CST, True), (CSP, CST, False), (CST, CSP, False), (CST, None, False)],
)
def test_a_leg_is_in_torque_mode_if_both_drives_were_sent_and_show_it(
    core, index, sent, shown, is_torque
):
    axis = core.axes[index]
    was_sent(axis, mode=sent)
    now_shows(axis, feedback=None if shown is None else FEEDBACK._replace(mode_display=shown))

    assert exercises.samples_of(core, mode_changing=False)[0].in_torque_mode is is_torque
