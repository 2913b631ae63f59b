"""Words of the therapist's page: stops, events, refusals and interruptions, without a raw code."""

import re
import string

import display_bench as bench
import pytest
from gaitd_client import (
    Cause,
    Event,
    EventCode,
    Kind,
    Outcome,
    Priority,
    RefusalCode,
    SetpointRefusal,
    Validity,
)
from gaitd_client.wire import Judgement, Refusal
from gaitd_display.controls import Command, Does, WhyNot
from gaitd_display.progress import interruption
from gaitd_display.therapist_view import event_item
from gaitd_display.web import refused
from gaitd_display.words import page_texts
from gaitd_session import BlockKind, Phase, Why
from gaitd_session.advice import Failure
from gaitd_texts import LANGUAGES, STOPS, Reader, catalogue, key_of, stop_of
from page_words import FOREIGN, GERMAN, english_in, words_of
from report_values import ENUMS

CODE = re.compile(r"[a-z]+_[a-z_]+|`|\{")
"""A raw code, a command of a terminal, or a value that is not filled in."""
NAMED = re.compile(r"`(?!gaitd)[^`]*`")
"""A key of a file or of a message, as its file or message has it."""
PAGE = (
    *("label", "stage", "lost", "loss", "leg", "valid", "do", "does", "why_not", "plan", "limit"),
    *("block", "end", "side", "axis", "power_state", "hand_switch", "emergency_stop", "bus"),
    *("kind", "first", "again", "stopped", "interruption", "trouble"),
)
"""Groups of the operator's texts that the page shows."""
REASONS = (
    {*Why, *RefusalCode, *Failure, *STOPS, Phase.STOPPED, Phase.PAUSED, Phase.NO_SIGNAL}
    | {key.partition(".")[2] for key in catalogue(Reader.OPERATOR, "en").texts if "failure." in key}
) - {RefusalCode.FAILED, "none"}
"""What a session writes where it is interrupted; of a request that failed, its failure."""
EVENT = {"id": "1", "time_ns": bench.BEGAN_NS, "kind": Kind.NOTE, "priority": Priority.INFO}


def shown(code, **given):
    return event_item(bench.filled(Event, **{**EVENT, "code": code, **given}))


def test_a_priority_of_a_later_version_is_shown_as_medium_and_ends_nothing():
    assert shown("drives_up", priority="critical").icon == "medium"


# --- stops --------------------------------------------------------------------------------------


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_cause_says_what_happened_what_to_do_and_whom_to_call_without_a_code(language):
    texts = catalogue(Reader.OPERATOR, language)
    for cause in [*STOPS, "of a later version"]:
        told = [
            texts.text(f"stopped.{key_of(cause)}", cause=cause),
            texts.text(f"first.{stop_of(cause).situation}"),
            texts.then(cause, texts.buttons()),
            texts.text(f"again.{stop_of(cause).again}"),
        ]
        assert all(told), cause
        assert not CODE.search(" ".join(told)), cause
    assert set(STOPS) == set(Cause) - {Cause.NONE}


# --- words --------------------------------------------------------------------------------------


def test_every_name_that_the_page_may_be_given_has_its_words():
    words = page_texts()["de"]
    groups = {
        "do": Command,
        "does": Does,
        "why_not": WhyNot,
        "valid": Validity,
        "block": BlockKind,
        "kind": ("stop", "medium", "low", "info"),
        "bus": ("active", "warning", "error passive", "bus-off"),
    }
    missing = [f"{group}.{name}" for group, names in groups.items() for name in names]
    assert [key for key in missing if key not in words] == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_label_of_the_page_has_no_code(language):
    for key, text in catalogue(Reader.OPERATOR, language).texts.items():
        if key.partition(".")[0] in PAGE:
            plain = "".join(part for part, *_ in string.Formatter().parse(text))
            assert not CODE.search(plain), key


