"""The therapist's page in headless Chromium: login, values, plan, progress, losses, memory.

Screenshots of all states are written to out/display.
"""

import browser as rig
import display_bench as bench
import pytest
from gaitd_client import Cause, Event, Mode
from gaitd_display.login import hash_password
from gaitd_display.therapist import TherapistServer
from gaitd_session.store import BlockRow, EndRow, InterruptionRow, SessionRow, Store, StrideRow
from training import PROFILE

pytestmark = pytest.mark.rig_browser

PASSWORD = "correct horse battery staple"
DAY_NS = 86_400_000_000_000


@pytest.fixture(scope="module")
def chromium():
    with rig.chromium() as browser:
        yield browser


@pytest.fixture
def trainer():
    return bench.MessageTrainer(("right", "left"))


@pytest.fixture(scope="module")
def password_hash():
    return hash_password(PASSWORD)


def write_history(file):
    """Six sessions, one a day; the third has no valid stride, the last goes on."""
    with Store(file, is_writer=True) as store:
        for day, share in enumerate((0.31, 0.36, None, 0.4, 0.38, 0.45)):
            begun_ns = bench.BEGAN_NS + day * DAY_NS
            strides = [
                StrideRow(1, "right", begun_ns + n, 2.0, share, 0.02, 5.0, -1.0, share is not None)
                for n in range(120)
            ]
            walked = BlockRow(1, "warm_up", 0.5, 0.4, 600.0, 480.0 + 20 * day)
            store.write([SessionRow("7f3k9m2q", "trainer", begun_ns), *strides, walked])
            if day < 5:
                end = "complete" if share else "left"
                store.write([InterruptionRow(begun_ns, "stopped", "a stop"), EndRow(begun_ns, end)])


@pytest.fixture
def desk(chromium, trainer, tmp_path, password_hash):
    table = bench.therapist_table(password_hash, legs=trainer.legs)
    table["session"] = {"profile": "profile.toml", "history": "history.sqlite"}
    (tmp_path / "profile.toml").write_text(PROFILE, encoding="utf-8")
    write_history(tmp_path / "history.sqlite")
    with (
        rig.Site(
            lambda made: TherapistServer(made, trainer, trainer.clock),
            table,
            tmp_path,
            rig.KINDS["therapist"],
        ) as site,
        rig.Player(trainer) as player,
    ):
        tab = rig.Tab(chromium, site, rig.SHOTS, size=(1440, 1000))
        yield tab, player
        tab.page.close()
    assert tab.errors == []
    assert tab.foreign == []


def login(tab):
    tab.page.fill("#password", PASSWORD)
    tab.page.click("#login button")
    tab.until("document.querySelector('#requests button') !== null")  # its script has run


def test_the_therapist_logs_in_sees_all_values_and_releases_a_plan(desk, trainer):
    tab, player = desk
    player.walk(3.5)
    tab.page.fill("#password", "a wrong password")
    tab.page.click("#login button")
    tab.until("document.querySelector('#answer').textContent === 'Wrong password.'")
    tab.shot("login")
    assert tab.violations() == []
    tab.page.click("#stop")
    tab.until("document.querySelector('#stop_done').checkVisibility()")
    assert trainer.requests == [("stop",)]

    login(tab)
    tab.until("document.querySelector('#state')?.textContent.includes('gait')")
    tab.until("document.querySelectorAll('#strides tr').length > 4")
    tab.shot("therapist")
    assert tab.violations() == []
    tab.page.click("#plan button[type=submit]")
    tab.until("document.querySelector('#plannow').textContent.startsWith('0.3')")
    assert (trainer.plan.duration_max_s, trainer.plan.hip_assist_max_nm) == (600, None)
    tab.until("document.querySelectorAll('#sessions tr').length === 6")
    assert tab.page.locator("#progresstroubles li").count() == 0
    assert tab.page.locator("#sessions tr:nth-child(4)").inner_text().split("\t")[4] == "–"
    tab.page.locator("#sessionbox").scroll_into_view_if_needed()
    tab.shot("therapist_progress")
    tab.page.click("#releaseprofile")
    tab.until("document.querySelector('#plannow').textContent.includes('10 N·m, 80 N')")
    assert trainer.plan.duration_max_s == 12

    player.play(mode=Mode.FAULT, cause=Cause.SPASM, validity="split_unobservable")
    tab.until("!document.querySelector('#verdict').hidden")
    tab.page.click("#language")
    tab.page.wait_for_timeout(200)
    tab.shot("therapist_stopped_de")
    assert tab.violations() == []
    assert tab.page.locator("td.invalid").count() >= 4
    player.fall_silent()
    tab.until("!document.querySelector('#loss').hidden")
    tab.shot("therapist_no_signal")
    assert tab.violations() == []
    player.speak()
    tab.page.click("#logout")
    tab.until("document.querySelector('#password') !== null")


def test_stop_of_the_therapist_s_page_is_in_reach_at_every_size_and_zoom(desk):
    tab, player = desk
    rig.are_in_reach(tab, rig.STOP)
    login(tab)
    rig.are_in_reach(tab, rig.STOP)
    player.play(mode=Mode.FAULT, cause=Cause.SPASM)
    tab.until("!document.querySelector('#verdict').hidden")
    rig.are_in_reach(tab, rig.STOP)


def test_the_memory_of_the_therapist_s_page_is_flat_over_an_hour_of_frames(desk, trainer):
    tab, player = desk
    login(tab)
    trainer.send("events", bench.filled(Event, id="1", text="an event", kind="note"))
    scenes = (lambda: player.play(mode=Mode.FAULT, cause=Cause.SPASM), lambda: player.walk(3.5))
    rig.is_flat(tab, trainer, scenes)


def test_the_therapist_s_alarm_sounds_for_a_stop_at_rest_and_for_a_server_that_is_lost(desk):
    tab, player = desk
    login(tab)
    tab.until("document.querySelector('#state')?.textContent.includes('ready')")
    player.play(mode=Mode.OFF, cause=Cause.DRIVE_SILENT)
    tab.until("!document.querySelector('#quiet').hidden")
    player.play(mode=Mode.HOLD)
    tab.until("document.querySelector('#quiet').hidden")
    tab.site.end()
    tab.until("!document.querySelector('#quiet').hidden")
    tab.shot("therapist_no_connection")
    tab.site.start()
