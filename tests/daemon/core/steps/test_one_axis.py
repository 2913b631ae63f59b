"""Homing and sign tests of one axis: request, start, progress and end in the core's state."""

from types import SimpleNamespace

import pytest
from gaitd_names import AxisStep, EventCode, Failure, Mode, RefusalCode, Trigger
from safety_inputs import FEEDBACK, LIMITS
from step_inputs import AT_REST, a_core, a_leg, an_axis, now_shows

from daemon.core.exercises.single_axis import AxisSample, AxisStart, Result
from daemon.core.modes.persistent_state import Wiring, prove
from daemon.core.steps import single_axis
from daemon.core.steps.single_axis import Change
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Event, Refusal
from drives.signals import HomingState, OperationMode

HIP, SLIDE = "right/hip", "right/slide"
NAMES = HIP, SLIDE
NOW_NS = 1_700_000_000_000_000_000
BEGIN_CYCLES = 500


class Run:
    """A homing or sign test that takes what it is shown, and is over when a test says so."""

    mode, requested_cycle, effort_si = Mode.REFERENCE, 100, 3.0

    def __init__(self, axis=HIP, *, is_over=False, why=Failure.NONE, moved_si=None, by_drive=True):
        self.axis, self.is_over, self.why, self.by_drive = axis, is_over, why, by_drive
        self.step, self.shown = AxisStep.SEARCHING, []
        self.outcome = Result(EventCode.HOMED, moved_si is None, moved_si, (1.0,))

    def advance(self, sample):
        self.shown.append(sample)
        return self

    def enabling(self):
        return "enabling"

    def failed(self, why):
        return Run(self.axis, is_over=True, why=why)

    def result(self):
        return self.outcome

    def moves_origin(self, feedback):
        return feedback is FEEDBACK

    def limits(self, usual, *, moving):
        return usual._replace(effort_max_si=12.0, velocity_max_si=float(moving))


@pytest.fixture
def core():
    """A core in READY whose axes rest, with drives of serial number 11."""
    axes = [
        an_axis(
            name,
            wiring=Wiring(5, 1, 50.0, None, 4096),
            push=f"push of {name}",
            homing=f"homing of {name}",
            sign_proven=name == SLIDE,
            is_other_drive=lambda serial_number: serial_number != 11,
        )
        for name in NAMES
    ]
    config = SimpleNamespace(signs_must_be_proven=True, period_s=0.01)
    return a_core(a_leg(*axes), mode=Mode.READY, config=config, evidence={})


# --- what others ask ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("mode", "is_moving"),
    [(Mode.COMMISSION, True), (Mode.REFERENCE, True), (Mode.READY, False), (Mode.STOPPING, False)],
)
def test_a_single_axis_moves_in_its_modes_alone(core, mode, is_moving, name):
    core.mode, core.single_axis = mode, Run(name)
    is_its = [one == name for one in NAMES]

    assert (single_axis.moving(core) is core.single_axis) is is_moving
    efforts = [single_axis.target_effort_si(core, axis) for axis in core.axes]
    assert efforts == [3.0 if is_one and is_moving else 0.0 for is_one in is_its]
    origins = [single_axis.moves_origin(core, axis, FEEDBACK) for axis in core.axes]
    assert origins == [is_one and is_moving for is_one in is_its]
    other = FEEDBACK._replace(node_id=6)
    assert not any(single_axis.moves_origin(core, axis, other) for axis in core.axes)
    assert [single_axis.active_limits(core, axis) for axis in core.axes] == [
        LIMITS._replace(effort_max_si=12.0, velocity_max_si=float(is_moving)) if one else LIMITS
        for one in is_its
    ]


def test_without_a_single_axis_nothing_of_it_is_there(core):
    core.mode = Mode.REFERENCE
    hip, _ = core.axes

    assert single_axis.moving(core) is None
    assert single_axis.target_effort_si(core, hip) == 0.0
    assert single_axis.active_limits(core, hip) == LIMITS
    assert not single_axis.is_homing(core, hip)
    assert not single_axis.seeks_home(core, hip)
    assert not single_axis.moves_origin(core, hip, FEEDBACK)


@pytest.mark.parametrize("mode", [Mode.GAIT, Mode.HAND_GUIDING, Mode.HOLD])
def test_hand_guiding_has_a_speed_limit_of_its_own(core, mode):
    core.mode = mode
    own = LIMITS._replace(velocity_max_si=LIMITS.hand_guiding_speed_max_si)

    found = single_axis.active_limits(core, core.axes[0])

    assert found == (own if mode is Mode.HAND_GUIDING else LIMITS)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("by_drive", [True, False])
