"""The files that we ship: they load, they hash, and their numbers are what their comments say."""

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from config_files import CONFIGS, Change, changed, copied
from gaitd_toml import load_toml

from daemon.config.drive_plan import cycle_settings, drive_limits, effort_per_motor_nm
from daemon.config.limit_settings import Limits
from daemon.config.robot import friction_parameters, leg_links, leg_parameters, observer_tuning
from daemon.config.settings import Robot, Trainer
from daemon.config.trainer import load_trainer
from daemon.preflight.load import ConfigError, load
from daemon.preflight.motion import mean_pose
from daemon.wire.causes import CHOSEN_CATEGORY
from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import DEFAULT_TUNING, LegObserver
from observer.mechanism.mechanism import gravity, mass_matrix
from tests.observer.mechanics import acceleration

SHIPPED = ("demo", "vcan", "trainer")
GENERIC = (
    Change("demo.toml", "drives/hip_epos4.toml", "drives/hip_generic.toml"),
    Change("demo.toml", "drives/slide_epos4.toml", "drives/slide_generic.toml"),
)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_configuration_loads(name):
    settings = load(CONFIGS / f"{name}.toml")

    assert [drive.name for drive in settings.drives] == ["right/hip", "right/slide"]
    assert settings.robot.patient is not None
    assert settings.limits == load_toml(CONFIGS / "limits.toml", Limits)


def test_the_generic_drives_and_the_empty_machine_load_too(tmp_path):
    empty = Change("demo.toml", '"robot.toml"', '"robot_empty.toml"')

    settings = load(changed(copied(tmp_path), *GENERIC, empty))

    assert {drive.profile.pdo.rpdo_timeout for drive in settings.drives} == {True}
    assert settings.robot.patient is None


def test_two_legs_make_four_drives_in_the_order_of_the_file():
    settings = load(CONFIGS / "two_legs.toml")

    names = [drive.name for drive in settings.drives]
    assert names == ["right/hip", "right/slide", "left/hip", "left/slide"]
    assert [drive.node_id for drive in settings.drives] == [5, 6, 7, 8]


def lines_beside(name, other):
    """Lines of one shipped file that another one does not have, without what is only said."""
    both = [
        [line.split("#")[0].rstrip() for line in (CONFIGS / file).read_text().splitlines()]
        for file in (name, other)
    ]
    return {line for line in both[0] if line not in both[1]}


def test_the_example_with_two_legs_is_the_demonstration_and_a_second_leg():
    assert lines_beside("two_legs.toml", "demo.toml") == {
        'sim = "plant_two_legs.toml"',
        'channel = "/dev/shm/gaitd-two-legs.bus"',
        'name = "left"',
        'hip = "drives/hip_left_epos4.toml"',
        'slide = "drives/slide_left_epos4.toml"',
        'runtime = "/dev/shm/gaitd-two-legs"',
        'state = "../out/two_legs/state"',
        'effect = "All four virtual drives brake, then go without power;'
        ' the springs carry each leg to rest near mid pose."',
    }
    assert lines_beside("plant_two_legs.toml", "plant.toml") == {
        "[drives.left.hip]",
        "[drives.left.slide]",
        "node_id = 7",
        "node_id = 8",
        "serial_number = 305_000_007",
        "serial_number = 305_000_008",
    }
    for axis, node in (("hip", 7), ("slide", 8)):
        left = lines_beside(f"drives/{axis}_left_epos4.toml", f"drives/{axis}_epos4.toml")
        assert left == {f"node_id = {node}"}


@pytest.mark.parametrize("name", SHIPPED)
def test_every_file_that_was_read_is_hashed(name):
    settings = load(CONFIGS / f"{name}.toml")

    assert {Path(file).name for file in settings.hashes} == {
        f"{name}.toml",
        "robot.toml",
        "limits.toml",
        "hip_epos4.toml",
        "slide_epos4.toml",
        "epos4.toml",
        "epos4.eds",
    }
    for file, sha256 in settings.hashes.items():
        assert sha256 == hashlib.sha256(Path(file).read_bytes()).hexdigest()


def test_one_changed_byte_changes_one_hash(tmp_path):
    configs = copied(tmp_path)
    before = load(configs / "demo.toml").hashes
    demo = changed(configs, Change("limits.toml", "power_max_w = 250.0", "power_max_w = 250.1"))

    after = load(demo).hashes

    assert [file for file in before if before[file] != after[file]] == [
        str(configs / "limits.toml")
    ]


def test_relative_paths_start_at_the_file_that_names_them(tmp_path, monkeypatch):
    configs = copied(tmp_path)
    monkeypatch.chdir(tmp_path)

    settings = load(Path("configs/demo.toml"))

    assert settings.runtime == Path("/dev/shm/gaitd-demo")
    assert settings.state == tmp_path / "out/demo/state"
    assert settings.file.sim == Path("configs/plant.toml")
    assert Path(settings.legs[0].hip.eds).samefile(configs / "drives/epos4.eds")


def test_a_trainer_has_absolute_places_and_nothing_to_simulate():
    file = load_trainer(CONFIGS / "trainer.toml")

    assert (file.runtime, file.state) == (Path("/run/gaitd"), Path("/var/lib/gaitd"))
    assert file.sim is None
    assert file.trainer.bus.channel == "can0"


def test_settings_cannot_be_changed():
    settings = load(CONFIGS / "demo.toml")

    with pytest.raises(AttributeError):
        settings.robot = settings.robot  # type: ignore[misc]
    with pytest.raises(AttributeError):
        settings.limits.hip.torque_max_nm = 1.0  # type: ignore[misc]


