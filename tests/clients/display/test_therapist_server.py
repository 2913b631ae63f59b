"""The therapist's server: login, CSRF, what the page gets and what it may request."""

import asyncio
import datetime
import json
import os
import shutil
import ssl
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest import mock
from urllib.error import URLError
from urllib.request import Request, urlopen

import display_bench as bench
import pytest
from command_line import ran
from gaitd_client import Cause, Event, Mode, NotValid, PlanLimits, Trouble
from gaitd_display import therapist
from gaitd_display.__main__ import main
from gaitd_display.alarm import INPUT_CYCLES
from gaitd_display.controls import Does
from gaitd_display.login import (
    FAILURES_MAX,
    SESSIONS_MAX,
    Attempts,
    PasswordError,
    Sessions,
    hash_password,
    read_hash,
)
from gaitd_display.progress import read_progress
from gaitd_display.settings import SessionFiles, TherapistSettings
from gaitd_display.therapist import COOKIE, TherapistServer
from gaitd_display.therapist_view import PlanState, TherapistState, leg_view
from gaitd_display.web import LOGIN_OVER
from gaitd_session.session import AXES
from gaitd_session.store import (
    BlockRow,
    GoalRow,
    InterruptionRow,
    MarkRow,
    SelfTestRow,
    SessionRow,
    Store,
    StrideRow,
)
from gaitd_texts import Reader, Situation, catalogue
from msgspec.structs import replace
from other_user import forked, result
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from training import PROFILE
from websockets.asyncio.client import connect

from daemon.keys.certificates import new_authority, new_certificate
from gaitd_lab.processes import free_port

PASSWORD = "correct horse battery staple"
ORIGIN = "https://127.0.0.1:8080"
OURS = {"origin": ORIGIN, "host": "127.0.0.1:8080"}
NS_PER_S = 1_000_000_000
NONE = NotValid("a key", Trouble.SILENT, "no message")
WRITER, READER, GROUP = 64001, 64002, 64003


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


# --- TLS ----------------------------------------------------------------------------------------


