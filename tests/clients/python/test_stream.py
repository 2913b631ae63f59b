"""What a stream yields of messages, silence and nonsense, by a clock that the test sets."""

import asyncio
import threading

import msgspec
import pytest
from gaitd_client import NotValid, Trouble, wire
from gaitd_client import stream as stream_module
from gaitd_client.stream import SECOND_SILENCE_NS, Stream, Watch

KEY = "gaitd/trainer/right/friction"
MS = 1_000_000
SCHEMA = "gaitd.friction.v1"


class Clock:
    def __init__(self):
        self.ms = 5_000

    def now_ns(self):
        return self.ms * MS


def message(cycle):
    empty = dict.fromkeys(wire.AxisFriction.__struct_fields__) | {"validity": "ok"}
    return wire.Friction(
        seq=cycle,
        core_boot_id="b",
        cycle=cycle,
        sample_time_ns=0,
        leg="right",
        mode="hold",
        status=(),
        status_bits="0x0000",
        hip=wire.AxisFriction(**empty),
        slide=wire.AxisFriction(**empty),
    )


def payload(cycle):
    return msgspec.json.encode(message(cycle))


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def stream(clock):
    return Stream(KEY, wire.Friction, Watch(clock))


def taken(stream, count):
    """So many items from the iterator, in a short form."""
    return [short(item) for _, item in zip(range(count), stream, strict=False)]


def short(item):
    return item.trouble if isinstance(item, NotValid) else item.cycle


def test_silence_of_200_ms_is_yielded_once_and_ends_with_the_next_message(stream, clock):
    stream.receive(payload(1))
    assert taken(stream, 1) == [1]
    clock.ms += 200
    assert short(stream.newest()) == 1

    clock.ms += 1

    assert taken(stream, 1) == [Trouble.SILENT]
    assert stream.newest() == NotValid(KEY, Trouble.SILENT, stream.newest().text)
    stream.receive(payload(2))
    assert short(stream.newest()) == 2
    assert taken(stream, 1) == [2]
    clock.ms += 201
    assert taken(stream, 1) == [Trouble.SILENT]


def test_a_stream_that_never_got_a_message_is_silent(stream, clock):
    assert short(stream.newest()) == Trouble.SILENT
    clock.ms += 201
    assert taken(stream, 1) == [Trouble.SILENT]


def test_a_slow_consumer_gets_the_newest_and_the_count_of_the_others(stream, clock):
    for cycle in range(1, 6):
        stream.receive(payload(cycle))

    assert taken(stream, 1) == [5]
    assert stream.dropped_count == 4


def test_a_message_that_waited_through_a_silence_is_not_passed_off_as_new(stream, clock):
    stream.receive(payload(1))
    clock.ms += 201

    assert taken(stream, 1) == [Trouble.SILENT]
    assert stream.dropped_count == 1


def test_a_backlog_keeps_the_order_and_drops_the_oldest(clock):
    stream = Stream(KEY, wire.Friction, Watch(clock), keep=3)
    for cycle in range(1, 6):
        stream.receive(payload(cycle))
    clock.ms += 201

    assert taken(stream, 4) == [3, 4, 5, Trouble.SILENT]
    assert stream.dropped_count == 2
    with pytest.raises(ValueError, match="at least 1"):
        Stream(KEY, wire.Friction, Watch(clock), keep=0)


def test_a_rare_message_is_of_the_past_once_the_trainer_was_silent(clock):
    trainer = Watch(clock)
    stream = Stream("gaitd/trainer/safety", wire.Friction, trainer, is_cyclic=False)
    stream.receive(payload(1))
    for _ in range(5):
        clock.ms += 100
        trainer.beat()
    assert short(stream.newest()) == 1

    clock.ms += 900
    trainer.beat()  # the trainer is back, and this value is not known to be true any more

    assert short(stream.newest()) == Trouble.SILENT
    # So does an iterator that was busy meanwhile: the value that waited is dropped.
    assert (taken(stream, 1), stream.dropped_count) == ([Trouble.SILENT], 1)
    stream.receive(payload(2))
    assert short(stream.newest()) == 2
    assert taken(stream, 1) == [2]


