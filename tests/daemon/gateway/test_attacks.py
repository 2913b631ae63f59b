"""Attacks beyond one message: recorded traffic sent again, peers that scout, floods.

Nothing is timed. What must not have happened is checked after a later message on the same link was
answered. While the gateway's loop is held, its clock stands and Zenoh's threads go on to receive.
"""

import contextlib
import json
import socket
import threading
from collections import Counter

import pytest
import zenoh
from gaitd_client import Trainer, wire
from gaitd_names import Mode, RequestKind
from keyed_gateway import BASE, ask, connected, flush, is_valid, running

from daemon.zenoh_io import publish

WAITING_MAX = 64
"""Queries that may wait, and stops of one client."""


@pytest.fixture(scope="module")
def started(fake_core):
    with running(fake_core) as made:
        yield made


@pytest.fixture(scope="module")
def started_open(fake_core):
    with running(fake_core, None) as made:
        yield made


@pytest.fixture
def valid(eventually):
    """Make records arrive, and forget the test before."""

    def wait(service):
        service.core.changes["mode"] = Mode.HOLD  # in which no restart is granted
        service.core.requests.clear()
        with connected(service.target("display.desk")) as session:
            eventually(lambda: is_valid(session))
        return service

    return wait


@pytest.fixture
def service(started, valid):
    return valid(started)


@pytest.fixture
def open_service(started_open, valid):
    return valid(started_open)


# --- recorded traffic -----------------------------------------------------------------------------


class Recorder:
    """Between a client and the gateway: forwards one link, and keeps what the client sends."""

    def __init__(self, endpoint):
        self.port = int(endpoint.rpartition(":")[2])
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"{endpoint.rpartition(':')[0]}:{self._server.getsockname()[1]}"
        self.flights = []
        """What the client sent, divided where the gateway answered."""
        self._answered = True
        self._thread = threading.Thread(target=self._forward)
        self._thread.start()

    def _forward(self):
        client, _ = self._server.accept()
        gateway = socket.create_connection(("127.0.0.1", self.port))
        back = threading.Thread(target=self._answer, args=(gateway, client))
        back.start()
        while data := client.recv(65536):
            if self._answered:
                self.flights.append(b"")
            self._answered = False
            self.flights[-1] += data
            gateway.sendall(data)
        gateway.shutdown(socket.SHUT_WR)
        back.join()
        client.close()
        gateway.close()

    def _answer(self, gateway, client):
        with contextlib.suppress(OSError):
            while data := gateway.recv(65536):
                self._answered = True
                client.sendall(data)

    def close(self):
        self._server.close()
        self._thread.join(60)

    def replay(self):
        """Send it all again on a new link, as the client did; read until the gateway closes it."""
        address = ("127.0.0.1", self.port)
        with (
            socket.create_connection(address, timeout=60) as link,
            contextlib.suppress(ConnectionError),
        ):
            for flight in (*self.flights[:2], b"".join(self.flights[2:])):
                link.sendall(flight)
                if not link.recv(65536):
                    return
            while link.recv(65536):
                pass


@pytest.mark.parametrize(
    ("kind", "name"),
    [("open_service", ""), ("service", "operator.desk"), ("service", "operator.ward")],
)
def test_a_recorded_link_that_is_sent_again_is_refused_by_its_handshake(
    kind, name, request, eventually
):
    """Zenoh gives each link a cookie of its own, a password answers to one, and so does TLS."""
    service = request.getfixturevalue(kind)
    target, core = service.target(name), service.core
    recorder = Recorder(target.endpoints[0])
    with connected(target._replace(endpoints=(recorder.endpoint,))) as session:
        assert ask(session, target.control("enable"))[0]["outcome"] == "done"
        assert ask(session, target.control("stop"))[0]["outcome"] == "done"
    recorder.close()
    assert len(core.requests) == 1
    stop_count = core.levels[-1].stop_count

    recorder.replay()

    with connected(target) as session:
        assert ask(session, target.control("disable"))[0]["outcome"] == "done"
    assert [one.kind for one in core.requests] == [RequestKind.ENABLE, RequestKind.DISABLE]
    assert core.levels[-1].stop_count == stop_count
    assert len(recorder.flights) > 2


def setpoint(lease, seq, hip_nm=1.0):
    made = {"lease": lease, "seq": seq, "for_cycle": 1}
    return json.dumps({**made, "hip": {"assist": hip_nm}, "slide": {"assist": 0.0}})


