"""Whatever value a key has: its file is accepted, or refused by file and key; nothing else happens.

Each key of each kind of file gets values of every type of TOML, the ends of its range, and what a
wrong unit makes of it. `make test` plays a part of them, spread over all keys.
"""

import copy
import datetime
import math
import resource
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
from config_files import CONFIGS, copied, toml
from gaitd_assist.settings import Settings as AssistSettings
from gaitd_assist.settings import read_settings as read_assist
from gaitd_display.settings import EngineerSettings, PatientSettings, TherapistSettings
from gaitd_display.settings import read_settings as read_display
from gaitd_session.profile import Profile, read_profile
from gaitd_texts import Reader, catalogue
from gaitd_toml import ConfigError, Document, decoded, read_toml
from msgspec import inspect
from training import PROFILE

from daemon.config.baseline import BaselineFile
from daemon.config.limit_settings import Limits
from daemon.config.settings import Robot, Trainer
from daemon.preflight.acceptance import check_files
from daemon.preflight.report_tables import sections
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveProfile
from gaitd_lab.virtual_machine import virtual_machine
from sim_drives.settings import PlantFile

ABSENT = object()
DAY = datetime.date(2026, 1, 1)
OF_EVERY_TYPE = (
    *(True, False, 0, 1, -1, 2, 2**63 - 1, -(2**63), 10**400),
    *(0.0, -0.0, 1.5, -1.5, math.nan, math.inf, -math.inf),
    *(5e-324, -5e-324, 1e-160, 1e-9, 1.7976931348623157e308, -1.7976931348623157e308),
    *("", "x", "nan", "1", "/", "..", "\0", "\n", "x" * 300),
    *([], [1.0], ["x"], [[]], [{}], [math.nan], {}, {"x": 1}),
    *(DAY, datetime.time(1, 2), datetime.datetime(2026, 1, 1, 1, 2)),
)
UNITS = (180 / math.pi, math.pi / 180, 1e3, 1e-3, 60, 1 / 60, 2 * math.pi, 10, 0.1, 2, 0.5, -1)
MEMORY_MAX_KIB = 200_000
"""More than one check needs, and less than a table whose size a file gives."""
BASELINE = {
    "robot_sha256": "0" * 64,
    "cadence_hz": 0.25,
    "stride_count": 10,
    "swing_rad": 0.7,
    "hip": {"kept_std_nm": 0.2},
    "slide": {"kept_std_n": 2.0},
    "theta": [0.0, 1.0],
    "covariance": [[1.0, 0.5], [0.5, 1.0]],
}

TEXTS = catalogue(Reader.OPERATOR, "en")


class Case(NamedTuple):
    place: tuple[str | int, ...]
    value: Any

    @property
    def key(self) -> str:
        parts = (f"[{one}]" if isinstance(one, int) else f".{one}" for one in self.place)
        return "".join(parts).lstrip(".")

    def of(self, table: dict[str, Any]) -> dict[str, Any]:
        """The table with this value at its place."""
        changed = inner = copy.deepcopy(table)
        for one in self.place[:-1]:
            inner = inner[one]
        inner[self.place[-1]] = self.value
        return changed


def kinds(info):
    """The types of a value without None."""
    if isinstance(info, inspect.UnionType):
        return [one for inner in info.types for one in kinds(inner)]
    return [] if isinstance(info, inspect.NoneType) else [info]


def places(info, value, place=()):
    """Every key of a table, and those that it may have, with type and value."""
    if place:
        yield place, info, value
    for kind in kinds(info):
        match kind, value:
            case inspect.StructType(), dict() if value.get(kind.tag_field) == kind.tag:
                for field in kind.fields:
                    name = field.encode_name
                    yield from places(field.type, value.get(name, ABSENT), (*place, name))
            case inspect.DictType(), dict():
                for name, item in value.items():
                    yield from places(kind.value_type, item, (*place, name))
            case inspect.CollectionType(), [first, *_]:
                yield from places(kind.item_type, first, (*place, 0))
            case inspect.TupleType(), list():
                for index, (inner, item) in enumerate(zip(kind.item_types, value, strict=False)):
                    yield from places(inner, item, (*place, index))


