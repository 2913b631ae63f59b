"""`gaitd wait` and `gaitd watch` on a gateway: what ends them, and what they print."""

import json
import threading

import msgspec
import pytest
from command_line import gaitd
from gaitd_client import Cause, Estimate, NotValid, Safety, Trainer, Trouble
from gaitd_names import ExitCode, Mode, StopCategory
from keyed_gateway import running, status_of

from daemon.ipc.record import Verdict
from daemon.keys import issuing

DISPLAY = "display.desk"
STOP = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, drive="right/hip")


@pytest.fixture(scope="module")
def service(fake_core):
    with running(fake_core, {DISPLAY: False}) as made:
        yield made


@pytest.fixture
def call(service, eventually):
    """The command line with credentials; the core is in mode torque."""
    service.core.changes = {"mode": Mode.TORQUE}
    target = service.target(DISPLAY)
    eventually(lambda: status_of(target).get("safety", {}).get("mode") == Mode.TORQUE)
    folder = service.folder / issuing.ISSUED / DISPLAY
    return lambda *words: gaitd(*words, "--credentials", folder)


def test_a_wait_ends_in_the_mode_at_once_or_when_it_comes(service, call):
    there = call("wait", "torque")
    assert (there.code, there.out.split()[0]) == (ExitCode.DONE, "mode")
    assert "Another program drives" in there.out

    threading.Timer(0.2, service.core.changes.update, [{"mode": Mode.HOLD}]).start()
    came = call("wait", "HOLD", "--timeout", "60", "--json")
    assert (came.code, json.loads(came.out)["mode"]) == (ExitCode.DONE, "hold")


def test_a_state_before_a_silence_is_not_told_as_the_present_one(monkeypatch, call):
    silent = NotValid("safety", Trouble.SILENT, "no message")
    monkeypatch.setattr(Trainer, "safety", lambda *_, **__: iter([silent]))

    ended = call("wait", "hold")

    assert ended.code == ExitCode.UNAVAILABLE
    assert "nothing is known" in ended.err
    assert "Another program drives" not in ended.err


def test_a_wait_ends_by_a_stop_with_what_to_do_and_by_its_time(service, call):
    late = call("wait", "hold", "--timeout", "0.1")
    assert (late.code, late.out) == (ExitCode.TIME_OVER, "")
    assert "Another program drives" in late.err

    change = {"mode": Mode.FAULT, "verdict": STOP}
    threading.Timer(0.2, service.core.changes.update, [change]).start()
    stopped = call("wait", "hold")
    assert (stopped.code, stopped.out) == (ExitCode.FAILED, "")
    assert "stop S1" in stopped.err
    assert "`gaitd reset`" in stopped.err
    told = json.loads(call("wait", "hold", "--json").out)
    assert (told["mode"], told["cause"], told["exit_code"]) == ("fault", "hand_switch_open", 1)
    assert call("wait", "fault").code == ExitCode.DONE


@pytest.mark.parametrize(("key", "kind"), [("right/estimate", Estimate), ("safety", Safety)])
def test_a_key_is_watched(call, key, kind):
    ended = call("watch", key, "--count", 2)

    assert ended.code == ExitCode.DONE, ended.err
    first, second = (msgspec.json.decode(line, type=kind) for line in ended.out.splitlines())
    assert second.seq > first.seq


def test_fields_are_printed_for_a_shell_and_the_end_of_a_unique_key_is_enough(call):
    fields = ("--field", "mode", "--field", "hip.patient", "--field", "gait_phase_ratio")

    assert call("watch", "estimate", "--once", *fields).out == "torque\t8.0\t\n"
    told = json.loads(call("watch", "estimate", "--once", *fields, "--json").out)
    assert told == {"mode": "torque", "hip.patient": 8.0, "gait_phase_ratio": None}
    assert call("watch", "hip", "--once", "--field", "name").out == "right/hip\n"
    assert call("watch", "safety", "--once", "--field", "limits.hip.torque_max_nm").out == "60.0\n"


def test_a_field_or_a_key_that_is_not_there_names_those_that_are(call):
    field = call("watch", "right/estimate", "--field", "hip.patint")
    key = call("watch", "force")

    assert (field.code, key.code) == (ExitCode.USAGE, ExitCode.USAGE)
    assert '--field = "hip.patint": one of hip.patient, ' in field.err
    assert "LEG/estimate" in key.err


def test_a_watch_ends_by_its_time(call):
    ended = call("watch", "right/stride", "--timeout", "0.1")

    assert (ended.code, ended.out) == (ExitCode.TIME_OVER, "")
    assert ended.err == "watch: right/stride: 0.1 s are over\n"
