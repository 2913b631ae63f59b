"""`self-test`, `reference` and `commission` against a service that keeps count of its requests."""

import json

import msgspec
import pytest
import typer
from gaitd_client import NoAnswerError, Target, wire
from typer.testing import CliRunner

from daemon.gateway import translate
from daemon.gateway.translate import Stamp
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import Cause, CycleRecord, Mode, RequestResult, StopCategory, Verdict
from daemon.ipc.report import EventCode, Finding, Refusal, RefusalCode, Untested
from daemon.wire.cause_texts import CAUSE_TEXT
from gaitd import preparation, remote
from gaitd.__main__ import build
from gaitd.remote import EXIT_NO_ANSWER, EXIT_REFUSED

STOP = Verdict(
    StopCategory.S1, Cause.DRIVE_FAULT, "right/hip", 0x2310, 0.0, Finding.EMCY, "overcurrent"
)


class Service:
    """In one mode after the other, the next one behind each refused request."""

    def __init__(self, *modes, refusal=None):
        self.modes, self.refusal = list(modes), refusal
        self.asked = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def request(self, name, **_):
        self.asked.append(name)
        del self.modes[: len(self.modes) > 1]
        return wire.Reply(
            **self.head(),
            **{"request": name, "outcome": "refused", "reason": "not yet", "mode": None},
            refusal=self.refusal,
        )

    def status(self):
        mode = self.modes[0]
        verdict = STOP if mode == Mode.FAULT else Verdict()
        safety = translate.safety(record(mode, verdict), None, Stamp(), 1)
        return wire.Status(**self.head(), version="1", safety=safety, drives=(), legs=(), events=())

    def head(self):
        return translate.head(Stamp(), 1)


def record(mode, verdict):
    return CycleRecord(
        seq=1,
        cycle=1,
        sync_mono_ns=0,
        sync_utc_ns=0,
        dt_s=0.01,
        mode=mode,
        verdict=verdict,
        events=(),
        request=RequestResult(),
        progress="",
        gateway_age_cycles=1,
        stop_count=0,
        gait_phase=-1.0,
        drives=(),
        legs=(),
        timing=CycleTiming(0, 0, 0, 0),
        bus_load_ratio=0.0,
    )


@pytest.fixture
def run(monkeypatch):
    """The command, before a service in these modes."""

    def against(*modes, refusal=None):
        service = Service(*modes, refusal=refusal)
        monkeypatch.setattr(preparation, "client_of", lambda *_: service)
        monkeypatch.setattr(preparation.time, "sleep", lambda _: None)
        return CliRunner().invoke(build("self-test"), ["self-test"]), service

    return against


@pytest.mark.parametrize("modes", [(Mode.FAULT,), (Mode.READY, Mode.FAULT)])
def test_a_latched_stop_is_shown_with_its_remedy_and_not_reset(run, modes):
    result, service = run(*modes)

    text = CAUSE_TEXT[Cause.DRIVE_FAULT]
    assert result.exit_code == EXIT_REFUSED
    assert f"right/hip: {text.title} (2310h overcurrent): {text.remedy}" in result.stdout
    assert service.asked == ["enable"] * (len(modes) - 1)
    assert preparation.AGAIN not in result.stdout


def test_the_fault_of_an_emergency_stop_that_was_asked_for_says_how_to_go_on(run):
    untested = Refusal(RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.STO_ACTIVE,))
    unseen = translate.refusal_message(untested)

    result, service = run(Mode.READY, Mode.FAULT, refusal=unseen)

    assert (result.exit_code, service.asked) == (EXIT_REFUSED, ["enable"])
    assert preparation.AGAIN in result.stdout


@pytest.mark.parametrize("modes", [(Mode.GAIT, Mode.READY), (Mode.READY, Mode.OFF, Mode.READY)])
def test_nothing_is_enabled_after_the_service_has_left_ready(run, modes):
    result, service = run(*modes)

    assert result.exit_code == EXIT_REFUSED
    assert service.asked == ["enable"] * (len(modes) - 2)


@pytest.mark.parametrize("as_json", [False, True])
def test_a_service_that_is_lost_while_an_axis_moves_is_reported_with_the_reason(
    monkeypatch, capsys, as_json
):
    class Lost(Service):
        def request(self, name, **arguments):
            super().request(name, **arguments)
            self.modes = []
            return wire.Reply(**self.head(), request=name, outcome="done", reason="", mode=None)

        def status(self):
            if not self.modes:
                raise NoAnswerError("no answer to status: the link is down")
            return super().status()

    service = Lost(Mode.READY)
    monkeypatch.setattr(preparation, "client_of", lambda *_: service)
    monkeypatch.setattr(preparation.time, "sleep", lambda _: None)
    with pytest.raises(typer.Exit) as ended:
        preparation.run_axis(Target(), "reference", "right/hip", EventCode.HOMED, as_json=as_json)

    reason = "no answer to status: the link is down; right/hip may be moving: look at it before"
    output = capsys.readouterr()
    said = json.loads(output.out.splitlines()[-1])["reason"] if as_json else output.err
    assert reason in said
    assert (ended.value.exit_code, service.asked) == (EXIT_NO_ANSWER, ["mode"])


@pytest.mark.parametrize(
    ("words", "code", "key"),
    [
        (("reference",), "homed", "homed"),
        (("commission", "--witnessed"), "sign_tested", "moves_with_its_torque"),
        (("commission",), "sign_tested", "moves_with_its_torque"),
    ],
)
def test_one_axis_has_one_json_document(monkeypatch, words, code, key):
    class Moving(Service):
        def request(self, name, **arguments):
            super().request(name)
            return wire.Reply(**self.head(), request=name, outcome="done", reason="", mode=None)

        def status(self):
            event = wire.Event(
                **self.head(),
                **{"id": "1", "time_ns": 1, "priority": "info", "kind": "drive"},
                **{"text": "as it went", "remedy": "", "cause": None, "subject": "right/hip"},
                code=code,
            )
            events = (event,) if self.asked else ()
            return msgspec.structs.replace(super().status(), events=events)

    service = Moving(Mode.READY)
    for module in (preparation, remote):
        monkeypatch.setattr(module, "client_of", lambda *_: service)
    monkeypatch.setattr(preparation.time, "sleep", lambda _: None)
    ran = CliRunner().invoke(build(words[0]), [words[0], "right/hip", *words[1:], "--json"])

    told = json.loads(ran.stdout)
    assert (told["axis"], told[key]) == ("right/hip", True)
    unseen = words == ("commission",)
    assert ran.exit_code == (EXIT_REFUSED if unseen else 0)
    assert len(service.asked) == (2 if "--witnessed" in words else 1)
