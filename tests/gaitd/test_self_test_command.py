"""`self-test`, `reference` and `commission` against a service that keeps count of its requests."""

import json
from itertools import count
from types import SimpleNamespace

import msgspec
import pytest
from gaitd_client import NoAnswerError, wire
from gaitd_names import (
    Cause,
    EventCode,
    ExitCode,
    Finding,
    Mode,
    RefusalCode,
    StopCategory,
    Untested,
)
from gaitd_texts import Reader, catalogue
from typer.testing import CliRunner

from daemon.gateway import translate
from daemon.gateway.translate import Stamp
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import CycleRecord, RequestResult, Verdict
from daemon.ipc.report import Refusal
from daemon.report_messages import judgement, refusal_message
from gaitd import preparation
from gaitd.__main__ import build
from gaitd.commissioning import remote_service

STOP = Verdict(
    StopCategory.S1, Cause.DRIVE_FAULT, "right/hip", 0x2310, 0.0, Finding.EMCY, "overcurrent"
)


TEXTS = catalogue(Reader.OPERATOR, "en")
AGAIN = "`gaitd self-test` again"
NO_PLAN = wire.Refusal(code="no_plan", subject=None, values={}, said="")


class Service:
    """In one mode after the other, the next one behind each refused request, with its event."""

    def __init__(self, *modes, refusal=NO_PLAN, event=None):
        self.modes, self.refusal, self.event = list(modes), refusal, event
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
            **{"request": name, "outcome": "refused", "mode": None},
            refusal=self.refusal,
        )

    def status(self):
        mode = self.modes[0]
        verdict = STOP if mode == Mode.FAULT else Verdict()
        safety = translate.safety(record(mode, verdict), None, Stamp(), 1)
        new = () if self.event is None or not self.asked else (self.event,)
        known = {"drives": (), "legs": (), "events": new}
        return wire.Status(**self.head(), version="1", safety=safety, **known)

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
        progress=None,
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
    """A command, before a service; each look takes a second."""

    def against(service, *words):
        seconds = count()
        monkeypatch.setattr(preparation, "client_of", lambda *_: service)
        monkeypatch.setattr(remote_service.time, "sleep", lambda _: None)
        monkeypatch.setattr(remote_service.time, "monotonic", lambda: float(next(seconds)))
        return CliRunner().invoke(build(words[0]), list(words))

    return against


@pytest.mark.parametrize("modes", [(Mode.FAULT,), (Mode.READY, Mode.FAULT)])
def test_a_latched_stop_is_shown_with_its_remedy_and_not_reset(run, modes):
    service = Service(*modes)

    result = run(service, "self-test")

    assert result.exit_code == ExitCode.FAILED
    assert f"{TEXTS.verdict(judgement(STOP))}: {TEXTS.remedy('drive_fault')}" in result.stdout
    assert service.asked == ["enable"] * (len(modes) - 1)
    assert AGAIN not in result.stdout


@pytest.mark.parametrize("code", [EventCode.STO_ACTIVATED, EventCode.STO_RELEASED])
def test_the_fault_of_an_emergency_stop_that_was_asked_for_says_how_to_go_on(run, code):
    untested = Refusal(RefusalCode.INPUT_UNTESTED, "right/hip", (Untested.STO_ACTIVE,))
    event = SimpleNamespace(id="1", code=code, subject="right/hip", values={}, said="")
    refusal = refusal_message(untested)
    service = Service(Mode.READY, Mode.FAULT, refusal=refusal, event=event)

    result = run(service, "self-test")

    assert (result.exit_code, service.asked) == (ExitCode.FAILED, ["enable"])
    assert (AGAIN in result.stdout) is (code is EventCode.STO_ACTIVATED)


@pytest.mark.parametrize("modes", [(Mode.GAIT, Mode.READY), (Mode.READY, Mode.OFF, Mode.READY)])
def test_nothing_is_enabled_after_the_service_has_left_ready(run, modes):
    service = Service(*modes)

    result = run(service, "self-test")

    assert result.exit_code == ExitCode.FAILED
    assert service.asked == ["enable"] * (len(modes) - 2)


class Accepting(Service):
    """Does what it is asked."""

    def request(self, name, **arguments):
        super().request(name)
        self.axis = arguments["axis"]
        return wire.Reply(**self.head(), request=name, outcome="done", mode=None)


@pytest.mark.parametrize("as_json", [False, True])
def test_a_service_that_is_lost_while_an_axis_moves_is_reported_with_the_reason(run, as_json):
    class Lost(Accepting):
        def status(self):
            if self.asked:
                raise NoAnswerError("no answer to status: the link is down")
            return super().status()

    service = Lost(Mode.READY)

    ran = run(service, "reference", "right/hip", *["--json"] * as_json)

    reason = "no answer to status: the link is down; right/hip may be moving: look at it before"
    assert reason in (json.loads(ran.stdout)["reason"] if as_json else ran.stderr)
    assert (ran.exit_code, service.asked) == (ExitCode.UNAVAILABLE, ["mode"])


class Moving(Accepting):
    """An axis that has moved as soon as it is asked to; `code` is the event of its end."""

    def __init__(self, code):
        super().__init__(Mode.READY)
        self.code = code

    def configuration(self):
        return SimpleNamespace(drive_names=("right/hip", "right/slide"))

    def status(self):
        event = wire.Event(
            **self.head(),
            **{"id": "1", "time_ns": 1, "priority": "info", "kind": "drive"},
            **{"said": "", "cause": None, "subject": "right/hip"},
            code=self.code,
            values={"failure": "does_not_move"},
        )
        events = (event,) if self.asked else ()
        return msgspec.structs.replace(super().status(), events=events)


@pytest.mark.parametrize(
    ("words", "code", "key"),
    [
        (("reference",), "homed", "homed"),
        (("commission", "--witnessed"), "sign_tested", "moves_with_its_torque"),
        (("commission",), "sign_tested", "moves_with_its_torque"),
    ],
)
@pytest.mark.parametrize("axis", ["right/hip", "hip"])
def test_one_axis_has_one_json_document_and_may_be_named_without_its_leg(
    run, words, code, key, axis
):
    service = Moving(code)

    ran = run(service, words[0], axis, *words[1:], "--json")

    told = json.loads(ran.stdout)
    assert (told["axis"], service.axis, told[key]) == ("right/hip", "right/hip", True)
    assert told["findings"][0]["report"]["values"] == {"failure": "does_not_move"}
    unseen = words == ("commission",)
    assert ran.exit_code == (ExitCode.FAILED if unseen else 0)
    assert len(service.asked) == (2 if "--witnessed" in words else 1)


@pytest.mark.parametrize(("command", "key"), [("reference", "homed"), ("commission", "witnessed")])
def test_an_axis_that_did_not_do_as_it_should_is_reported_with_its_event(run, command, key):
    service = Moving("single_axis_failed")

    ran = run(service, command, "right/hip", "--json")
    shown = run(Moving("single_axis_failed"), command, "right/hip")

    assert (ran.exit_code, json.loads(ran.stdout)[key]) == (ExitCode.FAILED, False)
    assert TEXTS.text("failure.does_not_move") in shown.stdout
    assert service.asked == ["mode"]


def test_nothing_is_announced_before_a_request_is_accepted(run):
    ran = run(Service(Mode.READY), "commission", "right/hip")

    assert ran.exit_code == ExitCode.FAILED
    assert ran.output.startswith("Change of the state: refused: no plan is released")
