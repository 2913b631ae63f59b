"""A core is built from the files in SI units and cycles, and warmed up before its first cycle."""

import math
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import pytest
from config_files import CONFIGS
from msgspec import structs

from daemon.config.edits import replaced
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


@pytest.fixture(scope="module")
def built():
    return build.build(SETTINGS, "boot", PersistentState(utc_newest_ns=7))


def test_the_files_become_rules_in_cycles(built):
    core = built.core
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
    robot = structs.replace(SETTINGS.robot, calibration=AcceptedCalibration(("false_effort",)))
    robot = robot if with_patient else structs.replace(robot, patient=None)
    trainer = SETTINGS.trainer
    trainer = structs.replace(
        trainer, self_test=structs.replace(trainer.self_test, required="never")
    )
    file = replace(SETTINGS.file, trainer=trainer)
    settings = replace(SETTINGS, robot=robot, file=file)

    core = build.build(settings, "boot", PersistentState()).core

    assert core.config.self_test.required == required


def test_the_first_leg_has_its_axes_and_the_second_walks_half_a_stride_later(built):
    right, left = built.core.legs
    hip, slide = right.axes

    assert [axis.name for axis in built.core.axes] == [
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
    assert [axis.limits.breakaway_si for axis in right.axes] == [
        law.stribeck for law in right.friction
    ]
    assert left.observers.observer is not right.observers.observer


@pytest.mark.parametrize(("with_patient", "stds"), [(True, None), (False, (0.15, 0.2))])
def test_a_leg_knows_offsets_and_slopes_and_how_sure_those_of_an_empty_machine_are(
    with_patient, stds
):
    changes = {
        "effort_offset.slide.force_n": -3.0,
        "friction_over_position.hip.slope_per_rad": 0.25,
        "uncertainty.slide.friction_slope_per_m": 0.2,
    }
    robot = replaced(SETTINGS.robot, changes)
    robot = robot if with_patient else structs.replace(robot, patient=None)
    settings = replace(SETTINGS, robot=robot)

    leg, _ = build.build(settings, "boot", PersistentState()).core.legs

    assert leg.observers.effort_offset == (0.0, -3.0)
    assert leg.observers.slope_std == stds
    middles = (
        robot.friction_over_position.hip.middle_rad,
        robot.friction_over_position.slide.middle_m,
    )
    assert [over for _, over in leg.friction_laws] == [(0.25, middles[0]), (0.0, middles[1])]
    assert [law for law, _ in leg.friction_laws] == [tuple(law) for law in leg.friction]


def test_signs_may_have_to_be_proven_and_poses_to_be_found():
    trainer = SETTINGS.trainer
    trainer = structs.replace(
        trainer,
        commissioning=structs.replace(trainer.commissioning, signs="proven"),
        reference=structs.replace(trainer.reference, without_stored_pose="home"),
    )
    settings = replace(SETTINGS, file=replace(SETTINGS.file, trainer=trainer))

    core = build.build(settings, "boot", PersistentState()).core

    assert core.config.signs_must_be_proven
    assert not any(axis.poses.believed_without_pose for axis in core.axes)


def test_times_that_are_no_whole_number_of_cycles_lose_their_rest(monkeypatch):
    (leg, _), limits = SETTINGS.legs, SETTINGS.limits
    spasm = structs.replace(limits.spasm, rise_window_ms=109)
    stop = structs.replace(limits.stop, assist_fade_ms=209)
    file = structs.replace(
        leg.hip.axis,
        enable_max_ms=259,
        homing=structs.replace(leg.hip.axis.homing, timeout_s=40.006),
    )
    profile = structs.replace(leg.hip.profile, fault_reaction_max_ms=509)
    hip = replace(leg.hip, axis=file, profile=profile)
    windows = []
    monkeypatch.setattr(build, "SpasmWatch", windows.append)

    core = build.build(
        replace(
            SETTINGS,
            legs=(replace(leg, hip=hip),),
            limits=structs.replace(limits, spasm=spasm, stop=stop),
        ),
        *("boot", PersistentState()),
    ).core

    counts = (
        *(core.config.spasm.window_cycles, core.config.assist_rules.fade_cycles, windows[0]),
        *(core.axes[0].limits.enable_max_cycles, core.axes[0].reaction_cycles),
        core.axes[0].homing.timeout_cycles,
    )
    assert counts == (10, 20, 10, 25, 50, 4001)
    assert {type(count) for count in counts} == {int}


def axis(name, kind):
    rules = HomingRules(1.0, 1.0, 1)
    return kind.begin(AxisStart(name, PushRules(1.0, 1.0, 1.0), rules, True, True, 0, 0.01))


def test_a_single_axis_gets_its_special_plan_until_it_is_over(built):
    plans = built.plans
    homing = axis("left/hip", Homing)

    assert [plan.description.name for plan in plans.usual] == [
        axis.name for axis in built.core.axes
    ]
    assert plans.of(None) is plans.usual
    assert plans.of(homing.failed(homing.why)) is plans.usual
    for kind, special in ((Homing, plans.homing), (SignTest, plans.commissioning)):
        for index, name in ((0, "right/hip"), (2, "left/hip")):
            expected = list(plans.usual)
            expected[index] = special[name]
            assert plans.of(axis(name, kind)) == tuple(expected) != plans.usual


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
    built, calls = build.build(load(CONFIGS / "demo.toml"), "boot", PersistentState()), []
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
