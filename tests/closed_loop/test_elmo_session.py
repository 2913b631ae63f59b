"""The whole service on two Elmo-like drives."""

from gaitd_names import Mode
from sessions import elmo_drives, new_session, scores


def test_it_walks_on_them_and_sees_the_patients_effort(tmp_path):
    session = new_session(elmo_drives(tmp_path)).walk(cadence_hz=0.5, duration_s=2.0)
    found = scores(session, 2.0)

    assert session.record.mode == Mode.GAIT
    assert found["hip"].rms < 0.5
    for name in session.machine.world.drives:
        errors = session.machine.world.node(name).dictionary.value(0x1003, 0)
        assert errors == 0, f"{name}: no controlword of ours is out of place"