def test_an_axis_seeks_home_until_its_homing_is_done(core, name, by_drive):
    core.single_axis = Run(name, by_drive=by_drive)
    expected = [one == name and by_drive for one in NAMES]

    assert [single_axis.is_homing(core, axis) for axis in core.axes] == expected
    for step in AxisStep:
        core.single_axis.step = step
        seeks = [single_axis.seeks_home(core, axis) for axis in core.axes]
        assert seeks == [one and step is not AxisStep.DONE for one in expected]


# --- request --------------------------------------------------------------------------------------


class Kind:
    """A kind of homing or sign test that returns what it is begun with."""

    may_begin = staticmethod(lambda start: ("may begin", start))
    begin = staticmethod(lambda start: ("begun", start))


@pytest.fixture
def modes(monkeypatch):
    rules = {Mode.COMMISSION: Kind, Mode.GAIT: None}
    made = {mode: SimpleNamespace(single_axis=kind) for mode, kind in rules.items()}
    monkeypatch.setattr(single_axis, "MODES", made)


@pytest.mark.usefixtures("modes")
@pytest.mark.parametrize("name", NAMES)
def test_it_begins_with_the_rules_of_its_axis_and_without_the_evidence_of_before(core, name):
    wanted = ModeRequest(Mode.COMMISSION, axis=name)
    start = AxisStart(
        name=name,
        push=f"push of {name}",
        homing=f"homing of {name}",
        sign_proven=name == SLIDE,
        signs_must_be_proven=True,
        cycle=7,
        period_s=0.01,
    )
    core.evidence = dict.fromkeys(NAMES, "shown")

    assert single_axis.refusal(core, wanted, 7) == ("may begin", start)
    for _ in range(2):
        single_axis.begin(core, wanted, 7)
        assert core.single_axis == ("begun", start)
        assert list(core.evidence) == [one for one in NAMES if one != name]


@pytest.mark.usefixtures("modes")
@pytest.mark.parametrize(
    ("mode", "axis"), [(Mode.COMMISSION, "left/hip"), (Mode.GAIT, HIP), (Mode.COMMISSION, "z")]
)
def test_a_request_for_an_axis_that_is_not_there_was_refused_before(core, mode, axis):
    wanted = ModeRequest(mode, axis=axis)

    refused = Refusal(RefusalCode.NO_SUCH_AXIS, said="right/hip, right/slide")
    assert single_axis.refusal(core, wanted, 1) == refused
    with pytest.raises(RuntimeError, match=f"there is no axis '{axis}'"):
        single_axis.begin(core, wanted, 1)


def test_a_sign_is_confirmed_after_its_test_alone(core):
    hip = core.axes[0]
    core.evidence = {
        HIP: Result(EventCode.SIGN_TESTED, moved_si=(0.04, -0.05), evidence=(1.0, 2.0)),
        SLIDE: Result(EventCode.HOMED, homed=True),
    }
    wanted = ModeRequest(Mode.COMMISSION, axis=HIP, witnessed=True)
    assert single_axis.refusal(core, wanted, 1) is None

    found = single_axis.confirmed(core, wanted, NOW_NS)

    assert found == (hip, prove(hip.wiring, 11, (0.04, -0.05), NOW_NS))
    assert core.events == [Event(EventCode.SIGN_PROVEN, HIP, (1.0, 2.0))]
    assert single_axis.refusal(core, wanted, 1) == Refusal(RefusalCode.NOT_TESTED, HIP)
    for axis in (HIP, SLIDE, "left/hip"):
        with pytest.raises(RuntimeError, match=f"'{axis}' has no sign test"):
            single_axis.confirmed(core, ModeRequest(Mode.COMMISSION, axis=axis), NOW_NS)


# --- time -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("after_cycles", "moves", "run", "begins"),
    [
        (BEGIN_CYCLES, None, Run(), True),
        (BEGIN_CYCLES, None, Run(by_drive=False), True),
        (BEGIN_CYCLES - 1, HIP, Run(), False),
        (BEGIN_CYCLES, SLIDE, Run(), False),
        (BEGIN_CYCLES + 1, None, Run(), None),
        (3 * BEGIN_CYCLES, None, Run(), None),
    ],
)
def test_it_begins_when_all_axes_rest_and_not_later_than_it_may(
    core, after_cycles, moves, run, begins
):
    core.single_axis = run
    for axis in core.axes:
        now_shows(axis, joint=AT_REST._replace(velocity_si=float(axis.name == moves)))

    change = single_axis.advance(core, 100 + after_cycles)

    if begins:
        assert core.single_axis == "enabling"
        homing = core.axes[0] if run.by_drive else None
        assert change == Change(Trigger.TO_REFERENCE, homing)
    elif begins is False:
        assert (change, core.single_axis) == (None, run)
    else:
        assert (change, core.single_axis.why) == (None, Failure.NOT_READY)
        assert core.events == [Event(EventCode.SINGLE_AXIS_FAILED, HIP, (Failure.NOT_READY,))]


