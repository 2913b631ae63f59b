"""A lease with a service that grants it at once: which setpoints are sent, and how all of it ends.

Streams call the lease in the thread of the test, so that the order of messages is known.
"""

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from display_bench import filled
from gaitd_client import (
    Assist,
    AsyncLease,
    AsyncTrainer,
    ClientError,
    Estimate,
    Health,
    Lease,
    NoAnswerError,
    NotReturnedError,
    NotValid,
    Reply,
    RequestRefusedError,
    Safety,
    Target,
    Trouble,
    stream,
)
from gaitd_client import lease as lease_module
from gaitd_client.stream import Stream, Watch
from gaitd_client.wire import Configuration, Refusal

BOOT = {"core_boot_id": "boot"}
SILENCE = NotValid("safety", Trouble.SILENT, "no message for 1500 ms")


def taken(holder):
    return Refusal(code="lease_taken", subject=None, values={"holder": holder}, said="")


class Clock:
    def now_ns(self):
        return 0


class Direct(Stream):
    """A stream that calls in the thread of the sender."""

    def call(self, function):
        self.send = function


class Service:
    """What a lease uses of a trainer: one machine with two legs."""

    def __init__(self, stream_kind=Direct):
        self.target, self.clock, self.stream_kind = Target(), Clock(), stream_kind
        self.cycle, self.mode, self.holder, self.number = 100, "hold", None, 0
        self.setpoints, self.streams, self.publishers = [], {}, set()
        self.leg_names = ("right", "left")
        self.is_late = False
        """True if a setpoint was sent after its publisher has ended."""
        self.release_error = self.declare_error = None
        self.released = []

    # as Trainer

    def configuration(self):
        return filled(Configuration, leg_names=self.leg_names)

    def connected_session(self):
        return self

    def _stream(self, key, kind):
        self.streams[key] = self.stream_kind(
            key, kind, Watch(self.clock), on_close=lambda: self.streams.pop(key)
        )
        return self.streams[key]

    def estimate(self, leg):
        return self._stream(leg, Estimate)

    def safety(self):
        return self._stream("safety", Safety)

    def health(self):
        return self._stream("health", Health)

    def acquire(self, client, duration_ms):
        head = {**BOOT, "cycle": self.cycle, "request": "acquire"}
        if self.holder is not None:
            return filled(Reply, **head, outcome="refused", refusal=taken(self.holder))
        self.holder, self.number = client, self.number + 1
        return filled(Reply, **head, outcome="done", lease=self.number)

    def request(self, name, client, lease):
        assert (name, client) == ("release", "test")
        if self.release_error is not None:
            raise self.release_error
        self.released.append(lease)
        self.holder = None

    # as a session

    def declare_publisher(self, key, **_settings):
        if self.declare_error is not None and self.publishers:
            raise self.declare_error
        return Publisher(self, key)

    # of the test

    def estimates(self, mode=None, legs=("right", "left")):
        """One cycle; return the assist at the hip of the setpoints that answer it."""
        self.mode, self.cycle, count = mode or self.mode, self.cycle + 1, len(self.setpoints)
        for leg in legs:
            head = {**BOOT, "cycle": self.cycle, "leg": leg, "mode": self.mode}
            self.streams[leg].send(filled(Estimate, **head))
        return [setpoint["hip"]["assist"] for setpoint in self.setpoints[count:]]

    def tell_safety(self, *, valid=True):
        self.cycle += 1
        head = {**BOOT, "cycle": self.cycle, "valid": valid, "mode": self.mode}
        self.streams["safety"].send(filled(Safety, **head, lease_holder=self.holder))

    def tell_health(self, **refused):
        self.streams["health"].send(filled(Health, setpoint_refused_count=refused))

    @property
    def is_left(self):
        return not self.streams and not self.publishers


class Publisher:
    def __init__(self, service, key):
        self.service, self.key = service, key
        service.publishers.add(key)

    def put(self, data):
        # Only noted: an exception here would be taken for one of the law.
        self.service.is_late |= self.key not in self.service.publishers
        self.service.setpoints.append(msgspec.json.decode(data))

    def undeclare(self):
        self.service.publishers.remove(self.key)


