"""The whole service on two Elmo-like drives."""

import pytest
from sessions import Session, elmo_drives

from daemon.ipc.record import Mode, Outcome, RequestKind
from drives.signals import PowerState


@pytest.fixture(scope="module")
def warm_elmo_gait(tmp_path_factory):
    return Session(elmo_drives(tmp_path_factory.mktemp("elmo"))).walking(warm_s=4.0)


@pytest.fixture
def session(warm_elmo_gait):
    return warm_elmo_gait


def test_it_walks_on_them_and_sees_the_patients_effort(session):
    scores = session.scores(4.0)

    assert session.lockstep.record.mode == Mode.GAIT
    assert scores["hip"].rms < 0.5
    for name in session.machine.world.drives:
        errors = session.machine.world.node(name).dictionary.value(0x1003, 0)
        assert errors == 0, f"{name}: no controlword of ours is out of place"


@pytest.mark.parametrize("drive", ["right/hip", "right/slide"])
def test_it_stops_resets_and_enables_again(session, drive):
    session.machine.command(f"emcy {drive} 0.5 0x2310")
    session.lockstep.run_until(lambda record: record.mode == Mode.FAULT, within_s=6)
    session.lockstep.run(2)

    answer = session.lockstep.request(RequestKind.RESET)
    assert answer.outcome == Outcome.DONE, answer.reason
    session.lockstep.run(1)
    states = {state.power_state for state in session.lockstep.record.drives}
    assert states == {PowerState.SWITCH_ON_DISABLED}
    assert session.lockstep.request(RequestKind.ENABLE).outcome == Outcome.DONE
