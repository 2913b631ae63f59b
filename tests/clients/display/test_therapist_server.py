"""The therapist's server: login, CSRF, what the page gets and what it may request."""

import display_bench as bench
import pytest
from gaitd_client import Cause, Event, Mode, PlanLimits
from gaitd_display import therapist
from gaitd_display.login import (
    FAILURES_MAX,
    SESSIONS_MAX,
    Attempts,
    PasswordError,
    Sessions,
    hash_password,
    read_hash,
)
from gaitd_display.settings import TherapistSettings
from gaitd_display.therapist import COOKIE, TherapistServer
from gaitd_display.web import LOGIN_OVER
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

PASSWORD = "correct horse battery staple"
ORIGIN = "https://127.0.0.1:8080"
OURS = {"origin": ORIGIN, "host": "127.0.0.1:8080"}
NS_PER_S = 1_000_000_000


@pytest.fixture(scope="module")
def password_hash():
    return hash_password(PASSWORD)


@pytest.fixture
def trainer():
    return bench.MessageTrainer()


@pytest.fixture
def client(tmp_path, trainer, password_hash):
    table = bench.therapist_table(password_hash)
    table["web"] |= {"certificate": "c.pem", "key": "k.pem"}
    settings = bench.settings_of(tmp_path, table, TherapistSettings)
    server = TherapistServer(settings, trainer, trainer.clock)
    with TestClient(server.app, base_url=ORIGIN) as client:
        client.server = server
        yield client


def login(client, password=PASSWORD):
    return client.post("/login", headers=OURS, json={"password": password})


def token(client):
    return client.get("/session.json").json()["csrf"]


def post(client, path, body, csrf=None):
    headers = {**OURS, "x-csrf-token": token(client) if csrf is None else csrf}
    return client.post(path, headers=headers, json=body)


# --- login --------------------------------------------------------------------------------------


def test_the_cookie_is_for_this_server_s_pages_alone(client):
    assert 'id="login"' in client.get("/").text
    answer = login(client)
    cookie = answer.headers["set-cookie"].lower()

    assert answer.status_code == 200
    assert cookie.startswith("__host-gaitd=")
    for part in ("httponly", "secure", "samesite=strict", "path=/"):
        assert part in cookie
    assert "domain" not in cookie
    assert 'id="legs"' in client.get("/").text


def test_after_five_wrong_passwords_none_is_checked_for_a_minute(client, trainer):
    for _ in range(FAILURES_MAX):
        assert login(client, "a wrong password").status_code == 401
    locked = login(client)
    assert (locked.status_code, locked.json()["reason"]) == (429, "locked")
    assert client.post("/stop", headers=OURS, json={}).json()["outcome"] == "done"

    trainer.clock.ns += 61 * NS_PER_S

    assert login(client).status_code == 200


def test_a_session_ends_by_logout_and_after_its_time(client, trainer):
    login(client)
    first = token(client)
    assert post(client, "/logout", {}).status_code == 200
    assert client.get("/session.json").json()["csrf"] == ""
    login(client)
    assert token(client) not in {"", first}
    trainer.clock.ns += 61 * 60 * NS_PER_S
    assert client.get("/session.json").json()["csrf"] == ""
    assert post(client, "/act", {"command": "enable"}, csrf="x").status_code == 401


def test_a_copied_cookie_does_not_outlive_the_session(client):
    login(client)
    stolen = client.cookies[COOKIE]
    post(client, "/logout", {})
    client.cookies.set(COOKIE, stolen)

    assert client.get("/session.json").json()["csrf"] == ""


def test_the_oldest_of_too_many_sessions_ends():
    sessions = Sessions(bench.Clock(), max_min=60)
    tokens = [sessions.begin() for _ in range(SESSIONS_MAX + 1)]

    assert sessions.of(tokens[0]) is None
    assert all(sessions.of(token) for token in tokens[1:])


def test_a_right_password_takes_its_attempt_back():
    attempts = Attempts(bench.Clock())
    for _ in range(3 * FAILURES_MAX):
        attempts.fail()
        attempts.succeed()

    assert not attempts.are_exhausted


def test_a_hash_is_salted_and_a_weak_or_broken_one_is_refused(password_hash):
    other = hash_password(PASSWORD)
    assert other != password_hash
    assert read_hash(other).fits(PASSWORD)
    assert not read_hash(other).fits(PASSWORD + " ")
    assert not read_hash(other).fits("x" * 100_000)
    kind, _, *rest = password_hash.split("$")
    for wrong in ("scrypt$", "$".join((kind, "1024", *rest)), password_hash + "="):
        with pytest.raises(PasswordError):
            read_hash(wrong)
    with pytest.raises(PasswordError, match="12"):
        hash_password("short")


# --- requests -----------------------------------------------------------------------------------


