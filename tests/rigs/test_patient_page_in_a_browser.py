"""The patient's page in headless Chromium: each state, its accessibility, losses, memory.

Screenshots of all states are written to out/display; with --write-pages those of
docs/pages_in_pictures.md to docs/pictures.
"""

import itertools
import re
import time
from pathlib import Path
from typing import NamedTuple

import browser as rig
import display_bench as bench
import msgspec
import pytest
from contact_sheet import contact_sheet
from gaitd_client import Cause, Mode, Stage
from gaitd_display.feed import PAGES_MAX, TICK_S
from gaitd_display.patient import PatientServer
from gaitd_display.training import Summary, TrainingView
from gaitd_display.words import UNBROKEN
from gaitd_session import Advice, Band, Button, Phase, Result, Step, Why
from gaitd_session.store import SelfTestRow, Store
from gaitd_texts import CAUTIOUS, catalogue
from training import PROFILE

pytestmark = pytest.mark.rig_browser

SIZES = ((1280, 800), (1920, 1080), (800, 1280))
LANGUAGES = ("en", "de")
SCHEMES = ("light", "dark")
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
FAR_ARC_MIN, HEAD_ARC_MIN = 16.0, 20.0
SMALL_TEXTS = """([diagonal_in, distance_m, far, head]) => {
    const mm = diagonal_in * 25.4 / Math.hypot(innerWidth, innerHeight);
    const canvas = document.createElement("canvas").getContext("2d");
    const capOf = ({ fontWeight, fontSize, fontFamily }) => {
        canvas.font = `${fontWeight} ${fontSize} ${fontFamily}`;
        return canvas.measureText("H").actualBoundingBoxAscent;
    };
    const near = "#small, #lefttext small, .strip.near, .sr";
    const large = "#word, .press, #stop > span, .card.end b, .digits, .tile b";
    const found = [];
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
        const element = texts.currentNode.parentElement;
        if (!texts.currentNode.data.trim() || !element.checkVisibility()) continue;
        if (element.closest(near)) continue;
        const cap = capOf(getComputedStyle(element)) * mm;
        const arc = Math.atan(cap / (1000 * distance_m)) * 60 * 180 / Math.PI;
        const least = element.matches(large) ? head : far;
        if (arc < least) found.push(`${arc.toFixed(1)}': ${texts.currentNode.data}`);
    }
    return found;
}"""
"""Texts to be read from the chair whose capitals are too small, in minutes of arc."""
PALE_TEXTS = """() => {
    const light = (colour) => {
        const [r, g, b] = colour.map((part) => {
            const value = part / 255;
            return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
        });
        return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
    };
    const parts = (colour) => {
        const [r, g, b, alpha] = colour.match(/[0-9.]+/g).map(Number);
        const full = colour.startsWith("color(") ? 255 : 1; // of one that is between two
        return [r * full, g * full, b * full, alpha];
    };
    const behind = (element) => {
        for (let at = element; at !== null; at = at.parentElement) {
            const [r, g, b, alpha = 1] = parts(getComputedStyle(at).backgroundColor);
            if (alpha === 1) return [r, g, b];
        }
        return [255, 255, 255];
    };
    const found = [];
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
        const element = texts.currentNode.parentElement;
        if (!texts.currentNode.data.trim() || !element.checkVisibility()) continue;
        const style = getComputedStyle(element);
        const isInPicture = element.namespaceURI.includes("svg");
        const front = parts(isInPicture ? style.fill : style.color).slice(0, 3);
        const [low, high] = [light(front), light(behind(element))].sort((a, b) => a - b);
        if (high / low < 4.5) found.push(`${(high / low).toFixed(1)}: ${texts.currentNode.data}`);
    }
    return found;
}"""
"""Texts whose colour is too close to the one behind them."""


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


class Told:
    """A session in place of one that is walked: it says what a test wants."""

    def __init__(self):
        self.now = None

    def begin(self):
        pass

    def end(self):
        pass

    def refresh(self):
        pass

    def view(self, _mode):
        return self.now

    def press(self, button):
        raise AssertionError(f"not to be pressed: {button}")


@pytest.fixture
def told():
    return Told()


def server_of(settings, trainer, told):
    """With the session of a test, where there is one."""
    server = PatientServer(settings, trainer, trainer.clock)
    if told is not None:
        server._training = told
    return server


@pytest.fixture
def site(trainer, tmp_path):
    with served(trainer, tmp_path) as site:
        yield site


