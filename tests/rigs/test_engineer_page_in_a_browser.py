"""The engineer's page in headless Chromium: each state and size, losses, truth, contrast.

Screenshots are written to out/display; with --write-pages that of README to docs/engineer.png.
"""

import itertools
import json
from pathlib import Path

import browser as rig
import display_bench as bench
import pytest
from contact_sheet import contact_sheet
from gaitd_client import Cause, Event, EventCode, Mode, Stage, Trainer
from gaitd_display.__main__ import utc_ahead_ns
from gaitd_display.engineer import EngineerServer

from gaitd_lab.testing.trainer import virtual_trainer
from sim_drives.plant.truth import TruthRow

pytestmark = pytest.mark.rig_browser

SIZES = ((1280, 800), (1600, 900), (1920, 1080))
SCHEMES = ("light", "dark")
LEGS = (("right",), ("right", "left"))
AHEAD_NS = bench.BEGAN_NS
"""UTC of the player's messages less its clock, which stands in for the computer's."""
LONG = "over-current of the power stage while the leg was braked"
STOPPED = {"mode": Mode.FAULT, "cause": Cause.HAND_SWITCH_OPEN, "switch": False}
SCENES = {
    "walking": {"top_w": 40.0},
    "at_rest": {"mode": Mode.READY, "validity": "split_unobservable"},
    "stopped": STOPPED,
}
DOCS = Path(__file__).parents[2] / "docs"
STOPPED_MS = 2_000
APART_MAX_NM = 4.0
LOOKS = 8
"""Looks at a leg in motion, over a stride."""
STRIDE_CYCLES = 200
"""Cycles of a stride in the pictures; the other tests have faster ones."""
CURVES_MS = 15_000
"""Longer than the curves, so that they are full."""
TEXTS = ("--ink", "--soft", "--estimate", "--true", "--friction", "--blue-ink", "--vermillion-ink")
SYMBOLS = ("--estimate-line", "--true", "--friction", "--edge", "--green", "--vermillion", "--mode")


@pytest.fixture(scope="module")
def chromium():
    with rig.chromium() as browser:
        yield browser


def served(trainer, folder, **given):
    return rig.Site(
        lambda made: EngineerServer(made, trainer, lambda: AHEAD_NS),
        bench.engineer_table(**given),
        folder,
        rig.KINDS["engineer"],
    )


@pytest.fixture(params=LEGS, ids=len)
def trainer(request):
    return bench.MessageTrainer(request.param)


@pytest.fixture
def site(trainer, tmp_path):
    with served(trainer, tmp_path) as site:
        yield site


@pytest.fixture
def player(trainer, site):
    with rig.Player(trainer) as player:
        yield player


@pytest.fixture
def tab(chromium, site, player):
    tab = rig.Tab(chromium, site, rig.SHOTS, size=SIZES[1])
    yield tab
    tab.page.close()
    assert tab.errors == []
    assert tab.foreign == []


one_leg = pytest.mark.parametrize("trainer", LEGS[:1], indirect=True, ids=len)
two_legs = pytest.mark.parametrize("trainer", LEGS[1:], indirect=True, ids=len)


def speak_of(trainer, number):
    event = {"id": str(number), "time_ns": AHEAD_NS + trainer.clock.ns}
    values = {"category": "S1", "cause": "drive_fault", "finding": "emcy", "value": 0x2310}
    event |= {"code": "stopped", "cause": "drive_fault", "said": LONG, "values": values}
    event |= {"subject": "right/hip", "kind": "stop", "priority": "high"}
    trainer.send("events", bench.filled(Event, **event))


def test_each_state_is_readable_at_each_size_and_in_both_schemes(tab, player, trainer):
    for number in range(12):
        speak_of(trainer, number)
    for name, scene in SCENES.items():
        player.play(**scene)
        word = {"walking": "moving", "at_rest": "resting", "stopped": "stopped"}[name]
        for scheme, (width, height) in itertools.product(SCHEMES, SIZES):
            tab.page.set_viewport_size({"width": width, "height": height})
            tab.page.emulate_media(color_scheme=scheme)
            tab.word(word)
            tab.until("document.querySelectorAll('#driverows tr').length > 3")
            for _ in range(LOOKS if name == "walking" else 2):
                tab.page.wait_for_timeout(80)
                assert tab.misplaced_texts() == [], (name, scheme, width)
            assert "NaN" not in tab.page.inner_text("body")
            assert tab.page.locator("#eventlist li").count() > 0, (name, scheme, width)
            said = "S1: The hand switch was let go" if name == "stopped" else ""
            assert tab.page.inner_text("#verdict") == said
            tab.shot(f"engineer_{len(trainer.legs)}_{name}_{scheme}_{width}")
            assert tab.violations() == []
    assert trainer.requests == []


