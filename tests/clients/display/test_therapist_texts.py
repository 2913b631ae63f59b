"""Words of the therapist's page: stops, events and refusals, without a raw code."""

import itertools
import re
import string

import display_bench as bench
import msgspec
import pytest
import records
from gaitd_client import Cause, Event, Kind, Mode, Priority, Stage, Validity
from gaitd_client.wire.fields import NMT_STATES, POWER_STATES
from gaitd_display.cause_texts import patient_text
from gaitd_display.controls import Command, Does, WhyNot
from gaitd_display.event_texts import event_text, refusal_text
from gaitd_display.progress import interruption_text
from gaitd_display.stop_texts import STOP_TEXTS, UNKNOWN, Again, stop_key, stop_labels
from gaitd_display.texts import LABELS, page_texts
from gaitd_display.therapist_texts import THERAPIST_LABELS
from gaitd_display.therapist_view import event_item
from gaitd_session import WHY, BlockKind, Why

from daemon.core.exercises.guards import GuardInputs
from daemon.core.modes import table
from daemon.gateway import events
from daemon.gateway import requests as requests_
from daemon.ipc import record
from daemon.ipc.report import Doubt, Untested
from daemon.wire import cause_texts, report_texts
from daemon.wire.cause_texts import CAUSE_TEXT

CODE = re.compile(r"[a-z]+_[a-z_]+|`")
"""A raw code, or a command of a terminal."""


def spoken(text, kind=Kind.NOTE, **given):
    event = {"kind": kind, "priority": "info", "text": text, "remedy": "", **given}
    return event_text(bench.filled(Event, id="1", **event))


# --- stops --------------------------------------------------------------------------------------


def test_each_cause_says_what_happened_what_to_do_and_whom_to_call_without_a_code():
    labels = stop_labels()
    for cause in [*STOP_TEXTS, UNKNOWN]:
        keys = [f"{part}.{cause}" for part in ("stopped", "then", "again")]
        for key in (*keys, f"first.{patient_text(cause).situation}"):
            text = labels[key]
            assert text.en
            assert text.de
            assert text.en != text.de
            assert not CODE.search(text.en + text.de), cause
    assert set(STOP_TEXTS) == set(Cause) - {Cause.NONE}
    assert (stop_key("spasm"), stop_key("of_a_later_version")) == ("spasm", UNKNOWN)


def test_whom_to_call_if_a_stop_comes_back_is_as_the_service_says():
    same = {
        cause_texts.CALL_SERVICE: Again.SUPPORT,
        cause_texts.CALL_TECHNICIAN: Again.TECHNICIAN,
        cause_texts.CALL_OPERATOR: Again.OPERATOR,
    }
    for cause, text in STOP_TEXTS.items():
        told = CAUSE_TEXT[record.Cause[cause.name]].again
        assert text.again == same.get(told, text.again), cause
        assert (text.again in same.values()) == (told in same), cause
    assert "physician" in STOP_TEXTS[Cause.SPASM].again.value.en


# --- words --------------------------------------------------------------------------------------


def test_every_name_that_the_page_may_be_given_has_its_words():
    words = page_texts()["de"]
    groups = {
        "mode": Mode,
        "stage": Stage,
        "power": POWER_STATES,
        "nmt": NMT_STATES.values(),
        "do": Command,
        "does": Does,
        "why_not": WhyNot,
        "valid": Validity,
        "block": BlockKind,
        "stopped": STOP_TEXTS,
        "kind": ("stop", "medium", "low", "info"),
        "bus": ("active", "warning", "error passive", "bus-off"),
    }
    missing = [f"{group}.{name}" for group, names in groups.items() for name in names]
    assert [key for key in missing if key not in words] == []


def test_no_text_of_the_therapist_s_page_is_of_another_page_too_and_both_languages_have_the_same():
    assert THERAPIST_LABELS.keys() & (LABELS.keys() | stop_labels().keys()) == set()
    for key, text in THERAPIST_LABELS.items():
        names = [{name for _, name, _, _ in string.Formatter().parse(one) if name} for one in text]
        assert names[0] == names[1], key
        assert not CODE.search("".join(text).replace("{", "").replace("}", "")), key


# --- events -------------------------------------------------------------------------------------


def test_events_of_the_service_are_said_in_plain_words():
    said = {
        "mode hold → gait": ("Now: Walking", "Jetzt: Gehen"),
        "mode gait -> hand_guiding: mode hand_guiding": (
            "Now: Moved by hand",
            "Jetzt: Von Hand geführt",
        ),
        "right/hip: hand switch open": (
            "right, hip: hand switch was let go",
            "rechts, Hüfte: Handschalter losgelassen",
        ),
        "left/slide: NMT state pre_operational": (
            "left, slide: waits on the bus",
            "links, Schlitten: wartet am Bus",
        ),
        "right/hip: quick stop active": (
            "right, hip: holds after a stop",
            "rechts, Hüfte: hält nach einem Halt",
        ),
        "right: self_test playing": ("right: Self-test, runs", "rechts: Selbsttest, läuft"),
        "mode, asked by session.home: done": (
            "Change of the state: done (session.home)",
            "Wechsel des Zustands: erledigt (session.home)",
        ),
        "enable refused: the hand switch is open": (
            "Switch on: refused. The hand switch is not held.",
            "Einschalten: abgelehnt. Der Handschalter wird nicht gehalten.",
        ),
    }
    for text, both in said.items():
        subject = re.match(r"(right|left)(/(hip|slide))?(?=:)", text)
        assert spoken(text, subject=subject and subject[0]) == both, text