def served(trainer, folder, told=None, **given):
    table = bench.patient_table(folder, legs=trainer.legs, target=told is None)
    table["page"] |= given
    return rig.Site(
        lambda made: server_of(made, trainer, told), table, folder, rig.KINDS["patient"]
    )


@pytest.fixture
def tab(chromium, site, player):
    tab = rig.Tab(chromium, site, rig.SHOTS)
    yield tab
    close(tab)


def close(tab):
    tab.page.close()
    assert tab.errors == []
    assert tab.foreign == []


# --- what is shown ------------------------------------------------------------------------------

BANDS = {"right": Band(0.32, 0.44), "left": Band(0.28, 0.4)}
REASON = {
    "en": "outside its range, move it back by hand: right, hip",
    "de": "außerhalb des Bereichs, von Hand zurückführen: rechts, Hüfte",
}


def training(phase, advice=Advice.LIE_STILL, *buttons, **given):
    base = {
        **{"reason": None, "why": None, "is_kept": True, "number": 2, "count": 4, "plan_s": 1020.0},
        **{"block_left_s": 350.0, "block_s": 600.0, "announce_left_s": 0.0, "bands": BANDS},
        **{"steps": (), "valid_count": 0, "in_band_count": 0, "row_count": 0, "summary": None},
        **{"session_valid_count": 96, "session_in_band_count": 84},
    }
    return TrainingView(phase=phase, advice=advice, buttons=buttons, **(base | given))


def steps(*shares, low=0.32, high=0.44, legs=("right",)):
    def result(share):
        if share is None:
            return Result.UNKNOWN
        return Result.BELOW if share < low else Result.ABOVE if share > high else Result.WITHIN

    pairs = zip(itertools.cycle(legs), shares, strict=False)
    return tuple(Step(leg, share, result(share)) for leg, share in pairs)


GOOD_SHARES = (0.27, 0.30, 0.35, 0.47, 0.38, None, 0.36, 0.39, 0.41, 0.36, 0.40, 0.38)
START, PAUSE, END = Button.START, Button.PAUSE, Button.END
STOPPED = {"mode": Mode.FAULT}
READY, HOLD = {"mode": Mode.READY}, {"mode": Mode.HOLD}
WALKING = {"top_w": 8.0}
GOOD = training(
    Phase.WALKING,
    Advice.WALK,
    *(PAUSE, END),
    steps=steps(*GOOD_SHARES),
    row_count=6,
)
PASSIVE = training(
    Phase.WALKING,
    Advice.RELAX,
    PAUSE,
    **{"number": 1, "block_left_s": 52.0, "block_s": 80.0},
    **{"session_valid_count": 0, "session_in_band_count": 0},
)
SUMMARY = Summary(
    **{"walked_s": 1200.0, "valid_count": 1447, "in_band_count": 1348, "best_row_count": 131},
    **{"share_ratio": 0.36, "past_share_ratios": (0.22, 0.24, 0.26, 0.28, 0.3, 0.32, 0.33)},
    best_share_ratio=0.38,
)
FIRST_SUMMARY = Summary(
    **{"walked_s": 42.0, "valid_count": 0, "in_band_count": 0, "best_row_count": 0},
    **{"share_ratio": None, "past_share_ratios": (), "best_share_ratio": None},
)


class State(NamedTuple):
    """A state of the page, and what leads to it."""

    word: str
    scene: dict
    training: TrainingView | None = None
    button: str | None = None
    """That is there once it is settled."""


def walking(word, *shares, **given):
    return State(
        word, WALKING, training(Phase.WALKING, Advice.WALK, PAUSE, steps=steps(*shares), **given)
    )