PICTURED = {
    "bring_up": (
        {
            **{"mode": Mode.OFF, "cause": Cause.BRING_UP_FAILED, "switch": False},
            **{"pose": (None, None), "validity": "bad", "fresh": False},
        },
        "resting",
    ),
    "ready": (SCENES["at_rest"], "resting"),
    "gait": ({"top_w": 4.0}, "moving"),
    "stopped": (STOPPED | {"validity": "split_unobservable"}, "stopped"),
    "bad": (
        {"mode": Mode.GAIT, "stage": Stage.PLAYING, "phase": 0.3, "validity": "bad"},
        "moving",
    ),
    "no_signal": (None, "no_signal"),
}
"""States of docs/pages_in_pictures.md in the order in which they are played, and their words."""
TOLD = {
    "bring_up": [
        (EventCode.BRING_UP_BEGUN, {}),
        (
            EventCode.BRING_UP_FAILED,
            {
                **{"subject": "right/slide", "priority": "high"},
                "said": "1018h:02 product code is 0x60500000, expected 0x60510000",
            },
        ),
    ],
    "ready": [(EventCode.BRING_UP_BEGUN, {}), (EventCode.DRIVES_UP, {})],
    "gait": [(EventCode.REQUEST_DONE, {"values": {"request": "mode", "mode": "gait"}})],
    "stopped": [
        (EventCode.HAND_SWITCH_OPENED, {}),
        (
            EventCode.STOPPED,
            {
                **{"priority": "medium", "kind": "stop", "cause": "hand_switch_open"},
                "values": {"category": "S1", "cause": "hand_switch_open"},
            },
        ),
    ],
    "bad": [(EventCode.REQUEST_DONE, {"values": {"request": "mode", "mode": "gait"}})],
    "no_signal": [],
}
"""Events of each state, by their code."""
AFTER_GAIT = {"stopped", "bad"}
WHOLE = {"bring_up", "gait"}
"""States that fill the curves."""
DESK, TABLET, PHONE = (1280, 800), (820, 1180), (390, 844)
SHEETS = {
    "engineer_bring_up": ([("bring_up", "light", DESK)], 1, 1000),
    "engineer_ready": ([("ready", "light", DESK)], 1, 1000),
    "engineer_gait": ([("gait", "light", DESK)], 1, 1000),
    "engineer_stopped": ([("stopped", "light", DESK)], 1, 1000),
    "engineer_lost": ([(name, "light", DESK) for name in ("bad", "no_signal")], 1, 1000),
    "engineer_dark": ([(name, "dark", DESK) for name in ("gait", "stopped")], 1, 1000),
    "engineer_tablet": ([(name, "light", TABLET) for name in ("gait", "stopped")], 2, 480),
    "engineer_phone": (
        [(name, "light", PHONE) for name in ("gait", "stopped", "no_signal")],
        *(3, 320),
    ),
}
"""Each picture: states with scheme and size, columns, and width of each."""
NOT_WHOLE = """(() => {
    const edge = document.querySelector('#mechanism').getBoundingClientRect();
    const texts = [...document.querySelectorAll('#mechanism .over.value, #readouts div')];
    const boxes = texts.map((text) => text.getBoundingClientRect());
    const meet = (a, b) =>
        a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    return texts.filter((_, one) => {
        const box = boxes[one];
        const isOut = box.left < edge.left || box.right > edge.right || box.bottom > edge.bottom;
        const limbs = [...document.querySelectorAll('#mechanism .fig-leg')];
        const isNumber = texts[one].matches('#readouts div');
        return isOut || (isNumber && limbs.some((limb) => meet(box, limb.getBoundingClientRect())));
    }).map((text) => text.textContent);
})()"""
"""Numbers that are cut off at the edge of the mechanism, or lie over a leg."""


