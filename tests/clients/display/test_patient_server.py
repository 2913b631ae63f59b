"""The patient's server over HTTP and WebSocket: what a page gets, and who may ask for what."""

import asyncio
import json
import re
import threading
from types import SimpleNamespace

import display_bench as bench
import pytest
from gaitd_client import Cause, Mode, Stage
from gaitd_display import feed as feed_module
from gaitd_display.feed import ITEMS_MAX, PAGES_MAX, WINDOW, Feed
from gaitd_display.patient import PatientServer
from gaitd_display.settings import FAR_RATIO, PatientSettings
from gaitd_display.therapist_view import StrideItem
from gaitd_display.web import BODY_MAX_BYTES, STATIC, TRY_LATER, working
from gaitd_session.machine import ANNOUNCE_S
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from training import PROFILE

OURS = bench.OURS
FOREIGN = {**OURS, "origin": "http://evil.example"}


@pytest.fixture
def trainer():
    return bench.MessageTrainer()


@pytest.fixture
def client(tmp_path, trainer):
    table = bench.patient_table(tmp_path)
    server = PatientServer(
        bench.settings_of(tmp_path, table, PatientSettings), trainer, trainer.clock
    )
    with TestClient(server.app, base_url=bench.ORIGIN) as client:
        client.server = server
        yield client


@pytest.fixture
def page(client):
    with client.websocket_connect("/live", headers=OURS) as socket:
        yield bench.Page(socket)


# --- what a page gets ---------------------------------------------------------------------------


def test_a_page_follows_the_trainer_and_has_each_stride_once(client, trainer, page):
    assert page.frame()["word"] == "no_signal"
    trainer.cycles(Mode.GAIT, stage=Stage.PLAYING, power_w=4.0, phase=0.1)
    page.until(lambda now: now["word"] == "go_on")
    trainer.step(1, 0.38, 3.0)
    trainer.step(2, None, None)

    now = page.until(lambda now: len(now["steps"]) == 2)

    assert now["legs"][0]["glow_ratio"] == 0.5
    assert [step["share_ratio"] for step in now["steps"]] == [0.38, None]
    with client.websocket_connect("/live", headers=OURS) as later:
        # A page that comes later has those of the past.
        assert bench.Page(later).frame()["steps"] == now["steps"]


def test_every_file_is_our_own_and_nothing_else_may_be_loaded(client):
    answer = client.get("/")
    rules = answer.headers["content-security-policy"]

    assert "default-src 'none'" in rules
    assert "unsafe" not in rules
    assert answer.headers["x-content-type-options"] == "nosniff"
    for file in STATIC.rglob("*.*"):
        served = client.get(f"/static/{file.relative_to(STATIC).as_posix()}")
        assert served.status_code == 200
        assert served.headers["content-security-policy"] == rules
        if file.suffix == ".woff2":
            continue
        text = file.read_text(encoding="utf-8")
        if not {"vendor", "fonts"} & {*file.parts}:
            assert "https://" not in text
            assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
        if file.suffix == ".html":
            assert not re.search(r"<script(?![^>]* src=)", text)
            assert " style=" not in text
            assert "onclick" not in text
    assert client.get("/static/%2e%2e/settings.py").status_code == 404


def test_stop_is_in_the_page_itself_and_bound_before_anything_else(client):
    text = client.get("/").text

    first, *_ = re.findall(r'<script[^>]*src="([^"]+)"', text)
    assert first == "/static/stop.js"
    assert not re.search(r"^import|fetch\((?!\"/stop\")", client.get(first).text, re.MULTILINE)
    assert re.search(r'<button id="stop".*>STOP<.*Not the emergency stop', text)
    assert "{{" not in text


def test_texts_and_the_page_s_own_words_are_served(client):
    assert client.get("/texts.json").json()["de"]["stop"] == "STOPP"
    smallest = f"--t-far: calc({100 * FAR_RATIO:g} * var(--text)"
    assert smallest in client.get("/static/tokens.css").text
    told = client.get("/page.json").json()
    assert told["page"] == {**bench.PAGE, "switch_hand": "right"}
    sizes = {"diagonal_mm": 254.0, "far_mm": 10.516, "far_ratio": 0.078, "text_max_ratio": 1.1}
    assert {name: told[name] for name in sizes} == pytest.approx(sizes, rel=1e-4)
    assert told["announce_s"] == ANNOUNCE_S
    assert set(told["losses"]) == {"no_connection", "too_many_pages"}


# --- who may ask for what -----------------------------------------------------------------------


def test_stop_needs_no_login_and_says_whether_it_arrived(client, trainer):
    assert client.post("/stop", headers=OURS, json={}).json()["outcome"] == "done"
    trainer.silent = True
    unanswered = client.post("/stop", headers=OURS, json={})

    assert trainer.requests == [("stop",)]
    assert (unanswered.status_code, unanswered.json()["outcome"]) == (504, "no_answer")


