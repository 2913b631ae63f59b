"""`Session` on a trainer that a test scripts: what a display and the disk do to it."""

import contextlib
from concurrent.futures import wait
from types import SimpleNamespace

import pytest
from display_bench import filled
from gaitd_client import Cause, Event, Mode, NoAnswerError, NotValid, Stage, Trouble
from gaitd_program import CommandError
from gaitd_session import (
    Advice,
    Button,
    History,
    Phase,
    Session,
    SessionError,
    Why,
    open_history,
)
from gaitd_session import session as session_module
from gaitd_session.advice import Failure, refusal_of
from gaitd_session.machine import ANNOUNCE_S, OFF_SETTLE_S, SILENCE_CYCLES
from gaitd_session.program import _check_off
from gaitd_session.session import FLUSH_S, LATE_LOOKS_MAX, NOT_ENDED, POLL_S
from gaitd_session.store import StoreError
from gaitd_texts import Reader, catalogue
from training import profile

HOUR_NS = 3_600_000_000_000
NONE = NotValid("a key", Trouble.SILENT, "no message")


class Stream:
    def __init__(self, message):
        self.message = message

    def newest(self):
        return self.message()

    def call(self, function):
        self.function = function

    def close(self):
        pass


class Trainer:
    """Does every request at once; a gait plays at once, and without end."""

    target = SimpleNamespace(trainer="trainer")

    def __init__(self):
        self.mode_now, self.stage, self.requests = Mode.READY, None, []
        self.is_silent = self.answers_nothing = self.keeps_drives_on = False
        self.events_stream = Stream(lambda: NONE)
        self.utc_ns, self.boot_id = 10**18, "a"

    def safety(self):
        return Stream(self._safety)

    def _safety(self):
        if self.is_silent:
            return NONE
        self.utc_ns += 1
        verdict = SimpleNamespace(cause=Cause.NONE)
        return SimpleNamespace(
            mode=self.mode_now,
            verdict=verdict,
            stage=self.stage,
            active=self.mode_now != Mode.READY,
            core_boot_id=self.boot_id,
            sample_time_ns=self.utc_ns,
        )

    def drive(self, _name):
        self.held = held = SimpleNamespace(
            hand_switch_closed=True, power_state="switch_on_disabled", cycle=0, fresh=True
        )
        return Stream(lambda: held)

    def events(self, *, history_count):
        assert history_count == 0
        return self.events_stream

    def passes_self_test(self):
        for axis in ("hip", "slide"):
            self.events_stream.function(
                filled(Event, code="self_test_passed", subject=f"right/{axis}")
            )
        self.mode_now = Mode.HOLD

    def stride(self, _leg):
        return Stream(lambda: NONE)

    def _done(self, name, mode, stage=None):
        self.requests.append(name)
        if self.answers_nothing:
            raise NoAnswerError("no answer")
        self.mode_now, self.stage = mode, stage

    def enable(self):
        self._done("enable", Mode.HOLD)

    def disable(self):
        self._done("disable", self.mode_now if self.keeps_drives_on else Mode.READY)

    def mode(self, mode, **_):
        self._done(mode, mode, Stage.PLAYING)


class Clock:
    def __init__(self):
        self.time_ns = 0

    def now_ns(self):
        return self.time_ns


class Bench:
    """A session whose steps a test takes; requests and writes are waited for."""

    def __init__(self, history):
        self.trainer, self.clock = Trainer(), Clock()
        self.session = Session(self.trainer, profile(), history, self.clock)
        self.session._subscribe()

    def step(self, *buttons, after_s=POLL_S):
        for button in buttons:
            self.session.press(button)
        self.clock.time_ns += round(after_s * 1e9)
        self.session._advance()
        wait([one for one in (*self.session._asked, self.session._writing) if one is not None])
        return self.session.view()

    def walk(self):
        self.step()
        self.step(Button.START)
        while self.step(after_s=ANNOUNCE_S / 4).phase is not Phase.WALKING:
            if self.session.view().phase is Phase.SELF_TEST:
                self.trainer.passes_self_test()
        return self


@pytest.fixture
def history(tmp_path):
    opened = open_history(tmp_path / "history.sqlite")
    with contextlib.closing(opened.store):
        yield opened


def test_a_session_that_is_left_disables_the_drives_and_tells_the_history(history):
    bench = Bench(history).walk()
    bench.step(after_s=4.0)
    bench.session._leave()
    bench.session._writer.shutdown()

    assert bench.trainer.requests == ["enable", Mode.SELF_TEST, Mode.GAIT, "disable"]
    assert bench.session.left_on == ""
    (summary,) = history.store.summaries(profile().id)
    assert (summary.end, summary.walked_s) == ("left", pytest.approx(4.0, abs=0.1))
    assert history.store.self_test_utc_ns(profile().id) > 10**18


