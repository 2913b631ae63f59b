"""The patient's page in headless Chromium: each state, its accessibility, losses, memory.

Screenshots of all states are written to out/display.
"""

import contextlib
import time
from pathlib import Path

import browser as rig
import display_bench as bench
import pytest
from gaitd_client import Cause, Mode, Stage
from gaitd_display.feed import PAGES_MAX, TICK_S
from gaitd_display.patient import PatientServer
from gaitd_session.store import SelfTestRow, Store
from training import PROFILE

pytestmark = pytest.mark.rig_browser

READABLE_PX = 32
VISIBLE = "{visibilityProperty: true}"
TONES = """
window.tones = 0;
window.AudioContext = class extends AudioContext {
  constructor() { super(); this.suspend(); }
  createOscillator() { tones += 1; return super.createOscillator(); }
};
"""
"""Counts tones. Chromium takes a look of Playwright for a touch, and may allow sound: here not."""
NO_MORE_PAINT = """
const frame = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = () => 0;
new Promise(frame);
"""
"""The page asks for no frame any more; evaluated when the one that it had asked for is painted."""
STEP_MS = 10


@pytest.fixture(scope="module")
def chromium():
    with rig.chromium() as browser:
        yield browser


@pytest.fixture
def trainer():
    return bench.MessageTrainer(("right", "left"))


@pytest.fixture
def player(trainer, site):
    with rig.Player(trainer) as player:
        yield player


@pytest.fixture
def site(trainer, tmp_path):
    table = bench.patient_table(tmp_path, legs=trainer.legs)
    with rig.Site(
        lambda made: PatientServer(made, trainer, trainer.clock),
        table,
        tmp_path,
        rig.KINDS["patient"],
    ) as site:
        yield site


@pytest.fixture
def tab(chromium, site, player):
    tab = rig.Tab(chromium, site, rig.SHOTS)
    yield tab
    tab.page.close()
    assert tab.errors == []
    assert tab.foreign == []


STOPPED = {"mode": Mode.FAULT}
STATES = {
    "wait": ("wait", {"mode": Mode.BRINGING_UP, "stage": Stage.PREPARING}),
    "ready": ("ready", {"mode": Mode.READY}),
    "rest": ("rest", {"mode": Mode.HOLD}),
    "soon": ("soon", {"mode": Mode.GAIT, "stage": Stage.ANNOUNCING}),
    "to_start": ("to_start", {"mode": Mode.GAIT, "stage": Stage.APPROACHING, "power_w": 1.0}),
    "against": ("go_on", {"mode": Mode.GAIT, "stage": Stage.PLAYING, "power_w": -1.5}),
    "good": ("good", {"top_w": 3.5}),
    "stronger": ("stronger", {"top_w": 1.0}),
    "gently": ("gently", {"top_w": 7.0}),
    "ending": ("ending", {"mode": Mode.GAIT, "stage": Stage.ENDING}),
    "self_test": ("self_test", {"mode": Mode.SELF_TEST, "stage": Stage.PLAYING}),
    "stopping": ("stopping", {"mode": Mode.STOPPING, "cause": Cause.SPASM}),
    "stopped_switch": ("stopped", {**STOPPED, "cause": Cause.HAND_SWITCH_OPEN, "switch": False}),
    "stopped_reset": ("stopped", {**STOPPED, "cause": Cause.TRACKING_LIMIT}),
    "stopped_loose": ("stopped", {**STOPPED, "cause": Cause.ENCODER_FROZEN}),
    "stopped_without_power": ("stopped", {**STOPPED, "cause": Cause.SPASM, "power": "fault"}),
    "stopped_at_rest": ("stopped", {"mode": Mode.OFF, "cause": Cause.DRIVE_SILENT}),
    "stopped_danger": ("stopped", {**STOPPED, "cause": Cause.DRIVE_SILENT}),
}


def is_good(tab):
    assert tab.violations() == []
    assert tab.small_texts(READABLE_PX) == []
    assert tab.overflows() == []


@pytest.mark.parametrize("name", STATES)
def test_each_state_is_readable_in_both_languages_and_breaks_no_rule_of_axe(tab, player, name):
    word, scene = STATES[name]
    player.play(**scene)
    tab.word(word)

    for language in ("en", "de"):
        tab.until(f"document.documentElement.lang === '{language}'")
        tab.page.wait_for_timeout(100)
        is_shown = False
        while not is_shown:  # a busy computer may lose the connection for a moment
            tab.word(word)
            tab.shot(f"{name}_{language}")
            is_shown = tab.page.evaluate("document.body.dataset.word") == word
        is_good(tab)
        tab.page.click("#language")