AGAINST = tuple(Step("right", 0.05, Result.AGAINST) for _ in range(4))
STATES = {
    "wait": State("wait", {"mode": Mode.BRINGING_UP, "stage": Stage.PREPARING}),
    "ready": State("ready", READY),
    "held": State("held", HOLD),
    "soon_without_session": State("soon", {"mode": Mode.GAIT, "stage": Stage.ANNOUNCING}),
    "to_start": State("to_start", {"mode": Mode.GAIT, "stage": Stage.APPROACHING}),
    "ending": State("ending", {"mode": Mode.GAIT, "stage": Stage.ENDING}),
    "self_test": State("self_test", {"mode": Mode.SELF_TEST, "stage": Stage.PLAYING}),
    "guide": State("guide", {"mode": Mode.HAND_GUIDING, "stage": Stage.PLAYING}),
    "service": State("service", {"mode": Mode.COMMISSION, "stage": Stage.PLAYING}),
    "start": State(
        "start", READY, training(Phase.WAITING, Advice.PRESS_START, START, END), "start"
    ),
    "start_without_switch": State(
        "start", READY | {"switch": False}, training(Phase.WAITING, Advice.HOLD_HAND_SWITCH, END)
    ),
    "daily_test": State(
        "daily_test",
        READY,
        training(Phase.WAITING, Advice.PRESS_EMERGENCY_STOP_AND_RELEASE_IT, START),
        "start",
    ),
    "release": State(
        "release", READY, training(Phase.WAITING, Advice.RELEASE_EMERGENCY_STOP, START), "start"
    ),
    "let_go": State(
        "let_go", READY, training(Phase.WAITING, Advice.LET_GO_AND_HOLD_HAND_SWITCH, START), "start"
    ),
    "failed": State(
        "failed",
        READY,
        training(Phase.PAUSED, Advice.TRY_AGAIN_OR_CALL_THERAPIST, START, END, reason=REASON),
        "start",
    ),
    "used": State("used", HOLD, training(Phase.WAITING, Advice.TRAINER_IS_USED, PAUSE)),
    "soon": State(
        "soon", HOLD, training(Phase.ANNOUNCED, Advice.LIE_STILL, PAUSE, announce_left_s=2.4)
    ),
    "good": State("good", WALKING, GOOD),
    "good_not_kept": walking("good", 0.38, block_left_s=42.0, is_kept=False, count=40, number=17),
    "good_of_both": State(
        "good",
        WALKING,
        msgspec.structs.replace(GOOD, steps=steps(*GOOD_SHARES[-8:], legs=("right", "left"))),
    ),
    "more": walking("more", 0.38, 0.36, 0.34, 0.30, 0.28, 0.24, 0.0),
    "gently": walking("gently", 0.38, 0.42, 0.46, 0.52, 1.0),
    "relax": State("relax", WALKING, training(Phase.WALKING, Advice.WALK, PAUSE, steps=AGAINST)),
    "passive": State("relax", WALKING, PASSIVE),
    "go_on": walking("go_on", 0.36, 0.41, None, None),
    "go_on_first": walking("go_on"),
    "rest": State(
        "rest",
        READY,
        training(
            *(Phase.REST, Advice.REST, END),
            **{"block_left_s": 44.3, "block_s": 60.0, "valid_count": 1112, "in_band_count": 1087},
        ),
    ),
    "rest_unmeasured": State(
        "rest", READY, training(Phase.REST, Advice.REST, END, block_left_s=754.0, block_s=900.0)
    ),
    "next": State(
        "next",
        READY,
        training(Phase.REST, Advice.PRESS_START, START, END, block_left_s=0.0),
        "start",
    ),
    "paused": State(
        "paused",
        READY,
        training(Phase.PAUSED, Advice.PRESS_START, START, END, why=Why.LATE),
        "start",
    ),
    "finished": State(
        "finished", READY, training(Phase.FINISHED, Advice.DONE, START, summary=SUMMARY), "start"
    ),
    "finished_first": State(
        "finished", READY, training(Phase.FINISHED, Advice.DONE, summary=FIRST_SUMMARY)
    ),
    "stopping": State("stopping", {"mode": Mode.STOPPING, "cause": Cause.DRIVE_POWERED}),
    "stopped_switch": State(
        "stopped", {**STOPPED, "cause": Cause.HAND_SWITCH_OPEN, "switch": False}
    ),
    "stopped_reset": State("stopped", {**STOPPED, "cause": Cause.SPASM}, None, "action"),
    "stopped_held": State("stopped", {**STOPPED, "cause": Cause.EFFORT_LIMIT}),
    "stopped_loose": State("stopped", {**STOPPED, "cause": Cause.ENCODER_FROZEN}),
    "stopped_without_power": State(
        "stopped", {**STOPPED, "cause": Cause.SINGULARITY, "power": "fault"}
    ),
    "stopped_at_rest": State("stopped", {"mode": Mode.OFF, "cause": Cause.BRING_UP_FAILED}),
    "stopped_danger": State("stopped", {**STOPPED, "cause": Cause.DRIVE_SILENT}),
    "stopped_danger_off": State(
        "stopped", {**STOPPED, "cause": Cause.STOP_NOT_OBEYED, "power": "fault"}
    ),
    "stopped_start": State(
        "stopped",
        {**STOPPED, "cause": Cause.DRIVE_FAULT, "power": "fault"},
        training(Phase.STOPPED, Advice.PRESS_START_TO_RESET, START),
        "start",
    ),
    "stopped_pressed": State(
        "stopped",
        {**STOPPED, "cause": Cause.STO_ACTIVE, "power": "fault", "sto": True},
        training(Phase.STOPPED, Advice.PRESS_START_TO_RESET, START),
        "start",
    ),
}


