"""Exit codes of a request, also for an outcome that this version does not know; no service."""

import json
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from gaitd_client import Reply, Target

from gaitd import remote


@pytest.mark.parametrize(("outcome", "code"), [("done", 0), ("refused", 1), ("of_later", 4)])
def test_every_outcome_has_an_exit_code(monkeypatch, capsys, outcome, code):
    reply = Reply(
        seq=1,
        core_boot_id=None,
        cycle=None,
        sample_time_ns=None,
        request="stop",
        outcome=outcome,
        reason="",
        mode=None,
    )
    trainer = SimpleNamespace(request=lambda _name: reply)
    monkeypatch.setattr(remote, "client_of", lambda _target, _name: nullcontext(trainer))

    assert remote.request(Target(), "stop", as_json=True) == code
    assert json.loads(capsys.readouterr().out)["outcome"] == outcome


@pytest.mark.parametrize(("name", "is_warned"), [("stop", True), ("enable", False)])
def test_a_stop_without_a_service_names_the_other_ways_to_stop(capsys, name, is_warned):
    nowhere = Target(("tcp/127.0.0.1:1",))

    assert remote.request(nowhere, name, as_json=False) == remote.EXIT_NO_ANSWER
    text = capsys.readouterr().err
    assert "no service listens on tcp/127.0.0.1:1" in text
    assert ("may not have stopped" in text and "emergency stop" in text) == is_warned
