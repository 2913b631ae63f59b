"""Friction that is not what the calibration said, seen through CAN frames on the empty machine."""

import math

import pytest
from gaitd_names import EventCode
from records import both
from sessions import empty_machine, new_session, reported


def test_friction_a_tenth_higher_than_calibrated_is_told_once_with_its_size(tmp_path):
    """The hip's is higher everywhere; the slide's rises along it, which its file does not say."""
    configs = empty_machine(tmp_path)
    plant = configs / "plant.toml"
    plant.write_text(plant.read_text().replace('"robot_empty.toml"', '"robot_worn.toml"'))
    worn = (configs / "robot_empty.toml").read_text()
    worn = worn.replace("stribeck_nm = 7.0", "stribeck_nm = 7.7")
    worn = worn.replace("slide.slope_per_m = 0.0", "slide.slope_per_m = 0.9")
    (configs / "robot_worn.toml").write_text(worn.replace("coulomb_nm = 6.0", "coulomb_nm = 6.6"))
    session = new_session(configs).excite("open_loop", 15.0)
    session.run(15.0)

    leg = session.record.legs[0]
    assert leg.hip.friction_error == pytest.approx(0.6, rel=0.3)
    assert leg.hip.drift_correlation < -0.8
    (advised,) = reported(session.records, EventCode.CALIBRATION_ADVISED)
    error_nm, correlation = advised.values
    assert advised.subject == "right/hip"
    assert 0.0 < error_nm < 1.0
    assert correlation < 0.0
    (rising,) = reported(session.records, EventCode.SLOPE_FOUND)
    assert rising.subject == "right/slide"
    assert rising.values == pytest.approx((0.9, 3.0 * 0.15), rel=0.4)
    assert not reported(session.records, EventCode.OFFSET_FOUND)


@pytest.mark.thorough
def test_with_a_patient_in_the_machine_the_number_is_there_and_no_advice(session):
    """A patient who pushes with the motion looks the same."""
    session.command("patient active")
    session.run(12.0)

    leg = session.record.legs[0]
    assert all(map(math.isfinite, both(leg, "drift_correlation")))
    assert leg.hip.friction_error < -1.0
    assert not reported(session.records, EventCode.CALIBRATION_ADVISED)
