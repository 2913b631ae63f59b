"""A trainer without a service: when it declares its subscribers, and how often it sends a stop."""

import threading
from types import SimpleNamespace

import msgspec
import pytest
import zenoh
from display_bench import filled
from gaitd_client import (
    ClientError,
    EndpointError,
    NoAnswerError,
    NoServiceError,
    NotValid,
    Reply,
    Safety,
    Target,
    Trainer,
    connection,
    trainer,
)
from gaitd_client.clock import MonotonicClock
from gaitd_client.connection import Connection
from gaitd_client.stream import SILENCE_NS
from gaitd_client.subscriptions import Subscriptions

KEY = "gaitd/trainer/safety"


class Session:
    def __init__(self, error=None):
        self.error, self.declared, self.is_closed = error, {}, False
        self.answers = []
        """What each query gets in turn: replies, or an error."""
        self.is_complete = threading.Event()

    def declare_subscriber(self, key, take):
        if self.error is not None and self.declared:
            raise self.error
        self.declared[key] = take
        if len(self.declared) == 2:
            self.is_complete.set()
        return Subscriber(self, key)

    def get(self, _key, payload, timeout):
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def close(self):
        self.is_closed = True


class Subscriber:
    def __init__(self, session, key):
        self.session, self.key = session, key

    def undeclare(self):
        assert not self.session.is_closed
        del self.session.declared[self.key]


@pytest.fixture
def sessions(monkeypatch):
    """What `zenoh.open` returns or raises, in turn."""
    given = []

    def open_session(_target):
        one = given.pop(0)
        if isinstance(one, Exception):
            raise one
        return one

    monkeypatch.setattr(connection, "open_session", open_session)
    monkeypatch.setattr(connection, "RETRY_S", 0.01)
    monkeypatch.setattr(trainer, "STOP_RETRY_S", 0.0)
    return given


def test_a_stream_of_before_with_works_inside_and_none_is_made_after(sessions):
    sessions.append(session := Session())
    made = Trainer()
    safety, health = made.safety(), made.health()

    with made:
        assert session.declared.keys() == {KEY, "gaitd/trainer/health"}
        health.close()
        assert session.declared.keys() == {KEY}

    assert session.is_closed
    assert list(safety) == []
    with pytest.raises(ClientError, match="safety: `with` of the trainer was left"):
        made.safety()


def test_what_is_declared_before_there_is_a_session_is_declared_with_it(sessions):
    sessions += [NoServiceError("away"), session := Session()]
    made, declared = Connection(Target(), keep_trying=True), threading.Event()
    kept, withdrawn = lambda _session: declared.set(), lambda _session: pytest.fail("withdrawn")
    made.declare(kept)
    made.declare(withdrawn)
    made.withdraw(withdrawn)

    made.begin()
    assert declared.wait(10)
    made.end()
    assert made.is_open
    assert made.session() is session
    later = []
    made.declare(later.append)
    assert later == [session]

    made.close()
    assert session.is_closed
    assert not made.is_open


class Open:
    """A connection with one session."""

    target = Target()

    def __init__(self):
        self.is_over, self.session = threading.Event(), Session()

    def declare(self, declare):
        declare(self.session)

    def withdraw(self, declare):
        pass


def test_streams_without_regular_messages_share_the_watch_of_the_trainer():
    made = Open()
    streams = Subscriptions(made, MonotonicClock())
    for name in ("stride", "events"):
        streams.open(Safety, name, keep=1, silence_ns=None)
    streams.open(Safety, "safety", keep=1, silence_ns=SILENCE_NS)

    keys = {f"gaitd/trainer/{name}" for name in ("stride", "events", "safety", "drives/*/*")}
    assert made.session.declared.keys() == keys
    streams.close()
    assert made.session.declared.keys() == {"gaitd/trainer/drives/*/*"}


