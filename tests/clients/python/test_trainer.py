"""When a trainer declares its subscribers, before, inside and after `with`; without a service."""

import threading

import pytest
import zenoh
from gaitd_client import ClientError, NoServiceError, NotValid, Safety, Trainer, trainer

KEY = "gaitd/trainer/safety"


class Session:
    def __init__(self, error=None):
        self.error, self.declared, self.is_closed = error, {}, False
        self.is_complete = threading.Event()

    def declare_subscriber(self, key, take):
        if self.error is not None and self.declared:
            raise self.error
        self.declared[key] = take
        if len(self.declared) == 2:
            self.is_complete.set()
        return Subscriber(self, key)

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

    monkeypatch.setattr(trainer, "open_session", open_session)
    monkeypatch.setattr(trainer, "RETRY_S", 0.01)
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


def test_a_session_that_is_lost_while_streams_are_declared_is_opened_again(sessions):
    away, lost, good = NoServiceError("away"), Session(zenoh.ZError("lost")), Session()
    sessions += [away, lost, good]

    with Trainer(keep_trying=True) as made:
        safety = made.safety()
        made.health()
        assert good.is_complete.wait(10)
        assert lost.is_closed
        assert isinstance(safety.newest(), NotValid)
        assert good.declared.keys() == {KEY, "gaitd/trainer/health"}
    assert not good.declared

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