def test_a_silent_trainer_and_a_dead_server_look_different_and_the_page_recovers(tab, player, site):
    player.walk(3.5)
    tab.word("good")
    player.fall_silent()
    tab.word("no_signal")
    tab.shot("no_signal")
    is_good(tab)
    assert tab.page.locator(".bar.invalid").count() == 2
    player.speak()
    tab.word("good")

    site.end()
    tab.word("no_connection")
    tab.shot("no_connection")
    is_good(tab)
    site.start()
    tab.word("good")


def test_silence_is_told_within_300_ms_of_the_last_sample(chromium, site, trainer):
    """On clocks that the test holds, the trainer's and the page's, so that no load decides.

    On top come a tick of the server, and a step by which the page's clock is behind.
    """
    tab = rig.Tab(chromium, site, rig.SHOTS)
    tab.page.clock.install(time=0)
    tab.page.reload()
    trainer.cycles(Mode.READY)
    tab.word("ready")
    tab.page.clock.pause_at(3_600_000)
    tab.page.evaluate(
        """() => {
            window.toldMs = performance.now();
            new MutationObserver(() => { window.toldMs = performance.now(); })
                .observe(document.body, { attributeFilter: ["data-word"] });
        }"""
    )

    def told_after_ms(word, go_on):
        began_ms = tab.page.evaluate("performance.now()")
        while tab.page.evaluate("document.body.dataset.word") != word:
            go_on()
            tab.page.clock.run_for(STEP_MS)
            assert tab.page.evaluate("performance.now()") <= began_ms + 1000
        return tab.page.evaluate("window.toldMs") - began_ms

    def tick():
        (page,) = site.server.feed._pages
        trainer.clock.ns += STEP_MS * 1_000_000
        later_seq = page._sent_seq + 2  # the next one may have been computed before
        while page._received_seq < later_seq:
            tab.page.wait_for_timeout(5)

    def cycle():
        trainer.cycles(Mode.READY)
        tick()

    while site.server.feed.page_count > 1:  # the one before it was loaded again
        tab.page.wait_for_timeout(5)
    told_after_ms("ready", cycle)
    silent_ms = told_after_ms("no_signal", tick)
    told_after_ms("ready", cycle)
    site.end()
    lost_ms = told_after_ms("no_connection", lambda: None)
    site.start()
    tab.page.close()
    print(f"no signal after {silent_ms:.0f} ms, no connection after {lost_ms:.0f} ms")
    assert 200 <= silent_ms <= 300 - 1000 * TICK_S - STEP_MS
    assert 200 <= lost_ms <= 300 - 1000 * TICK_S - STEP_MS


def test_stop_is_sent_at_the_first_touch_and_a_stop_that_does_not_arrive_is_told(
    tab, player, trainer, site
):
    player.walk(3.5)
    tab.word("good")
    tab.page.locator("#stop").dispatch_event("pointerdown")
    tab.until("document.querySelector('#stop_done').checkVisibility()")
    assert ("stop",) in trainer.requests
    tab.page.focus("#stop")
    tab.page.keyboard.press("Enter")
    tab.until("document.querySelector('#stop_done').checkVisibility()")
    assert trainer.requests.count(("stop",)) == 2

    trainer.silent = True
    tab.page.click("#stop")
    tab.until("document.querySelector('#stop_failed').checkVisibility()")
    tab.shot("stop_failed")
    is_good(tab)
    tab.page.wait_for_timeout(7000)
    assert tab.page.locator("#stop_failed").is_visible()  # until a stop arrives
    trainer.silent = False
    tab.page.click("#stop")
    tab.until("!document.querySelector('#stop_failed').checkVisibility()")


@pytest.mark.parametrize("missing", ["/texts.json", "/page.json", "/static/common.js"])
def test_stop_works_while_the_rest_of_the_page_cannot_be_loaded(tab, trainer, missing):
    tab.page.route(f"**{missing}", lambda route: route.fulfill(status=503))
    tab.page.reload()
    tab.page.click("#stop")
    tab.until("document.querySelector('#stop_done').checkVisibility()")
    assert trainer.requests == [("stop",)]
    tab.page.wait_for_timeout(1500)
    tab.shot(f"unloaded_{Path(missing).stem}")
    assert tab.page.locator("#unloaded").is_visible()
    assert "STOP" in tab.page.inner_text("#stop")
    tab.page.unroute(f"**{missing}")
    if missing.endswith("json"):
        tab.word("ready")
        assert tab.page.locator("#unloaded").count() == 0


def test_one_page_too_many_says_so_and_gets_its_place_later(chromium, tab, site):
    tab.word("ready")
    others = [site.server.feed.join() for _ in range(PAGES_MAX - 1)]
    later = rig.Tab(chromium, site, rig.SHOTS)
    later.word("too_many_pages")
    later.shot("too_many_pages")
    is_good(later)
    site.server.feed.leave(others[0])
    later.word("ready")
    later.page.close()