@pytest.fixture
def service():
    made = Service()
    yield made
    assert not made.is_late


def lease_of(service, law=lambda _: Assist(3.0), legs=None, on_refusal=None):
    return Lease(service, "test", law, legs, None, on_refusal)


def returns(value):
    return lambda _estimate: value


def exits(_estimate):
    raise SystemExit(3)


@pytest.mark.parametrize(
    ("law", "error", "text"),
    [
        (returns(None), TypeError, "leg right, cycle 101: None; return an Assist"),
        (returns(3.0), TypeError, "3.0; return an Assist"),
        (returns(Assist(1.0, None)), TypeError, "slide_n = None; a number is needed"),
        (returns(Assist(1.0, "2")), TypeError, "slide_n = '2'"),
        (exits, SystemExit, "3"),
    ],
)
def test_a_law_that_fails_in_any_way_ends_the_answers_for_both_legs(service, law, error, text):
    with pytest.raises(error, match=text) as raised, lease_of(service, law) as lease:
        assert service.estimates("gait") == []
        service.tell_safety()
        assert not lease.is_held
        assert f"ended by {error.__name__}" in lease.why_not
        lease.wait()

    assert not getattr(raised.value, "__notes__", [])
    assert service.is_left
    assert service.released == [1]


def test_numbers_of_numpy_are_sent_and_what_is_not_finite_is_counted(service):
    pulls = [np.float32(2.5)]
    refusals = []
    law = lambda _: Assist(pulls[0], np.int64(4))  # noqa: E731
    with lease_of(service, law, on_refusal=refusals.append) as lease:
        assert service.estimates("hold") == [0.0, 0.0]
        assert service.estimates("torque") == [2.5, 2.5]
        assert service.setpoints[-1] == {
            "lease": 1,
            "seq": 4,
            "for_cycle": 102,
            "hip": {"assist": 2.5},
            "slide": {"assist": 4.0},
            "stiffness_ratio": 1.0,
        }
        pulls[0] = np.nan
        assert service.estimates("torque", ["left"]) == []
        assert lease.is_held

        service.tell_health(stale=5)  # those of before the first report are not counted
        service.tell_health(stale=7, of_later=1)
        service.tell_health(stale=2, of_later=1)  # the gateway or the core has restarted
        service.tell_health(stale=3, of_later=1)

    assert [(refusal.reason, refusal.setpoint_count) for refusal in refusals] == [
        ("non_finite", 1),
        ("stale", 2),
        ("of_later", 1),
        ("stale", 1),
    ]
    assert lease.refused_count == {"non_finite": 1, "stale": 3, "of_later": 1}


