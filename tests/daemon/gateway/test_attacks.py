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
from keyed_gateway import BASE, ROLES, ask, connected, is_alive, running

from daemon.ipc.record import Mode, RequestKind
from daemon.zenoh_io.client import Target

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
            eventually(lambda: ask(session, f"{BASE}/control/status")[0]["safety"]["valid"])
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
        self._thread.join(30)

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


def setpoint(lease, seq, hip_assist_nm=1.0):
    made = {"lease": lease, "seq": seq, "for_cycle": 1}
    return json.dumps({**made, "hip_assist_nm": hip_assist_nm, "slide_assist_n": 0.0})


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
def acquired(service):
    """A controller's session, and what makes it acquire the lease."""
    target = service.target("controller.desk")
    with connected(target) as session:

        def acquire():
            return ask(session, target.control("acquire"), duration_ms=60_000)[0]["lease"]

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
        assert is_alive(stranger)
        # By the gateway: the same number, or an older one, whoever sends it.
        for sender in (holder, other):
            sender.put(key, setpoint(lease, 2))
            sender.put(key, setpoint(lease, 1))
            assert is_alive(sender)
        eventually(lambda: refusals.since() == {"repeated": 2, "reordered": 2})
        assert [one.seq for one in core.levels[-1].setpoints] == [2]

        # After the lease, and under the next one.
        for name in ("release", "acquire"):
            recorded = {"lease": lease, "client": "controller.desk"}
            assert not ask(other, controller.control(name), **recorded)
            reply = ask(other, service.target("controller.ward").control(name), **recorded)[0]
            assert (reply["outcome"], "holds the lease" in reply["reason"]) == ("refused", True)
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
        assert is_alive(attacker)
        reached = len(heard) + 20
        eventually(lambda: len(heard) >= reached)
        replies = ask(present, status)

    assert len(heard) == len(set(heard))
    assert len(replies) == 1
    assert json.dumps(replies[0]) != replied[0]
