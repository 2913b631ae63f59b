"""The command `gaitd-session`, and what is refused in a profile."""

import contextlib
import io
import os
import signal
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from command_line import ran
from gaitd_client import Cause, RefusalCode
from gaitd_client.signals import ENDS
from gaitd_client.wire import Refusal
from gaitd_session import (
    Button,
    Phase,
    Why,
    limits_of,
    parse_profile,
    program,
    read_profile,
)
from gaitd_session.machine import TrainerState, begin
from gaitd_session.store import (
    BlockRow,
    EndRow,
    GoalRow,
    InterruptionRow,
    MarkRow,
    SelfTestRow,
    SessionRow,
    Store,
    StrideRow,
)
from gaitd_session.terminal import NoTerminalError, render, run
from gaitd_session.view import view_of
from gaitd_texts import Reader, catalogue
from gaitd_toml import ConfigError
from msgspec.structs import replace
from rich.console import Console
from training import PROFILE, profile

OPTIONS = (
    *("--cadence", "0.25", "0.4", "--amplitude", "0.5", "0.7", "--share", "0.2", "0.6"),
    *("--assist", "10", "80", "--warm-up", "120", "--blocks", "3", "--duration", "300"),
    *("--rest", "60", "--leg", "right"),
)


def call(*words):
    return ran(program.main, "gaitd-session", *words)


def new_profile(folder, *options):
    ended = call("new-profile", *(options or OPTIONS), "--folder", folder)
    return ended, next(iter(folder.glob("*.toml")), None)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rest_s = 2.0\n", "", "plan.warm_up.rest_s = (missing): a number >= 0 and <= 3600"),
        (
            "rest_s = 3.0",
            "rests_s = 3.0",
            "rests_s = 3.0: unknown key. Did you mean `rest_s`?",
        ),
        (
            "share_max_ratio = 0.6",
            "share_max_ratio = 1.6",
            "goal.share_max_ratio = 1.6: a number >= 0 and <= 1",
        ),
        (
            "share_start_ratio = 0.3",
            "share_start_ratio = 0.7",
            "goal.share_start_ratio = 0.7: from 0.1 to 0.6, the therapist's bounds",
        ),
        (
            "amplitude_ratio = 0.6",
            "amplitude_ratio = 0.9",
            "plan.block[0].amplitude_ratio = 0.9: from 0.3 to 0.8, the profile's range",
        ),
        ("cadence_max_hz = 0.5", "cadence_max_hz = 0.1", "at least range.cadence_min_hz"),
        (
            "hip.max_nm = 10.0",
            "hip.max_nm = nan",
            "hip.max_nm = nan: a number >= 0 and <= 120, and finite",
        ),
        ('id = "7f3k9m2q"', 'id = "Erika M."', 'id = "Erika M.": text that matches'),
        ('legs = ["right"]', 'legs = ["right", "right"]', "legs = ('right', 'right'): each leg"),
        ("version = 1", "version = 2", "version = 2: a whole number >= 1 and <= 1"),
        ("version = 1", "version 1", "TOML syntax"),
    ],
)
def test_a_profile_is_refused_with_file_key_value_and_what_is_allowed(old, new, message):
    assert PROFILE.count(old) == 1
    with pytest.raises(ConfigError) as refused:
        parse_profile(PROFILE.replace(old, new), Path("her.toml"))

    assert str(refused.value).startswith("her.toml: ")
    assert message in str(refused.value)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    ended, _ = new_profile(tmp_path / "none")

    assert ended.code == 2
    assert "Invalid value for '--folder'" in ended.err


def test_a_new_profile_has_a_random_id_and_prints_the_plan_to_be_released(tmp_path):
    ended, file = new_profile(tmp_path)

    assert ended.code == 0, ended.err
    made = read_profile(file)
    assert file.stem == made.id
    assert "gaitd plan release --cadence 0.4 --amplitude 0.7 --duration 300" in ended.out
    assert [walk.duration_s for walk in made.plan.block] == [300.0] * 3
    assert limits_of(made).duration_max_s == 300.0
    assert (limits_of(made).hip.assist_max, limits_of(made).slide.assist_max) == (10.0, 80.0)


def test_a_new_profile_that_contradicts_itself_is_not_written(tmp_path):
    ended, file = new_profile(tmp_path, *OPTIONS[:6], "--share", "0.6", "0.2", *OPTIONS[9:])

    assert (ended.code, file) == (2, None)
    assert "goal.share_max_ratio = 0.2: at least goal.share_min_ratio" in ended.err