@pytest.mark.parametrize(
    "headers", [{"host": OURS["host"]}, FOREIGN, {**OURS, "host": "evil.example"}]
)
def test_a_page_of_another_site_can_neither_request_nor_watch(client, trainer, headers):
    for path in ("/stop", "/act"):
        assert client.post(path, headers=headers, json={"action": "reset"}).status_code == 403
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect("/live", headers=headers),
    ):
        pass
    assert trainer.requests == []


def test_another_name_of_this_address_is_refused(client):
    assert client.get("/", headers={"host": "evil.example"}).status_code == 403


def offered(trainer, page, action="reset", mode=Mode.FAULT, cause=Cause.SPASM):
    """Wait until the page offers it."""

    def after_some_cycles(now):
        trainer.cycles(mode, cause=cause, count=20)
        return now["action"] == action

    page.until(after_some_cycles)


def act(client, action):
    answer = client.post("/act", headers=OURS, json={"action": action})
    return answer.status_code, answer.json()["outcome"]


def test_only_the_request_that_the_page_offers_is_sent(client, trainer, page):
    trainer.cycles(Mode.FAULT, cause=Cause.SPASM)
    now = page.until(lambda now: now["step"] == "reset")
    assert now["action"] is None  # a second tap on the button before is no press of this one
    assert act(client, "reset") == (409, "refused")
    for action in ("enable", "hand_guiding", "hold"):
        assert act(client, action) == (409, "refused")
    assert act(client, "gait") == (400, "refused")
    big = b" " * (BODY_MAX_BYTES + 1)
    assert client.post("/act", headers=OURS, content=big).status_code == 400
    assert trainer.requests == []

    for mode, action in (
        (Mode.FAULT, "reset"),
        (Mode.READY, "enable"),
        (Mode.HOLD, "hand_guiding"),
        (Mode.HAND_GUIDING, "hold"),
    ):
        cause = Cause.SPASM if mode is Mode.FAULT else Cause.NONE

        offered(trainer, page, action, mode, cause)
        assert act(client, action) == (200, "done")
    assert [name for name, *_ in trainer.requests] == ["reset", "enable", "mode", "mode"]


def test_a_refusal_of_the_service_is_passed_on_with_its_reason(client, trainer, page):
    offered(trainer, page)
    trainer.refusal = "hand_switch_open"
    answer = client.post("/act", headers=OURS, json={"action": "reset"})

    assert answer.status_code == 409
    told = answer.json()
    assert (told["outcome"], told["reason"]) == ("refused", "hand_switch_open")
    assert told["said"]["de"] == "der Handschalter wird nicht gehalten"


def test_stops_have_threads_of_their_own(client, trainer, page):
    """A request that waits for its answer does not delay a stop."""
    going_on, asked = threading.Event(), threading.Event()

    def slow():
        asked.set()
        assert going_on.wait(30)
        return bench.filled(bench.Reply, request="reset", outcome="done")

    trainer.reset = slow
    offered(trainer, page)
    waiting = threading.Thread(target=act, args=(client, "reset"))
    waiting.start()
    assert asked.wait(30)
    try:
        assert act(client, "reset") == (409, "refused")
        assert client.post("/stop", headers=OURS, json={}).json()["outcome"] == "done"
    finally:
        going_on.set()
        waiting.join()


def test_an_error_of_the_feed_ends_the_server_so_that_systemd_starts_another(caplog):
    async def bug():
        raise KeyError("a bug")

    async def server():
        async with working(bug()):
            await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="stopped before Future completed"):
        asyncio.run(server())
    assert "the server ends" in caplog.text


# --- the training session -----------------------------------------------------------------------


