"""What drives do by themselves, in words, and what no leg may be given."""

import pytest
from drive_files import PROFILES, drive_of

from drives.cia402.option_codes import (
    WrittenObject,
    check_written,
    holds_after_quick_stop,
    in_words,
    without_torque,
)
from drives.errors import DescriptionError


def setting(index, value, legal=tuple(range(-1, 9))):
    return WrittenObject(
        index=index, sub=0, bits=16, signed=True, value=value, legal=legal, why="for a test"
    )


def settings(quick_stop=6, fault=2, master_gone=3):
    return setting(0x605A, quick_stop), setting(0x605E, fault), setting(0x6007, master_gone)


COAST = "switch off at once and coast"
WAYS = (
    "slow down on the slow-down ramp",
    "slow down on the quick-stop ramp",
    "slow down at the current limit",
    "slow down at the voltage limit",
)
OFF = [f"{way}, then switch off" for way in WAYS]


@pytest.mark.parametrize(
    ("index", "name", "meanings"),
    [
        (0x605A, "quick stop", [COAST, *OFF, *(f"{way} and stay in quick stop" for way in WAYS)]),
        (0x605D, "halt", [None, *(f"{way} and stay enabled" for way in WAYS)]),
        (0x605E, "fault", [COAST, *OFF]),
        (
            0x6007,
            "master gone",
            [
                *("nothing", "fault, then as defined by 605Eh", "disable voltage and coast"),
                "quick stop, then as defined by 605Ah",
            ],
        ),
    ],
)
def test_an_option_code_is_told_in_words(index, name, meanings):
    told = [in_words(setting(index, value)) for value in range(-1, 10)]

    wanted = [None, *meanings, *[None] * (10 - len(meanings))]
    assert told == [
        f"{name} ({index:04X}h = {value}): {meaning or 'manufacturer-specific'}"
        for value, meaning in zip(range(-1, 10), wanted, strict=True)
    ]


def test_a_setting_that_is_no_option_code_has_no_words():
    assert in_words(setting(0x60B2, 0)) is None


@pytest.mark.parametrize("profile", PROFILES)
def test_every_code_that_a_profile_writes_has_words(profile):
    told = [in_words(entry) for entry in drive_of(profile).profile.written]

    assert sum(words is not None for words in told) >= 3
    assert not [words for words in told if words and "maker's own" in words]


@pytest.mark.parametrize("value", range(-1, 11))
def test_a_quick_stop_holds_from_5_to_8(value):
    assert holds_after_quick_stop(settings(quick_stop=value)) is (5 <= value <= 8)


def test_the_code_of_another_reaction_does_not_hold_after_a_quick_stop():
    assert not holds_after_quick_stop(settings(quick_stop=2, fault=6, master_gone=6))


HOLDING = {0x605A: "5 to 8, which hold", 0x6007: "1 or 3, which slow down first"}


@pytest.mark.parametrize(
    ("codes", "losing"),
    [
        ({}, []),
        ({"quick_stop": 2}, [0x605A]),
        ({"quick_stop": 4}, [0x605A]),
        ({"quick_stop": 5}, []),
        ({"master_gone": 2}, [0x6007]),
        ({"master_gone": 1}, []),
        ({"quick_stop": 1, "master_gone": 2}, [0x605A, 0x6007]),
    ],
)
def test_codes_that_leave_an_axis_without_torque_are_found_with_those_that_hold(codes, losing):
    found = without_torque(settings(**codes))

    assert [(entry.index, instead) for entry, instead in found] == [
        (index, HOLDING[index]) for index in losing
    ]


FALLS = "that only switches off lets the leg fall"
RUNS = "a drive that continues without its master moves uncontrolled"
LISTED = [(0x6007, 0), (0x605A, 0), (0x605E, 0)]
BY_PROFILE = "because of optional_objects.halt_option"


@pytest.mark.parametrize(
    ("written", "halt", "key", "value", "allowed"),
    [
        (settings(quick_stop=0), False, "written[605Ah].value", 0, f"not 0: a quick stop {FALLS}"),
        (settings(fault=0), False, "written[605Eh].value", 0, f"not 0: a fault {FALLS}"),
        (settings(master_gone=0), False, "written[6007h].value", 0, f"not 0: {RUNS}"),
        (
            (setting(0x605A, 6, legal=(1, 2)), *settings()[1:]),
            *(False, "written[605Ah].value", 6, "one of 1, 2"),
        ),
        (
            (setting(0x605A, 32768, legal=(32768,)), *settings()[1:]),
            *(False, "written[605Ah].value", 32768),
            "-32768 to 32767, which 605Ah:00 can hold",
        ),
        (
            settings()[:2],
            *(False, "written", LISTED[1:], f"6007h:00 must be among them, since {RUNS}"),
        ),
        (
            settings(),
            *(True, "written", LISTED, f"605Dh:00 must be among them, {BY_PROFILE}"),
        ),
        (
            (*settings(), setting(0x605D, 1)),
            *(False, "written", sorted([*LISTED, (0x605D, 0)])),
            f"605Dh:00 must not be among them, {BY_PROFILE}",
        ),
    ],
)
def test_codes_that_endanger_the_leg_or_that_the_drive_does_not_know_are_refused(
    written, halt, key, value, allowed
):
    with pytest.raises(DescriptionError) as caught:
        check_written(written, halt=halt)

    told = caught.value
    assert (told.part, told.key, told.value, told.allowed) == ("profile", key, value, allowed)


def test_a_code_that_only_the_manufacturer_knows_is_left_to_the_profile():
    check_written((*settings(quick_stop=-1), setting(0x605D, 1)), halt=True)
