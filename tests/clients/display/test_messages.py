"""`/messages` of the engineer's server: what a client gets, what it loses, and what is refused."""

import json
import re

import display_bench as bench
import pytest
from gaitd_client import Event, Mode, wire
from gaitd_client.wire.asyncapi import PARAMETERS, PUBLISHED
from gaitd_display.engineer import EngineerServer
from gaitd_display.feed import ITEMS_MAX, WINDOW
from gaitd_display.messages import CLIENTS_MAX, NOT_ALLOWED, STREAMS, TRY_LATER, Message, Waiting
from gaitd_display.settings import EngineerSettings
from gaitd_toml import ConfigError
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

PROGRAM = {"host": bench.OURS["host"]}


@pytest.fixture
def trainer():
    return bench.MessageTrainer()


@pytest.fixture
def client(trainer, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "index.html").write_text("<p>mine</p>", encoding="utf-8")
    settings = bench.settings_of(tmp_path, bench.engineer_table(pages="own"), EngineerSettings)
    app = EngineerServer(settings, trainer, lambda: bench.BEGAN_NS).app
    with TestClient(app, base_url=bench.ORIGIN) as client:
        yield client


def test_the_module_of_pages_reads_the_versions_that_are_sent(client):
    module = client.get("/static/gaitd.mjs", headers=PROGRAM).text
    named = dict(re.findall(r'^  (\w+): "(gaitd\.\w+\.v\d+)",$', module, re.MULTILINE))

    assert named == {name: wire.schema_name(wire.MESSAGES[name]) for name in PUBLISHED}


def connect(client, *keys, headers=bench.OURS):
    query = "&".join(f"key={key}" for key in keys)
    return client.websocket_connect(f"/messages?{query}", headers=headers)


def messages_until(socket, count):
    found = []
    while len(found) < count:
        frame = socket.receive_json()
        socket.send_text(str(frame["seq"]))
        found += frame["messages"]
    return found


def test_a_client_gets_the_messages_of_its_keys_as_on_zenoh(client, trainer):
    with connect(client, "right/activity", "events") as socket:
        assert socket.receive_json() == {"seq": 1, "dropped_count": 0, "messages": []}
        socket.send_text("1")
        trainer.cycles(Mode.GAIT, power_w=4.0)
        trainer.send(
            "events", bench.filled(Event, id="1", code="mode_changed", priority="low", kind="mode")
        )
        found = {message["key"]: message for message in messages_until(socket, 2)}

    assert set(found) == {"right/activity", "events"}
    activity = found["right/activity"]
    assert (activity["schema"], activity["trouble"]) == ("gaitd.activity.v1", None)
    assert (activity["value"]["hip"]["patient"], activity["value"]["mode"]) == (8.0, "gait")
    assert found["events"]["value"]["code"] == "mode_changed"


def test_silence_is_told_and_a_client_that_leaves_ends_its_streams(client, trainer):
    with connect(client, "right/activity") as socket:
        trainer.cycles(Mode.GAIT, power_w=4.0)
        messages_until(socket, 1)
        trainer.clock.ns += 250_000_000
        (silent,) = messages_until(socket, 1)
        stream = trainer.streams["right/activity"][-1]
    assert (silent["value"], silent["trouble"]) == (None, "silent")
    assert list(stream) == []  # it ends at once: it was closed


@pytest.mark.parametrize("sent", ["{}", "2", "-1", '{"command": "enable"}'])
def test_what_is_no_acknowledgement_is_refused_and_reaches_nothing(client, trainer, sent):
    with connect(client, "safety") as socket:
        socket.receive_json()
        socket.send_text(sent)
        said = ""
        with pytest.raises(WebSocketDisconnect) as closed:
            while True:
                said = socket.receive_json().get("error", said)
    assert closed.value.code == NOT_ALLOWED
    assert sent in said
    assert "only reads" in said
    assert trainer.requests == []


@pytest.mark.parametrize("keys", [(), ("safety", "rihgt/activity"), ("control/stop",)])
def test_an_unknown_key_is_refused_with_those_that_exist(client, keys):
    with connect(client, *keys) as socket:
        said = socket.receive_json()["error"]
        with pytest.raises(WebSocketDisconnect):
            socket.receive_json()
    assert (keys[-1] if keys else "(missing)") in said
    assert "right/activity" in said


def test_a_page_of_another_site_is_refused_and_a_program_reads(client):
    for headers in (
        bench.OURS | {"origin": "http://127.0.0.1:8000"},
        PROGRAM | {"origin": "null"},
        {"host": "rebound.example"},
    ):
        with pytest.raises(WebSocketDisconnect), connect(client, "safety", headers=headers):
            pass
    with connect(client, "safety", headers=PROGRAM) as socket:
        assert socket.receive_json()["seq"] == 1
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/live", headers=PROGRAM):
        pass


def test_one_client_too_many_is_told_to_try_later(client):
    sockets = [connect(client, "safety") for _ in range(CLIENTS_MAX)]
    for socket in sockets:
        socket.__enter__()
    with connect(client, "safety") as socket, pytest.raises(WebSocketDisconnect) as closed:
        socket.receive_json()
    for one in sockets:
        one.__exit__(None, None, None)
    assert closed.value.code == TRY_LATER


async def frames_of(waiting, count):
    return [json.loads(await waiting.next(lambda: 0)) for _ in range(count)]


def test_a_client_that_does_not_read_loses_old_states_and_no_event_within_the_bound():
    import asyncio

    async def story():
        waiting = Waiting()
        for number in range(ITEMS_MAX + 3):
            waiting.add(Message("safety", str(number)))
            waiting.add(Message("events", str(number)))
        (frame,) = await frames_of(waiting, 1)
        for _ in range(WINDOW - 1):
            waiting.add(Message("safety", "on its way"))
            await frames_of(waiting, 1)
        waiting.add(Message("safety", "waits"))
        late = asyncio.create_task(frames_of(waiting, 1))
        await asyncio.sleep(0)
        assert not late.done()
        waiting.acknowledge("1")
        return frame, (await late)[0]

    frame, late = asyncio.run(story())
    events = [message["schema"] for message in frame["messages"] if message["key"] == "events"]
    assert events == [str(number) for number in range(3, ITEMS_MAX + 3)]
    (newest,) = [one for one in frame["messages"] if one["key"] == "safety"]
    assert newest["schema"] == str(ITEMS_MAX + 2)
    assert frame["dropped_count"] == ITEMS_MAX + 2 + 3
    assert [message["schema"] for message in late["messages"]] == ["waits"]


def test_own_pages_are_served_beside_it_under_the_same_policy(client, tmp_path):
    page = client.get("/pages/")
    assert page.text == "<p>mine</p>"
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "javascript" in client.get("/static/gaitd.mjs").headers["content-type"]
    assert client.get("/pages/../engineer.toml").status_code == 404
    with pytest.raises(ConfigError, match="a folder that exists"):
        bench.settings_of(tmp_path, bench.engineer_table(pages="none"), EngineerSettings)


def test_the_keys_are_those_of_the_published_messages():
    def keys(pattern):
        filled = [pattern]
        for name in ("leg", "axis"):
            values = PARAMETERS[name]["enum"]
            filled = [one.replace(f"{{{name}}}", value) for one in filled for value in values]
        return set(filled)

    assert set(STREAMS) == set().union(*map(keys, PUBLISHED.values()))
