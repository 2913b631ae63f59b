"""What outlives the core: poses, latched stops, proofs of signs, and the tests of the day."""

from types import SimpleNamespace

import pytest
from gaitd_names import Cause, EventCode, Finding, Mode, SelfTestDue, StopCategory
from msgspec.structs import replace
from safety_inputs import CATEGORIES, FEEDBACK
from step_inputs import AT_REST, a_core, a_leg, an_axis, now_shows

from daemon.core.exercises.self_test import SelfTest, Sums, Way
from daemon.core.modes.daily_test import STORE_NS
from daemon.core.modes.persistent_state import (
    PersistentState,
    StoredInputs,
    StoredSelfTest,
    StoredVerdict,
    Wiring,
    prove,
)
from daemon.core.steps import persistence
from daemon.ipc.record import Verdict
from daemon.ipc.report import Event
from drives.signals import Input

NOW_NS = 1_700_000_000_000_000_000
HOUR_NS = 3_600_000_000_000
HIP, SLIDE = "right/hip", "right/slide"
NAMES = HIP, SLIDE
WIRING = Wiring(5, 1, 50.0, None, 4096)


@pytest.fixture
def core():
    """A core in READY whose axes are followed and at rest, with drives of numbers 1 and 12."""
    axes = [
        an_axis(
            name,
            joint=AT_REST._replace(position_si=position_si),
            serial_number=number,
            wiring=WIRING,
            is_other_drive=lambda _: True,
        )
        for name, position_si, number in zip(NAMES, (0.2, 0.5), (1, 12), strict=True)
    ]
    config = SimpleNamespace(
        categories=CATEGORIES,
        leg_digest="leg",
        self_test=SimpleNamespace(required="daily", valid_h=24.0),
    )
    return a_core(
        a_leg(*axes),
        mode=Mode.READY,
        config=config,
        verdict=Verdict(),
        persistent=PersistentState(utc_newest_ns=NOW_NS),
        utc_newest_ns=NOW_NS,
        self_test_due=SelfTestDue.NONE,
        inputs_untested=(),
    )


def proof_of(serial_number):
    return prove(WIRING, serial_number, (0.04, -0.04), NOW_NS)


# --- poses and latched stops ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {"followed": False},
        {"joint": AT_REST._replace(fresh=False)},
        {"joint": AT_REST._replace(velocity_si=1.0)},
    ],
)
def test_the_pose_of_an_axis_that_is_followed_fresh_and_at_rest_is_stored(core, changes):
    hip, slide = core.axes
    persistence.store_poses(core, NOW_NS)
    stored = {name: (one.position_si, one.noted_utc_ns) for name, one in notes(core).items()}
    assert stored == {HIP: (0.2, NOW_NS), SLIDE: (0.5, NOW_NS)}

    core.persistent = PersistentState()
    now_shows(hip, **changes)
    persistence.store_poses(core, NOW_NS)

    assert list(notes(core)) == [slide.name]


def notes(core):
    return core.persistent.axes


def test_a_latched_stop_is_stored_until_it_is_cleared(core):
    before = core.persistent
    persistence.update_latch(core, NOW_NS)
    persistence.clear_latch(core)
    assert core.persistent is before

    core.mode, core.verdict = Mode.FAULT, Verdict(StopCategory.S1, Cause.BUS_OFF)
    persistence.update_latch(core, NOW_NS)
    latched = core.persistent.latched
    assert (latched.cause, latched.utc_ns) == (Cause.BUS_OFF, NOW_NS)
    persistence.update_latch(core, NOW_NS + 1)
    assert core.persistent.latched is latched
    persistence.clear_latch(core)
    assert core.persistent.latched is None
    assert isinstance(latched, StoredVerdict)


# --- signs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("serial_number", "is_trusted"), [(0, False), (1, True), (12, True)])
def test_a_proven_sign_is_trusted_for_a_drive_with_a_number(core, serial_number, is_trusted):
    hip, slide = core.axes
    hip.serial_number = serial_number

    persistence.prove_sign(core, hip, proof_of(serial_number))

    assert (hip.sign_proven, hip.sensed.sign_trusted) == (True, is_trusted)
    assert notes(core)[HIP].proof == proof_of(serial_number)
    for axis in core.axes:
        axis.sign_proven = not axis.sign_proven
        now_shows(axis, sign_trusted=not axis.sensed.sign_trusted)
    persistence.check_signs(core)
    assert (hip.sign_proven, slide.sign_proven) == (True, False)
    assert (hip.sensed.sign_trusted, slide.sensed.sign_trusted) == (is_trusted, False)