def test_the_alarm_sounds_until_it_is_acknowledged_and_again_for_the_next_stop(tab, player):
    tab.page.add_init_script(TONES)
    tab.page.reload()
    tab.word("ready")
    player.play(mode=Mode.FAULT, cause=Cause.SPASM)
    tab.word("stopped")
    tab.until("!document.querySelector('#quiet').hidden")
    assert tab.page.evaluate("tones") == 0  # without permission none waits for it
    tab.page.click("#sound")
    tab.until("document.querySelector('#sound').hidden")
    tab.until("tones > 0")
    tab.page.click("#quiet")
    tab.until("document.querySelector('#quiet').hidden")
    player.play(mode=Mode.READY)
    tab.word("ready")
    tab.page.evaluate("tones = 0")
    player.play(mode=Mode.FAULT, cause=Cause.SPASM)
    tab.until("!document.querySelector('#quiet').hidden")
    tab.until("tones > 0")


def test_the_alarm_sounds_in_a_tab_that_paints_nothing_and_for_a_server_that_is_lost(
    tab, player, site
):
    for script in (rig.FEED, TONES):
        tab.page.add_init_script(script)
    tab.page.reload()
    tab.word("ready")
    tab.page.click("#sound")
    tab.page.evaluate(NO_MORE_PAINT)
    player.play(mode=Mode.FAULT, cause=Cause.SPASM)
    tab.until("tones > 0")
    player.walk(3.5)
    tab.until("live.frames.at(-1).now.active")
    tab.page.evaluate("tones = 0")
    site.end()
    tab.until("tones > 0")
    assert tab.page.evaluate("document.body.dataset.word") == "ready"
    site.start()


def test_the_way_out_is_led_by_buttons(tab, player, trainer):
    for step, (mode, action) in enumerate(
        (
            (Mode.FAULT, "reset"),
            (Mode.READY, "enable"),
            (Mode.HOLD, "hand_guiding"),
            (Mode.HAND_GUIDING, "hold"),
        )
    ):
        player.play(mode=mode, cause=Cause.SPASM if mode is Mode.FAULT else Cause.NONE)
        tab.until(f"document.querySelector('#action').dataset.action === '{action}'")
        tab.until("document.querySelector('#action').checkVisibility({visibilityProperty: true})")
        tab.shot(f"way_out_{step + 1}_{action}")
        is_good(tab)
        tab.page.click("#action")
        tab.until("!document.querySelector('#action').disabled")
    names = [name for name, *_ in trainer.requests]
    assert names == ["reset", "enable", "mode", "mode"]


def test_a_page_that_was_suspended_gets_the_present_without_a_burst(tab, player, site):
    player.walk(3.5)
    tab.word("good")
    wire = tab.page.context.new_cdp_session(tab.page)
    wire.send("Debugger.enable")
    wire.send("Debugger.pause")
    player.play(mode=Mode.READY)
    (page,) = site.server.feed._pages
    tab.page.wait_for_timeout(500)
    at_first = page._sent_seq
    tab.page.wait_for_timeout(2000)
    assert page._sent_seq == at_first  # it takes nothing, and no more is on its way
    wire.send("Debugger.resume")

    tab.word("ready")
    assert site.server.feed._pages == {page}


def test_the_memory_of_the_patient_s_page_is_flat_over_an_hour_of_frames(tab, player, trainer):
    scenes = (
        lambda: player.play(mode=Mode.FAULT, cause=Cause.SPASM),
        lambda: player.play(mode=Mode.READY),
        lambda: player.walk(3.5),
    )
    rig.is_flat(tab, trainer, scenes)


START, PAUSE, END = ("Start",) * 2, ("Pause",) * 2, ("End", "Ende")
STEPS = (
    (Mode.FAULT, ("1 Let go", "1 Loslassen"), ()),
    (Mode.READY, ("2 Hold the leg", "2 Bein halten"), (START,)),
    (Mode.HOLD, ("3 Move by hand", "3 Von Hand bewegen"), (PAUSE,)),
    (Mode.HAND_GUIDING, ("4 Hold here", "4 Hier halten"), ()),
)


@contextlib.contextmanager
def session_tab(chromium, trainer, folder):
    (folder / "profile.toml").write_text(PROFILE, encoding="utf-8")
    with Store(folder / "history.sqlite", is_writer=True) as store:
        store.write([SelfTestRow("7f3k9m2q", bench.BEGAN_NS)])
    table = bench.patient_table(folder, legs=trainer.legs)
    table["session"] = {"profile": "profile.toml", "history": "history.sqlite"}
    with (
        rig.Site(
            lambda made: PatientServer(made, trainer, trainer.clock),
            table,
            folder,
            rig.KINDS["patient"],
        ) as site,
        rig.Player(trainer) as player,
    ):
        tab = rig.Tab(chromium, site, rig.SHOTS)
        yield tab, player
        tab.page.close()