@pytest.mark.thorough
@pytest.mark.timeout(600)
@one_leg
def test_the_states_of_the_guide_are_pictures(tab, player, trainer, pictures, monkeypatch):
    monkeypatch.setattr(rig, "STRIDE", STRIDE_CYCLES)
    wanted = dict.fromkeys(one for shots, *_ in SHEETS.values() for one in shots)
    shots = {}
    for name, (scene, word) in PICTURED.items():
        if name in AFTER_GAIT:
            player.play(**PICTURED["gait"][0])
            tab.page.wait_for_timeout(CURVES_MS)
        for code, given in TOLD[name]:
            fields = {"id": f"{name} {code}", "time_ns": AHEAD_NS + trainer.clock.ns, "code": code}
            trainer.send("events", bench.filled(Event, **fields, **given))
        if scene is None:
            player.fall_silent()
        else:
            player.play(**scene)
        tab.word(word)
        tab.page.wait_for_timeout(CURVES_MS if name in WHOLE else STOPPED_MS)
        for _, scheme, (width, height) in [one for one in wanted if one[0] == name]:
            tab.page.emulate_media(color_scheme=scheme)
            tab.page.set_viewport_size({"width": width, "height": height})
            tab.page.wait_for_timeout(600)
            tab.word(word)
            assert "NaN" not in tab.page.inner_text("body")
            shots[name, scheme, (width, height)] = tab.page.screenshot()
    for sheet, (names, columns, width) in SHEETS.items():
        contact_sheet(pictures / f"{sheet}.png", [shots[one] for one in names], columns, width)


@pytest.mark.thorough
@two_legs
def test_two_legs_are_pictures(tab, player, pictures, monkeypatch):
    monkeypatch.setattr(rig, "STRIDE", STRIDE_CYCLES)
    player.play(**PICTURED["gait"][0])
    tab.word("moving")
    tab.page.wait_for_timeout(CURVES_MS)
    for name, (width, height), wide in (("tablet", TABLET, 480), ("phone", PHONE, 320)):
        tab.page.set_viewport_size({"width": width, "height": height})
        tab.page.wait_for_timeout(600)
        tab.page.evaluate("window.scrollTo(0, 0)")
        whole = [tab.page.screenshot()]
        tab.page.evaluate("document.querySelector('#drives').scrollIntoView()")
        tab.page.wait_for_timeout(300)
        whole.append(tab.page.screenshot())
        contact_sheet(pictures / f"engineer_two_legs_{name}.png", whole, columns=2, width=wide)


@two_legs
def test_the_numbers_of_two_legs_are_whole_on_a_phone(tab, player):
    """The page scrolls there; the mechanism is at its top."""
    player.play(**SCENES["walking"])
    tab.word("moving")
    tab.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    tab.page.wait_for_timeout(600)

    assert tab.page.evaluate(NOT_WHOLE) == []


@one_leg
def test_the_colours_have_contrast_in_both_schemes(tab):
    for scheme in SCHEMES:
        tab.page.emulate_media(color_scheme=scheme)
        texts = [*((name, "--card") for name in TEXTS), ("--on-mode", "--mode")]
        assert {pair: ratio for pair, ratio in tab.contrasts(texts) if ratio < 4.5} == {}, scheme
        symbols = [(name, "--card") for name in SYMBOLS]
        assert {pair: ratio for pair, ratio in tab.contrasts(symbols) if ratio < 3} == {}, scheme


def values(tab):
    """What the page says as a number; none of it may be 0 where nothing is known."""
    said = "[...document.querySelectorAll('#readouts dd, .plot .now, #driverows tr, .over.value')]"
    return tab.page.evaluate(f"{said}.map((element) => element.textContent)")