@pytest.mark.parametrize(
    ("serial_number", "is_other", "had_proof", "is_forgotten"),
    [
        (0, True, True, True),
        (0, True, False, False),
        (0, False, True, False),
        (5, True, True, False),
    ],
)
def test_tests_of_a_drive_without_a_number_that_was_out_of_sight_are_forgotten_and_told(
    core, serial_number, is_other, had_proof, is_forgotten
):
    hip, slide = core.axes
    persistence.prove_sign(core, hip, proof_of(0))
    if had_proof:
        persistence.prove_sign(core, slide, proof_of(0))
    hip.is_other_drive = lambda _: False
    slide.is_other_drive = lambda reported: reported == serial_number and is_other
    reports = [SimpleNamespace(serial_number=number) for number in (0, serial_number)]

    for _ in range(2):
        persistence.forget_other_drives(core, reports)

    assert core.events == [Event(EventCode.TESTS_FORGOTTEN, SLIDE)] * is_forgotten
    assert notes(core)[HIP].proof is not None
    assert (SLIDE in notes(core) and notes(core)[SLIDE].proof is not None) is (
        had_proof and not is_forgotten
    )


@pytest.mark.parametrize(
    ("proven", "trusted", "doubted"),
    [(True, False, True), (True, True, False), (False, False, False)],
)
def test_a_doubt_of_a_proven_sign_is_stored(core, proven, trusted, doubted):
    hip, slide = core.axes
    for axis in core.axes:
        persistence.prove_sign(core, axis, proof_of(axis.serial_number))
    hip.sign_proven = proven
    now_shows(hip, sign_trusted=trusted)

    persistence.store_sign_doubts(core)

    assert [notes(core)[axis.name].proof.doubted for axis in (hip, slide)] == [doubted, False]


# --- daily test -----------------------------------------------------------------------------------


def of_self_test(friction_si, moved_si=0.08):
    """A self-test that is over, whose hip has this friction and has moved so far."""
    sums = Sums(friction_si, 1, -friction_si, 1, 0.0, moved_si, -0.08)
    good = Sums(6.0, 1, -6.0, 1, 0.0, 0.08, -0.08)
    ways = (Way(HIP, 0.08, 0.2, 6.0, 8.0, 0.0), Way(SLIDE, 0.08, 0.2, 6.0, 8.0, 0.0))
    return SelfTest(start=(0.0, 0.0), ways=ways, ratios=(0.5, 1.6), wait_s=0.0, sums=(sums, good))


@pytest.mark.parametrize(
    ("proven", "serial_number", "is_trusted"),
    [(True, 1, True), (True, 0, False), (False, 1, False)],
)
def test_a_passed_self_test_is_stored_and_trusts_the_proven_signs(
    core, proven, serial_number, is_trusted
):
    hip, slide = core.axes
    for axis in core.axes:
        persistence.prove_sign(core, axis, replace(proof_of(axis.serial_number), doubted=True))
        now_shows(axis, sign_trusted=False)
    hip.sign_proven, hip.serial_number = proven, serial_number
    core.legs[0].exercise = of_self_test(6.0)

    assert persistence.finish_self_test(core, NOW_NS) is None

    assert (hip.sensed.sign_trusted, slide.sensed.sign_trusted) == (is_trusted, True)
    assert [notes(core)[one.name].proof.doubted for one in core.axes] == [not is_trusted, False]
    stored = core.persistent.self_test
    assert (stored.passed, stored.utc_ns, stored.leg_digest) == (True, NOW_NS, "leg")
    assert {name: one.serial_number for name, one in stored.axes.items()} == {
        HIP: serial_number,
        SLIDE: 12,
    }
    numbers = 6.0, 1.0, 0.0, 0.08, Finding.NONE, 0.0, 0.0
    assert core.events == [Event(EventCode.SELF_TEST_PASSED, name, numbers) for name in NAMES]