def test_beyond_loopback_it_serves_with_tls_alone_and_is_refused_without(tmp_path, password_hash):
    now = datetime.datetime.now(datetime.UTC)
    authority = new_authority("trainer", now)
    pair = new_certificate(authority, "display", now, 1, ["127.0.0.1"])
    (tmp_path / "c.pem").write_bytes(pair.certificate)
    (tmp_path / "k.pem").write_bytes(pair.key)
    address = f"127.0.0.1:{free_port()}"
    origin = f"https://{address}"
    web = {"host": "0.0.0.0", "port": int(address.partition(":")[2]), "origins": [origin]}
    table = bench.therapist_table(password_hash)
    table["trainer"] = {"endpoint": f"tcp/127.0.0.1:{free_port()}"}
    file = tmp_path / "therapist.toml"
    command = [sys.executable, "-m", "gaitd_display", "therapist", "--config", str(file)]
    trusted = ssl.create_default_context(cadata=authority.certificate.decode())

    def request(path, body=None, context=trusted):
        headers = {"Origin": origin, "Content-Type": "application/json"}
        asked = Request(f"{origin}{path}", body, headers)
        with urlopen(asked, context=context, timeout=60) as answer:
            return answer.headers, answer.read()

    file.write_text(bench.toml({**table, "web": web}), encoding="utf-8")
    refused = ran(main, *command[2:])
    assert (refused.code, refused.err) == (
        2,
        f'configuration error: {file}: web.host = "0.0.0.0": 127.0.0.1, or web.certificate and'
        " web.key, as other machines can reach it\n",
    )
    web |= {"certificate": "c.pem", "key": "k.pem"}
    file.write_text(bench.toml({**table, "web": web}), encoding="utf-8")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == f"gaitd-display: https://0.0.0.0:{web['port']}/\n"
        assert b'id="login"' in request("/")[1]
        with pytest.raises(URLError, match="CERTIFICATE_VERIFY_FAILED"):
            request("/", context=ssl.create_default_context())
        with pytest.raises(OSError, match=r"closed|reset|Remote"):
            urlopen(f"http://{address}/", timeout=60)
        headers, _ = request("/login", b'{"password": "%s"}' % PASSWORD.encode())
        cookie, *attributes = headers["Set-Cookie"].split("; ")
        assert "Secure" in attributes
        live, of_login = f"wss://{address}/live", {"Cookie": cookie}

        async def first_view():
            # Python's TLS sockets lose a message of two threads, and websockets.sync has two.
            async with connect(
                live, ssl=trusted, origin=origin, additional_headers=of_login
            ) as socket:
                return json.loads(await socket.recv())

        assert asyncio.run(first_view())["now"]["is_silent"]
    finally:
        process.terminate()
        process.wait()


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
    assert client.server.state.plan.limits.cadence_max_hz == 0.3
    assert post(client, "/plan", {"plan": {**plan, "cadence_max_hz": 9}}).status_code == 400
    assert post(client, "/act", {"command": "gait"}).status_code == 400
    assert post(client, "/plan", {"plan": None}).json()["outcome"] == "done"
    assert client.server.state.plan.state is PlanState.NONE
    trainer.silent = True
    assert post(client, "/plan", {"plan": plan}).status_code == 504
    assert client.server.state.plan.state is PlanState.UNKNOWN
    trainer.silent = False

    names = [name for name, *_ in trainer.requests]
    assert names == ["enable", "mode", "mode", "mode", "disable", "reset", "plan", "plan"]
    trainer.refusal = "leg_moves"
    refused = post(client, "/act", {"command": "enable"}).json()
    assert refused["reason"] == "leg_moves"
    assert refused["said"]["de"] == "das Bein bewegt sich noch"
    trainer.refusal = "of_a_later_version"
    assert "of_a_later_version" in post(client, "/act", {"command": "enable"}).json()["said"]["de"]


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
        trainer.send("events", bench.filled(Event, id="1", code="core_back", priority="low"))
        trainer.step(7, 0.4, 5.0)
        items = []
        for _, frame in zip(range(500), frames(client, socket), strict=False):
            trainer.cycles(Mode.HOLD, power_w=2.0)
            items += frame["items"]
            if not frame["now"]["is_silent"] and len(items) == 2:
                break
        (leg,) = frame["now"]["legs"]
        hip, slide = leg["hip"], leg["slide"]
        assert hip["patient"] == {"value": 4.0, "std": 0.4}
        assert hip["friction"] == {"value": 3.0, "std": 0.2}
        assert (hip["net"], hip["validity"]) == ({"value": -1.5, "std": 0.3}, "ok")
        assert slide["net"] == {"value": 12.0, "std": 3.0}
        assert (hip["tremor_frequency_hz"], hip["tremor_amplitude"]) == (5.0, 2.5)
        assert slide["tremor_frequency_hz"] is slide["tremor_amplitude"] is None
        assert (leg["hip_angle_rad"], leg["slide_position_m"], leg["power_w"]) == (0.2, 0.4, 2.0)
        assert [one["effort"] for one in frame["now"]["drives"]] == [5.5, 5.5]
        assert {item["kind"] for item in items} == {"event", "stride"}

        for _, frame in zip(range(500), frames(client, socket), strict=False):
            trainer.cycles(Mode.FAULT, cause=Cause.SPASM)
            if frame["now"]["stop"] is not None:
                break
        stop = frame["now"]["stop"]
        assert (stop["subject"], stop["situation"]) == (None, "held")
        assert stop["stopped"]["de"] == "Das Bein des Patienten wurde steif"
        assert "first.held" in client.get("/texts.json").json()["de"]
        possible = [one for one in frame["now"]["controls"] if one["why_not"] is None]
        assert possible == [{"command": "reset", "does": "lets_go_until_enabled", "why_not": None}]
        assert frame["now"]["alarm"] is not None

        trainer.clock.ns += 300_000_000
        for _, frame in zip(range(500), frames(client, socket), strict=False):
            if frame["now"]["is_silent"]:
                break
        assert frame["now"]["legs"][0]["hip"]["net"] == {"value": None, "std": None}
        assert (frame["now"]["mode"], frame["now"]["stop"]) == (None, None)
        assert [one["effort"] for one in frame["now"]["drives"]] == [None, None]


