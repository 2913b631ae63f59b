"""Numbers have two bounds that mean something, and names can be looked up, in every file."""

import re
from functools import partial
from pathlib import Path

import pytest
from config_files import CONFIGS, Change, changed, copied
from gaitd_assist.settings import Settings as AssistSettings
from gaitd_assist.settings import read_settings as read_assist
from gaitd_display.settings import EngineerSettings, PatientSettings, TherapistSettings
from gaitd_display.settings import read_settings as read_display
from gaitd_session.profile import Profile
from gaitd_toml import ConfigError, Document, decoded, read_toml
from msgspec import inspect

from daemon.config.baseline import BaselineFile
from daemon.config.limit_settings import Limits
from daemon.config.settings import Robot, Trainer
from daemon.preflight.acceptance import check_files
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveProfile
from sim_drives.settings import PlantFile

FILES = (
    *(Trainer, Limits, Robot, AxisFile, DriveProfile, BaselineFile, PlantFile),
    *(AssistSettings, PatientSettings, TherapistSettings, EngineerSettings, Profile),
)


def numbers(info, key):
    """All numbers of a type, with their keys."""
    match info:
        case inspect.FloatType() | inspect.IntType():
            yield key, info
        case inspect.StructType():
            for field in info.fields:
                yield from numbers(field.type, f"{key}.{field.encode_name}")
        case inspect.UnionType(types=inner) | inspect.TupleType(item_types=inner):
            for one in inner:
                yield from numbers(one, key)
        case inspect.CollectionType(item_type=one) | inspect.DictType(value_type=one):
            yield from numbers(one, f"{key}[]")
        case _:
            pass


@pytest.mark.parametrize("kind", FILES, ids=lambda kind: kind.__module__ + "." + kind.__name__)
def test_every_number_has_two_bounds_and_none_may_be_next_to_nothing(kind):
    found = list(numbers(inspect.type_info(kind), ""))

    unbounded = [
        key
        for key, info in found
        if (info.ge is None and info.gt is None) or (info.le is None and info.lt is None)
    ]
    assert found
    assert not unbounded
    assert not [key for key, info in found if info.gt == 0]


@pytest.mark.parametrize(
    ("file", "kind", "place"),
    [
        ("limits.toml", Limits, ("hip", "power_max_w")),
        ("limits.toml", Limits, ("stop", "hip", "patient_nm")),
        ("robot.toml", Robot, ("friction", "hip", "bristle_stiffness_nm_per_rad")),
        ("robot.toml", Robot, ("springs", "hip", "rest_rad")),
        ("drives/hip_epos4.toml", AxisFile, ("transmission", "gear_ratio")),
        ("drives/profiles/epos4.toml", DriveProfile, ("torque_source", "factor")),
    ],
)
@pytest.mark.parametrize("value", [5e-324, -5e-324, 1e-160])
def test_a_number_next_to_nothing_is_refused_also_where_0_is_allowed(file, kind, place, value):
    *path, name = place
    whole = read_toml(CONFIGS / file).table
    table = whole
    for part in path:
        table = table[part]
    table[name] = value

    with pytest.raises(ConfigError) as refused:
        decoded(Document(Path(file), "", whole), kind)

    assert refused.value.key == ".".join(place)
    assert "0 without a sign or at least 1e-09 in size" in refused.value.allowed


LONG = "x" * 256


@pytest.mark.parametrize(
    ("file", "old", "new", "key", "allowed"),
    [
        ("demo.toml", '"robot.toml"', f'"{LONG}"', "robot", "a file that exists"),
        ("demo.toml", '"limits.toml"', f'"{LONG}"', "limits", "a file that exists"),
        ("demo.toml", '"../out/demo/state"', f'"{LONG}"', "paths.state", "file name too long"),
        ("demo.toml", '"robot.toml"', '"a\\u0000b"', "robot", "without the character 0"),
        ("demo.toml", ":7447", ":74470", "zenoh.listen[0]", "a port from 1 to 65535"),
        ("demo.toml", ":7447", ":0", "zenoh.listen[0]", "a port from 1 to 65535"),
        ("demo.toml", '"trainer"', '"trainer\\n"', "zenoh.trainer", "text that matches"),
        (
            *("drives/hip_epos4.toml", '"profiles/epos4.toml"', f'"{LONG}"', "profile"),
            "a file that exists",
        ),
        ("drives/hip_epos4.toml", '"epos4.eds"', f'"{LONG}"', "eds", "a file that exists"),
    ],
)
def test_a_name_that_nothing_can_have_is_refused(tmp_path, file, old, new, key, allowed):
    demo = changed(copied(tmp_path), Change(file, old, new))

    errors = check_files(demo).errors

    assert [(one.file, one.key) for one in errors] == [(str(tmp_path / "configs" / file), key)]
    assert allowed in errors[0].allowed


def test_position_limits_of_more_counts_than_a_drive_has_are_refused(tmp_path):
    wide = Change("drives/hip_epos4.toml", "counts_per_rev = 1024", "counts_per_rev = 16_777_216")
    far = Change("drives/hip_epos4.toml", "offset_rad = 0.0", "offset_rad = 9.9")

    (error,) = check_files(changed(copied(tmp_path), wide, far)).errors

    assert (error.key, error.value) == ("transmission.counts_per_rev", "16777216")
    assert error.allowed.startswith("<= 13165139: ")


@pytest.mark.parametrize(
    ("read", "file", "old"),
    [
        (read_assist, "assist/configs/assist.toml", "hip.max_nm = 20.0"),
        (read_assist, "assist/configs/assist.toml", "lead_s = 0.1"),
        (partial(read_display, kind=PatientSettings), "display/configs/patient.toml", "in = 10.0"),
    ],
)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_client_refuses_a_number_that_is_none(tmp_path, read, file, old, value):
    text = (CONFIGS.parent / "clients" / file).read_text(encoding="utf-8")
    path = tmp_path / "x.toml"
    path.write_text(text.replace(old, f"{old.partition(' = ')[0]} = {value}"), encoding="utf-8")

    with pytest.raises(ConfigError, match=f"= {value}: a number .*, and finite"):
        read(path)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("true", "the name of a file or folder"),
        ('""', "the name of a file or folder"),
        ('"a\\u0000b"', "the name of a file or folder, without the character 0"),
        ("5e-324", "the name of a file or folder, and 0 without"),
    ],
)
def test_a_client_refuses_a_path_that_no_file_can_have(tmp_path, value, words):
    text = (CONFIGS.parent / "clients/assist/configs/assist.toml").read_text(encoding="utf-8")
    path = tmp_path / "x.toml"
    path.write_text(re.sub("(?m)^log = .*", lambda _: f"log = {value}", text))

    with pytest.raises(ConfigError, match=rf"x\.toml: log = .*: .*{words}"):
        read_assist(path)


def test_a_plant_whose_name_is_too_long_is_one_that_is_not_there(tmp_path):
    demo = changed(copied(tmp_path), Change("demo.toml", '"plant.toml"', f'"{LONG}"'))

    report = check_files(demo).report

    assert report is not None
    assert any(line.startswith("sim: ") and "does not exist" in line for line in report.warnings)