def test_without_login_or_token_nothing_but_stop_is_possible(client, trainer):
    for path, body in (("/act", {"command": "enable"}), ("/plan", {"plan": None}), ("/logout", {})):
        assert post(client, path, body).status_code == 401
    with (
        client.websocket_connect("/live", headers=OURS) as socket,
        pytest.raises(WebSocketDisconnect) as refused,
    ):
        socket.receive_json()
    assert refused.value.code == LOGIN_OVER
    login(client)
    for csrf in ("", "wrong", "ü"):
        headers = {**OURS, "x-csrf-token": csrf.encode()}
        answer = client.post("/act", headers=headers, json={"command": "enable"})
        assert answer.status_code == 403
    evil = {**OURS, "origin": "https://evil.example", "x-csrf-token": token(client)}
    assert client.post("/act", headers=evil, json={"command": "enable"}).status_code == 403
    assert trainer.requests == []
    assert client.post("/stop", headers=OURS, json={}).status_code == 200


def test_commands_and_plans_are_sent_and_wrong_ones_are_refused(client, trainer):
    login(client)
    plan = {"cadence_max_hz": 0.3, "amplitude_max_ratio": 0.8, "duration_max_s": 600}
    for command in ("enable", "self_test", "hand_guiding", "hold", "disable", "reset"):
        assert post(client, "/act", {"command": command}).json()["outcome"] == "done"
    assert post(client, "/plan", {"plan": plan}).json()["outcome"] == "done"
    assert client.server.state.plan.cadence_max_hz == 0.3
    assert post(client, "/plan", {"plan": {**plan, "cadence_max_hz": 9}}).status_code == 400
    assert post(client, "/act", {"command": "gait"}).status_code == 400
    assert post(client, "/plan", {"plan": None}).json()["outcome"] == "done"
    assert client.server.state.plan is None

    names = [name for name, *_ in trainer.requests]
    assert names == ["enable", "mode", "mode", "mode", "disable", "reset", "plan", "plan"]
    trainer.refusal = "the leg is moving"
    assert post(client, "/act", {"command": "enable"}).json()["reason"] == "the leg is moving"


# --- what the page gets -------------------------------------------------------------------------


def frames(client, socket):
    while True:
        frame = socket.receive_json()
        socket.send_text(str(frame["seq"]))
        yield frame


def test_numbers_have_their_sigma_and_validity_and_a_stop_its_remedy(client, trainer):
    login(client)
    headers = {**OURS, "cookie": f"{COOKIE}={client.cookies[COOKIE]}"}
    with client.websocket_connect("/live", headers=headers) as socket:
        trainer.send("events", bench.filled(Event, id="1", text="an event", priority="low"))
        trainer.step(7, 0.4, 5.0)
        items = []
        for _, frame in zip(range(500), frames(client, socket), strict=False):
            trainer.cycles(Mode.HOLD, power_w=2.0)
            items += frame["items"]
            if not frame["now"]["is_silent"] and len(items) == 2:
                break
        hip = frame["now"]["legs"][0]["hip"]
        assert hip["patient"] == {"value": 4.0, "std": 0.4}
        assert hip["friction"] == {"value": 3.0, "std": 0.2}
        slide = frame["now"]["legs"][0]["slide"]
        assert slide["friction"] == {"value": None, "std": None}
        assert (hip["effort"], slide["effort"]) == (5.5, 5.5)
        assert (hip["net"], hip["validity"]) == ({"value": -1.5, "std": 0.3}, "ok")
        assert {item["kind"] for item in items} == {"event", "stride"}

        for _, frame in zip(range(500), frames(client, socket), strict=False):
            trainer.cycles(Mode.FAULT, cause=Cause.SPASM)
            if frame["now"]["verdict"] is not None:
                break
        assert frame["now"]["verdict"]["cause"] == "spasm"
        assert "remedy" in frame["now"]["verdict"]["remedy"]
        assert frame["now"]["alarm"] is not None

        trainer.clock.ns += 300_000_000
        for _, frame in zip(range(500), frames(client, socket), strict=False):
            if frame["now"]["is_silent"]:
                break
        assert frame["now"]["legs"][0]["hip"]["net"] == {"value": None, "std": None}
        assert (frame["now"]["mode"], frame["now"]["verdict"]) == (None, None)


def test_a_plan_that_another_operator_released_is_shown(client, trainer, monkeypatch):
    monkeypatch.setattr(therapist, "PLAN_POLL_S", 0.01)
    login(client)
    headers = {**OURS, "cookie": f"{COOKIE}={client.cookies[COOKIE]}"}
    with client.websocket_connect("/live", headers=headers) as socket:
        trainer.plan = PlanLimits(cadence_max_hz=0.3, amplitude_max_ratio=0.8, duration_max_s=600)
        for _, frame in zip(range(2000), frames(client, socket), strict=False):
            if frame["now"]["plan"] is not None:
                break
    assert frame["now"]["plan"]["cadence_max_hz"] == 0.3