def test_a_key_with_one_message_a_second_is_silent_after_one_and_a_half(clock):
    stream = Stream(KEY, wire.Friction, Watch(clock, SECOND_SILENCE_NS))
    stream.receive(payload(1))
    clock.ms += 1_500
    assert short(stream.newest()) == 1
    clock.ms += 1
    assert stream.newest().text == f"no message on {KEY} for 1500 ms: nothing is known"


@pytest.mark.parametrize(
    ("data", "schema", "text"),
    [
        (b"{", SCHEMA, "is no gaitd.friction.v1"),
        (b'{"seq": "one"}', SCHEMA, "is no gaitd.friction.v1"),
        (b"\xff\xfe", SCHEMA, "is no gaitd.friction.v1"),
        (b"[" * 100_000, SCHEMA, "is no gaitd.friction.v1"),
        (payload(1), "gaitd.friction.v2", "is gaitd.friction.v2, this client reads gaitd.fric"),
    ],
)
def test_a_payload_that_cannot_be_read_says_why_and_ends_nothing(stream, data, schema, text):
    stream.receive(data, schema)
    assert stream.newest() is stream.newest()
    (item,) = [item for _, item in zip(range(1), stream, strict=False)]

    assert (item.key, item.trouble) == (KEY, Trouble.UNREADABLE)
    assert text in item.text
    assert stream.unreadable_count == 1
    stream.receive(payload(2), SCHEMA)
    assert taken(stream, 1) == [2]


def test_an_iterator_waits_for_another_thread_and_ends_with_the_stream(stream):
    got, first = [], threading.Event()

    def note(item):
        got.append(short(item))
        first.set()

    stream.call(note)
    stream.receive(payload(1))
    assert first.wait(10)
    stream.close()

    assert got == [1]
    assert list(stream) == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_exception_in_a_call_is_raised_at_the_end_and_nothing_is_valid_after_it(stream):
    is_called = threading.Event()

    def fail(_item):
        is_called.set()
        raise ZeroDivisionError("in the function")

    with pytest.raises(ZeroDivisionError), stream:
        stream.call(fail)
        stream.receive(payload(1))
        assert is_called.wait(10)
    stream.receive(payload(2))

    assert short(stream.newest()) is Trouble.FAILED
    assert "has raised ZeroDivisionError: in the function" in stream.newest().text
    assert taken(stream, 2) == [Trouble.FAILED]


def test_asyncio_waits_for_a_message_from_another_thread(stream, clock):
    async def consume():
        threading.Timer(0.05, stream.receive, [payload(1)]).start()
        got = []
        async for item in stream:
            got.append(short(item))
            clock.ms += 201
            if len(got) == 2:
                stream.close()
        return got

    assert asyncio.run(consume()) == [1, Trouble.SILENT]


@pytest.mark.parametrize("turn_count", range(6))
def test_a_cancellation_at_the_moment_of_a_message_is_not_lost(stream, monkeypatch, turn_count):
    monkeypatch.setattr(stream_module, "POLL_S", 60.0)

    async def turns(count):
        for _ in range(count):
            await asyncio.sleep(0)

    async def consume():
        async for _ in stream:
            pass

    async def cancel():
        task = asyncio.create_task(consume())
        await turns(5)
        stream.receive(payload(1))
        await turns(turn_count)
        task.cancel()
        await turns(10)
        return task.cancelled()

    assert asyncio.run(cancel())


def test_an_event_loop_that_was_closed_does_not_stop_the_stream(clock):
    closed = []
    stream = Stream(KEY, wire.Friction, Watch(clock), on_close=lambda: closed.append(True))
    loop, items = asyncio.new_event_loop(), aiter(stream)
    stream.receive(payload(1))
    assert short(loop.run_until_complete(anext(items))) == 1
    loop.close()

    stream.receive(payload(2))
    assert taken(stream, 1) == [2]
    stream.close()
    assert closed == [True]
