"""Exit codes of a request, also for an outcome that this version does not know; no service."""

import json
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
import zenoh
from command_line import gaitd
from gaitd_client import Mode, Reply, Target, Trainer, wire
from gaitd_client.connection import config_of
from gaitd_names import ExitCode
from gaitd_toml import ConfigError

from gaitd import remote
from gaitd.watch import stream_of


def reply_of(request, outcome, refusal=None, mode=None):
    return Reply(
        seq=1,
        core_boot_id=None,
        cycle=None,
        sample_time_ns=None,
        request=request,
        outcome=outcome,
        refusal=refusal,
        mode=mode,
    )


@pytest.mark.parametrize(("outcome", "code"), [("done", 0), ("refused", 1), ("of_later", 4)])
def test_every_outcome_has_an_exit_code(monkeypatch, capsys, outcome, code):
    reply = reply_of("stop", outcome)
    trainer = SimpleNamespace(request=lambda _name: reply)
    monkeypatch.setattr(remote, "client_of", lambda _target, _name: nullcontext(trainer))

    assert remote.request(Target(), "stop", as_json=True) == code
    assert json.loads(capsys.readouterr().out)["outcome"] == outcome


@pytest.mark.parametrize(("name", "is_warned"), [("stop", True), ("enable", False)])
def test_a_stop_without_a_service_names_the_other_ways_to_stop(capsys, name, is_warned):
    nowhere = Target(("tcp/127.0.0.1:1",))

    assert remote.request(nowhere, name, as_json=False) == ExitCode.UNAVAILABLE
    text = capsys.readouterr().err
    assert "no service listens on tcp/127.0.0.1:1" in text
    assert ("may not have stopped" in text and "emergency stop" in text) == is_warned


@pytest.mark.parametrize(
    ("code", "mode", "following"),
    [
        ("not_in_this_mode", Mode.FAULT, "then `gaitd reset`"),
        ("not_in_this_mode", Mode.READY, "`gaitd enable`"),
        ("input_untested", Mode.READY, "next: `gaitd self-test`"),
        ("self_test_due", Mode.HOLD, "next: `gaitd self-test`"),
        ("not_referenced", Mode.READY, "next: `gaitd reference right/hip`"),
        ("sign_not_proven", Mode.READY, "next: `gaitd commission right/hip`"),
        ("patient_configured", Mode.READY, "without [patient]"),
        ("no_plan", Mode.HOLD, "next: `gaitd plan release --cadence"),
        ("no_such_axis", Mode.READY, "next: one of: right/hip, right/slide"),
        ("cadence_out_of_range", Mode.HOLD, "next: `gaitd mode gait --cadence"),
        ("of_a_later_version", None, "`gaitd status`"),
        (None, None, "`gaitd status`"),
    ],
)
def test_a_refusal_names_the_next_command(capsys, code, mode, following):
    why = code and wire.Refusal(
        code=code, subject="right/hip", values={}, said="right/hip, right/slide"
    )
    refused = reply_of("enable", "refused", why, mode)

    assert remote.report_reply(refused, as_json=False) == ExitCode.FAILED
    assert following in capsys.readouterr().out.splitlines()[1]


def test_a_refusal_that_names_the_mode_does_not_name_it_twice(capsys):
    values = {"trigger": "commission", "mode_now": "hold"}
    why = wire.Refusal(code="not_in_this_mode", subject=None, values=values, said="")

    remote.report_reply(reply_of("mode", "refused", why, Mode.HOLD), as_json=False)

    assert capsys.readouterr().out.count("(Leg is held)") == 1


def test_watching_a_trainer_that_is_not_there_ends(tmp_path):
    endpoint = f"unixsock-stream/{tmp_path}/zenoh"
    other = {"mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False}
    with zenoh.open(config_of(other)):
        ended = gaitd("watch", "safety", "--count", 1, "--endpoint", endpoint, "--trainer", "wrong")

    assert (ended.code, ended.out) == (ExitCode.UNAVAILABLE, "")
    assert "no answer to gaitd/wrong/control/status" in ended.err
    assert "another trainer" in ended.err


def test_every_key_of_a_trainer_can_be_watched_and_another_one_is_refused():
    trainer = Trainer()
    keys = ["safety", "health", "events", "right/estimate", "left/stride", "drives/right/hip"]

    assert [stream_of(trainer, key).key for key in keys] == [f"gaitd/trainer/{key}" for key in keys]
    for wrong in ("", "estimate", "middle/estimate", "right/force", "drives/right", "safety/x"):
        with pytest.raises(ConfigError, match=r"KEY = .*LEG/stride"):
            stream_of(trainer, wrong)