def test_stop_and_the_button_of_the_step_are_in_reach_at_every_size_and_zoom(
    chromium, trainer, tmp_path
):
    with session_tab(chromium, trainer, tmp_path) as (tab, player):

        def wait_for(name):
            tab.page.get_by_role("button", name=name, exact=True).wait_for(timeout=20_000)

        player.play(mode=Mode.READY)
        wait_for("Start")
        rig.are_in_reach(tab, rig.STOP, START, END)
        player.play(mode=Mode.FAULT, cause=Cause.ENCODER_FROZEN)
        tab.word("stopped")
        rig.are_in_reach(tab, rig.STOP)
        for mode, action, beside in STEPS:
            player.play(mode=mode, cause=Cause.SPASM if mode is Mode.FAULT else Cause.NONE)
            for name in (action, *beside):
                wait_for(name[0])
            rig.are_in_reach(tab, rig.STOP, action, *beside)
        player.play(mode=Mode.GAIT, stage=Stage.PLAYING)
        tab.word("go_on")
        player.play(mode=Mode.READY)
        tab.word("ready")
        wait_for("Start")
        tab.page.get_by_role("button", name="Start", exact=True).click()
        player.play(mode=Mode.HOLD)
        wait_for("Pause")
        rig.are_in_reach(tab, rig.STOP, PAUSE, END)
        player.fall_silent()
        tab.word("no_signal")
        rig.are_in_reach(tab, rig.STOP)


def test_the_buttons_of_a_session_are_big_and_beside_stop(chromium, trainer, tmp_path):
    short = PROFILE.replace("duration_s = 10.0", "duration_s = 5.0")
    (tmp_path / "profile.toml").write_text(short, encoding="utf-8")
    with Store(tmp_path / "history.sqlite", is_writer=True) as store:
        store.write([SelfTestRow("7f3k9m2q", bench.BEGAN_NS)])
    table = bench.patient_table(tmp_path, legs=trainer.legs)
    table["session"] = {"profile": "profile.toml", "history": "history.sqlite"}
    with (
        rig.Site(
            lambda made: PatientServer(made, trainer, trainer.clock),
            table,
            tmp_path,
            rig.KINDS["patient"],
        ) as site,
        rig.Player(trainer) as player,
    ):
        tab = rig.Tab(chromium, site, rig.SHOTS)

        def look(name):
            tab.page.wait_for_timeout(300)
            tab.shot(f"session_{name}")
            is_good(tab)

        def wait_for(button):
            tab.until(f"document.querySelector('#{button}').checkVisibility({VISIBLE})")

        def wait(condition):
            end_s = time.monotonic() + 20
            while not condition():
                assert time.monotonic() < end_s
                tab.page.wait_for_timeout(20)

        def requested(name):
            wait(lambda: name in {one for one, *_ in trainer.requests})

        player.play(mode=Mode.READY)
        wait_for("start")
        look("start")
        trainer.refusal = "hand switch and emergency stop (STO) pressed: not seen to act today"
        tab.page.click("#start")
        tab.until("document.querySelector('#line').textContent.startsWith('Press the emergency')")
        look("refused")
        trainer.refusal = None
        player.play(mode=Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", sto=True)
        tab.word("stopped")
        wait_for("start")
        look("reset")
        player.play(mode=Mode.READY)
        tab.word("ready")
        wait_for("start")
        tab.page.click("#start")
        wait_for("pause")
        player.play(mode=Mode.HOLD)
        look("soon")
        requested("mode")
        walks_ns = trainer.clock.ns
        player.walk(3.5)
        tab.word("good")
        look("band")
        wait(lambda: trainer.clock.ns > walks_ns + 4_000_000_000)
        player.play(mode=Mode.HOLD)  # the block is over
        requested("disable")
        player.play(mode=Mode.READY)
        tab.word("rest")
        look("rest")
        tab.page.click("#language")
        look("rest_de")
        tab.page.click("#language")
        wait_for("start")
        tab.page.click("#start")
        wait_for("pause")
        player.play(mode=Mode.HOLD)
        tab.page.click("#pause")
        player.play(mode=Mode.READY)
        wait_for("start")
        look("paused")
        tab.page.click("#end")
        tab.until("document.querySelector('#more').textContent.startsWith('Walked: 0.1 min')")
        look("finished")
        tab.page.click("#language")
        look("finished_de")
        tab.page.close()
