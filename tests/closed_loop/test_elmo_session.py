"""The whole service on two Elmo-like drives."""

import pytest
from gaitd_names import Mode, Outcome, RequestKind
from sessions import elmo_drives, new_session, scores

from drives.signals import PowerState


@pytest.fixture(scope="module")
def warm_elmo_gait(tmp_path_factory):
    return new_session(elmo_drives(tmp_path_factory.mktemp("elmo"))).walk(
        cadence_hz=0.5, duration_s=2.0
    )


@pytest.fixture
def session(warm_elmo_gait):
    return warm_elmo_gait


def test_it_walks_on_them_and_sees_the_patients_effort(session):
    found = scores(session, 2.0)

    assert session.record.mode == Mode.GAIT
    assert found["hip"].rms < 0.5
    for name in session.machine.world.drives:
        errors = session.machine.world.node(name).dictionary.value(0x1003, 0)
        assert errors == 0, f"{name}: no controlword of ours is out of place"


@pytest.mark.parametrize(
    "drive", ["right/hip", pytest.param("right/slide", marks=pytest.mark.thorough)]
)
def test_it_stops_resets_and_enables_again(session, drive):
    session.command(f"emcy {drive} 0.5 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=6)
    session.run(2)

    answer = session.request(RequestKind.RESET)
    assert answer.outcome == Outcome.DONE, answer.refusal
    session.run(1)
    states = {state.power_state for state in session.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}
    assert session.request(RequestKind.ENABLE).outcome == Outcome.DONE