def test_drives_may_be_on_until_the_session_has_ended_in_order(history, monkeypatch):
    with Bench(history).session as session:
        assert session.left_on == NOT_ENDED
    assert session.left_on == ""

    monkeypatch.setattr("threading.excepthook", lambda _: None)
    cut = Bench(history).walk().session
    monkeypatch.setattr(cut, "_switch_off", lambda _: 1 / 0)
    with cut:
        pass
    assert cut.left_on == NOT_ENDED


def test_a_self_test_of_today_is_not_repeated_by_the_next_session(history):
    Bench(history).walk()
    again, tomorrow = Bench(history), Bench(history)
    again.trainer.utc_ns += 10 * HOUR_NS
    tomorrow.trainer.utc_ns += 24 * HOUR_NS

    assert again.walk().trainer.requests == ["enable", Mode.GAIT]
    assert tomorrow.walk().trainer.requests == ["enable", Mode.SELF_TEST, Mode.GAIT]


def test_a_block_is_on_the_disk_within_the_time_of_a_flush(history):
    bench = Bench(history).walk()
    for _ in range(3):
        bench.step(after_s=FLUSH_S)
        (summary,) = history.store.summaries(profile().id)
        assert summary.walked_s >= bench.session._state.block_walked_s(bench.session._now_s())


def test_marks_before_within_and_after_a_session_are_in_its_history(history):
    bench = Bench(history)

    def mark(said):
        bench.trainer.events_stream.function(
            filled(Event, code="mark", said=said, time_ns=bench.trainer.utc_ns)
        )

    mark("before START")
    bench.walk()
    mark("within")
    bench.step(after_s=FLUSH_S)
    bench.step(Button.END)
    while bench.session.view().phase is not Phase.FINISHED:
        bench.step()
    mark("after the end")
    mark("when the page is closed")
    bench.session._leave()
    bench.session._writer.shutdown()

    said = ["before START", "within", "after the end", "when the page is closed"]
    assert [one.said for one in history.store.marks(profile().id)[1]] == said


def test_of_several_presses_the_strongest_counts_and_none_is_kept(history):
    bench = Bench(history)
    bench.step()
    bench.step(Button.START, Button.START, Button.PAUSE, Button.START)
    for _ in range(5):
        view = bench.step()

    assert (view.phase, bench.trainer.requests) == (Phase.WAITING, [])


@pytest.mark.parametrize(
    ("fails", "reason"), [("answers_nothing", "no answer"), ("keeps_drives_on", "they are on")]
)
def test_drives_that_could_not_be_switched_off_are_told(history, monkeypatch, fails, reason):
    monkeypatch.setattr(session_module, "LEAVE_S", 0.0)
    bench = Bench(history).walk()
    setattr(bench.trainer, fails, True)
    bench.session._leave()

    assert reason in bench.session.left_on
    with pytest.raises(CommandError, match="Not-Halt drücken"):
        _check_off(bench.session, catalogue(Reader.PATIENT, "de"))


def test_a_self_test_that_another_client_ended_is_not_written_as_passed(history):
    bench = Bench(history)
    bench.step()
    bench.step(Button.START)
    while bench.session.view().phase is not Phase.PAUSED:
        if bench.session.view().phase is Phase.SELF_TEST:
            bench.trainer.mode_now = Mode.HOLD
        bench.step(after_s=ANNOUNCE_S / 4)

    assert bench.trainer.requests == ["enable", Mode.SELF_TEST, "disable"]
    assert history.store.self_test_utc_ns(profile().id) == 0


def test_a_disk_that_fails_is_shown_and_loses_nothing_once_it_works(history):
    class Full:
        is_full = True

        def __getattr__(self, name):
            return getattr(history.store, name)

        def write(self, rows):
            if self.is_full:
                raise StoreError("the disk is full")
            history.store.write(rows)

    with_another = Bench(history).walk()
    with_another.step(Button.END)
    store = Full()
    bench = Bench(History(store, "an old trouble")).walk()
    view = bench.step()
    assert (view.phase, view.history_trouble) == (Phase.WALKING, "the disk is full")
    store.is_full = False
    for _ in range(2):
        bench.step(after_s=FLUSH_S)

    assert bench.step().history_trouble == "an old trouble"
    first, second = history.store.summaries(profile().id)
    assert (first.end, second.end) == ("ended", "")
    assert second.walked_s >= FLUSH_S