def test_an_axis_without_a_sample_does_not_rest(core):
    core.single_axis = Run()
    now_shows(core.axes[1], joint=AT_REST._replace(fresh=False))

    assert single_axis.advance(core, 100) is None


@pytest.mark.parametrize(
    ("run", "event", "is_homed", "evidence"),
    [
        (Run(is_over=True), Event(EventCode.HOMED, HIP, (1.0,)), True, []),
        (
            Run(is_over=True, moved_si=(0.1, -0.1)),
            *(Event(EventCode.HOMED, HIP, (1.0,)), False, [HIP]),
        ),
        *(
            (
                Run(is_over=True, why=why),
                *(Event(EventCode.SINGLE_AXIS_FAILED, HIP, (why,)), False, []),
            )
            for why in (Failure.HOME_NOT_FOUND, Failure.STOP_REQUESTED)
        ),
    ],
)
@pytest.mark.parametrize("mode", [Mode.REFERENCE, Mode.COMMISSION])
def test_its_end_is_told_with_what_it_has_shown(core, run, event, is_homed, evidence, mode):
    core.mode, core.single_axis = mode, run
    hip = core.axes[0]

    change = single_axis.advance(core, 1)

    assert change == Change(Trigger.EXERCISE_OVER, homed=hip if is_homed else None)
    assert core.events == [event]
    assert core.evidence == dict.fromkeys(evidence, run.outcome)
    core.mode = Mode.READY
    assert single_axis.advance(core, 2) == Change(Trigger.BRING_UP_RESTARTED)
    assert core.single_axis is None
    assert single_axis.advance(core, 3) is None


@pytest.mark.parametrize("mode", [Mode.REFERENCE, Mode.COMMISSION])
def test_under_way_it_is_shown_its_axis_and_in_another_mode_it_waits(core, mode):
    core.mode, core.single_axis = mode, Run(SLIDE)
    now_shows(core.axes[1], joint=AT_REST._replace(position_si=0.5), unready_cycles=1)

    assert single_axis.advance(core, 1) is None
    assert core.single_axis.shown == [AxisSample(False, HomingState.NOT_STARTED, 0.5, True)]
    for other in (Mode.STOPPING, Mode.HOLD):
        core.mode = other
        assert single_axis.advance(core, 2) is None
    assert len(core.single_axis.shown) == 1
    core.mode, core.single_axis = mode, Run("left/hip")
    assert single_axis.advance(core, 3) is None
    assert core.single_axis.shown == []


HOMED = FEEDBACK._replace(mode_display=OperationMode.HOMING, statusword=0x1637)


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        ({}, (True, HomingState.NOT_STARTED)),
        ({"feedback": HOMED}, (True, HomingState.DONE)),
        (
            {"feedback": HOMED._replace(mode_display=OperationMode.CYCLIC_SYNC_POSITION)},
            (True, HomingState.NOT_STARTED),
        ),
        (
            {"feedback": HOMED._replace(mode_display=OperationMode.NONE)},
            (True, HomingState.NOT_STARTED),
        ),
        ({"feedback": None}, (True, HomingState.NOT_STARTED)),
        ({"unready_cycles": 1}, (False, HomingState.NOT_STARTED)),
        ({"reached_enabled": False}, (False, HomingState.NOT_STARTED)),
    ],
)
def test_the_state_of_a_homing_counts_while_the_drive_shows_its_mode(core, shown, expected):
    core.mode, core.single_axis = Mode.REFERENCE, Run()
    now_shows(core.axes[0], **shown)
    single_axis.advance(core, 1)

    (sample,) = core.single_axis.shown
    assert (sample.ready, sample.homing) == expected


def test_a_single_axis_that_is_cancelled_is_told_once_and_dropped(core):
    core.single_axis = Run()
    for _ in range(2):
        single_axis.cancel(core, Failure.STOP_REQUESTED)

    told = [Event(EventCode.SINGLE_AXIS_FAILED, HIP, (Failure.STOP_REQUESTED,))]
    assert (core.events, core.single_axis.why) == (told, Failure.STOP_REQUESTED)
    single_axis.drop(core)
    single_axis.cancel(core, Failure.NOT_READY)
    assert (core.single_axis, core.events) == (None, told)


def test_a_sign_test_of_another_drive_is_dropped(core):
    core.evidence = dict.fromkeys(NAMES, "shown")
    reports = [SimpleNamespace(serial_number=number) for number in (11, 99)]
    for _ in range(2):
        single_axis.drop_tests_of_other_drives(core, reports)

    assert list(core.evidence) == [HIP]