def test_an_exception_of_on_refusal_is_raised_as_that_of_the_law(service):
    def law(_estimate):
        service.tell_health(stale=1)
        return Assist(3.0)

    with (
        pytest.raises(ZeroDivisionError),
        lease_of(service, law, on_refusal=lambda _: 1 // 0) as lease,
    ):
        service.tell_health(stale=0)
        assert service.estimates("torque") == []
        lease.wait()


def test_after_a_loss_the_law_waits_until_the_mode_is_requested_again(service):
    with lease_of(service) as lease:
        assert service.estimates("gait") == [3.0, 3.0]
        service.holder = None  # its time is over, and the gait continues
        service.tell_safety()

        assert (lease.is_held, service.number) == (True, 2)
        assert "until the mode is left and requested again" in lease.why_not
        assert service.estimates("gait") == [0.0, 0.0]
        assert service.setpoints[-1]["lease"] == 2

        service.cycle -= 3  # one of before the loss, which had waited behind a call of the law
        assert service.estimates("hold") == [0.0, 0.0]
        assert service.estimates("gait") == [0.0, 0.0]
        service.cycle += 3
        assert service.estimates("hold") == [0.0, 0.0]
        assert lease.why_not == ""
        assert service.estimates("gait") == [3.0, 3.0]


def test_a_lease_is_acquired_again_after_a_stop_only_while_estimates_arrive(service):
    with lease_of(service) as lease:
        service.estimates("torque")
        service.holder, service.mode = None, "fault"
        service.tell_safety()
        assert not lease.is_held
        assert "must be reset" in lease.why_not
        service.holder, service.mode = "another", "ready"
        service.tell_safety()
        assert lease.why_not == "held by another"
        service.holder = None
        service.tell_safety()
        assert (lease.is_held, service.number) == (True, 2)

        service.holder = None  # it expires, because no estimate was there to answer
        for _ in range(3):
            service.tell_safety()
        assert (lease.is_held, service.number) == (False, 2)
        assert "no estimate arrives" in lease.why_not
        service.estimates("ready")
        service.tell_safety()
        assert (lease.is_held, lease.why_not, service.number) == (True, "", 3)


def test_nothing_is_known_of_the_lease_while_the_service_is_away(service):
    with lease_of(service) as lease:
        assert (lease.is_held, lease.why_not) == (True, "")
        service.streams["safety"].send(SILENCE)
        assert not lease.is_held
        assert "1500 ms" in lease.why_not
        service.tell_safety(valid=False)
        assert not lease.is_held
        assert "nothing from the core" in lease.why_not
        service.tell_safety()
        assert (lease.is_held, lease.why_not, service.number) == (True, "", 1)


def test_a_law_that_does_not_return_gets_no_lease_again_and_is_left_behind(monkeypatch):
    monkeypatch.setattr(stream, "JOIN_S", 0.05)
    service, is_called, may_return = Service(Stream), threading.Event(), threading.Event()

    def law(_estimate):
        is_called.set()
        may_return.wait()
        return Assist(5.0)

    with (
        pytest.raises(NotReturnedError, match="the law does not return: right"),
        lease_of(service, law) as lease,
    ):
        head = {**BOOT, "cycle": 101, "mode": "gait"}
        calls = [service.streams[leg]._calls for leg in ("right", "left")]
        service.streams["right"].receive(msgspec.json.encode(filled(Estimate, leg="right", **head)))
        assert is_called.wait(10)
        service.streams["left"].receive(msgspec.json.encode(filled(Estimate, leg="left", **head)))
        service.holder = None
        for _ in range(2):
            lease._follow(filled(Safety, **head, valid=True))
        assert (lease.is_held, service.number) == (False, 1)
        assert lease.why_not == "the law does not return"

    assert service.is_left
    may_return.set()
    for call in calls:
        call.join(60)
        assert not call.is_alive()
    assert service.setpoints == []


def test_what_the_law_returns_after_the_loss_of_its_lease_is_not_sent(service):
    def law(_estimate):
        service.holder = None
        service.tell_safety()
        return Assist(5.0)

    with lease_of(service, law) as lease:
        assert service.estimates("gait", ["right"]) == []
        assert lease.why_not == "the law does not return"


def test_an_estimate_of_before_a_loss_does_not_clear_it_in_the_same_moment(service, monkeypatch):
    is_newer, losing = lease_module._is_newer, []

    def lose_meanwhile(message, other):
        """Lose the lease in another thread while the estimate is compared with an older loss."""
        if isinstance(message, Estimate):
            service.holder = None
            losing.append(threading.Thread(target=service.tell_safety))
            losing[0].start()
            losing[0].join(0.1)
        return is_newer(message, other)

    with lease_of(service) as lease:
        service.estimates("gait")
        service.holder = None
        service.tell_safety()
        monkeypatch.setattr(lease_module, "_is_newer", lose_meanwhile)
        service.estimates("hold", ["right"])
        losing[0].join(60)
        service.tell_safety()
        assert lease.is_held
        assert "until the mode is left" in lease.why_not


def test_what_fails_half_way_through_with_leaves_nothing_behind(service):
    service.declare_error = ClientError("no second publisher")
    with pytest.raises(ClientError, match="no second"):
        lease_of(service).__enter__()
    assert (service.is_left, service.number) == (True, 0)

    service.declare_error, service.holder = None, "another"
    refused = lease_of(service)
    with pytest.raises(RequestRefusedError, match="another holds the lease"):
        refused.__enter__()
    assert (service.is_left, service.released) == (True, [])
    service.holder = None
    with refused:  # the same one may be tried again
        assert service.estimates("torque") == [3.0, 3.0]

    for legs in ([], ["middle"]):
        with pytest.raises(ValueError, match=r"one or more of \('right', 'left'\)"):
            lease_of(service, legs=legs).__enter__()
    service.leg_names = ()
    with pytest.raises(NoAnswerError, match=r"no records of a core yet.* start the core"):
        lease_of(service).__enter__()
    with pytest.raises(TypeError, match="legs = 'right'"):
        lease_of(service, legs="right")


def test_no_exception_is_lost_at_the_end(service):
    service.release_error = NoAnswerError("no answer to release")
    with pytest.raises(ZeroDivisionError) as raised, lease_of(service, lambda _: 1 // 0):
        service.estimates("torque")
    assert "NoAnswerError: no answer to release" in raised.value.__notes__[0]

    service.holder = None
    with pytest.raises(KeyError, match="body") as raised, lease_of(service, lambda _: 1 // 0):
        service.estimates("torque")
        raise KeyError("body")
    notes = "\n".join(raised.value.__notes__)
    assert "ZeroDivisionError" in notes
    assert "NoAnswerError" in notes

    service.holder = None
    with pytest.raises(NoAnswerError), lease_of(service):
        pass

    service.holder, service.release_error = None, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt) as raised, lease_of(service, lambda _: 1 // 0):
        service.estimates("torque")
    assert "ZeroDivisionError" in raised.value.__notes__[0]


class Slow:
    """Something that takes its time to be entered."""

    def __init__(self):
        self.may_enter, self.is_entering, self.count = threading.Event(), threading.Event(), 0

    def __enter__(self):
        self.is_entering.set()
        self.may_enter.wait()
        self.count += 1
        return self

    def __exit__(self, *_error):
        self.count -= 1


def async_trainer_of(manager):
    made = AsyncTrainer()
    made.sync = manager
    return made


@pytest.mark.parametrize("made_of", [AsyncLease, async_trainer_of])
def test_what_is_cancelled_while_it_enters_is_left_again(made_of):
    slow = Slow()

    async def enter():
        async with made_of(slow):
            raise AssertionError("entered after its cancellation")

    async def cancel():
        task = asyncio.create_task(enter())
        await asyncio.to_thread(slow.is_entering.wait)
        for _ in range(2):  # a second cancellation does not leave it behind, either
            task.cancel()
            await asyncio.sleep(0)
        assert not task.done()
        slow.may_enter.set()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancel())
    assert slow.count == 0


def test_in_asyncio_the_law_raises_in_wait_and_the_callers_exception_is_not_that_of_the_body(
    service,
):
    async def run():
        try:
            {}["handled by the caller"]
        except LookupError:
            async with AsyncLease(lease_of(service, lambda _: 1 // 0)) as lease:
                waiting = asyncio.create_task(lease.wait())
                await asyncio.sleep(0)
                service.estimates("torque")
                assert not lease.is_held
                with pytest.raises(ZeroDivisionError):
                    await waiting

    with pytest.raises(ZeroDivisionError):
        asyncio.run(run())
    assert service.is_left


def test_a_stop_and_the_end_of_a_lease_do_not_wait_behind_other_work(service):
    trainer = async_trainer_of(SimpleNamespace(stop=lambda: "stopped"))
    may_end = threading.Event()

    async def run():
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        work = asyncio.create_task(asyncio.to_thread(may_end.wait, 10))
        await asyncio.sleep(0)
        async with AsyncLease(lease_of(service)):
            assert await trainer.stop() == "stopped"
        assert service.is_left
        assert not work.done()
        may_end.set()
        await work

    asyncio.run(run())