def test_a_plan_that_another_operator_released_is_shown(client, trainer, monkeypatch):
    monkeypatch.setattr(therapist, "PLAN_POLL_S", 0.01)
    login(client)
    headers = {**OURS, "cookie": f"{COOKIE}={client.cookies[COOKIE]}"}
    with client.websocket_connect("/live", headers=headers) as socket:
        shown = frames(client, socket)
        assert next(shown)["now"]["plan"] == {"state": "unknown", "limits": None}

        def until(state):
            for _ in range(2000):
                trainer.cycles(Mode.HOLD)
                if (now := next(shown)["now"])["plan"]["state"] == state:
                    return now["plan"]["limits"]
            raise AssertionError(f"never {state}: {now}")

        assert until("none") is None
        trainer.plan = PlanLimits(cadence_max_hz=0.3, amplitude_max_ratio=0.8, duration_max_s=600)
        assert until("released")["cadence_max_hz"] == 0.3
        trainer.clock.ns += NS_PER_S
        now = next(frame["now"] for frame in shown if frame["now"]["is_silent"])
    assert now["plan"] == {"state": "unknown", "limits": None}


@pytest.fixture
def view(trainer):
    """What the therapist's page shows of the newest messages."""
    estimate, activity, safety = (
        trainer.estimate("right"),
        trainer.activity("right"),
        trainer.safety(),
    )
    drives = {name: trainer.drive(name) for name in (f"right/{axis}" for axis in AXES)}
    state = TherapistState("run", has_session=True)

    def view(**changes):
        newest = {name: drive.newest() for name, drive in drives.items()}
        given = {"safety": safety.newest(), "drives": newest, **changes}
        leg = leg_view("right", estimate.newest(), activity.newest())
        return state.view((leg,), given["safety"], NONE, given["drives"])

    view.drives = drives
    return view


def test_values_are_relative_once_a_minute_with_a_passive_patient_is_taken_off(trainer, view):
    for relative in (False, True):
        trainer.cycles(Mode.HOLD, relative=relative)

        (leg,) = view().legs
        assert leg.is_relative is relative


def test_a_signal_that_is_lost_in_part_is_no_signal_and_an_alarm_if_the_drives_were_on(
    trainer, view
):
    trainer.cycles(Mode.HOLD)
    assert (view().is_silent, view().alarm) == (False, None)
    lost = view(safety=NONE)
    assert (lost.is_silent, lost.mode, lost.alarm) == (True, None, "run-1")
    assert view().alarm is None
    trainer.cycles(Mode.FAULT, cause=Cause.SPASM)
    assert view().alarm == view(safety=NONE).alarm == "run-2"
    stale = {name: replace(one.newest(), fresh=False) for name, one in view.drives.items()}
    assert [drive.effort for drive in view(drives=stale).drives] == [None, None]


def test_the_situation_of_the_controls_is_read_of_all_drives(trainer, view):
    def possible(**given):
        trainer.cycles(**given)
        return {one.command: one.does for one in view().controls if one.does is not None}

    assert possible(mode=Mode.READY) == {"enable": Does.HOLDS_THE_LEG}
    assert possible(mode=Mode.READY, switch=False) == {}
    unknown = {**{name: one.newest() for name, one in view.drives.items()}, "right/slide": NONE}
    assert view(drives=unknown).hand_switch_closed is False
    assert possible(mode=Mode.FAULT, cause=Cause.SPASM) == {"reset": Does.LETS_GO_UNTIL_ENABLED}
    assert possible(mode=Mode.FAULT, cause=Cause.SPASM, power="fault") == {
        "reset": Does.CLEARS_THE_STOP
    }
    assert view().stop.situation is Situation.LOOSE
    unknown = {**{name: one.newest() for name, one in view.drives.items()}, "right/slide": NONE}
    assert view(drives=unknown).hand_switch_closed is None
    reset = next(one for one in view(drives=unknown).controls if one.command == "reset")
    assert reset.does is Does.LETS_GO_UNTIL_ENABLED  # a drive that is not seen may have power


def test_a_stop_at_rest_sounds_as_on_the_patient_s_page(trainer, view):
    def alarm(mode, cause=Cause.NONE, **given):
        for _ in range(INPUT_CYCLES + 1):
            trainer.cycles(mode, cause=cause, **given)
            shown = view()
        return shown.alarm

    assert alarm(Mode.OFF, Cause.BRING_UP_FAILED) is None  # the machine was never up
    assert alarm(Mode.READY) is None
    for mode in (Mode.OFF, Mode.BRINGING_UP, Mode.READY):
        assert alarm(mode, Cause.DRIVE_SILENT) is not None, mode
        assert alarm(Mode.READY) is None
    # The daily test of a session.
    assert alarm(Mode.FAULT, Cause.DRIVE_FAULT, power="fault", sto=True) is None


# --- marks --------------------------------------------------------------------------------------