# --- events -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"code": EventCode.HAND_SWITCH_OPENED, "subject": "right/hip"},
            "rechts, Hüfte: Handschalter losgelassen",
        ),
        (
            {
                "code": EventCode.MODE_CHANGED,
                "values": {"mode_before": "hold", "mode": "gait", "trigger": "to_gait"},
            },
            "Bein wird gehalten → Gehen (Gehen)",
        ),
        (
            {
                "code": EventCode.NMT_STATE_CHANGED,
                "subject": "left/slide",
                "values": {"nmt_state": "pre_operational"},
            },
            "links, Schlitten: wartet am Bus",
        ),
    ],
)
def test_an_event_is_said_in_plain_words_with_leg_and_axis(given, said):
    assert shown(**given).said["de"] == said


def test_a_stop_is_said_by_its_cause_with_its_remedy_and_icon():
    given = {"kind": Kind.STOP, "priority": Priority.MEDIUM, "subject": "right/hip"}
    verdict = {"category": "S1", "cause": "hand_switch_open", "finding": "none"}
    item = shown(EventCode.STOPPED, cause="hand_switch_open", values=verdict, **given)
    assert "rechts, Hüfte: Der Handschalter wurde losgelassen" in item.said["de"]
    assert item.remedy["de"].startswith("Das Bein wird gehalten. Es stützen")
    assert (item.icon, CODE.search(item.remedy["de"])) == ("stop", None)
    verdict["cause"] = "of_a_later_version"
    later = shown(EventCode.STOPPED, cause="of_a_later_version", values=verdict, **given)
    assert "Das Gerät hat angehalten: of_a_later_version" in later.said["de"]
    assert later.remedy["de"].startswith("Not-Halt drücken.")


def test_an_event_of_a_later_version_is_shown_by_its_code_and_values():
    item = shown("of_a_later_version", subject="right/hip", values={"force_n": 12.5})
    for language in LANGUAGES:
        assert "of_a_later_version" in item.said[language]
        assert "force_n=12.5" in item.said[language]


# --- interruptions ------------------------------------------------------------------------------


def test_an_interruption_is_said_in_both_languages():
    for code in REASONS:
        for text in interruption(code).values():
            assert text, code
            assert not CODE.search(NAMED.sub("", text)), code


def test_an_interruption_of_a_later_version_is_said_by_its_code():
    assert interruption("of_a_later_version")["de"] == "of_a_later_version"


def test_the_verdict_of_an_event_has_its_numbers_as_the_language_writes_them():
    judgement = bench.filled(
        Judgement, cause="velocity_limit", category="S1", drive="right/hip", value=3.14, limit=3.0
    )
    said = catalogue(Reader.OPERATOR, "de").verdict(judgement)
    assert said.startswith("rechts, Hüfte: Das Bein war zu schnell (3,14, Grenze 3)")


# --- languages ----------------------------------------------------------------------------------


@pytest.mark.parametrize("reader", Reader)
def test_a_german_text_has_no_english_word_but_a_few_names(reader):
    english, german = (words_of(catalogue(reader, language)) for language in LANGUAGES)
    assert english & german - FOREIGN - GERMAN == set()
    assert len(english & german) > 10


NAMES = {
    **{name: list(kind) for name, kind in ENUMS.items() if name != "refusal"},
    "setpoint_refusal": SetpointRefusal,
    "outcome": Outcome,
    "cause": STOPS,
    # others have numbers or a state of the verdict that they are of
    "finding": [
        one
        for one in ENUMS["finding"]
        if "{" not in catalogue(Reader.OPERATOR, "de").texts[f"finding.{one}"]
    ],
}
"""Values of codes that are names of members; the names of refusals are codes, too."""


def test_each_event_and_refusal_is_german_also_where_a_value_is_a_name():
    said = []
    for name, members in NAMES.items():
        for member in members:
            values = {"cause": "spasm", name: member}
            said += [shown(code, values=values).said["de"] for code in EventCode]
            refusals = [
                Refusal(code=code, subject=None, values=values, said="") for code in RefusalCode
            ]
            said += [refused(one).said["de"] for one in refusals]
    assert english_in(said) == set()
