"""Hand guiding: how a strapped patient gets out after a stop, played by a scripted patient."""

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind, Stage, StopCategory, Trigger
from sessions import changed_configs, new_session, position_guidance

from daemon.ipc.record import CycleRecord, ModeRequest
from daemon.ipc.report import Refusal
from gaitd_lab.lockstep import LockstepSession

RELEASE = ModeRequest(Mode.HAND_GUIDING)
HOLD = ModeRequest(Mode.HOLD)
BEFORE = "[[patient.programme]]                  # pushes against a leg that is held still"
PROGRAMME = """[[patient.programme]]
name = "{name}"

[[patient.programme.effort]]
kind = "steady"
at_s = 0.5
until_s = {until_s}
rise_s = 0.5
fall_s = 0.3
hip.torque_nm = {hip_nm}
slide.force_n = {slide_n}

"""

OUT = {
    "foot_in": (4.0, 0.0, -110.0),
    "leg_straight": (3.0, 0.0, 110.0),
    "thigh_up": (2.5, 14.0, 0.0),
    "thigh_down": (3.0, -14.0, 0.0),
}
LED = OUT | {"a_little": (1.5, 0.0, -110.0), "torn": (3.0, 0.0, -450.0)}
"""Until when the patient leads the leg, and how hard: N·m and N. Breakaway friction is 7 and 75."""


def led(folder: Path, configs: Callable[..., Path]) -> LockstepSession:
    """A session whose patient can lead the leg in each of these ways."""
    programmes = "".join(
        PROGRAMME.format(name=name, until_s=until_s, hip_nm=hip_nm, slide_n=slide_n)
        for name, (until_s, hip_nm, slide_n) in LED.items()
    )
    return new_session(configs(folder, ("plant.toml", BEFORE, programmes + BEFORE)))


@pytest.fixture(scope="module")
def warm_led(tmp_path_factory):
    return led(tmp_path_factory.mktemp("led"), changed_configs).enable()


@pytest.fixture(scope="module")
def warm_led_position(tmp_path_factory):
    return led(tmp_path_factory.mktemp("led"), position_guidance).enable()


def released(session: LockstepSession) -> LockstepSession:
    answer = session.request(RequestKind.MODE, RELEASE)
    assert answer.outcome == Outcome.DONE, answer.refusal
    session.run_until(lambda record: record.stage is Stage.PLAYING, within_s=2)
    return session


def where(session: LockstepSession) -> tuple[float, float]:
    row = session.truth.rows[-1]
    return row.hip_angle_rad, row.slide_position_m


@pytest.mark.parametrize(
    "way",
    [
        "foot_in",
        "thigh_down",
        pytest.param("thigh_up", marks=pytest.mark.thorough),
        pytest.param("leg_straight", marks=pytest.mark.thorough),
    ],
)
def test_the_leg_can_be_moved_to_the_end_where_one_gets_out_and_stays_there(warm_led, way):
    until_s, hip_nm, slide_n = OUT[way]
    session = released(warm_led)
    begun = where(session)

    session.command(f"patient {way}")
    session.run(until_s + 0.5)
    there = where(session)
    session.run(0.4)
    later = where(session)

    assert session.record.verdict.cause == Cause.NONE
    assert session.record.mode == Mode.HAND_GUIDING
    assert abs(there[0] - begun[0]) > (0.38 if hip_nm else 0.0)
    assert abs(there[1] - begun[1]) > (0.34 if slide_n else 0.0)
    assert (there[0] - begun[0]) * hip_nm >= 0
    assert (there[1] - begun[1]) * slide_n >= 0
    # Let go at the very edge, its spring takes it a little back; nothing else moves it.
    assert later[0] == pytest.approx(there[0], abs=0.02)
    assert later[1] == pytest.approx(there[1], abs=0.01)


@pytest.mark.parametrize("for_s", [1.0, pytest.param(20.0, marks=pytest.mark.thorough)])
def test_a_leg_that_is_not_pushed_stays_where_it_is(warm_hold, for_s):
    session = released(warm_hold)
    begun = where(session)

    session.run(for_s)

    assert where(session)[0] == pytest.approx(begun[0], abs=0.002)
    assert where(session)[1] == pytest.approx(begun[1], abs=0.001)