def test_a_mark_is_sent_with_a_login_alone_and_what_is_no_line_is_refused_in_both_languages(
    client, trainer
):
    assert post(client, "/mark", {"text": "before"}).status_code == 401
    login(client)
    assert post(client, "/mark", {"text": "before"}, csrf="x").status_code == 403
    assert post(client, "/mark", {"text": "right knee"}).json()["outcome"] == "done"
    for text in ("", "x" * 81, "a\nb", "a\u202eb"):
        refused = post(client, "/mark", {"text": text})
        assert refused.status_code == 400
        assert "1 bis 80 Zeichen" in refused.json()["said"]["de"]
        assert "1 to 80 characters" in refused.json()["said"]["en"]
    trainer.refusal, trainer.refused = "too_many_marks", {"highest": 10, "window_s": 10}
    refused = post(client, "/mark", {"text": "once more"})
    assert refused.status_code == 409
    assert "10 Notizen in 10 s" in refused.json()["said"]["de"]
    assert [one for one in trainer.requests if one[1:] == ("right knee",)] == [
        ("mark", "right knee")
    ]


# --- profile and progress -----------------------------------------------------------------------


def test_profile_and_sessions_are_shown_and_what_cannot_be_read_is_told(client, trainer, tmp_path):
    assert client.get("/progress.json").status_code == 401
    login(client)
    assert client.get("/progress.json").json()["is_configured"] is False
    files = SessionFiles(profile=tmp_path / "profile.toml", history=tmp_path / "history.sqlite")
    client.server._settings = replace(client.server._settings, session=files)

    def progress():
        return client.get("/progress.json").json()

    assert "no such file" in progress()["troubles"][0]["de"]
    files.profile.write_text(PROFILE, encoding="utf-8")
    assert progress()["troubles"][0]["de"].startswith("Es gibt noch keinen Verlauf: /")
    assert progress()["profile"]["limits"]["duration_max_s"] == 12.0
    assert progress()["targets"] == {"right": {"low_ratio": 0.25, "high_ratio": 0.35}}
    assert progress()["self_test_ms"] is None
    with Store(files.history, is_writer=True) as store:
        store.write(
            [
                SessionRow("7f3k9m2q", "trainer", 1_795_000_000_000_000_000),
                BlockRow(1, "warm_up", 0.5, 0.4, 10.0, 9.0),
                GoalRow(1, "right", 0.4, 0.44),
                *(
                    StrideRow(1, "right", end_ns, 2.0, share, 0.02, 5.0, -1.0, share < 0.5)
                    for end_ns, share in enumerate((0.34, 0.36, 0.5), 1_795_000_002_000_000_000)
                ),
                InterruptionRow(1_795_000_001_000_000_000, "paused", ""),
                InterruptionRow(1_795_000_003_000_000_000, "stopped", Cause.SPASM),
                SelfTestRow("7f3k9m2q", 1_795_000_000_000_000_000),
                MarkRow("7f3k9m2q", 1_795_000_002_000_000_000, "right knee", is_before=False),
            ]
        )
        (session,) = progress()["sessions"]
        # The block goes on, so its own target holds; afterwards that of the next one.
        assert progress()["targets"]["right"]["low_ratio"] == pytest.approx(0.35)
    assert (session["begun_ms"], session["end"], session["block"]) == (1_795_000_000_000.0, "", 1)
    assert (session["walked_s"], session["mean_share_ratio"]) == (9.0, 0.35)
    assert (session["reached_count"], session["valid_count"]) == (1, 2)
    assert session["target"]["low_ratio"] == pytest.approx(0.35)
    newest, oldest = session["stops"]
    texts = catalogue(Reader.OPERATOR, "en")
    assert (newest["time_ms"], oldest["time_ms"]) == (1_795_000_003_000.0, 1_795_000_001_000.0)
    assert newest["said"]["en"] == texts.text("stopped.spasm")
    assert newest["remedy"]["en"] == texts.remedy(Cause.SPASM, texts.buttons())
    assert session["marks"] == [{"time_ms": 1_795_000_002_000.0, "text": "right knee"}]
    assert (oldest["said"]["en"], oldest["remedy"]) == ("The patient has paused.", None)
    assert progress()["self_test_ms"] == 1_795_000_000_000.0
    assert progress()["sessions"][0]["end"] == "interrupted"  # its program has ended without one
    assert progress()["targets"]["right"]["low_ratio"] == pytest.approx(0.39)
    limits = progress()["profile"]["limits"]
    assert post(client, "/plan", {"plan": limits}).json()["outcome"] == "done"
    assert trainer.plan.hip.assist_max == 10.0

    files.history.write_bytes(b"no database" * 1000)
    assert progress()["troubles"][0]["de"].startswith("Der Verlauf ist nicht verwendbar: /")
    assert (progress()["sessions"], progress()["profile"]["id"]) == ([], "7f3k9m2q")