@one_leg
def test_what_is_not_known_is_a_dash_and_the_page_recovers_by_itself(tab, player, site):
    player.play(top_w=40.0)
    tab.word("moving")
    tab.until("document.querySelector('#power_right').textContent.match(/[0-9]/)")
    player.play(**SCENES["at_rest"])
    tab.until("document.querySelector('.plot .now').textContent.startsWith('net −1.5 N·m')")
    assert tab.page.locator("#power_right").inner_text() == "– W"

    player.fall_silent()
    tab.word("no_signal")
    is_silent = "document.querySelector('.plot .now').textContent.startsWith('– N·m')"
    tab.page.wait_for_timeout(50)
    tab.until(is_silent)
    said = values(tab)
    assert len(said) > 4
    assert [text for text in said if any(letter.isdigit() for letter in text)] == []
    assert tab.page.locator("#nopose").is_visible()
    assert tab.misplaced_texts() == []
    tab.shot("engineer_no_signal")
    assert tab.violations() == []
    player.play(top_w=40.0)
    player.speak()
    tab.word("moving")

    site.end()
    tab.word("no_connection")
    tab.until(is_silent)
    tab.shot("engineer_no_connection")
    assert tab.misplaced_texts() == []
    site.start()
    tab.word("moving")
    tab.until("document.querySelector('#nopose').hidden")


PAINTED = """(canvas, name) => {
    document.body.style.color = `var(${name})`;
    const colour = getComputedStyle(document.body).color.match(/[0-9]+/g).map(Number);
    document.body.style.color = "";
    const { width, height } = canvas;
    const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
    let count = 0;
    for (let at = 0; at < data.length; at += 4) {
        if (colour.every((part, index) => Math.abs(data[at + index] - part) < 3)) count += 1;
    }
    return count;
}"""
"""Pixels of a colour."""


class Truth:
    """A file like that of the virtual drives, with a row for each cycle of the player."""

    def __init__(self, path):
        self._file = path.open("w", encoding="utf-8")
        self._file.write(",".join(TruthRow._fields) + "\n")

    def add(self, sync_ns, hip_nm):
        cells = dict.fromkeys(TruthRow._fields, "0") | {"hip_patient_nm": str(hip_nm)}
        self._file.write(",".join((cells | {"sync_mono_ns": str(sync_ns)}).values()) + "\n")
        self._file.flush()

    def close(self):
        self._file.close()


@one_leg
def test_the_truth_of_virtual_drives_is_a_curve_of_its_own_and_absent_without_a_file(
    chromium, trainer, tmp_path
):
    path = tmp_path / "truth.csv"
    with served(trainer, tmp_path, truth=str(path)) as site, rig.Player(trainer) as player:
        tab = rig.Tab(chromium, site, rig.SHOTS, size=SIZES[1])
        player.play(top_w=4.0)
        tab.word("moving")
        tab.until("document.querySelector('.plot canvas') !== null")
        tab.page.wait_for_timeout(500)
        canvas = tab.page.locator(".plot canvas").first
        assert not tab.page.locator("#keytrue").is_visible()
        assert canvas.evaluate(PAINTED, "--true") == 0
        assert canvas.evaluate(PAINTED, "--estimate-line") > 50

        truth = Truth(path)
        play = trainer.cycles

        def with_truth(*words, **named):
            truth.add(trainer.clock.ns + 10_000_000, 9.5)
            play(*words, **named)

        trainer.cycles = with_truth
        tab.until("document.querySelector('.plot .now').textContent.includes('true 9.5')")
        tab.until(f"({PAINTED})(document.querySelector('.plot canvas'), '--true') > 50")
        tab.until("document.querySelector('#keytrue').checkVisibility()")
        assert tab.page.locator("#sim").is_visible()
        tab.shot("engineer_truth")
        trainer.cycles = play
        tab.until("document.querySelector('#keytrue').hidden")
        truth.close()
        assert [error for error in tab.errors if "getImageData" not in error] == []
        tab.page.close()


@one_leg
def test_a_page_that_is_opened_later_has_the_last_minute(tab, player, trainer, chromium, site):
    player.play(**SCENES["at_rest"])
    tab.word("resting")
    player.play(**STOPPED)
    tab.word("stopped")
    player.play(top_w=40.0)
    tab.word("moving")
    later = rig.Tab(chromium, site, rig.SHOTS, size=SIZES[0])
    later.word("moving")
    shown = "[...document.querySelectorAll('#timeline .seg')].map((one) => one.className.baseVal)"
    later.until(
        f"['resting', 'stopped', 'moving'].every((name) => {shown}.includes(`seg ${{name}}`))"
    )
    later.page.close()
    past = json.loads(tab.page.request.get(f"{site.address}/past.json").text())
    assert set(past["rows"]) == {"right", "left"}
    assert past["rows"]["left"] == []


