"""The test of the day: what must have been seen and passed before a leg is moved."""

import re
from itertools import product
from pathlib import Path

import pytest
from gaitd_names import (
    Cause,
    EventCode,
    Finding,
    Mode,
    MotionPhase,
    Outcome,
    ProgressCode,
    RefusalCode,
    RequestKind,
    SelfTestDue,
    Untested,
)
from sessions import changed_configs, elsewhere, new_session, reported

from daemon.core.modes.persistent_state import PersistentState
from daemon.ipc.record import ModeRequest, RequestResult
from daemon.ipc.report import Progress, Refusal
from daemon.wire.report_fields import EVENT_FIELDS
from gaitd_lab.lockstep import LockstepSession

DAILY = ("demo.toml", 'required = "never"', 'required = "daily"')
SELF_TEST = ModeRequest(Mode.SELF_TEST)
GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=0.5, duration_s=5.0)
PICKY = (
    ("demo.toml", "slide.load_tolerance_n = 80.0", "slide.load_tolerance_n = 8.0"),
    ("demo.toml", "friction_min_ratio = 0.5", "friction_min_ratio = 0.9"),
)
"""Finds what the watch over spasms does not find before: with much less friction it stops first."""
HOUR_NS = 3_600_000_000_000
SHIFT_M = 0.1
"""By so much the other spring is longer."""


def ask(session: LockstepSession, wanted: ModeRequest) -> RequestResult:
    return session.request(RequestKind.MODE, wanted)


def seen_to_act(session: LockstepSession) -> LockstepSession:
    """A person lets go of the switch and presses the emergency stop, in READY."""
    session.until_ready()
    for line in ("hand_switch_open * 0.3", "sto_open * 0.3"):
        session.command(line)
        session.run(0.8)
    if session.record.mode == Mode.FAULT:
        assert session.request(RequestKind.RESET).outcome == Outcome.DONE
    return session


def put_to_test(session: LockstepSession) -> LockstepSession:
    answer = ask(session, SELF_TEST)
    assert answer.outcome == Outcome.DONE, answer.refusal
    session.run_until(lambda record: record.mode in {Mode.HOLD, Mode.STOPPING}, within_s=60)
    session.run(1.0)
    return session


def enabled(session: LockstepSession) -> LockstepSession:
    answer = session.request(RequestKind.ENABLE)
    assert answer.outcome == Outcome.DONE, answer.refusal
    return session


@pytest.fixture(scope="module")
def daily(tmp_path_factory) -> Path:
    return changed_configs(tmp_path_factory.mktemp("daily"), DAILY)


@pytest.fixture(scope="module")
def warm_day(daily) -> LockstepSession:
    """Nothing has been seen to act yet."""
    return new_session(daily).until_ready()


@pytest.fixture(scope="module")
def warm_tested(daily) -> tuple[LockstepSession, int]:
    """With the number of rows of the truth from before the test."""
    session = enabled(seen_to_act(new_session(daily)))
    begun = len(session.truth.rows)
    return put_to_test(session), begun


def due(why: SelfTestDue) -> Refusal:
    return Refusal(RefusalCode.SELF_TEST_DUE, values=(why,))


# --- passive ----------------------------------------------------------------------------------


def test_enable_waits_until_hand_switch_and_emergency_stop_have_been_seen_to_act(warm_day):
    answer = warm_day.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(
        RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.HAND_SWITCH_OPEN,)
    )
    assert warm_day.core.inputs_untested == tuple(
        product(("right/hip", "right/slide"), (Untested.HAND_SWITCH_OPEN, Untested.STO_ACTIVE))
    )


# --- active -----------------------------------------------------------------------------------


def test_a_machine_as_configured_is_moved_axis_by_axis_passes_and_may_walk_then(warm_tested):
    session, begun = warm_tested

    note = session.state_file.persistent.self_test
    assert note is not None
    assert note.passed
    assert set(note.axes) == {"right/hip", "right/slide"}
    assert all(axis.friction_ratio == pytest.approx(1.0, abs=0.1) for axis in note.axes.values())
    assert abs(note.axes["right/hip"].load_error_si) < 0.5
    assert abs(note.axes["right/slide"].load_error_si) < 3.0
    assert session.record.mode == Mode.HOLD
    assert_one_axis_after_the_other(session.truth.rows[begun:])
    assert ask(session, GAIT).outcome == Outcome.DONE


@pytest.mark.thorough
def test_a_machine_as_configured_passes_at_the_highest_speeds_that_are_allowed(tmp_path):
    fastest = (
        ("demo.toml", "hip.speed_rad_per_s = 0.1 ", "hip.speed_rad_per_s = 0.174 "),
        ("demo.toml", "slide.speed_m_per_s = 0.05 ", "slide.speed_m_per_s = 0.1 "),
    )
    session = put_to_test(new_session(changed_configs(tmp_path, *fastest)).enable())

    note = session.state_file.persistent.self_test
    assert note is not None
    assert note.passed
    assert all(axis.friction_ratio == pytest.approx(1.0, abs=0.2) for axis in note.axes.values())