def test_a_history_that_cannot_be_read_is_no_obstacle():
    class Damaged:
        def self_test_utc_ns(self, _profile):
            raise StoreError("damaged")

    view = Bench(History(Damaged(), "")).walk().step()

    assert view.history_trouble == "damaged; this session is not kept"


def test_no_history_at_all_is_no_obstacle():
    assert Bench(History(None, "no folder")).walk().step().history_trouble == "no folder"


def test_a_request_without_an_answer_pauses_and_silence_shows_no_signal(history):
    bench = Bench(history)
    bench.step()
    bench.trainer.answers_nothing = True
    bench.step(Button.START)
    view = bench.step()
    assert (view.phase, view.refusal) == (Phase.PAUSED, refusal_of(Failure.NO_ANSWER, "no answer"))
    bench.trainer.is_silent = True

    assert bench.step().phase is Phase.NO_SIGNAL


def announced(history):
    bench = Bench(history)
    bench.step()
    bench.step(Button.START)
    assert bench.step().phase is Phase.ANNOUNCED
    return bench


def test_a_look_that_comes_late_is_no_silence_and_a_training_goes_on(history):
    bench = announced(history)
    bench.trainer.is_silent = True
    assert bench.step(after_s=0.3).phase is Phase.ANNOUNCED  # nothing is received yet
    bench.trainer.is_silent = False
    assert bench.step().phase is Phase.ANNOUNCED

    bench.trainer.is_silent = True
    for _ in range(LATE_LOOKS_MAX):
        assert bench.step(after_s=0.3).phase is Phase.ANNOUNCED
    assert bench.step(after_s=0.3).phase is Phase.NO_SIGNAL  # a program that is always late


def test_what_a_drive_said_before_neither_begins_nor_ends_a_motion(history):
    bench = Bench(history)
    for mode in (Mode.READY, Mode.FAULT):
        bench.trainer.mode_now, bench.trainer.held.fresh = mode, True
        assert Button.START in bench.step().buttons
        bench.trainer.held.fresh = False
        assert Button.START not in bench.step().buttons

    bench.trainer.mode_now, bench.trainer.held.fresh = Mode.READY, True
    bench.walk()
    bench.trainer.held.fresh = bench.trainer.held.hand_switch_closed = False
    assert bench.step().phase is Phase.WALKING
    bench.trainer.held.fresh = True
    assert bench.step().phase is Phase.PAUSED


def test_a_press_counts_in_a_look_that_comes_late(history):
    bench = announced(history)
    bench.trainer.is_silent = True

    bench.step(Button.END, after_s=0.3)
    bench.trainer.is_silent = False
    bench.step()
    assert bench.step(after_s=OFF_SETTLE_S).phase is Phase.FINISHED


@pytest.mark.parametrize(
    ("boot_id", "cycle_count", "why"),
    [
        ("a", 1, Why.NO_SIGNAL),
        ("a", SILENCE_CYCLES, Why.LATE_HERE),
        ("b", SILENCE_CYCLES, Why.NO_SIGNAL),  # the core of before has not gone on
    ],
)
def test_a_silence_that_ends_a_start_is_told_with_whose_it_was(history, boot_id, cycle_count, why):
    bench = announced(history)
    bench.trainer.is_silent = True
    assert bench.step().phase is Phase.NO_SIGNAL
    bench.trainer.is_silent = False
    bench.trainer.boot_id = boot_id
    bench.trainer.held.cycle += cycle_count
    bench.step()
    view = bench.step(after_s=OFF_SETTLE_S)

    assert (view.phase, view.why, view.advice) == (Phase.PAUSED, why, Advice.PRESS_START)
    bench.step(after_s=FLUSH_S)
    (summary,) = history.store.summaries("7f3k9m2q")
    assert (summary.interruption_count, summary.last_interruption) == (1, why)
    assert bench.step(Button.START).why is None


def test_a_program_that_ends_in_a_silence_writes_it(history):
    bench = announced(history)
    bench.trainer.is_silent = True
    bench.step()
    bench.session._leave()

    (summary,) = history.store.summaries("7f3k9m2q")
    assert summary.last_interruption == Why.NO_SIGNAL


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_of_the_program_ends_the_motion_and_is_told_to_the_display(history):
    bench = Bench(history).walk()
    session = bench.session
    session._safety.message = lambda: 1 / 0
    session._thread.start()
    session._thread.join()

    assert bench.trainer.requests[-1] == "disable"
    with pytest.raises(SessionError, match="see stderr"):
        session.view()