def faults_of(tab):
    """All that can be seen to be wrong with what is shown, but the rules of axe."""
    screen = [10.0, 1.5, FAR_ARC_MIN, HEAD_ARC_MIN]
    return [
        *tab.misplaced_texts(),
        *tab.page.evaluate(SMALL_TEXTS, screen),
        *tab.page.evaluate(PALE_TEXTS),
    ]


def is_good(tab):
    assert faults_of(tab) == []
    assert tab.violations() == []


def speak(tab, language):
    while tab.page.evaluate("document.documentElement.lang") != language:
        tab.page.click("#language")


def look_at(tab, name, word):
    """Look until the state is still there after it; a busy computer may lose the connection."""
    for _ in range(20):
        tab.word(word)
        tab.page.evaluate(rig.PAINTED_TWICE)
        tab.shot(name)
        faults = faults_of(tab)
        if tab.page.evaluate("document.body.dataset.word") == word:
            return faults
    raise AssertionError(f"{word} did not last")


def look_at_states(chromium, folder, legs, names):
    """Each state in each size, with the pairs of both with language and scheme."""
    trainer, told, faults = bench.MessageTrainer(legs), Told(), {}
    with served(trainer, folder, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        for number, name in enumerate(names):
            state = STATES[name]
            told.now = state.training
            player.play(**state.scene)
            tab.word(state.word)
            if state.button is not None:
                tab.until(f"!document.querySelector('#{state.button}').hidden")
            for at, (width, height) in enumerate(SIZES):
                language = LANGUAGES[(number + at) % 2]
                scheme = SCHEMES[(number // 2 + (at + 1) // 2) % 2]
                tab.page.set_viewport_size({"width": width, "height": height})
                # With less motion no colour is between two.
                tab.page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
                speak(tab, language)
                shot = f"{name}_{len(legs)}_{language}_{scheme}_{width}"
                if found := look_at(tab, shot, state.word):
                    faults[shot] = found
            if found := tab.violations():
                faults[name] = found
        print("\n".join(f"{name}: {found}" for name, found in faults.items()))
        assert faults == {}
        close(tab)


HALF = len(STATES) // 2


@pytest.mark.parametrize("names", [[*STATES][:HALF], [*STATES][HALF:]], ids=["first", "second"])
def test_each_state_is_readable_in_pairs_of_language_size_and_scheme(chromium, tmp_path, names):
    look_at_states(chromium, tmp_path, ("right",), names)


SHEETS = {
    "patient_before": (
        *("start_without_switch", "start", "daily_test", "soon", "self_test", "passive"),
    ),
    "patient_walking": ("good", "more", "gently", "relax", "go_on", "guide"),
    "patient_after": ("rest", "next", "paused", "finished"),
    "patient_stopped": (
        *("stopped_switch", "stopped_reset", "stopped_held", "stopped_danger", "stopped_pressed"),
        "no_signal",
    ),
    "patient_dark": ("start", "good", "stopped_danger", "no_signal"),
}
"""Pictures of docs/pages_in_pictures.md, and the states in each."""


@pytest.mark.thorough
def test_the_states_of_the_guide_are_pictures(chromium, pictures, tmp_path):
    trainer, told = bench.MessageTrainer(), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        for sheet, names in SHEETS.items():
            scheme = "dark" if sheet == "patient_dark" else "light"
            tab.page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            shots = [shot_of(tab, told, player, name) for name in names]
            contact_sheet(pictures / f"{sheet}.png", shots, columns=2, width=560)
        close(tab)


@pytest.mark.thorough
def test_two_legs_are_a_picture(chromium, pictures, tmp_path):
    trainer, told = bench.MessageTrainer(("right", "left")), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS, size=(820, 1180))
        tab.page.emulate_media(color_scheme="light", reduced_motion="reduce")
        shots = [shot_of(tab, told, player, name) for name in ("good_of_both", "more")]
        contact_sheet(pictures / "patient_two_legs.png", shots, columns=2, width=480)
        close(tab)


def shot_of(tab, told, player, name):
    """A picture of the page once it has settled in a state."""
    if name == "no_signal":
        player.fall_silent()
        tab.word("no_signal")
        shot = tab.page.screenshot()
        player.speak()
        return shot
    state = STATES[name]
    told.now = state.training
    player.play(**state.scene)
    for _ in range(20):  # a busy computer may lose the connection
        tab.word(state.word)
        if state.button is not None:
            tab.until(f"!document.querySelector('#{state.button}').hidden")
        tab.page.wait_for_timeout(300)
        shot = tab.page.screenshot()
        if tab.page.evaluate("document.body.dataset.word") == state.word:
            return shot
    raise AssertionError(f"{name} did not last")


def test_two_legs_are_readable_alike(chromium, tmp_path):
    look_at_states(
        chromium, tmp_path, ("right", "left"), ["good", "good_of_both", "more", "go_on", "soon"]
    )


def test_a_silent_trainer_and_a_dead_server_look_different_and_the_page_recovers(tab, player, site):
    player.walk(3.5, [0.38])
    tab.word("good")
    player.fall_silent()
    for language in LANGUAGES:
        speak(tab, language)
        assert look_at(tab, f"no_signal_{language}", "no_signal") == []
    assert tab.violations() == []
    player.speak()
    tab.word("good")

    site.end()
    for language in LANGUAGES:
        speak(tab, language)
        assert look_at(tab, f"no_connection_{language}", "no_connection") == []
        note = tab.page.inner_text("#stop small")
        assert note == {"en": "does not work now", "de": "wirkt jetzt nicht"}[language]
    assert tab.violations() == []
    site.start()
    tab.word("good")


def test_a_text_that_is_missing_is_the_most_cautious_sentence_and_stop_keeps_its_name(
    chromium, trainer, tmp_path
):
    cautious = CAUTIOUS["de"].replace("Not-Halt", UNBROKEN)
    with bench.catalogues(tmp_path) as folder:
        file = folder / "patient.de.toml"
        whole = file.read_text(encoding="utf-8")
        file.write_text(whole.replace('spasm = "Ihr Bein wurde steif"\n', ""), encoding="utf-8")
        with served(trainer, tmp_path, language="de") as site, rig.Player(trainer) as player:
            tab = rig.Tab(chromium, site, rig.SHOTS)
            player.play(**STOPPED, cause=Cause.SPASM)
            tab.word("stopped")
            assert tab.page.inner_text("#word") == cautious
            assert tab.page.locator("#stop span").inner_text() == "STOPP"
            close(tab)
        file.write_text("[", encoding="utf-8")
        catalogue.cache_clear()
        with served(trainer, tmp_path, language="de") as site, rig.Player(trainer) as player:
            tab = rig.Tab(chromium, site, rig.SHOTS)
            player.play(**READY)
            tab.word("ready")
            assert tab.page.inner_text("#word") == cautious
            assert tab.page.locator("#stop span").inner_text() == "STOP"
            tab.shot("patient_without_its_texts")
            tab.page.click("#language")
            tab.until("document.querySelector('#word').textContent === 'Ready'")
            close(tab)


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
    player.walk(3.5, [0.38])
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
    player.play(mode=Mode.FAULT, cause=Cause.ENCODER_FROZEN)
    tab.word("stopped")
    tab.until("!document.querySelector('#sound').hidden")
    assert tab.page.evaluate("tones") == 0  # without permission none waits for it
    assert tab.page.locator("#quiet").is_hidden()
    tab.page.click("#sound")
    tab.until("document.querySelector('#sound').hidden")
    tab.until("tones > 0")
    tab.page.click("#quiet")
    tab.until("document.querySelector('#quiet').hidden")
    player.play(mode=Mode.READY)
    tab.word("ready")
    tab.page.evaluate("tones = 0")
    player.play(mode=Mode.FAULT, cause=Cause.ENCODER_FROZEN)
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
    player.play(mode=Mode.FAULT, cause=Cause.ENCODER_FROZEN)
    tab.until("tones > 0")
    player.walk(3.5, [0.38])
    tab.until("live.frames.at(-1).now.active")
    tab.page.evaluate("tones = 0")
    site.end()
    tab.until("tones > 0")
    assert tab.page.evaluate("document.body.dataset.word") == "ready"
    site.start()


def test_a_page_that_was_suspended_gets_the_present_without_a_burst(tab, player, site):
    player.walk(3.5, [0.38])
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
        lambda: player.walk(3.5, [0.38] * 14),  # a whole path
    )
    rig.is_flat(tab, trainer, scenes)


NAMES = {
    "start": ("Start",) * 2,
    "pause": ("Pause",) * 2,
    "end": ("End", "Ende"),
    "reset": ("Let leg go", "Bein lösen"),
    "enable": ("Hold leg", "Bein halten"),
    "hand_guiding": ("By hand", "Von Hand"),
    "hold": ("Hold here", "Hier halten"),
}
"""Names of the buttons."""
STEPS = (
    (Mode.FAULT, "reset", ()),
    (Mode.READY, "enable", (START,)),
    (Mode.HOLD, "hand_guiding", (PAUSE,)),
    (Mode.HAND_GUIDING, "hold", ()),
)


def test_stop_and_the_buttons_are_in_reach_at_every_size_and_zoom(chromium, tmp_path):
    trainer, told = bench.MessageTrainer(("right", "left")), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)

        def are_in_reach(word, scene, phase, *buttons, action=None, **given):
            told.now = training(phase, Advice.PRESS_START, *buttons, **given)
            player.play(**scene)
            tab.word(word)
            names = [NAMES[button] for button in buttons]
            names += [] if action is None else [NAMES[action]]
            for name in names:
                button = tab.page.get_by_role("button", name=re.compile(f"^{name[0]}"))
                button.wait_for(timeout=20_000)
            rig.are_in_reach(tab, rig.STOP, *names)

        are_in_reach("paused", READY, Phase.PAUSED, START, END)
        are_in_reach("rest", READY, Phase.REST, END, valid_count=20, in_band_count=18)
        are_in_reach("soon", HOLD, Phase.ANNOUNCED, PAUSE)
        are_in_reach("stopped", {**STOPPED, "cause": Cause.ENCODER_FROZEN}, Phase.STOPPED)
        for mode, action, beside in STEPS:
            scene = {"mode": mode, "cause": Cause.SPASM if mode is Mode.FAULT else Cause.NONE}
            word = "stopped" if mode is Mode.FAULT else "way_out"
            are_in_reach(word, scene, Phase.PAUSED, *beside, action=action)
        player.fall_silent()
        tab.word("no_signal")
        rig.are_in_reach(tab, rig.STOP)
        close(tab)


