"""A core is built from the files in SI units and cycles, and warmed up before its first cycle."""

import dataclasses
import math
from types import SimpleNamespace

import msgspec
import pytest
from config_files import CONFIGS
from fresh_core import fresh

from daemon.config.settings import AcceptedCalibration
from daemon.core.exercises.homing import Homing
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import AxisStart, HomingRules, PushRules
from daemon.core.modes.persistent_state import PersistentState, PoseRules, Wiring
from daemon.core.motion.assist import AssistRules
from daemon.core.runtime import build, warm_up
from daemon.core.safety.spasm import SpasmRules
from daemon.core.safety.stop_sequence import StopRules
from daemon.preflight.load import load

SETTINGS = load(CONFIGS / "two_legs.toml")
BUILT = build.build(SETTINGS, "boot", PersistentState(utc_newest_ns=7))


def test_the_files_become_rules_in_cycles():
    core = BUILT.core
    config, trainer = core.config, SETTINGS.trainer

    assert (core.boot_id, core.persistent.utc_newest_ns) == ("boot", 7)
    assert (config.period_ns, config.period_s) == (10_000_000, 0.01)
    assert config.stop_rules == StopRules(3, 10, 1.5, 0.01, reaction_cycles=0)
    assert config.spasm == SpasmRules(10, 0.5, 0.1, 0.005)
    assert config.assist_rules == AssistRules(10, 50, 20, 0.01)
    assert config.thresholds.sample_age_max_cycles == 3
    assert config.categories.of is not None
    assert config.leg_digest == SETTINGS.hashes[str(SETTINGS.file.robot)][:16]
    assert config.patient_configured is (SETTINGS.robot.patient is not None)
    assert config.signs_must_be_proven is (trainer.commissioning.signs == "proven")
    assert (config.hold, config.gait, config.hand_guiding) == (
        *(trainer.hold, trainer.gait, trainer.hand_guiding),
    )
    assert (config.excite, config.self_test) == (dict(trainer.excite), trainer.self_test)


@pytest.mark.parametrize(("with_patient", "required"), [(True, "daily"), (False, "never")])
def test_an_accepted_calibration_moves_no_patient_before_a_self_test(with_patient, required):
    replace = msgspec.structs.replace
    robot = replace(SETTINGS.robot, calibration=AcceptedCalibration(("false_effort",)))
    robot = robot if with_patient else replace(robot, patient=None)
    trainer = SETTINGS.trainer
    trainer = replace(trainer, self_test=replace(trainer.self_test, required="never"))
    file = dataclasses.replace(SETTINGS.file, trainer=trainer)
    settings = dataclasses.replace(SETTINGS, robot=robot, file=file)

    core = build.build(settings, "boot", PersistentState()).core

    assert core.config.self_test.required == required


def test_the_first_leg_has_its_axes_and_the_second_walks_half_a_stride_later():
    right, left = BUILT.core.legs
    hip, slide = right.axes

    assert [axis.name for axis in BUILT.core.axes] == [
        *("right/hip", "right/slide", "left/hip", "left/slide"),
    ]
    assert (right.phase_offset_strides, left.phase_offset_strides) == (0.0, 0.5)
    assert hip.wiring == Wiring(5, 1, 100.0, None, 1024)
    assert slide.wiring == Wiring(6, -1, 6.0, 0.15, 512)
    assert (hip.poses, slide.poses) == (PoseRules(math.pi, True), PoseRules(2.0, True))
    assert hip.push == PushRules(12.0, 6.0, math.radians(2.0))
    assert slide.push == PushRules(120.0, 60.0, 0.02)
    assert hip.homing == HomingRules(50.0, pytest.approx(0.3), 4000)
    assert slide.homing == HomingRules(250.0, pytest.approx(0.15), 4000)
    assert (hip.reaction_cycles, hip.limits.enable_max_cycles, hip.node_id) == (50, 25, 5)
    assert (hip.limits.effort_max_si, slide.limits.effort_max_si) == (
        *(SETTINGS.limits.hip.torque_max_nm, SETTINGS.limits.slide.force_max_n),
    )
    assert right.observers.friction == right.friction
    assert left.observers.observer is not right.observers.observer


