"""Every cause tells a layman what to do, in three parts and in commands that exist."""

import re

import pytest

from daemon.ipc.record import Cause
from daemon.wire.cause_texts import CAUSE_TEXT, Blame
from daemon.wire.causes import CHOSEN_CATEGORY, FIXED_CATEGORY
from gaitd.__main__ import COMMANDS

STOPS = [cause for cause in Cause if cause != Cause.NONE]


def test_every_cause_has_a_text_and_every_text_a_cause():
    assert set(CAUSE_TEXT) == set(Cause)


@pytest.mark.parametrize("cause", STOPS)
def test_a_cause_says_what_it_is_what_to_do_first_then_and_if_it_comes_back(cause):
    text = CAUSE_TEXT[cause]

    assert all(len(part) >= 8 for part in (text.title, text.then, text.again))
    assert len(text.first) >= 25
    for part in (text.first, text.then, text.again):
        assert part in text.remedy


@pytest.mark.parametrize("cause", STOPS)
def test_what_comes_first_is_about_the_person_and_needs_no_command(cause):
    first = CAUSE_TEXT[cause].first

    about_person = ("lie still", "emergency stop", "help the person out by hand")
    assert any(words in first for words in about_person)
    assert not first.startswith("`")


@pytest.mark.parametrize("cause", STOPS)
def test_every_command_that_it_names_exists(cause):
    named = re.findall(r"`gaitd ([a-z-]+)", CAUSE_TEXT[cause].remedy)

    assert set(named) <= set(COMMANDS)


@pytest.mark.parametrize("cause", STOPS)
def test_what_a_reset_lets_go_of_is_held_by_a_helper(cause):
    """A reset takes the power from the drives: whoever is told to reset was told to support."""
    text = CAUSE_TEXT[cause]

    if "`gaitd reset`" in text.then:
        assert "support" in text.first or "help the person out" in text.then


def test_drives_that_cannot_be_trusted_are_not_a_matter_of_the_person():
    for cause in FIXED_CATEGORY:
        text = CAUSE_TEXT[cause]
        if text.blame is Blame.DRIVE:
            assert "technician" in text.again or "look" in text.again


def test_no_cause_is_both_fixed_and_chosen():
    assert not set(FIXED_CATEGORY) & set(CHOSEN_CATEGORY)
