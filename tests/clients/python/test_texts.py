"""Every code has a text and, where a person must act, what to do, in each language."""

import re
import string
from collections import Counter

import gaitd_names as names
import pytest
from gaitd_client import SetpointRefusal, wire
from gaitd_texts import (
    CAUTIOUS,
    LANGUAGES,
    STOPS,
    Catalogue,
    Reader,
    catalogue,
    language_of,
    stop_of,
    texts_of,
)
from gaitd_texts.catalogue import read
from report_values import ENUMS

from analysis.acceptance.record import FindingCode, Judgement, ReasonCode, Section
from daemon.wire.report_fields import EVENT_FIELDS, PROGRESS_FIELDS, REFUSAL_FIELDS
from gaitd.__main__ import COMMANDS
from gaitd.commissioning.messages import InstructionCode
from gaitd.commissioning.objects import NOTED
from gaitd.commissioning.stops import STOPS as WAYS_TO_STOP

OPERATOR, PATIENT = Reader.OPERATOR, Reader.PATIENT
EVERY = [(reader, language) for reader in Reader for language in LANGUAGES]
OF_ANOTHER_GROUP = {
    *("mode_before", "mode_now", "open_request"),  # as `mode` and `request`
    *("category", "refusal", "cause", "untested", "stage", "mode"),
}
GROUPS = {
    "event": names.EventCode,
    "refusal": names.RefusalCode,
    "progress": names.ProgressCode,
    "setpoint_refusal": SetpointRefusal,
    "mode": names.Mode,
    "stage": names.Stage,
    "validity": names.Validity,
    "priority": names.Priority,
    "outcome": names.Outcome,
    "untested": names.Untested,
    **{group: list(kind) for group, kind in ENUMS.items() if group not in OF_ANOTHER_GROUP},
    "lapse": list(names.Lapse),
}
"""Groups of the operator's catalogue by the enum that names their members."""
COMMISSIONING = {
    "instruction": InstructionCode,
    "reason": ReasonCode,
    "section": Section,
    "judgement": Judgement,
    "asked": FindingCode,
    "measured": FindingCode,
    "allowed": FindingCode,
    "motion": wire.JOINTS,
    "when_fast": [way.cause for way in WAYS_TO_STOP],
    "noted": [name for *_, name in NOTED],
}
ADDED = {
    *("subject", "axis", "said", "unit", "unit_position"),  # of each report
    *("verdict", "refusal", "mode", "client"),
}


