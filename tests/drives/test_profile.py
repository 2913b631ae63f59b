import copy
from dataclasses import replace

import msgspec
import pytest
from drive_files import CYCLE, FOLDER, HIP_LIMITS, SLIDE_LIMITS, drive, join, table

from drives import eds
from drives.errors import DescriptionError
from drives.plan import plan
from drives.profile import check_nodes

NAMES = ["hip_epos4", "slide_epos4", "hip_generic", "slide_generic"]


def broken(name, part, path, value):
    """The tables of a drive with one value changed; None removes the key."""
    axis = copy.deepcopy(table(f"{name}.toml"))
    profile = copy.deepcopy(table(axis["profile"]))
    place = {"axis": axis, "profile": profile}[part]
    *folders, key = path
    for folder in folders:
        place = place[folder]
    if value is None:
        del place[key]
    else:
        place[key] = value
    return axis, profile


@pytest.mark.parametrize("name", NAMES)
def test_every_drive_file_of_the_project_is_consistent(name):
    description = drive(name)

    assert description.name == f"right/{name.split('_')[0]}"
    assert not description.profile.verified_on_hardware


@pytest.mark.parametrize("name", NAMES)
def test_the_eds_knows_every_object_that_bring_up_touches(name):
    description = drive(name)
    limits = HIP_LIMITS if "hip" in name else SLIDE_LIMITS

    dictionary = eds.load_eds(description.eds, description.node_id)

    assert eds.objections(plan(description, limits, CYCLE), dictionary) == []


def test_an_object_that_the_eds_does_not_have_is_named():
    dictionary = eds.load_eds(str(FOLDER / "epos4.eds"), 5)

    found = eds.objections(plan(drive("hip_generic"), HIP_LIMITS, CYCLE), dictionary)

    places = {line.split()[0] for line in found}
    assert places == {"6075h:00", "6072h:00", "605Dh:00", "1400h:05", "2100h:01"}


def test_a_mapping_of_objects_is_not_compared_with_the_eds_s_own_default():
    broken_plan = plan(drive("hip_epos4"), HIP_LIMITS, CYCLE)

    assert "60410010h" in str(broken_plan)


@pytest.mark.parametrize("path", ["absent.eds", "hip_epos4.toml"])
def test_a_file_that_is_no_eds_is_the_operator_s_matter(path):
    with pytest.raises(DescriptionError, match="readable EDS"):
        eds.load_eds(str(FOLDER / path), 5)


@pytest.mark.parametrize(
    ("name", "part", "path", "value", "key"),
    [
        ("hip_epos4", "axis", ("transmission", "lead_m"), 0.1, "transmission.lead_m"),
        ("slide_epos4", "axis", ("transmission", "lead_m"), None, "transmission.lead_m"),
        ("slide_epos4", "axis", ("transmission", "offset_m"), None, "transmission.offset_m"),
        ("slide_epos4", "axis", ("transmission", "offset_rad"), 0.0, "transmission.offset_rad"),
        ("hip_epos4", "axis", ("motor", "rated_torque_raw"), 279, "motor.rated_torque_raw"),
        ("hip_generic", "axis", ("motor", "rated_torque_raw"), 278_680, "motor.rated_torque_raw"),
        ("hip_epos4", "axis", ("motor", "rated_current_raw"), 9520, "motor.rated_current_raw"),
        ("hip_epos4", "axis", ("motor", "torque_constant_raw"), None, "motor.torque_constant_raw"),
        ("hip_generic", "axis", ("motor", "torque_constant_raw"), 55736, "torque_constant_raw"),
        ("hip_epos4", "axis", ("motor", "current_limit_a"), 1.0, "motor.current_limit_a"),
        ("hip_epos4", "profile", ("written", 0, "value"), 2, "605A"),
        ("hip_generic", "profile", ("written", 0, "value"), 0, "605A"),
        ("hip_generic", "profile", ("written", 1, "value"), 0, "605E"),
        ("hip_generic", "profile", ("written", 2, "value"), 0, "6007"),
        ("hip_generic", "profile", ("written",), [], "written"),
        ("hip_epos4", "profile", ("heartbeat", "consumer_entries"), 0, "consumer_entries"),
        ("hip_epos4", "profile", ("inputs", "sto_released", "bit"), 16, "inputs"),
    ],
)
def test_files_that_cannot_be_true_together_are_refused_by_key(name, part, path, value, key):
    axis, profile = broken(name, part, path, value)

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, name)

    assert key in caught.value.key
    assert caught.value.part == part
    assert caught.value.allowed


@pytest.mark.parametrize(
    ("part", "path", "value"),
    [
        ("axis", ("transmission", "sign"), 0),
        ("axis", ("node_id",), 128),
        ("axis", ("brand",), "maxon"),
        ("profile", ("torque_source", "unit"), "newton_metre"),
        ("profile", ("torque_limit", "bits"), 24),
        ("profile", ("velocity_unit",), "rad_per_s"),
    ],
)
def test_values_that_no_drive_has_are_refused_by_the_structs(part, path, value):
    axis, profile = broken("hip_epos4", part, path, value)

    with pytest.raises(msgspec.ValidationError):
        join(axis, profile, "hip_epos4")


def test_a_node_number_belongs_to_one_drive_and_not_to_the_master():
    hip, slide = drive("hip_epos4"), drive("slide_epos4")

    check_nodes((hip, slide), master_node_id=1)
    with pytest.raises(DescriptionError, match="the master"):
        check_nodes((hip, slide), master_node_id=6)
    with pytest.raises(DescriptionError, match="right/hip"):
        check_nodes((hip, slide, replace(hip, name="left/hip")), master_node_id=1)