@one_leg
def test_the_page_has_no_button_and_its_server_no_request_that_changes_anything(tab, site):
    assert tab.page.locator("button, input, a, form").count() == 0
    for path in ("/stop", "/act", "/plan", "/session"):
        answer = tab.page.request.post(f"{site.address}{path}", headers={"origin": site.address})
        assert answer.status == 404


TIME_GOES_ON = """
window.beforeFed = (frame, number) => {
  const time_ms = window.begunMs + number * 1000 / 60;
  frame.now.time_ms = time_ms;
  for (const { row } of frame.now.legs) if (row !== null) row[0] = time_ms;
  if (frame.now.second !== null) frame.now.second.time_ms = 1000 * Math.floor(time_ms / 1000);
  for (const item of frame.items) item.time_ms = time_ms;
};
window.begunMs = 1_800_000_000_000 + 3_600_000;
"""
"""The frames that are fed have the times of an hour."""


@one_leg
def test_the_memory_of_the_engineer_s_page_is_flat_over_twenty_minutes(tab, player, trainer):
    tab.page.add_init_script(TIME_GOES_ON)
    scenes = (lambda: player.play(**STOPPED), lambda: player.play(top_w=40.0))
    speak_of(trainer, 1)
    count = rig.HOUR_FRAMES // 3  # it keeps a minute, and 200 strides; both looks are in one scene
    rig.is_flat(tab, trainer, scenes, count, nodes_apart=10)  # texts of short segments


def strides(count):
    return f"document.querySelectorAll('#timeline .stride:not(.none)').length >= {count}"


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("file", "shot"),
    [
        ("demo.toml", "engineer"),
        pytest.param("two_legs.toml", "engineer_two_legs", marks=pytest.mark.thorough),
    ],
)
def test_a_running_service_is_shown_beside_the_truth(chromium, tmp_path, pytestconfig, file, shot):
    is_for_readme = pytestconfig.option.write_pages and shot == "engineer"
    with virtual_trainer(trainer_file=file, pace=1) as service:
        table = bench.engineer_table(truth=str(service.truth_path))
        table["trainer"] = {"endpoint": service.endpoint, "trainer": service.trainer}
        trainer = Trainer(service.endpoint, trainer=service.trainer)
        with rig.Site(
            lambda made: EngineerServer(made, trainer, utc_ahead_ns),
            table,
            tmp_path,
            rig.KINDS["engineer"],
        ) as site:
            tab = rig.Tab(chromium, site, DOCS if is_for_readme else rig.SHOTS, size=SIZES[1])
            tab.page.emulate_media(color_scheme="dark")
            service.patient("active")
            service.gait(cadence_hz=0.4, amplitude_ratio=0.8)
            tab.word("moving")
            tab.until("!document.querySelector('#keytrue').hidden")
            tab.until(strides(5), within_s=120)
            service.tell("hand_switch_open *")
            tab.word("stopped")
            tab.page.wait_for_timeout(STOPPED_MS)
            service.tell("clear hand_switch_open *")
            service.gait(cadence_hz=0.4, amplitude_ratio=0.8)
            tab.word("moving")
            tab.until(strides(11), within_s=120)
            past = json.loads(tab.page.request.get(f"{site.address}/past.json").text())
            drives = "document.querySelector('#driverows').textContent"  # a busy computer is late
            tab.until(f"document.body.dataset.word === 'moving' && {drives}.includes('enabled')")
            tab.shot(shot)
            assert tab.misplaced_texts() == []
            assert tab.errors == []
            tab.page.close()

    for leg in service.table["leg"]:
        rows = [dict(zip(past["columns"], one, strict=True)) for one in past["rows"][leg["name"]]]
        both = [(row["hip_patient_nm"], row["hip_true_nm"]) for row in rows]
        known = [(one, true) for one, true in both if one is not None and true is not None]
        assert len(known) > 0.5 * len(rows)
        # The truth of another leg or axis, or none, would be off by the effort's own size, 8 N m.
        assert max(abs(one - true) for one, true in known) < APART_MAX_NM