def test_the_way_out_is_led_by_buttons(tab, player, trainer):
    for step, (mode, action, _) in enumerate(STEPS):
        player.play(mode=mode, cause=Cause.SPASM if mode is Mode.FAULT else Cause.NONE)
        tab.until(f"document.querySelector('#action').dataset.action === '{action}'")
        word = "stopped" if mode is Mode.FAULT else "way_out"
        for language in LANGUAGES:
            speak(tab, language)
            assert look_at(tab, f"way_out_{step + 1}_{language}", word) == []
        tab.page.click("#action")
        tab.until("!document.querySelector('#action').disabled")
    names = [name for name, *_ in trainer.requests]
    assert names == ["reset", "enable", "mode", "mode"]


def test_a_way_out_beside_a_session_has_both_buttons_and_stop_in_a_row_of_its_own(
    chromium, tmp_path
):
    trainer, told, faults = bench.MessageTrainer(), Told(), []
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        told.now = training(Phase.PAUSED, Advice.PRESS_START)
        player.play(mode=Mode.FAULT, cause=Cause.SPASM)
        tab.until("document.querySelector('#action')?.hidden === false")
        for mode, _, beside in STEPS[1:]:
            told.now = training(Phase.PAUSED, Advice.PRESS_START, *beside)
            player.play(mode=mode)
            tab.until(f"document.body.dataset.presses === '{1 + len(beside)}'")
            for (width, height), language in itertools.product(SIZES, LANGUAGES):
                tab.page.set_viewport_size({"width": width, "height": height})
                speak(tab, language)
                faults += look_at(tab, f"way_out_{mode}_{language}_{width}", "way_out")
        assert faults == []
        close(tab)