@pytest.mark.parametrize(
    ("test", "finding", "value", "limit"),
    [
        (of_self_test(1.2), Finding.FRICTION_LESS, 0.2, 0.5),
        (of_self_test(6.0, 0.01), Finding.NOT_MOVED_FORTH, 0.01, 0.08),
    ],
)
def test_a_self_test_that_has_found_something_is_told_stored_and_stops(
    core, test, finding, value, limit
):
    hip = core.axes[0]
    persistence.prove_sign(core, hip, proof_of(1))
    now_shows(hip, sign_trusted=False)
    core.legs = [a_leg(exercise=one) for one in (None, test)]

    verdict = persistence.finish_self_test(core, NOW_NS)

    cause = Cause.SELF_TEST_FAILED
    assert verdict == Verdict(
        CATEGORIES.of(cause), cause, HIP, pytest.approx(value), limit, finding
    )
    assert [(event.code, event.subject) for event in core.events] == [
        (EventCode.SELF_TEST_FAILED, HIP),
        (EventCode.SELF_TEST_PASSED, SLIDE),
    ]
    assert core.events[0].values[4:] == (finding, pytest.approx(value), limit)
    assert not core.persistent.self_test.passed
    assert not hip.sensed.sign_trusted


@pytest.mark.parametrize(
    ("mode", "required", "shown", "sees"),
    [
        (Mode.READY, "daily", {}, True),
        (Mode.READY, "never", {}, True),
        (Mode.FAULT, "daily", {}, True),
        (Mode.OFF, "never", {}, False),
        (Mode.STOPPING, "daily", {}, False),
        (Mode.HOLD, "daily", {}, False),
        (Mode.HOLD, "never", {}, False),
        (Mode.READY, "daily", None, False),
        (Mode.READY, "daily", {"fresh": False}, False),
        (Mode.READY, "daily", {"inputs": Input.IMPOSSIBLE}, False),
    ],
)
def test_inputs_are_seen_to_act_at_rest_with_a_fresh_sample(core, mode, required, shown, sees):
    core.mode, core.config.self_test.required = mode, required
    open_and_active = FEEDBACK._replace(inputs=Input.NONE)
    for axis in core.axes:
        now_shows(axis, feedback=None if shown is None else open_and_active._replace(**shown))

    persistence.check_day(core, NOW_NS)

    inputs = core.persistent.inputs
    assert {name: one.serial_number for name, one in inputs.items()} == (
        {HIP: 1, SLIDE: 12} if sees else {}
    )
    due = SelfTestDue.NOT_PASSED_TODAY if required == "daily" else SelfTestDue.NONE
    assert core.self_test_due is due
    states = {"daily": 2 if sees else 4, "never": 0}[required]
    assert [name for name, _ in core.inputs_untested] == [HIP] * states + [SLIDE] * states


@pytest.mark.parametrize(
    ("mode", "newest_ns", "later_ns", "is_stored"),
    [
        (Mode.READY, NOW_NS, STORE_NS - 1, False),
        (Mode.READY, NOW_NS, STORE_NS, False),
        (Mode.READY, NOW_NS, STORE_NS + 1, True),
        (Mode.HOLD, NOW_NS, STORE_NS + 1, False),
        (Mode.READY, 0, 0, True),
    ],
)
def test_the_time_is_stored_now_and_then_while_no_drive_is_enabled(
    core, mode, newest_ns, later_ns, is_stored
):
    core.mode, core.persistent = mode, PersistentState(utc_newest_ns=newest_ns)

    persistence.check_day(core, NOW_NS + later_ns)

    assert core.persistent.utc_newest_ns == (NOW_NS + later_ns if is_stored else newest_ns)
    assert core.utc_newest_ns == NOW_NS + later_ns


TESTED = StoredSelfTest(NOW_NS, True, "leg")


@pytest.mark.parametrize(
    "tests", [{}, {"self_test": TESTED}, {"inputs": {HIP: StoredInputs()}}], ids=len
)
@pytest.mark.parametrize("newest", [(NOW_NS, 0), (0, NOW_NS)], ids=["stored", "read"])
def test_a_clock_that_was_set_back_voids_the_tests_of_the_day(core, tests, newest):
    core.mode = Mode.HOLD
    stored_ns, core.utc_newest_ns = newest
    core.persistent = PersistentState(utc_newest_ns=stored_ns, **tests)

    persistence.check_day(core, NOW_NS - HOUR_NS)

    assert (core.persistent.self_test, core.persistent.inputs) == (None, {})
    assert core.persistent.utc_newest_ns == core.utc_newest_ns == NOW_NS - HOUR_NS
    told = [Event(EventCode.CLOCK_SET_BACK, "", (pytest.approx(3600.0),))]
    assert core.events == told * bool(tests)