def fields_of(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


def event(code: str, **changes: object) -> wire.Event:
    made = {
        **{"seq": 1, "core_boot_id": "b", "cycle": 1, "sample_time_ns": 1, "id": "b-1-1"},
        **{"time_ns": 1, "priority": "info", "kind": "note", "cause": None, "subject": None},
        **{"values": {}, "said": ""},
    }
    return wire.Event(**{**made, "code": code, **changes})  # type: ignore[arg-type]


def test_the_languages_have_the_same_keys_with_the_same_fields():
    for reader in Reader:
        first, *others = (catalogue(reader, language).texts for language in LANGUAGES)
        assert first
        for other in others:
            assert {key: fields_of(text) for key, text in first.items()} == {
                key: fields_of(text) for key, text in other.items()
            }


def test_a_page_that_gets_both_catalogues_finds_each_key_once():
    count = sum(len(catalogue(reader, "en").texts) for reader in Reader)

    assert len(texts_of("en", tuple(Reader))) == count


@pytest.mark.parametrize("group", GROUPS)
def test_every_member_has_a_text(group):
    texts = catalogue(OPERATOR, "en").texts

    assert [member for member in GROUPS[group] if f"{group}.{member}" not in texts] == []


@pytest.mark.parametrize("group", COMMISSIONING)
def test_every_code_of_commissioning_has_a_text_and_no_other_has(group):
    texts = catalogue(OPERATOR, "en").texts

    members = {key.partition(".")[2] for key in texts if key.startswith(f"{group}.")}
    assert members == {str(member) for member in COMMISSIONING[group]}


def test_every_cause_has_its_sentences_and_none_is_left_over():
    causes = {*names.Cause} - {names.Cause.NONE}
    operator, patient = (catalogue(reader, "en").texts for reader in (OPERATOR, PATIENT))

    assert set(STOPS) == causes
    for group, texts in (("stopped", operator), ("stop", patient), ("happened", patient)):
        members = {key.partition(".")[2] for key in texts if key.startswith(f"{group}.")}
        assert members == causes | {"unknown"}


@pytest.mark.parametrize(
    ("group", "fields"),
    [("event", EVENT_FIELDS), ("refusal", REFUSAL_FIELDS), ("progress", PROGRESS_FIELDS)],
)
def test_a_text_of_the_core_takes_no_field_that_its_code_does_not_have(group, fields):
    texts = catalogue(OPERATOR, "en").texts

    for code, known in fields.items():
        assert fields_of(texts[f"{group}.{code}"]) <= {*known, *ADDED}


def test_the_values_of_a_refusal_replace_none_of_its_request():
    with_both = {code for code, names in REFUSAL_FIELDS.items() if {"request", "mode"} & {*names}}

    assert with_both == {  # theirs are those of the request
        names.RefusalCode.NO_SUCH_MODE,
        names.RefusalCode.ROLE_MAY_NOT,
        names.RefusalCode.ROLE_MAY_NOT_MODE,
    }


@pytest.mark.parametrize(("reader", "language"), EVERY)
def test_no_sentence_is_told_twice_in_a_group(reader, language):
    sentences = Counter(
        (key.partition(".")[0], text)
        for key, text in catalogue(reader, language).texts.items()
        if len(text) > 40 and not key.startswith(("next.", "happened."))
    )

    assert [text for text, count in sentences.items() if count > 1] == []


def test_every_command_that_a_text_names_exists():
    texts = catalogue(OPERATOR, "en")
    remedies = [texts.remedy(cause) for cause in STOPS]

    named = re.findall(r"`gaitd ([a-z-]+)", " ".join((*texts.texts.values(), *remedies)))
    assert set(named) <= set(COMMANDS)


@pytest.mark.parametrize("cause", STOPS)
def test_a_remedy_says_what_to_do_first_for_the_person_then_and_if_it_comes_back(cause):
    texts = catalogue(OPERATOR, "en")
    remedy, stop = texts.remedy(cause), stop_of(cause)

    first = texts.text(f"first.{stop.situation}")
    assert remedy.startswith(first)
    assert not first.startswith("`")
    assert texts.text(f"again.{stop.again}") in remedy
    if "`gaitd reset`" in remedy:  # whoever is told to reset was told to support the leg
        assert "upport" in first or "Help the person out" in remedy


def test_an_event_names_its_subject_and_its_values_in_words():
    changed = event(
        "mode_changed", values={"mode_before": "hold", "mode": "gait", "trigger": "to_gait"}
    )
    passed = event(
        "self_test_passed",
        subject="right/hip",
        values={"friction_si": 5.25, "friction_ratio": 1.05, "load_error_si": 0.5},
    )

    assert catalogue(OPERATOR, "en").event(changed) == "Leg is held → Walking (walking)"
    assert catalogue(OPERATOR, "de").event(passed) == (
        "rechts, Hüfte: Selbsttest bestanden: Reibung 5,25 N·m (1,05 der eingerichteten), "
        "Last weicht um 0,5 N·m ab"
    )


def test_a_refusal_in_an_event_is_its_sentence_and_a_verdict_has_value_and_limit():
    refused = event(
        "request_refused",
        values={"request": "enable", "mode": "hold", "refusal": "not_referenced", "doubt": None},
        subject="right/hip",
    )
    stopped = event(
        "stopped",
        subject="left/slide",
        values={
            **{"category": "S1", "cause": "velocity_limit", "value": 3.51, "limit": 3.5},
            "finding": "none",
        },
    )
    texts = catalogue(OPERATOR, "en")

    assert texts.event(refused).startswith("Switch on – refused: the position is not known")
    assert "right, hip" in texts.event(refused)
    assert texts.event(stopped) == "stop S1: left, slide: The leg was too fast (3.51, limit 3.5)"


@pytest.mark.parametrize(
    ("code", "values", "sentence"),
    [
        (
            "setpoint_refused",
            {"holder": "pusher", "setpoint_refusal": "repeated"},
            "setpoint refused: its `seq` has been accepted before. Holder of the lease: pusher",
        ),
        (
            "setpoint_refused",
            {"holder": None, "setpoint_refusal": "repeated"},
            "setpoint refused: its `seq` has been accepted before. Holder of the lease: –",
        ),
        (
            "assist_lapsed",
            {"client": None, "lapse": "lease_ended"},
            "assist has lapsed: its lease has ended. It fades, the leg is braked and held.",
        ),
    ],
)
def test_who_holds_the_lease_is_not_who_has_sent_the_setpoint(code, values, sentence):
    assert catalogue(OPERATOR, "en").event(event(code, values=values)) == sentence


@pytest.mark.parametrize(("reader", "language"), EVERY)
def test_an_unknown_code_and_a_catalogue_that_cannot_be_read_are_never_silent(
    reader, language, tmp_path, caplog
):
    unreadable = tmp_path / "operator.en.toml"
    unreadable.write_text("[event\n")
    broken = Catalogue(reader, language, read(unreadable))

    assert str(unreadable) in caplog.text
    for texts in (catalogue(reader, language), broken):
        new = texts.event(event("of_a_later_version", values={"found_nm": 3.5}))
        if reader is PATIENT:
            assert new == CAUTIOUS[language]
        else:
            assert new == "of_a_later_version found_nm=3.5"
    assert broken.text("label.stop") == (CAUTIOUS[language] if reader is PATIENT else "stop")


def test_values_of_another_version_leave_a_sentence():
    texts = catalogue(OPERATOR, "en")

    assert texts.event(event("cycles_missed")) == (
        "– cycles in a row had no time and were left out: late by the"
    )
    assert texts.event(event("cycles_missed", values={"missed_count": "many", "part": 3.0}))
    for code, values in (
        ("found_with_error", {"emcy_code": "3210"}),
        *(("still_latched", {"latched_utc_s": utc_s}) for utc_s in (1e13, 1e17, 1e300, "now")),
    ):
        assert texts.event(event(code, values=values)).startswith(f"{code} ")


@pytest.mark.parametrize(
    ("environment", "language"),
    [
        ({}, "en"),
        ({"LANG": "de_DE.UTF-8"}, "de"),
        ({"LANG": "C.UTF-8", "LANGUAGE": "de"}, "en"),
        ({"LANG": "en_GB.UTF-8", "LANGUAGE": "fr:de:en"}, "de"),
        ({"LC_ALL": "en_US.UTF-8", "LANG": "de_DE.UTF-8"}, "en"),
        ({"LC_ALL": "", "LC_MESSAGES": "de_AT", "LANG": "en_US"}, "de"),
        ({"LANG": "fr_FR.UTF-8"}, "en"),
    ],
)
def test_the_language_is_that_of_the_terminal(environment, language):
    assert language_of(environment) == language