def ends(kind):
    """What a type names: members, and the ends of a range with their neighbours."""
    match kind:
        case inspect.LiteralType():
            yield from kind.values
        case inspect.EnumType():
            yield from (member.value for member in kind.cls)
        case inspect.IntType() | inspect.FloatType():
            for end in (kind.ge, kind.gt, kind.le, kind.lt):
                if end is not None and isinstance(kind, inspect.IntType):
                    yield from (int(end) - 1, int(end), int(end) + 1)
                elif end is not None:
                    yield from (float(end), *(math.nextafter(end, way) for way in (9e99, -9e99)))


def cases(kind, table):
    for place, info, value in places(inspect.type_info(kind), table):
        named = [end for one in kinds(info) for end in ends(one)]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        units = [type(value)(value * unit) for unit in UNITS] if is_number else []
        for one in {repr(one): one for one in (*named, *units, *OF_EVERY_TYPE)}.values():
            yield Case(place, one)


TRAINER = {
    "demo.toml": Trainer,
    "limits.toml": Limits,
    "robot.toml": Robot,
    "plant.toml": PlantFile,
    "drives/hip_epos4.toml": AxisFile,
    "drives/profiles/epos4.toml": DriveProfile,
}
CLIENTS = CONFIGS.parent / "clients"
OF_CLIENTS = {
    "assist": (AssistSettings, CLIENTS / "assist/configs/assist.toml", read_assist),
    **{
        name: (
            kind,
            CLIENTS / f"display/configs/{name}.toml",
            partial(read_display, kind=kind),
        )
        for name, kind in (
            ("patient", PatientSettings),
            ("therapist", TherapistSettings),
            ("engineer", EngineerSettings),
        )
    },
    "profile": (Profile, None, read_profile),
}
SOME = pytest.mark.parametrize("every", [61, pytest.param(1, marks=pytest.mark.thorough)])


def decodes(case, file, kind, table):
    """True if the file is accepted by itself; else the key is named, or what holds it."""
    try:
        decoded(Document(file, "", case.of(table)), kind)
    except ConfigError as error:
        for one in (error, *error.more):
            assert one.file == str(file)
            assert one.key
            assert one.key.startswith(case.key) or case.key.startswith(one.key), str(one)
        return False
    return True


@SOME
@pytest.mark.parametrize("name", [*TRAINER, "baseline.toml"])
def test_a_file_of_the_trainer_is_accepted_or_refused_by_its_key(name, every):
    kind = TRAINER.get(name, BaselineFile)
    table = BASELINE if kind is BaselineFile else read_toml(CONFIGS / name).table
    found = {decodes(case, Path(name), kind, table) for case in list(cases(kind, table))[::every]}
    assert False in found


@pytest.mark.timeout(1800)  # all cases of one file take minutes
@pytest.mark.parametrize("every", [151, pytest.param(1, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("name", TRAINER)
def test_files_that_are_accepted_by_themselves_are_checked_together(tmp_path, name, every):
    """A plant is read by the virtual machine; `check` does not read it."""
    configs, kind = copied(tmp_path), TRAINER[name]
    table = read_toml(configs / name).table
    some = list(cases(kind, table))[::every]
    good = [case for case in some if decodes(case, Path(name), kind, table)]
    assert good
    if every > 1:
        good = good[:: 1 + len(good) // 6]
    file = check_files(configs / "demo.toml").settings.file
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    for case in good:
        (configs / name).write_text(toml(case.of(table)), encoding="utf-8")
        if kind is PlantFile:
            try:
                virtual_machine(file)
            except ConfigError as error:
                assert error.file
                assert error.key or "`" in error.allowed  # of two keys that contradict each other
            continue
        result = check_files(configs / "demo.toml")
        assert all(error.file and error.key for error in result.errors), case
        if result.report is not None:
            msgspec.json.encode(msgspec.to_builtins(result.report))
            assert list(sections(result.report, TEXTS))

    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < MEMORY_MAX_KIB


@SOME
@pytest.mark.parametrize("name", OF_CLIENTS)
def test_a_file_of_a_client_is_accepted_or_refused_by_its_key(tmp_path, name, every):
    kind, shipped, read = OF_CLIENTS[name]
    file = tmp_path / f"{name}.toml"
    file.write_text(PROFILE if shipped is None else shipped.read_text(encoding="utf-8"))
    table = read_toml(file).table
    refused_count = 0

    for case in list(cases(kind, table))[::every]:
        file.write_text(toml(case.of(table)), encoding="utf-8")
        try:
            read(file)
        except ConfigError as error:
            refused_count += 1
            assert str(error).startswith(f"{file}: ")
            first = str(case.place[0])
            assert first in str(error).removeprefix(str(file)), case

    assert refused_count