class Refusals:
    """Setpoints refused since the last look, by reason, from the messages `health`."""

    def __init__(self, session, eventually):
        self._newest = None
        self._subscriber = session.declare_subscriber(f"{BASE}/health", self._receive)
        eventually(lambda: self._newest)
        self._before = Counter(self._newest)

    def _receive(self, sample):
        self._newest = json.loads(sample.payload.to_bytes())["setpoint_refused_count"]

    def since(self):
        return Counter(self._newest) - self._before

    def forget(self):
        self._before = Counter(self._newest)

    def close(self):
        self._subscriber.undeclare()


@pytest.fixture
def acquired(service, eventually):
    """A controller's session, and what makes it acquire the lease."""
    target = service.target("controller.desk")
    with connected(target) as session:

        def acquire():
            replies = []

            def granted():
                replies[:] = ask(session, target.control("acquire"), duration_ms=60_000)
                return replies[0]["lease"]

            eventually(granted)
            return replies[0]["lease"]

        yield session, acquire


def test_a_recorded_setpoint_is_refused_under_its_lease_and_after_it(service, acquired, eventually):
    holder, acquire = acquired
    controller = service.target("controller.desk")
    key, core = f"{BASE}/right/setpoint", service.core

    with (
        connected(service.target("controller.ward")) as other,
        connected(service.target("session.ward")) as stranger,
        contextlib.closing(Refusals(other, eventually)) as refusals,
    ):
        lease = acquire()
        for seq in (1, 2):
            holder.put(key, setpoint(lease, seq))
            eventually(lambda seq=seq: [one.seq for one in core.levels[-1].setpoints] == [seq])
        refusals.forget()

        # By Zenoh: a client that may send no setpoints. It is not even counted.
        stranger.put(key, setpoint(lease, 3))
        flush(stranger)
        # By the gateway: the same number, or an older one, whoever sends it.
        for sender in (holder, other):
            sender.put(key, setpoint(lease, 2))
            sender.put(key, setpoint(lease, 1))
            flush(sender)
        eventually(lambda: refusals.since() == {"repeated": 2, "reordered": 2})
        assert [one.seq for one in core.levels[-1].setpoints] == [2]

        # After the lease, and under the next one.
        for name in ("release", "acquire"):
            recorded = {"lease": lease, "client": "controller.desk"}
            assert not ask(other, controller.control(name), **recorded)
            reply = ask(other, service.target("controller.ward").control(name), **recorded)[0]
            assert (reply["outcome"], reply["refusal"]["code"]) == ("refused", "lease_taken")
        ask(holder, controller.control("release"), lease=lease)
        refusals.forget()
        holder.put(key, setpoint(lease, 3))
        eventually(lambda: refusals.since() == {"unleased": 1})
        again = acquire()
        holder.put(key, setpoint(lease, 4))
        eventually(lambda: refusals.since() == {"unleased": 1, "wrong_lease": 1})
        assert core.levels[-1].setpoints == ()

        # Not protected: another controller that knows the number, which none is told.
        other.put(key, setpoint(again, 9))
        eventually(lambda: [one.seq for one in core.levels[-1].setpoints] == [9])
        ask(holder, controller.control("release"), lease=again)


def test_no_recorded_setpoint_outlives_its_gateway(service, acquired, eventually):
    _, acquire = acquired
    operator, lease = service.target("operator.desk"), acquire()
    service.core.changes["mode"] = Mode.READY
    with connected(operator) as session:
        eventually(lambda: ask(session, operator.control("restart"))[0]["outcome"] == "done")
    service.wait_for_restart(eventually)

    with (
        connected(service.target("controller.desk")) as session,
        contextlib.closing(Refusals(session, eventually)) as refusals,
    ):
        session.put(f"{BASE}/right/setpoint", setpoint(lease, 1))
        eventually(lambda: refusals.since() == {"unleased": 1})
        assert service.core.levels[-1].lease == 0


def test_a_recorded_estimate_and_a_recorded_reply_come_from_the_gateway_alone(service, eventually):
    heard, replied = [], []
    key, status = f"{BASE}/right/estimate", f"{BASE}/control/status"
    with (
        connected(service.target("display.desk")) as present,
        connected(service.target("operator.ward")) as attacker,
        present.declare_subscriber(key, lambda sample: heard.append(sample.payload.to_bytes())),
        attacker.declare_queryable(status, lambda query: query.reply(status, replied[0])),
    ):
        eventually(lambda: heard)
        replied += [json.dumps(ask(present, status)[0])]
        attacker.put(key, heard[0])
        flush(attacker)
        reached = len(heard) + 20
        eventually(lambda: len(heard) >= reached)
        replies = ask(present, status)

    assert len(heard) == len(set(heard))
    assert len(replies) == 1
    assert json.dumps(replies[0]) != replied[0]