def order_of(tab, count):
    """What the keyboard reaches, from the begin of the page."""
    found = [None]
    while found.pop() != "":
        tab.page.keyboard.press("Tab")
        found.append(tab.page.evaluate("document.activeElement.id"))
    for _ in range(count):
        tab.page.keyboard.press("Tab")
        found.append(tab.page.evaluate("document.activeElement.id"))
    return found


def test_the_keyboard_reaches_the_button_then_stop_and_the_language_last(chromium, tmp_path):
    trainer, told = bench.MessageTrainer(), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        for name, order in (
            ("good", ["pause", "stop", "language"]),
            ("start", ["start", "stop", "language"]),
            ("ready", ["stop", "language"]),
        ):
            state = STATES[name]
            told.now = state.training
            player.play(**state.scene)
            for _ in range(20):  # a busy computer may lose the connection
                tab.word(state.word)
                if state.button is not None:
                    tab.until(f"!document.querySelector('#{state.button}').hidden")
                tab.page.wait_for_timeout(50)
                tab.page.evaluate(HEAR)
                found = order_of(tab, len(order))
                if not tab.page.evaluate("words.length"):
                    break
            assert found == order
        close(tab)


HEAR = """() => {
    window.heard = [];
    window.words = [];
    const watched = { subtree: true, childList: true, characterData: true };
    const said = document.querySelector("#said");
    new MutationObserver(() => heard.push(said.innerText.trim())).observe(said, watched);
    const word = { attributeFilter: ["data-word"] };
    new MutationObserver(() => words.push(document.body.dataset.word)).observe(document.body, word);
}"""
"""What a screen reader says, and the changes of the word; a busy computer may lose the signal."""


