"""A recording in place of a core: what is published of it, and that nothing moves by it."""

import contextlib
import re
import threading
from pathlib import Path

import pytest
from gaitd_client import NoAnswerError, NotValid, RequestRefusedError, Trainer, Trouble
from gaitd_names import RefusalCode
from gaitd_texts import Reader, catalogue
from tutorial import example

from analysis.stop_recording import opened
from daemon.gateway.clients import PlanStore
from daemon.gateway.playback import NO_LEASE, Readers, Recorded, play
from daemon.gateway.service import Gateway

SAMPLE = Path(__file__).parents[3] / "gaitd" / "sample.ring.xz"
PACE = 20.0
WALKING = catalogue(Reader.OPERATOR, "en").text("mode.gait")
SHOWN = re.compile(rf"\[#+\.+\] {WALKING} .*\nstride \d: \d+%", re.DOTALL)


@pytest.fixture(scope="module")
def tape():
    with opened(SAMPLE) as ring:
        return ring.header, ring.since(0)


def test_the_sample_is_published_whole_with_its_strides_modes_and_stop(bench, tape):
    header, records = tape
    clock, outlet = bench.clock, bench.outlet
    source = Recorded(header, records, clock, PACE)
    plans = PlanStore(bench.runtime / "plan.json", bench.submit)
    gateway = Gateway(source, outlet, clock, "trainer", ("x",), NO_LEASE, Readers(), plans, str)
    turn_count = 0
    while not source.is_over:
        clock.ns += 1_000_000
        gateway.publish_estimates(clock.ns)
        gateway.turn(clock.ns, [])
        turn_count += 1

    span_ms = (records[-1].sync_mono_ns - records[0].sync_mono_ns) / PACE / 1e6
    assert turn_count == pytest.approx(span_ms, abs=2)
    for name in ("estimate", "activity", "friction"):
        assert [one.cycle for one in outlet.on(f"right/{name}")] == [one.cycle for one in records]
    strides = outlet.on("right/stride")
    assert [one.number for one in strides] == [1, 2, 3]
    assert strides[0].share_ratio < 0.1
    assert strides[-1].share_ratio > 0.25
    stages = [one.stage for one in outlet.on("safety")]
    assert list(dict.fromkeys(stages)) == [None, "announcing", "approaching", "playing"]
    assert outlet.on("safety")[-1].verdict.cause == "stop_requested"
    played = {"mode": "gait", "stage": "playing", "failure": "none"}
    assert any(event.values == played for event in outlet.events)


@contextlib.contextmanager
def repeated(tape, endpoint):
    ended = threading.Event()

    def run():
        while not ended.is_set():
            play(*tape, (endpoint,), PACE)

    player = threading.Thread(target=run)
    player.start()
    try:
        yield
    finally:
        ended.set()
        player.join()


def test_the_display_of_the_tutorial_shows_it_and_nothing_can_be_requested(tape, runtime, capsys):
    endpoint, printed, refusal = f"unixsock-stream/{runtime}/tape", "", None
    display = example("own_display")
    with (
        repeated(tape, endpoint),
        Trainer(endpoint, client="display", keep_trying=True) as trainer,
    ):
        while not SHOWN.search(printed):
            display.main(trainer, 60)
            printed += capsys.readouterr().out
        while refusal is None:
            try:
                trainer.enable()
            except RequestRefusedError as error:
                refusal = error.reply.refusal
            except NoAnswerError:  # between two runs of the recording
                continue

    assert refusal.code == RefusalCode.RECORDING_PLAYED
    assert display.bar(NotValid("key", Trouble.SILENT, "")) == "?" * display.WIDTH
