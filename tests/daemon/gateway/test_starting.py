"""A core that starts says so, and what asks for it waits."""

import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from command_line import gaitd
from config_files import Change, changed, copied
from gaitd_client import NoAnswerError, NoServiceError, Target, Trainer, wire
from gaitd_client import trainer as client_trainer
from gaitd_texts import Reader, catalogue
from gaitd_toml import ConfigError

from daemon.ipc import starting
from daemon.preflight import acceptance
from gaitd import record as record_command
from gaitd import status

STARTS = wire.Progress(code="core_starting", subject=None, values={})


def test_every_answer_says_that_the_core_starts_until_it_has_begun(bench, ask):
    with starting.said(bench.runtime):
        asks = {name: ask(name) for name in ("enable", "mode", "status")}
        asks["mode"].payload = b'{"mode": "hold"}'
        asks["acquire"] = ask("acquire", b'{"client": "law"}')
        bench.turn(*asks.values(), after_ms=1000)

        replies = {name: one.replies[0] for name, one in asks.items()}
        for name in ("enable", "mode", "acquire"):
            assert (replies[name].outcome, replies[name].refusal.code) == (
                "refused",
                "core_starting",
            )
        safety = replies["status"].safety
        assert (safety.valid, safety.mode, safety.progress.code) == (False, None, "core_starting")
        screen = "\n".join(status.lines(replies["status"], catalogue(Reader.OPERATOR, "en")))
        assert "the control program starts" in screen

        begun = ask("status")
        bench.cycle(begun)
        assert begun.replies[0].safety.valid
        assert begun.replies[0].safety.progress is None

    after = ask("enable")
    bench.turn(after, after_ms=1000)
    assert after.replies[0].refusal.code == "core_silent"


def test_a_core_that_was_killed_while_it_started_says_nothing(tmp_path):
    code = (
        "import sys; from daemon.ipc import starting; from pathlib import Path; import os, signal\n"
    )
    code += "with starting.said(Path(sys.argv[1])): os.kill(os.getpid(), signal.SIGKILL)"
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)

    assert (tmp_path / starting.STARTING_NAME).exists()
    assert not starting.starting(tmp_path)


def test_the_core_says_it_before_it_checks_its_files_and_no_longer_when_it_ends(
    tmp_path, monkeypatch
):
    change = Change("demo.toml", '"/dev/shm/gaitd-demo" ', f'"{tmp_path}/run" ')
    demo = changed(copied(tmp_path), change)
    heard = []

    def accepted(config):
        heard.append(starting.starting(tmp_path / "run"))
        raise ConfigError(config, "", "", "enough")

    monkeypatch.setattr(acceptance, "accepted", accepted)
    ended = gaitd("core", "--config", demo)

    assert (ended.code, heard) == (2, [True])
    assert not starting.starting(tmp_path / "run")


def trainer_whose_core_starts(monkeypatch, count):
    """A client whose service says `count` times that its core starts."""
    monkeypatch.setattr(client_trainer, "START_RETRY_S", 0.001)
    left = [count]

    def safety():
        left[0] -= 1
        starts = left[0] >= 0
        return SimpleNamespace(valid=not starts, progress=STARTS if starts else None)

    trainer = Trainer()
    monkeypatch.setattr(trainer, "status", lambda: SimpleNamespace(safety=safety()))
    return trainer, left


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_client_waits_while_the_core_starts_and_says_so_once(monkeypatch, count):
    trainer, left = trainer_whose_core_starts(monkeypatch, count)
    heard = []

    trainer.wait_for_core(heard.append)

    assert left == [-1]
    assert heard == [STARTS][:count]


def test_a_client_does_not_wait_for_a_core_that_does_not_run_or_never_begins(monkeypatch):
    trainer, _ = trainer_whose_core_starts(monkeypatch, 10**9)
    monkeypatch.setattr(client_trainer, "START_TIMEOUT_NS", 0)

    with pytest.raises(NoAnswerError, match="still core_starting"):
        trainer.wait_for_core()
    gone = wire.Safety(**{**dict.fromkeys(wire.Safety.__struct_fields__), "valid": False})
    monkeypatch.setattr(trainer, "status", lambda: SimpleNamespace(safety=gone))
    trainer.wait_for_core()


def test_a_recorder_waits_for_its_service_until_it_is_ended(monkeypatch, capsys):
    monkeypatch.setattr(record_command, "RETRY_S", 0.001)
    tries, over = [], threading.Event()

    def client_of(_target, _name):
        tries.append(1)
        if len(tries) < 3:
            raise NoServiceError("no service listens")
        return SimpleNamespace(__enter__=None)

    monkeypatch.setattr(record_command, "client_of", client_of)
    ending = SimpleNamespace(enter_context=lambda service: service)

    assert record_command._service(Target(), over, ending) is not None
    assert len(tries) == 3
    assert capsys.readouterr().err.count("waiting: no service listens") == 1
    over.set()
    assert record_command._service(Target(), over, ending) is None