def assert_one_axis_after_the_other(rows):
    """Each is moved by no more than configured."""
    hips = [row.hip_angle_rad for row in rows]
    slides = [row.slide_position_m for row in rows]
    assert 0.05 < max(hips) - min(hips) < 0.08
    assert 0.03 < max(slides) - min(slides) < 0.045
    assert max(abs(row.hip_velocity_rad_per_s) for row in rows) < 0.2
    assert max(abs(row.slide_velocity_m_per_s) for row in rows) < 0.12
    together = [
        row
        for row in rows
        if abs(row.hip_velocity_rad_per_s) > 0.05 and abs(row.slide_velocity_m_per_s) > 0.025
    ]
    assert not together


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("worn", "axis", "finding"),
    [
        (
            [
                ("coulomb_nm = 6.0", "coulomb_nm = 11.0"),
                ("stribeck_nm = 7.0", "stribeck_nm = 12.5"),
            ],
            "right/hip",
            Finding.FRICTION_MORE,
        ),
        (
            [("coulomb_n = 65.0", "coulomb_n = 53.0"), ("stribeck_n = 75.0", "stribeck_n = 60.0")],
            "right/slide",
            Finding.FRICTION_LESS,
        ),
        (
            [("slide.rest_m = ", "slide.rest_m = 0.15 + ")],
            "right/slide",
            Finding.LOAD_OF_ANOTHER_LEG,
        ),
    ],
    ids=["a bearing that goes", "a coupling that slips", "a spring of another length"],
)
def test_a_machine_that_is_not_as_configured_is_found_and_named(tmp_path, worn, axis, finding):
    configs = changed_configs(tmp_path, *PICKY, ("plant.toml", '"robot.toml"', '"worn.toml"'))
    text = (configs / "robot.toml").read_text()
    for old, new in worn:
        assert old in text
        text = text.replace(old, new)
    text = re.sub(r"= 0.15 \+ ([\d.]+)", lambda found: f"= {SHIFT_M + float(found[1]):.4f}", text)
    (configs / "worn.toml").write_text(text)
    session = new_session(configs).enable()

    put_to_test(session)

    record = session.record
    assert record.verdict.cause == Cause.SELF_TEST_FAILED
    assert record.verdict.drive == axis
    assert record.verdict.finding is finding
    failed = reported(session.records, EventCode.SELF_TEST_FAILED)
    at = EVENT_FIELDS[EventCode.SELF_TEST_FAILED].index("finding")
    assert (axis, finding) in [(event.subject, event.values[at]) for event in failed]
    note = session.state_file.persistent.self_test
    assert note is not None
    assert not note.passed


def test_a_failed_test_is_tested_again_before_anything_moves(tmp_path):
    """So short a way that a jammed hip is not pushed as hard as at a frozen encoder."""
    short = ("demo.toml", "hip.motion_deg = 4.0", "hip.motion_deg = 2.5")
    session = enabled(seen_to_act(new_session(changed_configs(tmp_path, DAILY, short))))
    ask(session, SELF_TEST)
    way = Progress(ProgressCode.TESTING, "right/hip", (MotionPhase.TURN,))
    session.run_until(lambda record: record.progress == way, within_s=5)
    session.command("blocked_rotor right/hip")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=10)
    verdict = session.record.verdict
    assert (verdict.cause, verdict.drive) == (Cause.SELF_TEST_FAILED, "right/hip")
    assert verdict.finding is Finding.NOT_MOVED_BACK

    session.command("clear blocked_rotor right/hip")
    assert session.request(RequestKind.RESET).outcome == Outcome.DONE
    enabled(session)

    assert ask(session, GAIT).refusal == due(SelfTestDue.FAILED)


# --- for how long -----------------------------------------------------------------------------


def disabled(session: LockstepSession) -> PersistentState:
    session.request(RequestKind.DISABLE)
    session.run(0.1)
    return session.state_file.persistent


@pytest.fixture(scope="module")
def passed(daily, warm_tested) -> tuple[Path, PersistentState]:
    session, _ = warm_tested
    return daily, elsewhere(session, disabled)


def test_a_test_of_another_leg_does_not_count(passed):
    configs, persistent = passed
    text = (configs / "robot.toml").read_text()
    (configs / "robot.toml").write_text(text + "\n# another one\n")

    later = new_session(configs, persistent).until_ready()

    (configs / "robot.toml").write_text(text)
    assert later.core.self_test_due is SelfTestDue.OTHER_ROBOT_FILE


def test_what_was_tested_of_one_drive_does_not_count_for_the_one_in_its_place(passed):
    configs, persistent = passed
    text = (configs / "plant.toml").read_text()
    (configs / "plant.toml").write_text(text.replace("305_000_005", "305_000_099"))

    session = new_session(configs, persistent)
    session.clock.utc_stepped_ns = HOUR_NS
    later = session.until_ready()

    (configs / "plant.toml").write_text(text)
    assert later.core.self_test_due is SelfTestDue.OTHER_DRIVE
    # The power came on with the hand switch held: the new drive has seen neither act.
    assert later.core.inputs_untested == (
        ("right/hip", Untested.HAND_SWITCH_OPEN),
        ("right/hip", Untested.STO_ACTIVE),
    )