def test_a_session_is_started_by_hand_switch_and_button_and_nothing_of_it_is_shown_without_one(
    client, tmp_path, page
):
    assert page.frame()["training"] is None
    assert client.post("/session", headers=OURS, json={"button": "start"}).status_code == 409

    trainer = bench.MessageTrainer()
    table = bench.session_table(tmp_path, PROFILE)
    made = bench.settings_of(tmp_path, table, PatientSettings)
    server = PatientServer(made, trainer, trainer.clock)
    with (
        TestClient(server.app, base_url=bench.ORIGIN) as site,
        site.websocket_connect("/live", headers=OURS) as socket,
    ):
        page = bench.Page(socket)

        def until(condition, **scene):
            def after_some_cycles(now):
                trainer.cycles(**scene, count=10)
                return condition(now)

            return page.until(after_some_cycles)

        def press(button):
            return site.post("/session", headers=OURS, json={"button": button}).status_code

        now = until(
            lambda now: now["training"]["advice"] == "hold_hand_switch",
            mode=Mode.READY,
            switch=False,
        )
        assert now["training"]["buttons"] == ["end"]
        assert press("start") == 409
        until(lambda now: now["training"]["buttons"][0] == "start", mode=Mode.READY)
        assert press("pause") == 409
        assert trainer.requests == []

        assert press("start") == 200
        until(lambda _: ("enable",) in trainer.requests, mode=Mode.READY)
        now = until(lambda now: "pause" in now["training"]["buttons"], mode=Mode.HOLD)
        assert (now["training"]["number"], now["training"]["count"]) == (1, 2)
        assert now["training"]["plan_s"] == 22.0

        # What has ended a START early is told.
        def fell_silent(now):
            trainer.clock.ns += 10_000_000
            return now["training"]["phase"] == "no_signal"

        page.until(fell_silent)

        def is_heard(now):
            trainer.cycles(Mode.READY)
            return now["training"]["phase"] == "paused"

        now = page.until(is_heard)
        assert now["training"]["why"] == "no_signal"
        assert site.get("/texts.json").json()["de"]["why_short.no_signal"]
        until(lambda now: now["training"]["buttons"] == [], mode=Mode.FAULT, cause=Cause.SPASM)
        assert press("start") == 409

        # Without power RESET takes nothing from the leg: START requests it.
        stopped = {"mode": Mode.FAULT, "cause": Cause.DRIVE_FAULT, "power": "fault"}
        now = until(lambda now: now["training"]["buttons"] == ["start"], **stopped)
        assert (now["step"], now["action"]) == ("start", None)
        assert press("start") == 200
        until(lambda _: ("reset",) in trainer.requests, **stopped)

        # START waits for no other request, and PAUSE is not kept waiting by one.
        # START was there before the reset, too: a frame of then is not the answer.
        until(
            lambda now: now["mode"] == "ready" and "start" in now["training"]["buttons"],
            mode=Mode.READY,
        )
        trainer.requests.clear()
        site.portal.call(server._asking.acquire)
        try:
            assert press("start") == 409
            until(lambda now: "pause" in now["training"]["buttons"], mode=Mode.HOLD)
            assert press("pause") == 200
            until(lambda _: ("disable",) in trainer.requests, mode=Mode.HOLD)
        finally:
            site.portal.call(server._asking.release)


# --- the queue of a page ------------------------------------------------------------------------


def test_a_page_that_does_not_read_gets_the_present_and_costs_no_memory():
    async def story():
        views = iter(range(10_000_000))
        feed = Feed(lambda: bench.filled(StrideItem, time_ms=next(views)))
        page = feed.join()
        for number in range(WINDOW):
            feed.tick()
            assert json.loads(await page.next())["now"]["time_ms"] == number
        feed.tick()
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(page.next(), 0)
        for number in range(100_000):
            feed.tick()
            feed.add(bench.filled(StrideItem, time_ms=number))
        page.acknowledge(WINDOW)
        frame = json.loads(await page.next())

        assert frame["now"]["time_ms"] == WINDOW + 100_000  # the newest, and no burst before it
        assert [item["time_ms"] for item in frame["items"]] == list(
            range(100_000 - ITEMS_MAX, 100_000)
        )
        with pytest.raises(ValueError, match="frame"):
            page.acknowledge(WINDOW + 100)

    asyncio.run(story())


def test_a_server_that_wakes_late_receives_before_it_judges_a_silence(monkeypatch):
    """Else each of its own delays would be a silence of the trainer, and an alarm."""
    now_s, told, waited = 0.0, [], []

    async def sleep(duration_s):
        nonlocal now_s
        waited.append(duration_s)
        now_s += duration_s + (0.3 if len(waited) == 2 else 0.0)
        if len(waited) == 5:
            raise asyncio.CancelledError

    loop = SimpleNamespace(time=lambda: now_s)
    faked = SimpleNamespace(get_running_loop=lambda: loop, sleep=sleep)
    monkeypatch.setattr(feed_module, "asyncio", faked)
    feed = SimpleNamespace(tick=lambda: told.append(len(waited)))
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(Feed.run(feed))

    assert told == [0, 1, 3, 4]  # after the second, late one it has waited once more


def test_more_pages_than_there_is_room_for_are_told_so(client):
    feed = client.server.feed
    pages = [feed.join() for _ in range(PAGES_MAX)]
    with client.websocket_connect("/live", headers=OURS) as socket:
        with pytest.raises(WebSocketDisconnect) as refused:
            socket.receive_json()
        assert refused.value.code == TRY_LATER
    feed.leave(pages[0])
    with client.websocket_connect("/live", headers=OURS) as socket:
        assert bench.Page(socket).frame()["word"] == "no_signal"


def test_a_page_that_sends_anything_else_is_closed_and_one_that_goes_is_forgotten(client, page):
    page.frame()
    assert client.server.feed.page_count == 1
    page.socket.send_text("hello")
    with pytest.raises(WebSocketDisconnect):
        for _ in range(100):
            page.socket.receive_json()
    assert client.server.feed.page_count == 0