def test_a_patient_who_tears_at_the_leg_stops_it_by_the_speed_of_hand_guiding(warm_led):
    session = released(warm_led)

    session.command("patient torn")
    session.run_until(lambda record: record.mode == Mode.STOPPING, within_s=3)

    verdict = session.record.verdict
    assert verdict.cause == Cause.VELOCITY_LIMIT
    assert verdict.limit == session.settings.limits.slide.hand_guiding_speed_max_m_per_s
    assert verdict.value < session.settings.limits.slide.velocity_max_m_per_s


def test_the_hand_switch_stops_hand_guiding_as_any_motion(warm_led):
    session = released(warm_led)
    session.command("patient foot_in")
    session.run(0.8)

    session.command("hand_switch_open *")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=3)

    verdict = session.record.verdict
    assert (verdict.cause, verdict.category) == (Cause.HAND_SWITCH_OPEN, StopCategory.S1)


def test_it_ends_by_itself_and_holds_the_leg_where_it_is_then(tmp_path):
    configs = changed_configs(
        tmp_path, ("demo.toml", "duration_max_s = 120.0", "duration_max_s = 0.5")
    )
    session = released(new_session(configs).enable())

    session.run_until(lambda record: record.mode == Mode.HOLD, within_s=4)
    there = where(session)
    session.run(0.3)

    assert where(session) == pytest.approx(there, abs=0.002)
    assert session.record.mode == Mode.HOLD


def test_after_it_the_leg_is_held_or_switched_off_and_walks_again(warm_led_position):
    session = released(warm_led_position)
    session.command("patient a_little")
    session.run(2.0)

    assert session.request(RequestKind.MODE, HOLD).outcome == Outcome.DONE
    session.run(0.5)
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=0.5, duration_s=5.0)
    assert session.request(RequestKind.MODE, gait).outcome == Outcome.DONE
    session.run_until(lambda record: record.gait_phase >= 0, within_s=30)
    assert session.request(RequestKind.DISABLE).outcome == Outcome.DONE
    assert session.record.mode == Mode.READY


def test_out_of_it_the_drives_can_be_switched_off_at_once(warm_hold):
    session = released(warm_hold)

    assert session.request(RequestKind.DISABLE).outcome == Outcome.DONE
    assert session.record.mode == Mode.READY


@pytest.mark.parametrize(
    "line",
    [
        "hand_switch_open * 0.3",
        pytest.param("emcy right/hip 0.3 0x2310", marks=pytest.mark.thorough),
    ],
)
def test_after_a_stop_the_way_out_is_reset_enable_release(warm_led, line):
    session = warm_led
    session.command(line)
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=4)
    session.run(0.4)

    for kind in (RequestKind.RESET, RequestKind.ENABLE):
        answer = session.request(kind)
        assert answer.outcome == Outcome.DONE, answer.refusal
    released(session)
    begun = where(session)
    session.command("patient foot_in")
    session.run(1.5)

    assert session.record.mode == Mode.HAND_GUIDING
    assert where(session)[1] < begun[1] - 0.03


def test_it_is_asked_for_in_hold_alone(warm_ready):
    answer = warm_ready.request(RequestKind.MODE, RELEASE)

    assert answer.outcome == Outcome.REFUSED
    not_here = (Trigger.TO_HAND_GUIDING, Mode.READY)
    assert answer.refusal == Refusal(RefusalCode.NOT_IN_THIS_MODE, values=not_here)


def pushes(records: list[CycleRecord]) -> list[tuple[float, float]]:
    """What the drives were sent while a person may have had the leg."""
    return [
        (record.drives[0].target_effort, record.drives[1].target_effort)
        for record in records
        if record.mode == Mode.HAND_GUIDING
    ]


def test_nothing_it_sends_steps_by_more_than_a_person_would_feel(warm_led):
    """A tenth of what the rate limits would let through from one cycle to the next; no edge."""
    begun = len(warm_led.records)
    released(warm_led)
    warm_led.command("patient a_little")
    warm_led.run(2.5)

    sent = pushes(warm_led.records[begun:])
    steps = [
        (abs(later[0] - before[0]), abs(later[1] - before[1]))
        for before, later in itertools.pairwise(sent)
    ]

    assert max(hip for hip, _ in steps) < 1.5
    assert max(slide for _, slide in steps) < 15.0
