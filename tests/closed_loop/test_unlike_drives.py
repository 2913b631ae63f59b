"""Two legs with four different drives: makers, gears, encoders, signs and zeros.

Where both legs have the same drives, an index of the wrong leg or axis changes nothing.
"""

import re

import pytest
from sessions import briefly_announced, changed_configs

from daemon.preflight.load import load
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.plant.truth import TruthLog

HIP = {
    "sign": -1,
    "gear_ratio": 80.0,
    "counts_per_rev": 4096,
    "offset_rad": 1.1,
    "torque_constant_nm_per_a": 0.07,
    "current_limit_a": 14.0,
}
SLIDE = {
    "sign": 1,
    "gear_ratio": 5.0,
    "lead_m": 0.12,
    "counts_per_rev": 2000,
    "offset_m": -0.6,
    "torque_constant_nm_per_a": 0.12,
    "nominal_current_a": 5.5,
}
WALK_CYCLES = 100


def changed(text, values):
    """TOML with other values of keys that it has once each."""
    for key, value in values.items():
        text, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value}", text)
        assert count == 1, key
    return text


@pytest.fixture(scope="module")
def unlike(tmp_path_factory):
    """Both legs in a gait at 0.5 Hz, with the truth of each."""
    configs = changed_configs(
        tmp_path_factory.mktemp("unlike"),
        ("two_legs.toml", "hip_left_epos4", "hip_generic"),
        ("two_legs.toml", "slide_left_epos4", "slide_elmo"),
    )
    drives = configs / "drives"
    for file, values in (
        ("hip_generic.toml", HIP | {"node_id": 7, "rated_torque_raw": 350}),
        ("slide_elmo.toml", SLIDE | {"node_id": 8, "rated_current_raw": 5500}),
    ):
        (drives / file).write_text(changed((drives / file).read_text(), values))
    plant = configs / "plant_two_legs.toml"
    head, hip, slide = re.split(r"(?m)^(?=\[drives\.left)", plant.read_text())
    hip = changed(hip, HIP | {"personality": '"generic"', "eds": '"drives/generic402.eds"'})
    maker = {"personality": '"elmo_gold"', "eds": '"drives/elmo_gold.eds"'}
    plant.write_text(head + hip + changed(slide, SLIDE | maker))

    settings = briefly_announced(load(configs / "two_legs.toml"))
    truth = {leg.name: TruthLog(None) for leg in settings.legs}
    session = LockstepSession(settings, virtual_machine(settings.file, truth=truth))
    return session.walk(cadence_hz=0.5, duration_s=2.0), truth


def test_two_legs_walk_half_a_stride_apart_and_stop_together(unlike):
    """Each leg is where its own drives say, and its patient is passive."""
    session, truth = unlike
    session.run(WALK_CYCLES * 0.01)

    for number, leg in enumerate(session.settings.legs):
        rows = {row.sync_mono_ns: row for row in truth[leg.name].rows}
        for record in session.records[-WALK_CYCLES:]:
            row, drives = rows[record.sync_mono_ns], record.drives[2 * number : 2 * number + 2]
            assert drives[0].position == pytest.approx(row.hip_angle_rad, abs=2e-3)
            assert drives[1].position == pytest.approx(row.slide_position_m, abs=1e-3)
            activity = record.legs[number]
            if activity.hip.validity == 0:
                assert activity.hip.patient == pytest.approx(0.0, abs=3.0)
    walking = session.record

    session.command("hand_switch_open left/slide")
    session.run(0.5)

    stopped = session.record
    right, left = walking.legs
    assert [right.name, left.name] == ["right", "left"]
    assert abs(right.hip.reference_position - left.hip.reference_position) > 0.05
    assert (left.gait_phase - right.gait_phase) % 1.0 == pytest.approx(0.5)
    assert stopped.verdict.drive == "left/slide"
    assert {drive.power_state for drive in stopped.drives} == {PowerState.QUICK_STOP_ACTIVE}