def test_a_screen_reader_hears_the_word_once_for_each_change(tab, player):
    def counts(text, word):
        same = "{}.filter((one) => one === '{}').length"
        return [
            tab.page.evaluate(same.format(*kept)) for kept in (("heard", text), ("words", word))
        ]

    player.walk(8.0, [0.38] * 3)
    tab.word("good")
    tab.page.evaluate(HEAR)
    frames = tab.page.evaluate("painted.frames")
    tab.until(f"painted.frames > {frames + 120}")
    heard, changes = counts("Good", "good")
    assert heard == changes
    player.walk(8.0, [0.9] * 3)
    tab.word("gently")
    tab.until(f"painted.frames > {frames + 180}")
    heard, changes = counts("Gently", "gently")
    assert heard == changes > 0
    label = tab.page.get_attribute("#scene svg[role=img]", "aria-label")
    assert label.startswith("Right: 90 %, Target 32 % – 44 %; Left: ")


def test_less_motion_and_colours_of_a_person_s_own_are_respected(chromium, tmp_path):
    trainer, told = bench.MessageTrainer(), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        for name, scheme in itertools.product(("start", "good", "stopped_danger"), SCHEMES):
            state = STATES[name]
            told.now = state.training
            player.play(**state.scene)
            own = {"reduced_motion": "reduce", "forced_colors": "active", "color_scheme": scheme}
            tab.page.emulate_media(**own)
            assert look_at(tab, f"forced_colors_{name}_{scheme}", state.word) == []
            moving = "document.getAnimations().filter(({ playState }) => playState === 'running')"
            assert tab.page.evaluate(f"{moving}.length") == 0
        close(tab)


@pytest.mark.parametrize("hand", ["right", "left"])
def test_buttons_are_on_the_side_of_the_free_hand(chromium, tmp_path, hand):
    trainer, told = bench.MessageTrainer(), Told()
    with served(trainer, tmp_path, told, switch_hand=hand) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        told.now = STATES["start"].training
        player.play(**READY)
        start_px, stop_px = tab.until(
            "document.querySelector('#start')?.hidden === false && ['#start', '#stop']"
            ".map((name) => document.querySelector(name).getBoundingClientRect().x)"
        )
        assert (start_px < stop_px) == (hand == "right")
        mirrored = tab.page.locator(".picture g[transform*='scale(-1']").count()
        assert mirrored == (0 if hand == "right" else 1)
        tab.shot(f"hand_{hand}")
        close(tab)