def test_one_profile_is_summed_up_exported_and_erased(tmp_path):
    file = tmp_path / "her.toml"
    file.write_text(PROFILE)
    history = tmp_path / "history.sqlite"
    with Store(history, is_writer=True) as store:
        store.write(
            [
                SessionRow(profile().id, "trainer", 1_795_000_000_000_000_000),
                StrideRow(1, "right", 1_795_000_002_000_000_000, 2.0, 0.42, 0.02, 5.0, -1.0, True),
            ]
        )
    (tmp_path / "history.sqlite.aside-1").write_text("unreadable")
    table = tmp_path / "strides.csv"

    assert "42%" in call("summary", "--profile", file).out
    assert call("export", "--profile", file, "--output", table).code == 0
    assert "7f3k9m2q,1,1795000000000000000" in table.read_text()
    assert call("export", "--profile", file, "--output", tmp_path / "a.txt").code == 2
    erased = call("erase", "--profile", file, "--yes")

    assert erased.code == 0, erased.err
    assert "1 sessions and the profile are deleted" in erased.out
    assert "history.sqlite.aside-1 could not be read once" in erased.out
    assert not file.exists()
    assert profile().id.encode() not in history.read_bytes()


def trained(folder):
    """A profile, and a session of it with two legs, a warm-up, a block cut short, and a stop."""
    _, file = new_profile(folder, *OPTIONS, "--leg", "left")
    begun_ns, minute_ns = 1_795_000_000_000_000_000, 60_000_000_000
    rows = [
        SessionRow(read_profile(file).id, "trainer", begun_ns),
        SelfTestRow(read_profile(file).id, begun_ns),
        BlockRow(1, "warm_up", 0.25, 0.5, 120.0, 120.0),
        BlockRow(2, "walking", 0.4, 0.7, 300.0, 90.0),
        *(GoalRow(block, leg, 0.3, 0.35) for block in (1, 2) for leg in ("right", "left")),
        InterruptionRow(begun_ns + 4 * minute_ns, "stopped", Cause.SPASM),
        InterruptionRow(begun_ns + 5 * minute_ns, "paused", ""),
        MarkRow(read_profile(file).id, begun_ns + minute_ns, "right <knee>", is_before=False),
    ]
    for number in range(60):
        block, end_ns = 1 + number // 40, begun_ns + number * minute_ns // 15
        share = None if number == 7 else 0.1 + 0.4 * number / 60
        rows += [
            StrideRow(block, "right", end_ns, 4.0, share, 0.02, 5.0, -1.0, share is not None),
            StrideRow(block, "left", end_ns + 1, 4.0, 0.3, 0.02, 4.0, -1.0, True),
        ]
    with Store(folder / "history.sqlite", is_writer=True) as store:
        store.write([*rows, EndRow(begun_ns + 6 * minute_ns, "ended")])
    return file