def test_a_profile_is_changed_with_a_login_and_its_journal_line_says_old_and_new(
    client, tmp_path, capsys
):
    assert client.get("/profile.json").status_code == 401
    assert post(client, "/profile", {"sha256": "", "values": {}}).status_code == 401
    login(client)
    assert client.get("/profile.json").status_code == 404
    files = SessionFiles(profile=tmp_path / "profile.toml", history=tmp_path / "history.sqlite")
    client.server._settings = replace(client.server._settings, session=files)
    assert "no such file" in client.get("/profile.json").json()["said"]["de"]
    files.profile.write_text(PROFILE, encoding="utf-8")
    form = client.get("/profile.json").json()
    assert form["bounds"]["plan.block.rest_s"] == {"value_low": 0, "value_high": 3600}

    def save(**walk):
        values = json.loads(json.dumps(form["values"]))
        values["plan"]["block"][0] |= walk
        return post(client, "/profile", {"sha256": form["sha256"], "values": values})

    assert post(client, "/profile", {"sha256": "", "values": {}}, csrf="x").status_code == 403
    refused = save(rest_s=4000, cadence_hz=None)
    assert refused.status_code == 400
    wrong = {one.pop("key"): one for one in refused.json()["wrong"]}
    assert wrong == {
        "plan.block[0].cadence_hz": {"value": None, "value_low": 0.01, "value_high": 2},
        "plan.block[0].rest_s": {"value": 4000, "value_low": 0, "value_high": 3600},
    }
    capsys.readouterr()
    assert save(rest_s=45).json()["outcome"] == "done"
    told = f"gaitd-display: {files.profile} changed: plan.block[0].rest_s 3 -> 45\n"
    assert capsys.readouterr().out == told
    again = save(rest_s=50)
    assert (again.status_code, again.json()["reason"]) == (409, "profile_conflict")
    assert "inzwischen geändert" in again.json()["said"]["de"]
    assert client.get("/progress.json").json()["profile"]["blocks"][1]["rest_s"] == 45
    form = client.get("/profile.json").json()
    with mock.patch("os.fsync", side_effect=OSError(28, "No space left on device")):
        full = save(rest_s=60)
    assert (full.status_code, full.json()["reason"]) == (500, "trouble.profile_not_written")
    assert "No space left" in full.json()["said"]["de"]
    assert post(client, "/profile", {"sha256": 5, "values": {}}).status_code == 400


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be two other users")
def test_another_user_reads_the_history_by_the_shared_group_alone_and_does_not_hinder_the_writer():
    # Not in pytest's folder, which is for its own user.
    folder = Path(tempfile.mkdtemp())
    os.chown(folder, WRITER, GROUP)
    folder.chmod(0o770)
    (folder / "profile.toml").write_text(PROFILE, encoding="utf-8")
    files = SessionFiles(profile=folder / "profile.toml", history=folder / "history.sqlite")

    def read():
        return len(read_progress(files).sessions)

    def write():
        with Store(files.history, is_writer=True) as store:
            store.write([SessionRow("7f3k9m2q", "trainer", 1)])
            os.write(written, b".")
            os.read(end, 1)  # the file stays open until the test has read it
            store.write([SessionRow("7f3k9m2q", "trainer", 2)])
            return len(store.summaries("7f3k9m2q"))

    is_written, written = os.pipe()
    end, may_end = os.pipe()
    try:
        for count in (1, 3):
            writer = forked(WRITER, GROUP, write)
            os.read(is_written, 1)
            assert result(forked(READER, GROUP, read)) == count
            os.write(may_end, b".")
            assert result(writer) == count + 1
            # The last one to close it is a reader, who has made the log anew.
            assert result(forked(READER, GROUP, read)) == count + 1
        stranger = forked(READER, READER, lambda: "permission denied" in str(read_progress(files)))
        assert result(stranger) == 1
    finally:
        shutil.rmtree(folder)
        for pipe in (is_written, written, end, may_end):
            os.close(pipe)