def test_the_two_robot_files_differ_in_the_patient_and_the_springs_alone():
    full = load_toml(CONFIGS / "robot.toml", Robot)
    empty = load_toml(CONFIGS / "robot_empty.toml", Robot)

    different = {
        name for name in Robot.__struct_fields__ if getattr(full, name) != getattr(empty, name)
    }

    assert different == {"patient", "springs"}


def test_exoskeleton_and_patient_together_are_the_golden_leg():
    """observer.md 2.6: composite centres of mass, inertias and masses of the three links."""
    links = leg_links(load_toml(CONFIGS / "robot.toml", Robot))

    for link, golden in zip(
        links,
        (
            (12.0, 0.438426153, 0.023868249, 0.227826954),
            (6.22, 0.459498474, -0.038127365, 0.109953498),
            (4.16, 0.447764659, 0.239867432, 0.052787001),
        ),
        strict=True,
    ):
        assert tuple(link) == pytest.approx(golden, abs=2e-9)


def test_the_robot_file_moves_as_the_golden_vectors_say():
    """observer.md 2.6, first vector; its springs rest at 2.0 rad and 1.2 m."""
    robot = load_toml(CONFIGS / "robot.toml", Robot)
    leg = leg_parameters(robot)._replace(hip_rest_rad=2.0, slide_rest_m=1.2)
    q, dq = np.array([0.20943951, 0.5]), np.array([1.1, -0.7])

    faster = acceleration(leg, q, dq, np.array([20.0, 80.0]), np.zeros(2), True)

    assert mass_matrix(leg, q).ravel() == pytest.approx(
        [1.7636329928, 0.2896938494, 0.2896938494, 15.7769169100], abs=1e-8
    )
    assert gravity(leg, q) == pytest.approx([7.665372744, -2.4863927461], abs=1e-7)
    assert faster == pytest.approx([1.9877350282, 5.2397086559], abs=1e-7)


@pytest.mark.parametrize("name", ["robot.toml", "robot_empty.toml"])
def test_the_springs_carry_the_leg_at_the_mean_pose_of_the_gait(tmp_path, name):
    settings = load(changed(copied(tmp_path), Change("demo.toml", '"robot.toml"', f'"{name}"')))
    leg = leg_parameters(settings.robot)

    load_left = gravity(leg, np.array(mean_pose(settings, leg)))

    assert load_left == pytest.approx([0.0, 0.0], abs=0.01)


def test_the_observer_takes_what_the_robot_file_says():
    tuning = observer_tuning(load_toml(CONFIGS / "robot.toml", Robot))

    assert tuning.process_std == DEFAULT_TUNING.process_std
    assert tuning.measurement_std == DEFAULT_TUNING.measurement_std
    assert (tuning.integrator, tuning.substeps) == (Integrator.RK4, 2)
    assert (tuning.coriolis, tuning.velocity_gated, tuning.gate_nis) == (True, True, 60.0)
    assert tuning.patient_noise_max_ratio == 20.0


@pytest.mark.parametrize("name", ["robot.toml", "robot_empty.toml"])
def test_what_the_loader_lets_through_the_observer_does_not_refuse(tmp_path, name):
    robot = load(changed(copied(tmp_path), Change("demo.toml", '"robot.toml"', f'"{name}"'))).robot

    LegObserver(leg_parameters(robot), *friction_parameters(robot), observer_tuning(robot))


def test_efforts_at_the_joint_need_no_efficiency_factor():
    """Contract of the demo machine: tau = k_t i gear, F = k_t i gear 2 pi / lead."""
    hip, slide = load(CONFIGS / "demo.toml").drives

    assert effort_per_motor_nm(hip) == pytest.approx(100.0)
    assert effort_per_motor_nm(slide) == pytest.approx(6 * 2 * math.pi / 0.15)


def test_what_bring_up_writes_comes_from_the_limits_file():
    settings = load(CONFIGS / "demo.toml")

    hip, slide = drive_limits(settings.limits)
    cycle = cycle_settings(settings.trainer.cycle)

    assert (hip.position_min_si, hip.position_max_si) == pytest.approx(
        (math.radians(-20), math.radians(40))
    )
    assert (slide.effort_max_si, slide.quick_stop_deceleration_si_per_s2) == (480.0, 15.4)
    assert (cycle.period_ms, cycle.drive_detection_ms, cycle.rpdo_timeout_ms) == (10, 100, 30)


def test_the_limits_file_chooses_for_exactly_the_causes_that_it_may():
    limits = load_toml(CONFIGS / "limits.toml", Limits)

    assert set(limits.stop_category) == set(CHOSEN_CATEGORY)


def test_only_scenarios_named_so_carry_an_artificial_disturbance():
    excite = load_toml(CONFIGS / "demo.toml", Trainer).excite

    assert {name for name, scenario in excite.items() if scenario.artificial} == {"paper"}
    assert excite["paper"].torque == excite["open_loop"].torque
    assert {"friction_hip", "friction_slide"} < set(excite)


def test_the_three_trainer_files_share_gait_and_scenarios():
    files = [load_toml(CONFIGS / f"{name}.toml", Trainer) for name in SHIPPED]

    for table in ("gait", "hold", "excite", "leg"):
        assert len({repr(getattr(file, table)) for file in files}) == 1


def test_an_error_is_one_line_with_all_four_parts():
    error = ConfigError("limits.toml", "hip.torque_max_nm", 300.0, "a number <= 120")

    assert error.lines == (
        "configuration error: limits.toml: hip.torque_max_nm = 300.0: a number <= 120"
    )