class Page(HTMLParser):
    """What a reader of a page sees, and what a browser would fetch."""

    def __init__(self, page):
        super().__init__()
        self.words, self.marks, self.fetched, self.open = [], 0, [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.fetched += [value for name, value in attrs if name in {"src", "href"}]
        self.marks += tag == "circle" or (tag, dict(attrs).get("fill")) == ("rect", "#a34400")

    def handle_data(self, data):
        if data.strip() and self.open[-1] != "style":
            self.words.append(data.strip())


@pytest.mark.parametrize(
    ("language", "title", "stop"),
    [
        ("en", "Report of a training session", catalogue(Reader.OPERATOR, "en")),
        ("de", "Bericht über ein Training", catalogue(Reader.OPERATOR, "de")),
    ],
)
def test_a_report_has_figures_blocks_and_stops_in_one_file(tmp_path, language, title, stop):
    file, output = trained(tmp_path), tmp_path / "report.html"

    ended = call("report", "--profile", file, "--output", output, "--language", language)

    assert ended.code == 0, ended.err
    text = output.read_text(encoding="utf-8")
    page = Page(text)
    assert page.fetched == []
    assert "url(" not in text
    assert page.words[0] == title
    assert {"3.5 min", "120", "119", "30%", "4.5 J", "2.0 / 2.0 min", "39 / 40"} <= {*page.words}
    assert {stop.text("stopped.spasm"), stop.text("interruption.paused")} <= {*page.words}
    assert {"2026-11-18 11:07:40 UTC", "right <knee>"} <= {*page.words}
    assert page.marks == 119 + 2  # one for each valid step, and the key of both legs


def test_a_report_of_a_session_that_is_not_there_is_refused(tmp_path):
    file = trained(tmp_path)

    ended = call("report", "--profile", file, "--output", tmp_path / "r.html", "--session", 7)

    assert ended.code == 2
    assert "has no session 7; it has 1" in ended.err


class Left(contextlib.AbstractContextManager):
    """A session that a signal ends, and that all of them reach while it leaves."""

    left_on = ""

    def __init__(self, *_, **__):
        pass

    def configuration(self):
        return self

    leg_names = ("right",)

    def __exit__(self, *_):
        for end in ENDS:
            signal.raise_signal(end)
        self.left_on = "busy"


@pytest.mark.parametrize("end", ENDS)
def test_a_second_signal_does_not_cut_off_the_end_and_drives_that_stay_on_are_code_3(
    tmp_path, monkeypatch, end
):
    (tmp_path / "her.toml").write_text(PROFILE)
    monkeypatch.setattr(program, "Trainer", Left)
    monkeypatch.setattr(program, "Session", Left)
    monkeypatch.setattr(program.terminal, "run", lambda *_: signal.raise_signal(end))
    before = [signal.getsignal(one) for one in ENDS]

    ended = call("run", "--profile", tmp_path / "her.toml")

    assert ended.code == 3, ended.err
    assert "is being switched off: up to 18 s" in ended.out
    assert "The session was left." in ended.out
    assert ended.err.startswith("The drives may be on: busy.")
    assert [signal.getsignal(one) for one in ENDS] == before


class Shown:
    """A session that waits for START, and is over after END."""

    def __init__(self):
        ready = TrainerState("a", "ready", False, None, "none", False, True)
        self.shown = view_of(begin(profile(), {}, self_test_due=False), ready, 0.0)
        self.pressed = []

    def view(self):
        return self.shown

    def press(self, button):
        self.pressed.append(button)
        if button is Button.END:
            self.shown = replace(self.shown, phase=Phase.FINISHED, buttons=())


def test_keys_of_the_terminal_are_the_buttons(monkeypatch):
    master, slave = os.openpty()
    session = Shown()
    with os.fdopen(slave, encoding="utf-8") as keys, os.fdopen(master, "wb", buffering=0) as hand:
        monkeypatch.setattr(sys, "stdin", keys)
        hand.write(b"xse")
        assert run(session, catalogue(Reader.PATIENT, "en")).phase is Phase.FINISHED

    assert session.pressed == [Button.START, Button.END]


def shown_in(language, view):
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(render(view, catalogue(Reader.PATIENT, language)))
    return console.export_text()


def test_the_terminal_shows_block_times_goal_and_keys_in_its_language():
    shown = shown_in("en", Shown().view())
    assert "part 1 of 2 (Warm-up): 0:10 left, session 0:24" in shown
    assert "your share –, target 25% to 35%, reached in 0 of 0 steps" in shown
    assert "[s] START   [e] END" in shown
    german = shown_in("de", Shown().view())
    assert "Teil 1 von 2 (Aufwärmen): noch 0:10, Training 0:24" in german
    assert "[s] START   [e] ENDE" in german


def test_the_terminal_says_why_a_start_was_refused_and_what_has_stopped_the_machine():
    refusal = Refusal(code=RefusalCode.LEG_MOVES, subject=None, values={}, said="")
    refused = replace(Shown().view(), phase=Phase.PAUSED, refusal=refusal)
    assert "das Bein bewegt sich noch" in shown_in("de", refused)
    stopped = replace(Shown().view(), phase=Phase.STOPPED, cause=Cause.SPASM)
    assert "Ihr Bein wurde steif." in shown_in("de", stopped)
    ended = replace(Shown().view(), phase=Phase.PAUSED, why=Why.RESTARTED)
    assert "Das Gerät ist neu gestartet." in shown_in("de", ended)


def test_without_a_terminal_a_session_is_refused():
    with Path(os.devnull).open() as nothing, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdin", nothing)
        with pytest.raises(NoTerminalError):
            run(Shown(), catalogue(Reader.PATIENT, "en"))