# --- connections that say nothing -----------------------------------------------------------------

MUTE_COUNT = 300


def test_300_connections_that_say_nothing_keep_no_new_client_out(service):
    """A client gives up before Zenoh closes them, if they take all places of new links."""
    target = service.target("operator.desk")
    port = int(target.endpoints[0].rpartition(":")[2])
    with contextlib.ExitStack() as mute:
        for _ in range(MUTE_COUNT):
            mute.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60))
        with Trainer(target.endpoints, target.credentials) as operator:
            assert operator.stop().outcome == "done"


# --- peers that scout -----------------------------------------------------------------------------

LIE = b'{"forged": true}'
SCOUTING = {
    "mode": "peer",
    "listen/endpoints": ["tcp/127.0.0.1:0"],
    "scouting/multicast/enabled": True,
    "scouting/gossip/enabled": True,
}
ANY_KIND = "peer|router|client"


def multicast_works():
    """Whether a datagram to Zenoh's group comes back on this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        try:
            end.bind(("", 0))
            group = socket.inet_aton("224.0.0.224") + socket.inet_aton("0.0.0.0")
            end.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            end.settimeout(10)
            end.sendto(b"back", ("224.0.0.224", end.getsockname()[1]))
            return end.recv(16) == b"back"
        except OSError:
            return False


def opened(**settings):
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return contextlib.closing(zenoh.open(config))


def test_a_peer_that_scouts_finds_another_peer_and_not_the_gateway(open_service, eventually):
    service = open_service
    if not multicast_works():
        pytest.skip("this machine has no multicast, so no peer can scout on it")
    heard, believed, answers = [], [], []
    with (
        connected(service.target("display.desk")) as present,
        present.declare_subscriber("**", lambda sample: believed.append(sample.payload.to_bytes())),
        opened(**SCOUTING) as attacker,
        attacker.declare_subscriber("**", lambda sample: heard.append(sample.payload.to_bytes())),
        opened(**SCOUTING) as peer,
    ):
        scout = zenoh.scout(lambda hello: answers.append(hello.zid), ANY_KIND)
        eventually(lambda: peer.zid() in attacker.info.peers_zid())
        eventually(lambda: answers.count(peer.zid()) > 1)
        scout.stop()
        for name in ("right/estimate", "right/activity", "safety", "events", "right/setpoint"):
            attacker.put(f"{BASE}/{name}", LIE)
        assert not ask(attacker, f"{BASE}/control/status")
        assert not ask(attacker, f"{BASE}/control/stop")
        reached = len(believed) + 20
        eventually(lambda: len(believed) >= reached)
        gateway = [*present.info.peers_zid()]
        found = {*answers, *attacker.info.peers_zid(), *attacker.info.routers_zid()}

    assert len(gateway) == 1
    assert not found & {*gateway}
    assert {*heard} <= {LIE}  # its own
    assert LIE not in believed


def test_the_gateway_introduces_no_peer_to_another(open_service, eventually):
    service = open_service
    gossiping = {**SCOUTING, "scouting/multicast/enabled": False}
    heard = []
    with (
        connected(service.target("display.desk"), **gossiping) as one,
        connected(service.target("operator.desk"), **gossiping) as other,
        one.declare_subscriber("**", heard.append),
    ):
        other.put("another/program", LIE)
        flush(other)
        reached = len(heard) + 20
        eventually(lambda: len(heard) >= reached)
        known = {*one.info.peers_zid(), *other.info.peers_zid()}
        zids = {one.zid(), other.zid()}

    assert len(known) == 1
    assert not known & zids
    assert not [sample for sample in heard if sample.payload.to_bytes() == LIE]


# --- floods ---------------------------------------------------------------------------------------

FLOOD = 90
QUERIES = (
    *("status", "config", "schema", "acquire", "release", "enable", "disable", "mode", "reset"),
    *("report", "plan", "mark", "restart"),
)
OWN = {
    "controller": {"status", "config", "schema", "acquire", "release", "report"},
    "session": {"status", "config", "schema", "enable", "disable", "mode", "reset"},
}


class Flood:
    """Queries of a client, and what became of them."""

    def __init__(self, session, target):
        self.session, self.target = session, target
        self.sent_count = self.ended_count = 0
        self.answered = Counter()

    def query(self, name, count=1):
        self.sent_count += count
        for _ in range(count):
            handler = zenoh.handlers.Callback(lambda _: self.answered.update([name]), self._end)
            self.session.get(self.target.control(name), handler, payload="{}", timeout=120.0)

    def _end(self):
        self.ended_count += 1


@pytest.mark.parametrize("role", ["controller", "session"])
def test_a_flood_takes_neither_the_lease_nor_the_stop_nor_memory(
    service, acquired, role, eventually
):
    """While the loop is held a flood can only pile up: what is kept of it has a bound."""
    holder, acquire = acquired
    key, core = f"{BASE}/right/setpoint", service.core
    target, display = service.target(f"{role}.ward"), service.target("display.desk")
    with (
        connected(target) as attacker,
        connected(display) as present,
        contextlib.closing(Refusals(present, eventually)) as refusals,
    ):
        lease = acquire()
        stop_count = core.levels[-1].stop_count
        flood, stops = Flood(attacker, target), Flood(attacker, target)
        bystander = Flood(present, display)
        with service.held():
            for name in QUERIES:
                flood.query(name, FLOOD)
            for seq in range(FLOOD):
                attacker.put(key, setpoint(lease + 1, seq))
                attacker.put(f"{BASE}/right/estimate", LIE)
            flush(attacker)
            holder.put(key, setpoint(lease, 1))
            flush(holder)
            eventually(lambda: flood.ended_count >= flood.sent_count - WAITING_MAX)
            assert not flood.answered
        eventually(lambda: flood.ended_count == flood.sent_count)
        eventually(lambda: [one.lease for one in core.levels[-1].setpoints] == [lease])
        assert 0 < flood.answered.total() <= WAITING_MAX
        assert set(flood.answered) <= OWN[role]
        assert (core.levels[-1].lease, core.levels[-1].stop_count) == (lease, stop_count)
        # A controller's setpoints are counted; those of other roles do not even arrive. Four are
        # kept of all that wait for one turn; what came before the loop was held had its own turns.
        if role == "controller":
            eventually(lambda: refusals.since().total() == FLOOD)
            assert refusals.since()["flood"] > refusals.since()["wrong_lease"] > 0
        else:
            assert not refusals.since()

        with service.held():
            stops.query("stop", FLOOD)
            flood.query("status", FLOOD)
            flush(attacker)
            bystander.query("stop")
            flush(present)
            eventually(lambda: stops.ended_count >= FLOOD - WAITING_MAX)
        eventually(lambda: bystander.answered["stop"])
        eventually(lambda: stops.ended_count == FLOOD)
        assert stops.answered["stop"] == WAITING_MAX
        eventually(lambda: core.levels[-1].stop_count == stop_count + WAITING_MAX + 1)
        assert core.levels[-1].lease == 0


def test_the_schemas_are_made_once_however_many_ask():
    assert wire.schemas() is wire.schemas()


# --- a restart ------------------------------------------------------------------------------------


@pytest.mark.parametrize("restarts", [True, False])
def test_a_stop_that_waits_when_the_gateway_ends_is_read_before(
    fake_core, eventually, monkeypatch, restarts
):
    """Zenoh has received the stop, and calls back only when the loop has ended."""
    arrived, loop_ended, received = threading.Event(), threading.Event(), publish.ZenohInquiry
    end_queries = publish.ZenohOutlet.end_queries

    def receive(query):
        inquiry = received(query)
        if inquiry.name == "stop":
            arrived.set()
            assert loop_ended.wait(60)
        return inquiry

    def end(outlet):
        loop_ended.set()
        end_queries(outlet)

    monkeypatch.setattr(publish, "ZenohInquiry", receive)
    monkeypatch.setattr(publish.ZenohOutlet, "end_queries", end)
    with running(fake_core) as service, contextlib.ExitStack() as clients:
        service.core.changes["mode"] = Mode.READY
        operator, display = service.target("operator.desk"), service.target("display.desk")
        session, present = (clients.enter_context(connected(one)) for one in (operator, display))
        eventually(lambda: is_valid(session) and service.core.levels)
        stop_count = service.core.levels[-1].stop_count
        requests, stop = Flood(session, operator), Flood(present, display)
        with service.held():
            if restarts:
                requests.query("restart")
                flush(session)
            else:
                service.end_soon()
            stop.query("stop")
            assert arrived.wait(60)
        eventually(lambda: service.core.levels[-1].stop_count == stop_count + 1)
        eventually(lambda: stop.answered["stop"])
        if restarts:
            service.wait_for_restart(eventually)
