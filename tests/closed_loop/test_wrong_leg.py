"""Another leg in the machine than the one that it is configured for."""

import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind
from records import both
from sessions import changed_configs, new_session

from daemon.ipc.record import ModeRequest
from drives.signals import PowerState

GAIT = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=10.0)
FAR_TOO_HEAVY = ("robot.toml", "mass_kg = 80.0", "mass_kg = 130.0")
OTHER_SPRING = ("robot.toml", "hip.rest_rad = 2.3132", "hip.rest_rad = 1.3132")
GROSS = {Cause.STATIC_LOAD_WRONG, Cause.ENCODER_FROZEN}
"""Torque without motion may be doubted before the loads are compared; it stops either way."""


def configured_for(tmp_path, *changes):
    """The plant keeps the shipped robot file under another name; the service believes `changes`."""
    configs = changed_configs(tmp_path, ("plant.toml", '"robot.toml"', '"plant_robot.toml"'))
    (configs / "plant_robot.toml").write_text((configs / "robot.toml").read_text())
    for name, old, new in changes:
        text = (configs / name).read_text()
        assert old in text
        (configs / name).write_text(text.replace(old, new))
    return configs


@pytest.mark.parametrize(
    "believed",
    [
        pytest.param(FAR_TOO_HEAVY, id="another-patient"),
        pytest.param(OTHER_SPRING, id="another-spring"),
    ],
)
def test_a_leg_that_weighs_other_than_configured_is_stopped_before_any_exercise(tmp_path, believed):
    session = new_session(configured_for(tmp_path, believed)).until_ready()
    start = both(session.record.legs[0], "measured_position")

    session.request(RequestKind.ENABLE)
    session.run(2.0)

    record = session.record
    assert record.verdict.cause in GROSS
    assert abs(record.verdict.value) > record.verdict.limit
    assert record.mode in {Mode.STOPPING, Mode.FAULT}
    assert session.request(RequestKind.MODE, GAIT).outcome == Outcome.REFUSED
    assert both(record.legs[0], "measured_position") == pytest.approx(start, abs=0.1)
    assert PowerState.OPERATION_ENABLED not in {one.power_state for one in record.drives}


def test_a_leg_that_weighs_as_configured_is_held(tmp_path):
    session = new_session(configured_for(tmp_path)).enable()
    session.run(2.0)

    assert session.record.mode == Mode.HOLD