def test_a_screen_that_is_farther_away_has_larger_text(chromium, tmp_path):
    trainer = bench.MessageTrainer()
    table = bench.patient_table(tmp_path)
    table["screen"] = {"diagonal_in": 15.6, "distance_m": 2.38}
    with (
        rig.Site(
            lambda made: server_of(made, trainer, None), table, tmp_path, rig.KINDS["patient"]
        ) as site,
        rig.Player(trainer) as player,
    ):
        tab = rig.Tab(chromium, site, rig.SHOTS, size=(1920, 1080))
        player.play(mode=Mode.FAULT, cause=Cause.ENCODER_FROZEN)
        tab.word("stopped")
        tab.page.evaluate(rig.PAINTED_TWICE)
        assert tab.misplaced_texts() == []
        assert tab.page.evaluate(SMALL_TEXTS, [15.6, 2.38, FAR_ARC_MIN, HEAD_ARC_MIN]) == []
        assert tab.page.evaluate(SMALL_TEXTS, [15.6, 2.6, FAR_ARC_MIN, HEAD_ARC_MIN]) != []
        close(tab)


def test_what_is_not_known_is_hatched_and_a_dash_and_never_0(tab, player):
    player.walk(8.0, [0.38, None])
    tab.word("go_on")
    tab.until("document.querySelectorAll('.hatchline').length > 10")
    assert tab.page.locator(".column").count() == 0
    player.play(mode=Mode.HOLD, fresh=False)
    tab.word("wait")
    tab.until("document.querySelector('.panel').classList.contains('unknown')")
    assert tab.page.locator(".fig-leg-group:not(.absent)").count() == 0


def test_stop_keeps_its_place_while_a_patient_walks(chromium, tmp_path):
    trainer, told = bench.MessageTrainer(), Told()
    with served(trainer, tmp_path, told) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS)
        boxes = []
        for name in ("good", "more", "gently", "relax", "go_on"):
            told.now = STATES[name].training
            player.play(**WALKING)
            boxes.append(
                tab.until(
                    f"document.body.dataset.word === '{name}'"
                    " && !document.querySelector('#pause').hidden"
                    " && document.querySelector('#stop').getBoundingClientRect().toJSON()"
                )
            )
        assert boxes == boxes[:1] * len(boxes)
        assert boxes[0]["height"] >= 64
        close(tab)


def test_a_session_is_walked_from_its_start_to_its_summary(chromium, trainer, tmp_path):
    short = PROFILE.replace("duration_s = 10.0", "duration_s = 5.0")
    with Store(tmp_path / "history.sqlite", is_writer=True) as store:
        store.write([SelfTestRow("7f3k9m2q", bench.BEGAN_NS)])
    table = bench.session_table(tmp_path, short, legs=trainer.legs)
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

        def look(name, word):
            assert look_at(tab, f"session_{name}", word) == []

        def wait_for(button):
            tab.until(f"document.querySelector('#{button}')?.hidden === false")

        def wait(condition):
            end_s = time.monotonic() + 20
            while not condition():
                assert time.monotonic() < end_s
                tab.page.wait_for_timeout(20)

        def requested(name):
            wait(lambda: name in {one for one, *_ in trainer.requests})

        player.play(mode=Mode.READY)
        wait_for("start")
        look("start", "start")
        trainer.refusal, trainer.refused = "input_untested", {"untested": "sto_active"}
        tab.page.click("#start")
        look("refused", "daily_test")
        trainer.refusal = None
        player.play(mode=Mode.FAULT, cause=Cause.DRIVE_FAULT, power="fault", sto=True)
        tab.word("stopped")
        wait_for("start")
        look("reset", "stopped")
        player.play(mode=Mode.READY)
        tab.word("start")
        wait_for("start")
        tab.page.click("#start")
        wait_for("pause")
        player.play(mode=Mode.HOLD)
        tab.until("['3', '2', '1'].includes(document.querySelector('.digits')?.textContent)")
        look("soon", "soon")
        requested("mode")
        walks_ns = trainer.clock.ns
        player.walk(3.5, [0.3] * 4)
        tab.word("good")
        tab.until("document.querySelector('.tally').textContent.includes('in target')")
        look("walk", "good")
        wait(lambda: trainer.clock.ns > walks_ns + 4_000_000_000)
        player.play(mode=Mode.HOLD)  # the block is over
        requested("disable")
        player.play(mode=Mode.READY)
        tab.word("rest")
        tab.until("document.querySelector('.praise b') !== null")
        wait_for("start")
        look("next", "next")
        tab.page.click("#start")
        wait_for("pause")
        player.play(mode=Mode.HOLD)
        tab.page.click("#pause")
        player.play(mode=Mode.READY)
        tab.word("paused")
        wait_for("start")
        tab.page.click("#end")
        tab.word("finished")
        tab.until("document.querySelector('.tile').textContent.startsWith('0.1')")
        look("finished", "finished")
        close(tab)
