"""The therapist's page in headless Chromium: each state, size, scheme, language; what it requests.

Screenshots of all states are written to out/display; with --write-pages those of
docs/pages_in_pictures.md to docs/pictures.
"""

import contextlib
import itertools
from enum import StrEnum

import browser as rig
import display_bench as bench
import gaitd_names as names
import pytest
from contact_sheet import contact_sheet
from gaitd_client import AxisPlan, Cause, Event, Mode, PlanLimits, RefusalCode
from gaitd_display.login import hash_password
from gaitd_display.therapist import TherapistServer
from gaitd_names import NMT_STATES, POWER_STATES
from gaitd_session import Why
from gaitd_session.profile import read_profile
from gaitd_session.report import report
from gaitd_session.store import (
    BlockRow,
    EndRow,
    GoalRow,
    InterruptionRow,
    MarkRow,
    SessionRow,
    Store,
    StrideRow,
)
from gaitd_texts import Reader, catalogue
from page_words import english_in
from training import PROFILE

pytestmark = pytest.mark.rig_browser

PASSWORD = "correct horse battery staple"
DAY_NS = 86_400_000_000_000
STRIDE_NS = 4_500_000_000
SIZES = ((1280, 800), (1920, 1080), (800, 1280), (390, 844))
LANGUAGES = ("en", "de")
SCHEMES = ("light", "dark")
LEGS = (("right",), ("right", "left"))
AT_REST = {"validity": "split_unobservable"}
SCENES = {
    "walking": {"top_w": 3.5},
    "hold": {"mode": Mode.HOLD, "relative": True, **AT_REST},
    "ready": {"mode": Mode.READY, **AT_REST},
    "guiding": {"mode": Mode.HAND_GUIDING, "validity": "bad"},
    "stopped": {"mode": Mode.FAULT, "cause": Cause.SPASM, **AT_REST},
    "no_signal": None,
}
WORDS = {
    "walking": "moving",
    "hold": "holding",
    "ready": "resting",
    "guiding": "moving",
    "stopped": "stopped",
    "no_signal": "lost",
}
CASES = [
    (state, size, LANGUAGES[(one + other) % 2], SCHEMES[(one + other // 2) % 2])
    for one, state in enumerate(SCENES)
    for other, size in enumerate(SIZES)
]
"""Each pair of state, size, language and scheme at least once."""
LONG_PROFILE = PROFILE.replace("duration_s = 10.0", "duration_s = 480.0").replace(
    "duration_s = 12.0", "duration_s = 720.0"
)
CODES = {
    name
    for kind in vars(names).values()
    if isinstance(kind, type) and issubclass(kind, StrEnum)
    for name in kind
    if "_" in name
} | {name for name in (*POWER_STATES, *NMT_STATES.values()) if "_" in name}
SAID = """[document.body.innerText, ...[...document.querySelectorAll('[aria-label]')].map(
    (element) => element.getAttribute('aria-label'))].join(' ')"""
EVENTS = (
    {
        "code": "mode_changed",
        "kind": "mode",
        "values": {"mode_before": "hold", "mode": "hand_guiding", "trigger": "to_hand_guiding"},
    },
    {
        "code": "stopped",
        "kind": "stop",
        "priority": "high",
        "cause": "velocity_limit",
        "subject": "right/hip",
        "values": {
            "category": "S1",
            "cause": "velocity_limit",
            "value": 3.1,
            "limit": 3.0,
            "finding": "none",
        },
    },
    {
        "code": "nmt_state_changed",
        "kind": "drive",
        "subject": "right/slide",
        "values": {"nmt_state": "pre_operational"},
    },
    {
        "code": "calibration_advised",
        "priority": "low",
        "subject": "right/hip",
        "values": {"friction_error_si": 0.6, "correlation": 0.7},
    },
    {
        "code": "request_answered",
        "kind": "request",
        "priority": "medium",
        "values": {
            "request": "mode",
            "client": "session.home",
            "outcome": "refused",
            "refusal": "not_in_this_mode",
            "trigger": "to_gait",
            "mode": "bringing_up",
        },
    },
)
NAMES = (
    "session.home",
    "7f3k9m2q",
    "right knee",
    "Jan Feb Mär Apr Mai Jun Jul Aug Sep Okt Nov Dez W s",
)
"""What the tests name, months and units."""
GERMAN_MODES = {mode: catalogue(Reader.OPERATOR, "de").text(f"mode.{mode}") for mode in Mode}
IS_OPEN = "document.body.dataset.page === 'therapist' && document.querySelector('.leg') !== null"


@pytest.fixture(scope="module")
def chromium():
    with rig.chromium() as browser:
        yield browser


@pytest.fixture
def trainer(request):
    made = bench.MessageTrainer(getattr(request, "param", LEGS[1]))
    made.plan = PlanLimits(cadence_max_hz=0.4, amplitude_max_ratio=0.8, duration_max_s=1200)
    return made


one_leg = pytest.mark.parametrize("trainer", LEGS[:1], indirect=True, ids=len)


@pytest.fixture(scope="module")
def password_hash():
    return hash_password(PASSWORD)


def stride_at(end_ns, share):
    return StrideRow(1, "right", end_ns, 2.0, share, 0.02, 5.0, -1.0, share is not None)


@contextlib.contextmanager
def a_session_going_on(file):
    """Nine sessions, one a day; the third has no valid stride, the last goes on."""
    reasons = (Cause.SPASM, Why.LATE_HERE, RefusalCode.HAND_SWITCH_OPEN)
    with Store(file, is_writer=True) as store:
        for day, share in enumerate((0.31, 0.28, None, 0.34, 0.33, 0.38, 0.36, 0.41, 0.43)):
            begun_ns = bench.BEGAN_NS + day * DAY_NS
            strides = [
                stride_at(begun_ns + n * STRIDE_NS, share and share + (n * 5 % 7 - 3) / 100)
                for n in range(120)
            ]
            walked = BlockRow(1, "warm_up", 0.5, 0.4, 600.0, 480.0 + 10 * day)
            goal = GoalRow(1, "right", 0.25 + 0.015 * day, 0.27 + 0.015 * day)
            store.write([SessionRow("7f3k9m2q", "trainer", begun_ns), *strides, walked, goal])
            if day < 8:
                end = "complete" if share else "left"
                reason = InterruptionRow(begun_ns, "stopped", reasons[day % 3])
                store.write([*([reason] if day % 2 else []), EndRow(begun_ns, end)])
            else:
                store.write([MarkRow("7f3k9m2q", begun_ns, "right knee", is_before=False)])
        yield


@pytest.fixture
def desk(chromium, trainer, tmp_path, password_hash):
    with opened(chromium, trainer, tmp_path, password_hash) as desk:
        yield desk


@contextlib.contextmanager
def opened(chromium, trainer, folder, password_hash, **given):
    table = bench.therapist_table(password_hash, legs=trainer.legs) | given
    table = bench.with_session(table, folder, LONG_PROFILE)
    with (
        a_session_going_on(folder / "history.sqlite"),
        rig.Site(
            lambda made: TherapistServer(made, trainer, trainer.clock),
            table,
            folder,
            rig.KINDS["therapist"],
        ) as site,
        rig.Player(trainer) as player,
    ):
        tab = rig.Tab(chromium, site, rig.SHOTS)
        yield tab, player
        tab.page.close()
    assert tab.errors == []
    assert tab.foreign == []


def login(tab):
    tab.until("document.body.dataset.page === 'login'")
    tab.page.fill("#password", PASSWORD)
    tab.page.click("#login button")
    tab.until(IS_OPEN)


def speak(tab, trainer):
    for number, event in enumerate(EVENTS):
        given = {"kind": "note", "priority": "info", **event, "id": str(number)}
        given["time_ns"] = bench.BEGAN_NS + number * 10_000_000_000
        trainer.send("events", bench.filled(Event, **given))
    tab.until(f"document.querySelectorAll('#eventlist time').length === {len(EVENTS)}")


def show(tab, size, language="en", scheme="light"):
    tab.page.set_viewport_size({"width": size[0], "height": size[1]})
    tab.page.emulate_media(color_scheme=scheme)
    if tab.page.evaluate("document.documentElement.lang") != language:
        tab.page.click("#language")
    tab.until(f"document.documentElement.lang === '{language}'")


HEIGHT = """['#top', '#main, #entrance', 'footer'].reduce(
    (sum, part) => sum + document.querySelector(part).scrollHeight, 4)"""
IS_WHOLE = """['#page', '#main, #entrance'].map((part) => document.querySelector(part)).every(
    (one) => one.scrollHeight <= one.clientHeight + 1)"""


def misplaced(tab):
    """What is wrong with the texts of the whole page, in a window that nothing scrolls in.

    A busy computer may lose the connection for a moment, which makes the page longer.
    """
    size = tab.page.viewport_size
    for _ in range(10):
        height = max(size["height"], tab.page.evaluate(HEIGHT))
        tab.page.set_viewport_size({**size, "height": height})
        tab.page.evaluate(rig.PAINTED_TWICE)
        tab.page.wait_for_timeout(150)  # the curves and paths have their new size
        was_whole = tab.page.evaluate(IS_WHOLE)
        found = tab.misplaced_texts()
        if was_whole and tab.page.evaluate(IS_WHOLE):
            break
    tab.page.set_viewport_size(size)
    return found


def violations(tab):
    """What axe-core finds twice: a busy computer may lose the connection while it looks."""
    found = tab.violations()
    return found and [one for one in tab.violations() if one in found]


def test_the_cases_hold_every_pair():
    for one, other in itertools.combinations(range(4), 2):
        wanted = {case[one] for case in CASES}, {case[other] for case in CASES}
        assert {(case[one], case[other]) for case in CASES} == set(itertools.product(*wanted))


@pytest.mark.timeout(300)
def test_each_state_is_whole_readable_and_without_a_code_at_each_size(desk, trainer):
    tab, player = desk
    login(tab)
    speak(tab, trainer)
    player.play(**SCENES["walking"])
    tab.until("document.querySelectorAll('.path .mark').length > 4")
    for state, rows in itertools.groupby(CASES, key=lambda case: case[0]):
        if SCENES[state] is None:
            player.fall_silent()
        else:
            player.play(**SCENES[state])
        checked = set()
        for _, size, language, scheme in rows:
            where = (state, size, language, scheme)
            tab.word(WORDS[state])
            show(tab, size, language, scheme)
            tab.until("document.querySelector('#sessions tr') !== null")
            assert misplaced(tab) == [], where
            stop = "STOPP" if language == "de" else "STOP"
            assert tab.unreachable(stop) == [], where
            said = tab.page.evaluate(SAID)
            assert [code for code in CODES if code in said] == [], where
            assert language == "en" or english_in([said], NAMES) == set(), where
            if scheme not in checked:
                checked.add(scheme)
                assert violations(tab) == [], where
            tab.word(WORDS[state])
            if state != "no_signal":
                label = "label.relative" if state == "hold" else "label.no_baseline"
                sentence = catalogue(Reader.OPERATOR, language).text(label)
                tab.until(f"document.body.innerText.includes({sentence!r})")
            tab.shot("_".join(("therapist", state, language, scheme, str(size[0]))))
    player.speak()


@pytest.mark.thorough
@one_leg
def test_the_states_of_the_guide_are_pictures(chromium, desk, pictures, tmp_path):
    tab, player = desk
    login(tab)
    show(tab, (1280, 800))
    tab.until("document.querySelector('#sessions tr') !== null")
    shots = {}
    for state in ("ready", "walking", "stopped"):
        player.play(**SCENES[state])
        tab.word(WORDS[state])
        if state == "walking":
            tab.until("document.querySelectorAll('.path .mark').length > 4")
        tab.page.wait_for_timeout(700)  # buttons that have just appeared are pale
        tab.word(WORDS[state])
        shots[state] = tab.page.screenshot()
    player.play(**SCENES["walking"])
    show(tab, (1280, 800), scheme="dark")
    tab.word("moving")
    contact_sheet(pictures / "therapist_dark.png", [tab.page.screenshot()], columns=1, width=880)
    for state, shot in shots.items():
        contact_sheet(pictures / f"therapist_{state}.png", [shot], columns=1, width=1000)
    with Store(tmp_path / "history.sqlite", is_writer=False) as store:
        profile = read_profile(tmp_path / "profile.toml")
        page = report(store, profile, 8, catalogue(Reader.OPERATOR, "en"))
    paper = chromium.new_page(viewport={"width": 900, "height": 1000})
    paper.set_content(page)
    contact_sheet(pictures / "session_report.png", [paper.screenshot()], columns=1, width=800)
    paper.close()


@pytest.mark.thorough
def test_two_legs_are_a_picture(desk, pictures):
    tab, player = desk
    login(tab)
    player.play(**SCENES["walking"])
    tab.until("document.querySelectorAll('.path .mark').length > 8")
    shots = []
    for size in ((820, 1180), (390, 844)):
        show(tab, size)
        tab.page.wait_for_timeout(300)
        shots.append(tab.page.screenshot())
    contact_sheet(pictures / "therapist_two_legs_tablet.png", shots[:1], columns=1, width=640)
    contact_sheet(pictures / "therapist_two_legs_phone.png", shots[1:], columns=1, width=320)


@one_leg
def test_a_trainer_with_one_leg_fills_the_page(desk):
    tab, player = desk
    login(tab)
    player.play(**SCENES["walking"])
    tab.until("document.querySelectorAll('.path .mark').length > 4")
    for index, size in enumerate((*SIZES, (640, 400))):
        show(tab, size, LANGUAGES[index % 2], SCHEMES[index // 2 % 2])
        assert misplaced(tab) == [], size
        tab.shot(f"therapist_one_leg_{size[0]}")
    assert tab.page.locator(".leg").count() == 1


def test_the_login_page_is_whole_and_has_stop(desk, trainer):
    tab, _ = desk
    tab.until("document.body.dataset.page === 'login'")
    for index, size in enumerate(SIZES):
        show(tab, size, LANGUAGES[index % 2], SCHEMES[index // 2])
        assert misplaced(tab) == []
        assert violations(tab) == []
        tab.shot(f"login_{size[0]}")
    show(tab, SIZES[0])
    tab.page.fill("#password", "a wrong password")
    tab.page.click("#login button")
    tab.until("document.querySelector('#answer').textContent === 'Wrong password.'")
    tab.page.click("#stop")
    tab.until("document.querySelector('#stop_done').checkVisibility()")
    assert trainer.requests == [("stop",)]
    assert tab.unreachable("STOP") == []  # what it tells is not over it
    assert misplaced(tab) == []


def test_the_colours_have_contrast_in_both_schemes(desk):
    tab, _ = desk
    inks = ("--ink", "--soft", "--blue-ink", "--green-ink", "--orange-ink", "--vermillion-ink")
    texts = [*((ink, "--card") for ink in inks), ("--soft", "--paper"), ("--soft", "--shade")]
    texts += [("--ink", f"--{tint}-tint") for tint in ("vermillion", "green", "grey", "orange")]
    texts += [("--soft", "--vermillion-tint"), ("--stop-ink", "--stop")]
    symbols = [(name, "--card") for name in ("--edge", "--blue-ink", "--orange-ink", "--ink")]
    symbols += [("--green-ink", "--green-tint"), ("--stop", "--card")]
    for scheme in SCHEMES:
        tab.page.emulate_media(color_scheme=scheme)
        for pairs, least in ((texts, 4.5), (symbols, 3)):
            low = {pair: ratio for pair, ratio in tab.contrasts(pairs) if ratio < least}
            assert low == {}, scheme


def test_forced_colours_and_reduced_motion_keep_all_that_is_needed(desk):
    tab, player = desk
    login(tab)
    tab.page.emulate_media(forced_colors="active", reduced_motion="reduce")
    player.play(**SCENES["stopped"])
    tab.until("document.querySelectorAll('#possible button').length === 1")
    assert tab.unreachable("STOP") == []
    assert violations(tab) == []
    border = "getComputedStyle(document.querySelector('#stop')).borderTopWidth"
    assert tab.page.evaluate(border) == "2px"
    tab.shot("therapist_forced_colours")
    player.play(**SCENES["walking"])
    tab.word("moving")
    path = "document.querySelector('.fig-leg.thigh').getAttribute('d')"
    before = tab.page.evaluate(path)
    tab.until(f"{path} !== {before!r}")  # the leg moves: it is data
    glow = "getComputedStyle(document.querySelector('.fig-glow')).transitionDuration"
    assert tab.page.evaluate(glow) == "0s"


FOCUSED = """() => {
    const one = document.activeElement;
    const style = getComputedStyle(one);
    const { left, right, top, bottom } = one.getBoundingClientRect();
    const at = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    const isSeen = at !== null && (one.contains(at) || at.contains(one));
    const isMarked = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 3;
    return [one.id || one.textContent, isSeen && isMarked];
}"""


def test_the_keyboard_reaches_everything_in_order_and_shows_where_it_is(desk):
    tab, player = desk
    login(tab)
    player.play(**SCENES["hold"])
    tab.word("holding")
    tab.until(
        "!document.querySelector('#all').hidden && !document.querySelector('#withdraw').hidden"
    )
    tab.page.evaluate(
        "document.querySelector('#sound').remove()"
    )  # as with a sound that is allowed
    order = []
    while "stop" not in order:
        tab.page.keyboard.press("Tab")
        name, is_seen = tab.page.evaluate(FOCUSED)
        assert is_seen, name
        order.append(name)
        assert len(order) < 40, order
    buttons = [name for name in order if name.startswith(("Move", "Self", "Switch"))]
    fields = [f"f-{name}" for name in ("cadence_max_hz", "amplitude_max_ratio", "duration_max_s")]
    fields += ["f-hip_assist_max", "t-hip_assist_max"]
    fields += ["f-slide_assist_max", "t-slide_assist_max"]
    known = [
        "language",
        "logout",
        *buttons,
        "marktext",
        "markwrite",
        "withdraw",
        "releaseprofile",
        *fields,
    ]
    assert order[: len(known)] == known
    assert order[-3:] == ["all", "editprofile", "stop"]
    assert len(buttons) == 3


def is_german(tab):
    assert english_in([tab.page.evaluate(SAID)], NAMES) == set()


def test_no_english_word_is_on_the_german_page_whatever_is_answered_or_missing(desk, trainer):
    tab, player = desk
    show(tab, SIZES[0], "de")
    tab.page.fill("#password", "a wrong password")
    tab.page.click("#login button")
    tab.until("document.querySelector('#answer').textContent === 'Falsches Kennwort.'")
    is_german(tab)
    login(tab)
    show(tab, SIZES[0], "de")
    speak(tab, trainer)
    tab.page.locator("#events").scroll_into_view_if_needed()
    tab.shot("therapist_german_events")
    for mode in Mode:
        player.play(mode=mode, cause=Cause.SPASM if mode is Mode.FAULT else Cause.NONE, **AT_REST)
        tab.until(f"document.querySelector('#modeword').textContent === {GERMAN_MODES[mode]!r}")
        is_german(tab)
    player.play(mode=Mode.FAULT, cause="of_a_later_version")
    tab.until("document.querySelector('#cause').textContent.includes('of_a_later_version')")
    player.play(**SCENES["hold"])
    tab.word("holding")
    for answer, told in (
        (None, "Erledigt"),
        ("hand_switch_open", "Handschalter"),
        ("sto_active", "STO"),
    ):
        trainer.refusal = answer
        tab.page.wait_for_timeout(620)
        tab.page.click("#possible button")
        tab.until(f"{ASKED}.includes('{told}')")
        is_german(tab)
    trainer.refusal, trainer.silent = None, True
    tab.page.click("#possible button")
    tab.until(f"{ASKED}.includes('nicht geantwortet')")
    is_german(tab)
    trainer.silent = False
    tab.page.fill("#f-duration_max_s", "130")
    is_german(tab)
    tab.shot("therapist_german_answers")
    tab.site.end()
    tab.word("no_connection")
    is_german(tab)
    tab.site.start()
    tab.until("document.body.dataset.page === 'login'")


TOLD = "[data-text], #modeword, #cause, #then, #again, #first"
EMPTY = f"""[...document.querySelectorAll('{TOLD}')].filter(
    (one) => one.checkVisibility() && one.textContent.trim() === '').length"""


def test_without_its_texts_the_page_has_codes_and_values_and_nothing_empty(
    chromium, trainer, tmp_path, password_hash
):
    with bench.catalogues(tmp_path) as folder:
        (folder / "operator.de.toml").write_text("[", encoding="utf-8")
        with opened(chromium, trainer, tmp_path, password_hash, language="de") as (tab, player):
            login(tab)
            speak(tab, trainer)
            player.play(**SCENES["walking"])
            tab.word("moving")
            assert tab.page.inner_text("#modeword") == "mode.other mode=gait"
            tab.until("document.querySelector('#facts').textContent.includes('bus_load load=31')")
            assert "nmt_state_changed nmt_state=pre_operational" in tab.page.text_content("#events")
            player.play(**SCENES["stopped"])
            tab.word("stopped")
            assert tab.page.inner_text("#cause") == "spasm cause=spasm"
            assert tab.page.inner_text("#first") == "first.held"
            assert tab.page.evaluate(EMPTY) == 0
            assert tab.page.locator("#stop span").inner_text() == "STOPP"
            tab.shot("therapist_without_its_texts")


def possible(tab):
    return tab.page.locator("#possible button span").all_inner_texts()


ASKED = "document.querySelector('#answer').textContent"


def test_what_is_possible_is_a_button_and_the_rest_says_why_not(desk, trainer):
    tab, player = desk
    login(tab)
    player.play(**SCENES["ready"])
    tab.word("resting")
    tab.until("document.querySelectorAll('#possible button').length === 1")
    assert possible(tab) == ["Switch on"]
    assert "no stop to end" in tab.page.locator("#impossible li").last.inner_text()
    tab.page.wait_for_timeout(700)
    tab.page.click("#possible button")
    tab.until(f"{ASKED} === 'Done'")
    assert trainer.requests == [("enable",)]

    # A second tap meets another button, which does nothing yet.
    player.play(**SCENES["hold"])
    tab.until("document.querySelectorAll('#possible button').length === 3")
    tab.page.evaluate("document.querySelector('#possible button').click()")
    assert tab.page.evaluate("document.activeElement.id") == "h-controls"
    assert possible(tab) == ["Move by hand", "Self-test", "Switch off"]
    tab.page.wait_for_timeout(700)
    assert trainer.requests == [("enable",)]
    trainer.refusal = "hand_switch_open"
    tab.page.click("#possible button")
    tab.until(f"{ASKED} === 'The machine has refused: the hand switch is not held'")
    trainer.refusal = "of_a_later_version"
    tab.page.click("#possible button")
    tab.until(f"{ASKED} === 'The machine has refused: of_a_later_version'")
    trainer.refusal = None

    player.fall_silent()
    tab.word("lost")
    assert possible(tab) == []
    player.speak()


RELEASE = "document.querySelector('#release')"
WHY_NOT = "document.querySelector('#why').textContent"


def test_a_plan_is_released_by_what_the_therapist_has_filled_in_alone(desk, trainer):
    tab, player = desk
    login(tab)
    player.play(**SCENES["hold"])
    tab.word("holding")
    tab.until("document.querySelector('#planstate').textContent === 'Released'")
    tab.until("document.querySelector('#f-slide_assist_max').placeholder === '0–150'")
    fields = tab.page.locator("#plan input[inputmode]")
    assert [one.input_value() for one in fields.all()] == [""] * 5
    now = "document.querySelectorAll('#plan b')"
    assert tab.page.evaluate(f"[...{now}].map((one) => one.textContent)") == [
        "0.4",
        "80",
        "20",
        "as configured",
        "as configured",
    ]
    assert tab.page.evaluate(f"{RELEASE}.disabled")
    assert tab.page.evaluate(WHY_NOT) == "First fill in all fields."

    show(tab, SIZES[0], "de")
    for name, value in (("cadence_max_hz", "0,35"), ("amplitude_max_ratio", "70")):
        tab.page.fill(f"#f-{name}", value)
    tab.page.fill("#f-duration_max_s", "130")
    assert tab.page.evaluate(WHY_NOT) == "Dauer eines Teils: erlaubt ist 0,01 bis 120"
    tab.page.fill("#f-duration_max_s", "15")
    assert tab.page.evaluate(WHY_NOT) == ("Erst ausfüllen: Hilfe an der Hüfte, Hilfe am Schlitten")
    tab.page.fill("#f-hip_assist_max", "12,5")
    assert tab.page.evaluate(f"{RELEASE}.disabled")
    tab.page.check("#t-slide_assist_max")
    assert not tab.page.evaluate(f"{RELEASE}.disabled")
    assert tab.page.evaluate(WHY_NOT) == ""
    tab.shot("therapist_plan_filled")
    tab.page.click("#release")
    tab.until(f"{ASKED} === 'Erledigt'")
    assert trainer.plan == PlanLimits(
        cadence_max_hz=0.35,
        amplitude_max_ratio=0.7,
        duration_max_s=900,
        hip=AxisPlan(assist_max=12.5),
    )
    assert [one.input_value() for one in fields.all()] == [""] * 5
    assert not tab.page.is_checked("#t-slide_assist_max")

    said = tab.page.locator("#profilesaid").inner_text()
    assert "0,5 Doppelschritte/s, Schritt 60 %, 12 min, Hilfe 10" in said
    tab.page.click("#releaseprofile")
    tab.until("document.querySelectorAll('#plan b')[2].textContent === '12'")
    assert (trainer.plan.duration_max_s, trainer.plan.hip.assist_max) == (720, 10)
    tab.page.click("#withdraw")
    tab.until("document.querySelector('#planstate').textContent === 'Nicht freigegeben'")
    assert trainer.plan is None
    assert not tab.page.locator("#withdraw").is_visible()


def test_a_mark_is_written_with_the_keyboard_and_stays_in_the_field_if_it_is_refused(desk, trainer):
    tab, player = desk
    login(tab)
    player.play(**SCENES["walking"])
    tab.word("moving")
    tab.page.focus("#marktext")
    tab.page.keyboard.type(" right knee ")
    trainer.refusal, trainer.refused = "too_many_marks", {"highest": 10, "window_s": 10}
    tab.page.keyboard.press("Enter")
    tab.until(f"{ASKED}.includes('10 marks in 10 s')")
    trainer.refusal = None
    tab.page.keyboard.press("Enter")
    tab.until(f"{ASKED} === 'Done'")
    assert trainer.requests[-1] == ("mark", "right knee")
    assert tab.page.input_value("#marktext") == ""
    tab.page.keyboard.type("x" * 100)
    assert len(tab.page.input_value("#marktext")) == 80


SAYS = "document.querySelector('#profilesays').textContent"
FIRST_PART = "document.getElementById('p-plan.block[0].duration_s')"


def test_the_profile_is_changed_in_a_form_that_says_what_is_wrong(desk, trainer, tmp_path):
    tab, player = desk
    login(tab)
    player.play(**SCENES["hold"])
    tab.word("holding")
    tab.until("document.querySelector('#editprofile').checkVisibility()")
    tab.page.click("#editprofile")
    tab.until(f"{FIRST_PART}?.value === '720'")
    for index, size in enumerate(((1180, 820), (820, 1180), (390, 844))):
        for scheme in SCHEMES:
            show(tab, size, LANGUAGES[index % 2], scheme)
            assert misplaced(tab) == [], size
            assert violations(tab) == [], size
            tab.page.locator("#profilesave").scroll_into_view_if_needed()
            tab.shot(f"therapist_profile_{size[0]}_{scheme}")

    show(tab, SIZES[0], "de")
    field = tab.page.locator('[id="p-plan.block[0].duration_s"]')
    field.fill("4000")
    tab.page.locator('[id="p-range.cadence_min_hz"]').fill("schnell")
    field.press("Enter")
    tab.until(f"{SAYS} === 'Nicht gespeichert. Falsche Werte: 2'")
    assert tab.page.locator("#profile .wrong").all_inner_texts() == [
        "Langsamstes, 1/s: schnell ist nicht erlaubt, erlaubt ist 0,01 bis 2",
        "Teil 1, Dauer, s: 4000 ist nicht erlaubt, erlaubt ist 5 bis 3600",
    ]
    assert tab.page.evaluate("document.activeElement.id") == "p-range.cadence_min_hz"
    assert violations(tab) == []
    tab.shot("therapist_profile_wrong")
    tab.page.locator('[id="p-range.cadence_min_hz"]').fill("0,2")
    field.fill("500")
    tab.page.click("#addpart")
    tab.page.locator('[id="p-plan.block[1].duration_s"]').fill("60")
    tab.page.check("#haspassive")
    tab.page.locator('[id="p-plan.passive.duration_s"]').fill("80")
    is_german(tab)
    tab.page.click("#editprofile")
    assert not tab.page.is_visible("#profile")
    tab.page.click("#editprofile")
    assert tab.page.locator('[id="p-plan.block[1].duration_s"]').input_value() == "60"
    tab.page.click("#profilesave")
    tab.until(f"{SAYS}.startsWith('Gespeichert')")
    plan = read_profile(tmp_path / "profile.toml").plan
    assert [walk.duration_s for walk in plan.block] == [500, 60]
    assert plan.passive.duration_s == 80
    tab.until("document.querySelectorAll('#partrows tr').length === 4")

    with (tmp_path / "profile.toml").open("a", encoding="utf-8") as opened:
        opened.write("# by another program")
    tab.page.locator("button[data-part='1']").click()
    tab.page.click("#profilesave")
    tab.until(f"{SAYS}.includes('inzwischen geändert')")
    is_german(tab)
    tab.page.click("#profilediscard")
    tab.until("document.querySelectorAll('#profileparts tr').length === 4")


def test_progress_has_a_row_for_each_session_and_says_why_one_was_interrupted(desk):
    tab, _ = desk
    login(tab)
    tab.until("document.querySelectorAll('#sessions tr:not(.why)').length === 6")
    rows = tab.page.locator("#sessions tr:not(.why)")
    assert rows.first.inner_text().split("\t")[1:] == ["9", "120 / 120", "43 %", "0", "goes on"]
    assert "Mark: right knee" in tab.page.locator("#sessions .why").first.inner_text()
    tab.page.click("#all")
    tab.until("document.querySelectorAll('#sessions tr:not(.why)').length === 9")
    assert rows.nth(6).inner_text().split("\t")[2:] == ["0 / 0", "–", "0", "page ended"]
    assert tab.page.locator("#sessions .unknown").count() == 1
    why = tab.page.locator("#sessions .why").all_inner_texts()
    assert "was too slow. The machine went on." in why[1]
    assert "The hand switch was let go" in why[2]
    assert "The patient's leg became stiff" in why[3]
    # Two runs of the curve: the session without a share is a gap.
    assert tab.page.locator("#chart .shares").count() == 2
    assert tab.page.locator("#chart .dot").count() == 8
    assert tab.page.locator("#parttext").inner_text() == "Part 1 of 2, 9 of 20 min"
    tab.page.click("#parts summary")
    assert tab.page.locator("#partrows tr").count() == 2


def test_nothing_is_known_without_a_signal_or_a_connection_and_the_page_recovers_by_itself(desk):
    tab, player = desk
    login(tab)
    is_known = "document.querySelector('.values tbody td').textContent.includes('±')"
    player.play(**SCENES["walking"])
    tab.word("moving")
    tab.until(is_known)

    def is_unknown(word):
        tab.word(word)
        tab.until(f"!{is_known}")
        tab.page.wait_for_timeout(300)
        numbers = (
            "[...document.querySelectorAll('.values tbody td, #drives td:nth-child(n+3), #plan b')]"
        )
        said = tab.page.evaluate(f"{numbers}.map((one) => one.textContent)")
        assert len(said) > 20
        assert set(said) <= {"–", ""}
        assert tab.page.locator(".nopose").first.is_visible()
        assert tab.page.locator("#possible button").count() == 0
        assert tab.page.locator("#loss").is_visible()

    player.fall_silent()
    is_unknown("lost")
    player.speak()
    tab.word("moving")
    tab.until(is_known)
    tab.site.end()
    is_unknown("no_connection")
    assert violations(tab) == []
    tab.shot("therapist_no_connection")
    tab.site.start()
    tab.until("document.body.dataset.page === 'login'")  # its sessions ended with the server


def test_stop_of_the_therapist_s_page_is_in_reach_at_every_size_and_zoom(desk):
    tab, player = desk
    tab.until("document.body.dataset.page === 'login'")
    rig.are_in_reach(tab, rig.STOP)
    login(tab)
    player.play(**SCENES["stopped"])
    tab.until("!document.querySelector('#verdict').hidden")
    rig.are_in_reach(tab, rig.STOP)


TIME_GOES_ON = """
window.beforeFed = (frame, number) => {
  const time_ms = 1_800_003_600_000 + number * 1000 / 60;
  for (const leg of frame.now.legs) if (leg.time_ms !== null) leg.time_ms = time_ms;
  for (const item of frame.items) item.time_ms = time_ms;
};
"""
"""The frames that are fed have the times of an hour."""


def test_the_memory_of_the_therapist_s_page_is_flat_over_ten_minutes_of_frames(desk, trainer):
    tab, player = desk
    login(tab)
    tab.page.add_init_script(TIME_GOES_ON)
    trainer.send(
        "events", bench.filled(Event, id="1", code="core_back", kind="note", priority="info")
    )
    scenes = [
        lambda name=name: player.play(**SCENES[name]) for name in ("stopped", "walking", "hold")
    ]
    count = (
        rig.HOUR_FRAMES // 6
    )  # it keeps 20 s, 200 strides, 50 events; both looks are in one scene
    rig.is_flat(tab, trainer, scenes, count, most_mb=0.1)  # 0.05, of the strides that come to 200


def test_the_therapist_s_alarm_sounds_for_a_stop_at_rest_and_for_a_server_that_is_lost(desk):
    tab, player = desk
    login(tab)
    tab.word("resting")
    player.play(mode=Mode.OFF, cause=Cause.DRIVE_SILENT)
    tab.until("!document.querySelector('#quiet').hidden")
    player.play(mode=Mode.HOLD)
    tab.until("document.querySelector('#quiet').hidden")
    tab.site.end()
    tab.until("!document.querySelector('#quiet').hidden")
    tab.site.start()