def axis(name, kind):
    rules = HomingRules(1.0, 1.0, 1)
    return kind.begin(AxisStart(name, PushRules(1.0, 1.0, 1.0), rules, True, True, 0, 0.01))


def test_a_single_axis_gets_its_special_plan_until_it_is_over():
    plans = BUILT.plans
    homing = axis("left/hip", Homing)

    assert [plan.description.name for plan in plans.usual] == [
        axis.name for axis in BUILT.core.axes
    ]
    assert plans.of(None) is plans.usual
    assert plans.of(homing.failed(homing.why)) is plans.usual
    for run, special in ((homing, plans.homing), (axis("left/hip", SignTest), plans.commissioning)):
        expected = list(plans.usual)
        expected[2] = special["left/hip"]
        assert plans.of(run) == tuple(expected) != plans.usual


def test_the_ring_says_whose_records_it_has():
    header = build.ring_header(SETTINGS, "boot", 123, "0.1")

    assert (header.core_boot_id, header.start_utc_ns, header.version) == ("boot", 123, "0.1")
    assert (header.period_ns, header.trainer) == (10_000_000, SETTINGS.trainer.zenoh.trainer)
    assert header.drive_names == ("right/hip", "right/slide", "left/hip", "left/slide")
    assert (header.leg_names, header.config_hashes) == (("right", "left"), dict(SETTINGS.hashes))
    assert (header.robot, header.limits) == (
        msgspec.to_builtins(SETTINGS.robot),
        msgspec.to_builtins(SETTINGS.limits),
    )
    assert header.kept is None


def test_everything_that_a_cycle_calls_is_called_once_before(monkeypatch):
    built, calls = fresh(), []
    (leg,) = built.core.legs

    def recorded(name, result=None):
        def call(*given, **named):
            calls.append((name, given, named))
            return result

        return call

    kernels = {
        "gait_shape": ("gait_angles", "joints_of_angles", "angles_of_joints", "load_at"),
        "stopping_path": ("least_ratio", "gradient"),
        "inverse_dynamics": ("warm_up",),
    }
    alone = ("ratio_and_load", "singularity_ratio", "mass_matrix", "static_friction_of", "settle")
    for module, names in kernels.items():
        for name in names:
            given = getattr(getattr(warm_up, module), name)
            fake = recorded(name, (0.2, 0.5) if module == "gait_shape" else None)
            assert callable(given)
            monkeypatch.setattr(getattr(warm_up, module), name, fake)
    for name in alone:
        monkeypatch.setattr(warm_up, name, recorded(name))
    leg.observers = SimpleNamespace(
        friction=leg.friction,
        observer=SimpleNamespace(reset=recorded("reset"), step=recorded("step", "estimate")),
        smoother=SimpleNamespace(add=recorded("add")),
        strides=SimpleNamespace(warm_up=recorded("strides")),
    )

    warm_up.warm_up(built)

    assert [name for name, *_ in calls] == [
        *("gait_angles", "joints_of_angles", "joints_of_angles", "angles_of_joints", "load_at"),
        *("ratio_and_load", "singularity_ratio", "mass_matrix", "least_ratio", "gradient"),
        *("warm_up", "static_friction_of", "reset", *("step", "add") * 20, "strides", "settle"),
    ]
    named = {name: (given, more) for name, given, more in calls}
    assert named["least_ratio"][0] == (
        *(leg.mechanism, (0.2, 0.5), (0.0, 0.0), (1.0, 1.0), warm_up.stopping_path.REACTION_S),
    )
    assert named["gait_angles"][0] == (leg.shape, 0.0, 0.0)
    assert named["static_friction_of"][0] == (leg.friction[0], 0.0)
    assert named["warm_up"][0] == (leg.mechanism, leg.friction_laws)
    assert named["step"][1] == {"late": False, "unreferenced": False, "artificial": False}
    assert named["step"][0][2] == 0.01
    assert [tuple(one) for one in named["step"][0][:2]] == [(0.2, 0.5), (0.2, 0.5)]
    assert named["add"][0] == ("estimate", (0.2, 0.5), 0.01)
