"""Which connections a server of the display holds, and that STOP finds a place among them."""

import asyncio
import contextlib
import datetime
import errno
import http.client
import json
import os
import resource
import socket
import ssl
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import browser as rig
import display_bench as bench
import pytest
from command_line import ran
from gaitd_display import connections, web
from gaitd_display.__main__ import main
from gaitd_display.connections import (
    ADDRESS_MAX,
    CONNECTIONS_MAX,
    REPORT_S,
    WAIT_S,
    Connections,
    Refusals,
    overdue,
    surplus,
)
from gaitd_display.feed import PAGES_MAX
from gaitd_display.patient import PatientServer
from gaitd_display.web import STOPS_MAX, Server
from starlette.requests import Request
from websockets.asyncio.client import connect

from daemon.keys.certificates import new_authority, new_certificate
from gaitd_lab.processes import free_port

IDLE_COUNT = 400
ROOM = 160
"""Descriptors that the test leaves for the server: the services have 256 in all."""
FLOOD = """
import http.client, json, resource, socket, ssl, sys
most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
port, count, is_tls, origin = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "1", sys.argv[4]
idle = [socket.create_connection(("127.0.0.1", port), timeout=60) for _ in range(count)]
if is_tls:
    stop = http.client.HTTPSConnection(
        "127.0.0.1", port, timeout=60, context=ssl._create_unverified_context()
    )
else:
    stop = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
stop.request("POST", "/stop", "{}", {"Origin": origin, "Content-Type": "application/json"})
print(json.loads(stop.getresponse().read())["outcome"])
"""


def held(address, since_s, **more):
    return SimpleNamespace(address=address, since_s=since_s, is_asking=False, is_kept=False, **more)


def asking(address, since_s, *, is_kept=False):
    return SimpleNamespace(address=address, since_s=since_s, is_asking=True, is_kept=is_kept)


# --- which one is closed ------------------------------------------------------------------------


def test_none_is_closed_while_there_is_room():
    full = [held(f"a{n % 3}", n) for n in range(CONNECTIONS_MAX)]
    assert surplus(full, "a0") is None
    assert surplus([held("a", n) for n in range(ADDRESS_MAX)], "a") is None


def test_one_address_gives_up_its_own_oldest():
    mine = [held("other", 0), *(held("a", n + 1) for n in range(ADDRESS_MAX + 1))]
    assert surplus(mine, "a") is mine[1]


def test_when_all_are_too_many_the_address_with_most_gives_one_up():
    many = [held("many", 100 + n) for n in range(ADDRESS_MAX)]
    few = [held(f"b{n}", n) for n in range(CONNECTIONS_MAX - ADDRESS_MAX)]
    assert surplus([*few, *many, held("new", 999)], "new") is many[0]


def test_a_new_one_is_served_where_each_other_has_a_request():
    asking_all = [asking("a", n) for n in range(ADDRESS_MAX)]
    assert surplus([*asking_all, held("a", 999)], "a") is asking_all[0]


def test_pages_and_stops_are_kept_and_a_request_goes_after_one_that_says_nothing():
    kept = [asking("a", n, is_kept=True) for n in range(PAGES_MAX + STOPS_MAX)]
    slow = asking("a", 100)
    mute = [held("a", 200 + n) for n in range(ADDRESS_MAX - len(kept))]
    assert surplus([*kept, slow, *mute], "a") is mute[0]
    requests = [asking("a", 200 + n) for n in range(ADDRESS_MAX - len(kept))]
    assert surplus([*kept, slow, *requests], "a") is slow


def test_there_is_a_place_for_a_stop_beside_all_that_is_kept():
    assert PAGES_MAX + STOPS_MAX < ADDRESS_MAX < CONNECTIONS_MAX < ROOM


def test_one_that_says_nothing_is_overdue_and_one_with_a_request_never():
    mute, other, busy = held("a", 0.0), held("a", 0.1), asking("a", 0.0)
    assert overdue([mute, other, busy], WAIT_S) == [mute]


def test_a_body_that_does_not_come_is_refused(monkeypatch):
    monkeypatch.setattr(web, "WAIT_S", 0.01)
    request = Request({"type": "http", "method": "POST", "headers": []}, asyncio.Event().wait)

    with pytest.raises(ValueError, match="not complete"):
        asyncio.run(web.small_body(request))


def failed(number):
    return OSError(number, os.strerror(number))


def test_a_reason_why_none_is_accepted_is_reported_once_in_its_time_with_what_to_do():
    refusals = Refusals()
    first = refusals.line(failed(errno.EMFILE), 1000.0)
    assert "a STOP that needs a new connection is lost" in first
    assert "raise LimitNOFILE of its unit" in first
    assert refusals.line(failed(errno.EMFILE), 1000.0 + 0.99 * REPORT_S) == ""
    assert refusals.line(failed(errno.EMFILE), 1000.0 + REPORT_S) == first
    other = refusals.line(failed(errno.EPROTO), 1000.0 + REPORT_S)
    assert "a connection was not accepted: Protocol error" in other


# --- over sockets -------------------------------------------------------------------------------


@pytest.fixture
def trainer():
    return bench.MessageTrainer()