def test_a_session_that_is_lost_while_streams_are_declared_is_opened_again(sessions):
    away, lost, good = NoServiceError("away"), Session(zenoh.ZError("lost")), Session()
    sessions += [away, lost, good]

    made = Trainer(keep_trying=True)
    safety = made.safety()
    made.health()
    with made:
        assert good.is_complete.wait(10)
        assert lost.is_closed
        assert isinstance(safety.newest(), NotValid)
        assert good.declared.keys() == {KEY, "gaitd/trainer/health"}
    assert not good.declared

    sessions.append(broken := Session(KeyError("a bug")))
    early = Trainer()
    early.safety()
    early.health()
    with pytest.raises(KeyError, match="a bug"), early:
        pass
    assert broken.is_closed

    sessions.append(Session(zenoh.ZError("lost")))
    late = Trainer()
    late.safety()
    late.health()
    with pytest.raises(NoServiceError, match="the connection was lost"), late:
        pass


def test_a_function_that_does_not_return_does_not_keep_the_session_open(sessions, monkeypatch):
    monkeypatch.setattr("gaitd_client.stream.JOIN_S", 0.05)
    sessions.append(session := Session())
    is_called, may_return = threading.Event(), threading.Event()

    def take(_item: Safety | NotValid):
        is_called.set()
        may_return.wait()

    with pytest.raises(ClientError, match="a call has not returned"), Trainer() as made:
        safety = made.safety()
        safety.call(take)
        safety.receive(b"")
        assert is_called.wait(10)
    assert session.is_closed
    may_return.set()


def test_why_there_is_no_connection_is_said_with_each_request(sessions, monkeypatch):
    monkeypatch.setattr(connection, "RETRY_S", 60.0)
    made = Trainer(keep_trying=True)
    with pytest.raises(NoAnswerError, match="not connected: use `with`"):
        made.status()
    sessions.append(NoServiceError("the certificate has expired"))
    with made, pytest.raises(NoAnswerError, match="not connected: the certificate has expired"):
        made.status()
    with pytest.raises(NoAnswerError, match="not connected: `with` was left"):
        made.status()


def reply_of(request):
    sample = SimpleNamespace(
        encoding="application/json",
        payload=zenoh.ZBytes(msgspec.json.encode(filled(Reply, request=request, outcome="done"))),
    )
    return SimpleNamespace(ok=sample, err=None)


def test_a_stop_is_sent_until_it_is_answered_and_no_other_request_is(sessions, monkeypatch):
    sessions.append(session := Session())
    with Trainer() as made:
        session.answers = [zenoh.ZError("lost"), [], [reply_of("stop")], []]
        assert made.stop().request == "stop"
        with pytest.raises(NoAnswerError):
            made.enable()
        assert not session.answers

        monkeypatch.setattr(trainer, "ANSWER_TIMEOUT_S", 0.0)
        session.answers = [[]]
        with pytest.raises(
            NoAnswerError,
            match=r"may not have stopped: .* hand switch.* emergency stop \(no answer",
        ):
            made.stop()


def test_the_name_of_a_leg_or_a_drive_is_one_of_the_machine():
    made = Trainer()
    for stream_of in (made.estimate, made.activity, made.friction, made.stride):
        with pytest.raises(ValueError, match=r"gaitd/trainer/\*/.*: '\*' is none of right, left"):
            stream_of("*")
    with pytest.raises(ValueError, match=r"drives/right/hop: 'right/hop' is none of right/hip, "):
        made.drive("right/hop")
    assert made.drive("left/slide").key == "gaitd/trainer/drives/left/slide"


@pytest.mark.parametrize(
    "endpoint",
    ["nonsense", "tcp/127.0.0.1", "tcp/127.0.0.1:0", "tcp/127.0.0.1:65536", "foo/host:7447", ""],
)
def test_an_endpoint_on_which_no_service_can_listen_is_refused_at_once(endpoint):
    with pytest.raises(EndpointError, match=f"^endpoint {endpoint!r}: allowed are tcp/HOST:PORT"):
        Trainer(endpoint)


@pytest.mark.parametrize("endpoint", ["tls/[::1]:7447", "unixsock-stream//run/gaitd/zenoh.sock"])
def test_any_other_endpoint_is_taken_as_it_is(endpoint):
    assert Trainer(endpoint).target.endpoints == (endpoint,)
