"""Each fact of a profile has a source, or is one that the drive must show."""

import copy

import pytest
from drive_files import axis_for, join, table

from drives.cia402.sources import facts
from drives.errors import DescriptionError


def profile_with(sources, must_show=(), **changes):
    profile = copy.deepcopy(table("profiles/generic.toml")) | changes
    profile["sources"] = [{"what": "a document of some length", "states": sources}]
    profile["must_show"] = list(must_show)
    return join(axis_for(profile), profile, "hip_generic").profile


def all_tables():
    return sorted({fact.split(".")[0] for fact in facts(profile_with(WHOLE))})


WHOLE = [
    *("velocity_unit", "deceleration_unit", "fault_reaction_max_ms"),
    *("resume_from_quick_stop", "inputs_always_zero", "torque_source", "torque_base"),
    *("torque_limit", "target_torque", "temperature", "optional_objects", "torque_mode", "pdo"),
    *("heartbeat", "written", "homing"),
]


def test_the_facts_are_the_keys_of_a_profile_and_the_objects_that_it_writes():
    found = facts(profile_with(WHOLE))

    assert {"velocity_unit", "torque_source.sampling", "pdo.count", "written.605Ah:00"} <= {*found}
    assert "homing.home.index" in found
    assert not {fact for fact in found if fact.startswith(("sources", "must_show", "vendor"))}
    assert all_tables() == sorted(WHOLE)


@pytest.mark.parametrize("left_out", WHOLE)
def test_a_fact_without_a_source_is_refused_by_its_key(left_out):
    with pytest.raises(DescriptionError) as caught:
        profile_with([name for name in WHOLE if name != left_out])

    assert str(caught.value).startswith("profile: sources = ")
    assert str(caught.value.value).startswith(left_out)
    assert "must_show" in caught.value.allowed


def test_the_longer_name_counts():
    rest = [name for name in WHOLE if name != "pdo"]
    profile = profile_with(rest, ["torque_source.sampling", "written.6007h:00", "pdo"])
    stated = profile_with([*rest, "pdo.count"], ["pdo"])

    assert profile.open_facts == (
        "torque_source.sampling",
        *(f"pdo.{key}" for key in ("count", "rpdo_timeout", "error_code")),
        "written.6007h:00",
    )
    assert stated.open_facts == ("pdo.rpdo_timeout", "pdo.error_code")
    assert profile_with(WHOLE, ["pdo"]).open_facts == ()
    assert profile_with([*WHOLE, "pdo.count"], ["pdo.count"]).open_facts == ()


@pytest.mark.parametrize("name", ["velocity", "torque_source.samplng", "written.605Fh:00", "pdo.x"])
@pytest.mark.parametrize("where", ["sources", "must_show"])
def test_a_name_that_is_no_key_is_refused(where, name):
    with pytest.raises(DescriptionError) as caught:
        profile_with([*WHOLE, name] if where == "sources" else WHOLE, [name][: where != "sources"])

    assert str(caught.value) == f"profile: {where} = {name!r}: a key of this profile"


@pytest.mark.parametrize("absent", ["homing.home", "temperature", "checked.608Fh:01"])
def test_a_source_may_state_what_the_profile_has_not(absent):
    profile = copy.deepcopy(table("profiles/generic.toml"))
    del profile["homing"], profile["temperature"]
    profile["sources"] = [{"what": "a document of some length", "states": [*WHOLE, absent]}]
    profile["must_show"] = []

    assert join(axis_for(profile), profile, "hip_generic").profile.open_facts == ()