@pytest.fixture(params=[False, True], ids=["plain", "tls"])
def site(request, tmp_path, trainer):
    table = bench.patient_table(tmp_path)
    if request.param:
        now = datetime.datetime.now(datetime.UTC)
        pair = new_certificate(new_authority("trainer", now), "display", now, 1, ["127.0.0.1"])
        (tmp_path / "c.pem").write_bytes(pair.certificate)
        (tmp_path / "k.pem").write_bytes(pair.key)
        table["web"] |= {"certificate": "c.pem", "key": "k.pem"}
    with rig.Site(
        lambda made: PatientServer(made, trainer, trainer.clock),
        table,
        tmp_path,
        rig.KINDS["patient"],
    ) as site:
        site.is_tls = request.param
        yield site


@contextlib.contextmanager
def few_descriptors():
    """Leave `ROOM` to this process, as the service has them."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(int(one.name) for one in Path("/proc/self/fd").iterdir())
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def no_descriptors():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    lowest = os.dup(0)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def unverified():
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def test_a_server_that_has_not_begun_holds_its_port_and_keeps_who_comes(trainer, tmp_path):
    table = bench.patient_table(tmp_path)
    table["web"]["port"] = port = free_port()
    settings = bench.settings_of(tmp_path, table, rig.KINDS["patient"])
    app = PatientServer(settings, trainer, trainer.clock).app
    server = Server(app, settings.web)

    with pytest.raises(OSError, match="in use"):
        Server(app, settings.web)
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as early:
        early.request("GET", "/")
        thread = threading.Thread(target=server.run)
        thread.start()
        try:
            assert early.getresponse().status == 200
        finally:
            server.should_exit = True
            thread.join()


def test_a_stop_arrives_while_400_connections_say_nothing_and_pages_go_on(
    site, trainer, monkeypatch
):
    monkeypatch.setattr(connections, "WAIT_S", 1000.0)  # it does not wait for them to be closed
    script = [sys.executable, "-c", FLOOD, str(site.port), str(IDLE_COUNT), str(int(site.is_tls))]
    tls = {"ssl": unverified()} if site.is_tls else {}
    live = f"{site.address.replace('http', 'ws', 1)}/live"

    def flooded():
        words = [*script, site.address]
        return subprocess.run(words, check=False, capture_output=True, text=True, timeout=60)

    async def watched():
        # Python's TLS sockets lose a message of two threads, and websockets.sync has two.
        async with asyncio.timeout(90), connect(live, origin=site.address, **tls) as page:
            await page.recv()
            flood = await asyncio.to_thread(flooded)
            assert (flood.stdout, flood.stderr) == ("done\n", "")
            assert trainer.requests == [("stop",)]
            for _ in range(3):
                await page.send(str(json.loads(await page.recv())["seq"]))

    with few_descriptors():
        asyncio.run(watched())


def test_without_descriptors_there_is_one_line_and_a_client_that_waits_is_accepted_later(
    monkeypatch, capsys
):
    monkeypatch.setattr(connections, "RETRY_S", 0.001)

    async def accepted():
        is_accepted = asyncio.Event()

        class Taken(asyncio.Protocol):
            def connection_made(self, _):
                is_accepted.set()

        with (
            socket.create_server(("127.0.0.1", 0)) as listener,
            socket.create_connection(listener.getsockname()),
        ):
            listener.setblocking(False)
            with no_descriptors():
                accepting = asyncio.create_task(Connections(None).accept([listener], Taken, None))
                await asyncio.sleep(0.05)
            before = is_accepted.is_set()
            await asyncio.wait_for(is_accepted.wait(), 10)
            accepting.cancel()
            await asyncio.gather(accepting, return_exceptions=True)
        return before

    assert not asyncio.run(accepted())
    assert capsys.readouterr().err.count("no file descriptor left") == 1


def test_one_that_says_nothing_is_closed_in_time(site, monkeypatch):
    for name, value in (("WAIT_S", 0.2), ("LOOK_S", 0.02)):
        monkeypatch.setattr(connections, name, value)
    with (
        socket.create_connection(("127.0.0.1", site.port), timeout=60) as mute,
        socket.create_connection(("127.0.0.1", site.port), timeout=60) as slow,
    ):
        slow.sendall(b"POST /stop HTTP/1.1\r\n")
        for one in (mute, slow):
            with contextlib.suppress(ConnectionResetError):
                while one.recv(1000):
                    pass


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"web": {"certificate": "none", "key": "none"}},
            "PEM files of a certificate and of its key",
        ),
        ({"web": {"certificate": "patient.toml", "key": "patient.toml"}}, "PEM lib (_ssl"),
        ({"trainer": {"endpoint": ""}}, "endpoint '': allowed are tcp/HOST:PORT"),
        ({"session": {"profile": "none", "history": "."}}, "the name of a file; this is a folder"),
        ({"session": {"profile": "none", "history": "x" * 300}}, "or cannot be looked up"),
    ],
)
def test_what_no_server_can_use_is_refused_with_its_file_in_each_line(tmp_path, changes, words):
    table = bench.patient_table(tmp_path)
    for name, values in changes.items():
        table[name] = {**table.get(name, {}), **values}

    file = tmp_path / "patient.toml"
    file.write_text(bench.toml(table), encoding="utf-8")

    ended = ran(main, "gaitd-display", "patient", "--config", file)

    assert (ended.code, ended.out) == (2, "")
    for line in ended.err.splitlines():
        assert line.startswith(f"configuration error: {file}: ")
    assert words in ended.err
