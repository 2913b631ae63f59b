"""[uncertainty] of a robot file: the physics that the observer's sigma considers."""

import msgspec
import pytest
from config_files import CONFIGS
from gaitd_toml import load_toml
from msgspec.structs import replace

from daemon.config.robot import considered, friction_parameters, leg_parameters
from daemon.config.settings import Robot, Uncertainty
from observer.filter.considered import VARIANTS_MAX, Variant

FILES = ("robot.toml", "robot_empty.toml", "robot_bench.toml")


def keys(kind=Uncertainty, before=""):
    for one in msgspec.structs.fields(kind):
        if isinstance(one.type, type) and issubclass(one.type, msgspec.Struct):
            yield from keys(one.type, f"{before}{one.name}.")
        else:
            yield before + one.name


def only(value, *, key=None, kind=Uncertainty, before=""):
    """An uncertainty of 0 everywhere but at the key."""
    table = {}
    for one in msgspec.structs.fields(kind):
        place = before + one.name
        if isinstance(one.type, type) and issubclass(one.type, msgspec.Struct):
            table[one.name] = only(value, key=key, kind=one.type, before=f"{place}.")
        else:
            table[one.name] = value if place == key else 0.0
    return kind(**table)


@pytest.fixture
def robot():
    return load_toml(CONFIGS / "robot.toml", Robot)


def physics(robot):
    return Variant(leg_parameters(robot), *friction_parameters(robot))


@pytest.mark.parametrize("key", list(keys()))
def test_a_parameter_that_is_not_sure_makes_other_physics(robot, key):
    found = considered(replace(robot, uncertainty=only(0.01, key=key)))

    assert found
    assert all(one != physics(robot) for one in found)
    assert len(set(found)) == len(found)


def test_a_ratio_is_relative_and_another_deviation_is_added(robot):
    (stiffer,) = considered(replace(robot, uncertainty=only(0.1, key="hip.spring_ratio")))
    (later,) = considered(replace(robot, uncertainty=only(0.1, key="hip.spring_rest_rad")))

    own = physics(robot).leg
    assert stiffer.leg == own._replace(hip_stiffness=pytest.approx(1.1 * own.hip_stiffness))
    assert later.leg == own._replace(hip_rest_rad=own.hip_rest_rad + 0.1)


def test_of_a_machine_that_is_certain_nothing_is_considered(robot):
    assert considered(replace(robot, uncertainty=only(0.0))) == ()


def test_without_a_patient_no_segment_of_a_body_is_unsure(robot):
    unsure = only(0.1, key="body_segment_ratio")

    assert len(considered(replace(robot, uncertainty=unsure))) == 3
    assert considered(replace(robot, uncertainty=unsure, patient=None)) == ()


@pytest.mark.parametrize("name", FILES)
def test_what_a_shipped_file_says_has_room(name):
    assert 0 < len(considered(load_toml(CONFIGS / name, Robot))) <= VARIANTS_MAX
