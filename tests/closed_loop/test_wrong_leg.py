"""Another leg in the machine than the one that it is configured for."""

import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind
from records import both
from sessions import changed_configs, new_session

from daemon.ipc.record import ModeRequest
from drives.signals import PowerState

GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0)


def test_a_leg_that_weighs_other_than_configured_is_stopped_before_any_exercise(tmp_path):
    """The plant keeps the shipped robot file under another name."""
    configs = changed_configs(tmp_path, ("plant.toml", '"robot.toml"', '"plant_robot.toml"'))
    text = (configs / "robot.toml").read_text()
    (configs / "plant_robot.toml").write_text(text)
    (configs / "robot.toml").write_text(text.replace("mass_kg = 80.0", "mass_kg = 130.0"))
    session = new_session(configs).until_ready()
    start = both(session.record.legs[0], "measured_position")

    session.request(RequestKind.ENABLE)
    session.run_until(lambda record: record.mode == Mode.STOPPING, within_s=0.05)
    session.run(2.0)

    record = session.record
    assert record.verdict.cause == Cause.STATIC_LOAD_WRONG
    assert abs(record.verdict.value) > record.verdict.limit
    assert record.mode in {Mode.STOPPING, Mode.FAULT}
    assert session.request(RequestKind.MODE, GAIT).outcome == Outcome.REFUSED
    assert both(record.legs[0], "measured_position") == pytest.approx(start, abs=0.1)
    assert PowerState.OPERATION_ENABLED not in {one.power_state for one in record.drives}
