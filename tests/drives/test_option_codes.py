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


@pytest.mark.parametrize(
    ("index", "value", "words"),
    [
        (0x605A, 2, "quick stop (605Ah = 2): slow down on the quick-stop ramp, then switch off"),
        (
            0x605A,
            6,
            "quick stop (605Ah = 6): slow down on the quick-stop ramp and stay in quick stop",
        ),
        (0x605A, 0, "quick stop (605Ah = 0): switch off at once and coast"),
        (
            0x605A,
            7,
            "quick stop (605Ah = 7): slow down at the current limit and stay in quick stop",
        ),
        (0x605A, -1, "quick stop (605Ah = -1): manufacturer-specific"),
        (0x605D, 1, "halt (605Dh = 1): slow down on the slow-down ramp and stay enabled"),
        (0x605E, 4, "fault (605Eh = 4): slow down at the voltage limit, then switch off"),
        (0x6007, 2, "master gone (6007h = 2): disable voltage and coast"),
        (0x6007, 3, "master gone (6007h = 3): quick stop, then as defined by 605Ah"),
        (0x60B2, 0, None),
    ],
)
def test_an_option_code_is_told_in_words(index, value, words):
    assert in_words(setting(index, value)) == words


@pytest.mark.parametrize("profile", PROFILES)
def test_every_code_that_a_profile_writes_has_words(profile):
    told = [in_words(entry) for entry in drive_of(profile).profile.written]

    assert sum(words is not None for words in told) >= 3
    assert not [words for words in told if words and "maker's own" in words]


@pytest.mark.parametrize("value", range(-1, 9))
def test_a_quick_stop_holds_from_5_to_8(value):
    assert holds_after_quick_stop(settings(quick_stop=value)) is (value >= 5)


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
def test_codes_that_leave_an_axis_without_torque_are_found(codes, losing):
    assert [entry.index for entry, _ in without_torque(settings(**codes))] == losing


@pytest.mark.parametrize("codes", [{"quick_stop": 0}, {"fault": 0}, {"master_gone": 0}])
def test_a_code_that_lets_the_leg_fall_or_run_is_refused_whatever_the_drive_can(codes):
    with pytest.raises(DescriptionError, match="not 0"):
        check_written(settings(**codes), halt=False)


def test_a_code_that_the_drive_does_not_know_is_refused_with_those_that_it_does():
    written = (setting(0x605A, 6, legal=(1, 2)), *settings()[1:])

    with pytest.raises(DescriptionError, match="one of 1, 2"):
        check_written(written, halt=False)
