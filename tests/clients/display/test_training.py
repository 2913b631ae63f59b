"""The session behind the patient's page: what its end leaves, and what its errors do."""

import contextlib
import signal
import threading
import time
from pathlib import Path

import display_bench as bench
import pytest
from gaitd_client import Mode
from gaitd_display.settings import SessionFiles, Web
from gaitd_display.training import Summary, Training
from gaitd_display.web import Server
from gaitd_session import Advice, Phase, SessionError
from gaitd_session.store import EndRow, SelfTestRow, SessionRow, Store, StrideRow
from starlette.applications import Starlette
from training import PROFILE


@pytest.fixture
def trainer():
    with bench.MessageTrainer() as made:
        yield made


@pytest.fixture
def files(tmp_path):
    (tmp_path / "profile.toml").write_text(PROFILE, encoding="utf-8")
    return SessionFiles(profile=tmp_path / "profile.toml", history=tmp_path / "history.sqlite")


def until(training, trainer, mode, reached):
    """The first view that fits, while the trainer sends messages of this mode."""
    for _ in range(1000):
        trainer.cycles(mode, count=5)
        if reached(view := training.view(mode)):
            return view
        time.sleep(0.005)  # the session steps by the time of the computer
    raise AssertionError(f"it did not come: {view}")


def test_after_the_end_drives_can_be_switched_off_and_only_then_another_session_begins(
    files, trainer
):
    training = Training(files, trainer, trainer.clock)
    training.begin()
    until(training, trainer, Mode.READY, lambda view: "end" in view.buttons)
    training.press("end")
    until(training, trainer, Mode.READY, lambda view: view.buttons == ("start",))
    until(training, trainer, Mode.HOLD, lambda view: view.buttons == ("pause",))
    training.press("start")
    assert trainer.requests == []

    training.press("pause")
    until(training, trainer, Mode.HOLD, lambda _: len(trainer.requests) >= 2)
    assert set(trainer.requests) == {("disable",)}
    finished = until(training, trainer, Mode.READY, lambda view: view.buttons == ("start",))
    assert finished.advice == Advice.DONE
    assert finished.summary == Summary(
        **{"walked_s": 0.0, "valid_count": 0, "in_band_count": 0, "best_row_count": 0},
        **{"share_ratio": None, "past_share_ratios": (), "best_share_ratio": None},
    )
    training.press("start")
    again = until(training, trainer, Mode.READY, lambda view: "start" in view.buttons)

    assert again.advice == Advice.PRESS_START
    training.end()


def plan_of(file, duration_s):
    text = PROFILE.replace("duration_s = 12.0", f"duration_s = {duration_s}")
    file.write_text(text, encoding="utf-8")


def test_a_changed_profile_counts_before_the_first_start_and_from_the_next_session_on(
    files, trainer, capsys
):
    training = Training(files, trainer, trainer.clock)
    training.begin()
    until(training, trainer, Mode.READY, lambda view: view.plan_s == 22.0)
    before = training._session
    training.refresh()
    assert training._session is before
    plan_of(files.profile, 120.0)
    training.refresh()
    until(training, trainer, Mode.READY, lambda view: view.plan_s == 130.0)
    files.profile.write_text("version = 1", encoding="utf-8")
    training.refresh()  # a profile that cannot be read is told once, and changes nothing
    training.refresh()
    until(training, trainer, Mode.READY, lambda view: view.plan_s == 130.0)
    assert capsys.readouterr().err.count("the profile of before stays in force") == 1

    training.press("start")
    until(training, trainer, Mode.READY, lambda view: view.phase is not Phase.WAITING)
    plan_of(files.profile, 50.0)
    training.refresh()
    assert until(training, trainer, Mode.READY, lambda _: True).plan_s == 130.0
    training.press("end")
    until(training, trainer, Mode.READY, lambda view: view.buttons == ("start",))
    training.refresh()
    assert until(training, trainer, Mode.READY, lambda _: True).plan_s == 130.0
    training.press("start")
    until(training, trainer, Mode.READY, lambda view: view.plan_s == 60.0)
    training.end()
    ended = training._session
    plan_of(files.profile, 70.0)
    training.refresh()
    assert training._session is ended


def test_another_session_knows_what_the_one_before_wrote_last_even_if_that_failed(
    files, trainer, monkeypatch
):
    training = Training(files, trainer, trainer.clock)
    training.begin()
    until(training, trainer, Mode.READY, lambda view: "end" in view.buttons)
    training.press("end")
    until(training, trainer, Mode.READY, lambda view: view.buttons == ("start",))
    before = training._session
    leave = before.__exit__

    def write_last(*error):
        leave(*error)
        training._history.store.write([SelfTestRow(before._profile.id, 7)])
        raise OSError("the disk is gone")

    monkeypatch.setattr(before, "__exit__", write_last)
    with pytest.raises(OSError, match="the disk is gone"):
        training.press("start")

    assert training._session is not before
    assert training._session._tested_utc_ns == 7
    training.end()


def test_the_summary_has_the_shares_of_the_sessions_before_without_those_that_have_none(
    files, trainer
):
    with Store(files.history, is_writer=True) as store:
        for number, share in enumerate((0.5, None, *[0.3 + at / 100 for at in range(8)])):
            rows = [SessionRow("7f3k9m2q", "trainer", 1000 * number)]
            if share is not None:
                rows.append(StrideRow(1, "right", number, 2.0, share, 0.02, 5.0, -1.0, True))
            store.write([*rows, EndRow(1000 * number + 500, "complete")])
    training = Training(files, trainer, trainer.clock)
    training.begin()
    until(training, trainer, Mode.READY, lambda view: "end" in view.buttons)
    training.press("end")
    view = until(training, trainer, Mode.READY, lambda view: view.summary is not None)
    training.end()

    past = view.summary.past_share_ratios
    assert past == pytest.approx(tuple(0.31 + at / 100 for at in range(7)))
    assert view.summary.best_share_ratio == 0.5


def test_a_session_that_dies_ends_the_server_and_a_history_that_cannot_be_written_is_told(
    files, trainer, monkeypatch
):
    training = Training(
        SessionFiles(profile=files.profile, history=Path("/none/history.sqlite")),
        trainer,
        trainer.clock,
    )
    assert not training.view(None).is_kept
    monkeypatch.setattr(training._session, "_read", lambda: 1 / 0)
    monkeypatch.setattr("threading.excepthook", lambda _: None)
    training.begin()
    training._session._thread.join()

    with pytest.raises(SessionError):
        training.view(Mode.READY)


def test_a_server_that_gets_a_second_signal_still_ends_its_session():
    ended = []

    @contextlib.asynccontextmanager
    async def lifespan(_app):
        yield
        ended.append("session")

    server = Server(Starlette(lifespan=lifespan), Web(host="127.0.0.1", port=0))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.005)
    for _ in range(2):
        server.handle_exit(signal.SIGINT, None)
    thread.join()

    assert ended == ["session"]
