"""Hand guiding: how a strapped patient gets out after a stop, played by a scripted patient."""

import itertools

import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind, Stage
from sessions import changed_configs, new_session

from daemon.ipc.record import CycleRecord, ModeRequest
from gaitd_lab.lockstep import LockstepSession

RELEASE = ModeRequest(Mode.HAND_GUIDING)
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

LED = {
    "foot_in": (4.0, 0.0, -110.0),
    "a_little": (1.5, 0.0, -110.0),
    "torn": (3.0, 0.0, -450.0),
}
"""Until when the patient leads the leg, and how hard: N·m and N. Breakaway friction is 7 and 75."""


@pytest.fixture(scope="module")
def warm_led(tmp_path_factory):
    """Held; the patient can lead the leg in each of these ways."""
    programmes = "".join(
        PROGRAMME.format(name=name, until_s=until_s, hip_nm=hip_nm, slide_n=slide_n)
        for name, (until_s, hip_nm, slide_n) in LED.items()
    )
    change = ("plant.toml", BEFORE, programmes + BEFORE)
    return new_session(changed_configs(tmp_path_factory.mktemp("led"), change)).enable()


def released(session: LockstepSession) -> LockstepSession:
    answer = session.request(RequestKind.MODE, RELEASE)
    assert answer.outcome == Outcome.DONE, answer.refusal
    session.run_until(lambda record: record.stage is Stage.PLAYING, within_s=2)
    return session


def where(session: LockstepSession) -> tuple[float, float]:
    row = session.truth.rows[-1]
    return row.hip_angle_rad, row.slide_position_m


def test_the_leg_can_be_moved_to_the_end_where_one_gets_out_and_stays_there(warm_led):
    session = released(warm_led)
    begun = where(session)

    session.command("patient foot_in")
    session.run(LED["foot_in"][0] + 0.5)
    there = where(session)
    session.run(0.4)
    later = where(session)

    assert session.record.verdict.cause == Cause.NONE
    assert session.record.mode == Mode.HAND_GUIDING
    assert there[1] < begun[1] - 0.34
    # Let go at the very edge, its spring takes it a little back; nothing else moves it.
    assert later[0] == pytest.approx(there[0], abs=0.02)
    assert later[1] == pytest.approx(there[1], abs=0.01)


def test_a_leg_that_is_not_pushed_stays_where_it_is(warm_hold):
    session = released(warm_hold)
    begun = where(session)

    session.run(1.0)

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


def test_after_a_stop_the_way_out_is_reset_enable_release(warm_led):
    session = warm_led
    session.command("hand_switch_open * 0.3")
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