def test_a_stop_is_said_by_its_cause_with_its_remedy_and_icon():
    given = {"kind": Kind.STOP, "priority": Priority.MEDIUM, "cause": "hand_switch_open"}
    event = bench.filled(
        Event, id="1", text="stop S1: the hand switch is open", subject="right/hip", **given
    )
    item = event_item(event)
    assert item.said["en"] == "right, hip: The hand switch was let go"
    assert item.said_remedy["de"].startswith("Handschalter halten")
    assert item.icon == "stop"
    # Of a later version: its own words, in English.
    later = event_item(
        bench.filled(
            Event,
            id="2",
            text="stop S1: x",
            cause="new",
            **{name: given[name] for name in ("kind", "priority")},
        )
    )
    assert (later.said, later.text, later.icon) == (None, "stop S1: x", "stop")


def test_an_event_that_is_not_known_keeps_its_own_words():
    for text in ("right/hip: friction 12 % above its law", "black box: kept a.gbb", "mode x -> y"):
        assert spoken(text) is None, text


def record_of(mode=record.Mode.HOLD, **changes):
    """A record of one drive that differs in this."""
    return msgspec.structs.replace(
        records.record(1),
        mode=mode,
        drives=(msgspec.structs.replace(records.drive("right/hip"), **changes),),
    )


def test_each_change_of_a_drive_and_of_the_mode_that_the_gateway_tells_is_known():
    before = record_of()
    now = [
        *(record_of(mode) for mode in record.Mode),
        *(record_of(power_state=number) for number in range(len(POWER_STATES))),
        *(record_of(nmt_state=number) for number in NMT_STATES),
        record_of(hand_switch_closed=False),
        record_of(sto_released=False),
        record_of(referenced=False),
    ]
    drafts = [draft for one in now for draft in events.new_events(before, one)]
    drafts += [draft for one in now for draft in events.new_events(one, before)]
    drafts += events.new_events(None, before)
    drafts += [events.CORE_BACK, events.core_lost(200), events.request_sent("stop", "a page")]
    assert len(drafts) > 40
    for draft in drafts:
        text = spoken(draft.text, draft.kind, subject=draft.subject)
        assert text is not None, draft.text
        assert not CODE.search(text.en + text.de), draft.text


GOOD = {
    "mode": record.Mode.READY,
    **dict.fromkeys(("gateway_alive", "at_rest", "hand_switch_closed", "sto_released"), True),
    **dict.fromkeys(("hand_switch_known", "drives_powered", "patient_configured"), True),
    **dict.fromkeys(("unreferenced", "outside"), ()),
    "cadence_max_hz": 0.5,
    "scenarios": {},
    "artificial": frozenset(),
    "guidance": "impedance",
}
BAD = (
    {"gateway_alive": False},
    {"hand_switch_closed": False},
    {"sto_released": False},
    {"unproven": ("right/hip",)},
    {"unreferenced": (("right/hip", Doubt.REBOOTED),)},
    {"inputs_untested": (("right/hip", Untested.HAND_SWITCH_OPEN),)},
    {"unsampled": ("right/hip",)},
    {"at_rest": False},
    {"outside": ("right/hip",)},
)


def test_each_refusal_of_the_service_s_table_is_known():
    requests = [
        (record.RequestKind.ENABLE, record.ModeRequest()),
        (record.RequestKind.RESET, record.ModeRequest()),
        (record.RequestKind.MODE, record.ModeRequest(mode=record.Mode.HAND_GUIDING)),
        (record.RequestKind.MODE, record.ModeRequest(mode=record.Mode.SELF_TEST)),
    ]
    states = [{"mode": mode} for mode in record.Mode]
    states += [{"mode": record.Mode.FAULT} | bad for bad in BAD] + list(BAD)
    states += [{"mode": record.Mode.HOLD, "drives_powered": False}]
    refused = {
        table.refusal(kind, wanted, GuardInputs(**GOOD | state))
        for (kind, wanted), state in itertools.product(requests, states)
    } - {None}
    assert len(refused) > 30
    reasons = map(report_texts.refusal_text, refused)
    for reason in (*reasons, requests_.SILENT, requests_.RESTARTED, "busy: mode has no answer yet"):
        text = refusal_text(reason)
        assert text is not None, reason
        assert not CODE.search(text.en + text.de), reason
    assert refusal_text("no self-test has been passed today: `gaitd self-test`") is not None
    assert refusal_text("a reason of a later version") is None


# --- interruptions ------------------------------------------------------------------------------


@pytest.mark.parametrize("why", Why)
def test_an_interruption_that_the_session_has_named_is_said_in_both_languages(why):
    assert interruption_text(WHY[why].en) == WHY[why]


def test_other_interruptions_are_said_by_their_phase_or_refusal_or_not_at_all():
    assert interruption_text("stopped").de == "Das Gerät hat angehalten."
    assert interruption_text("safe torque off is active").en.startswith("The emergency stop")
    assert interruption_text("a joint was too fast: first: lie still") is None
    assert interruption_text("") is None
