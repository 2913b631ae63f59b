"""Nothing grows while the service runs: thousands of cycles, and bring-ups, in lock-step.

The collector is off, as in the core. What a stretch of time keeps, and what only a collector could
free, is counted in the same way as the interpreter does: in blocks and in unreachable objects.
"""

import contextlib
import gc
import sys
from collections import Counter

import pytest
from sessions import Session

from daemon.core import realtime
from daemon.core.energy import STRIDE_MAX_CYCLES
from daemon.record import Mode, RequestKind
from drives import busload

CYCLES = 1000
"""Of a stretch: ten seconds, five strides."""
WARM_CYCLES = 1200
"""All windows over the last cycles are full: the longest has STRIDE_MAX_CYCLES."""
BRING_UPS = 4
NOISE_BLOCKS = 100
"""Floats of more or fewer digits in the plant, a list of free frames: one block in ten cycles, not
in each."""


@contextlib.contextmanager
def no_collector():
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class Quiet:
    """A session that keeps none of what lock-step keeps for tests."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.lockstep = session.lockstep

    def turn(self, cycles: int) -> None:
        for _ in range(cycles):
            self.lockstep.loop.turn()
            self.forget()

    def forget(self) -> None:
        del self.lockstep.records[:-2]
        self.lockstep.bus.sent.clear()
        self.session.truth.rows.clear()

    def bring_up_again(self) -> None:
        """A drive falls silent; somebody resets; it is brought up anew."""
        lockstep = self.lockstep
        self.session.machine.command("silent right/hip 0.3")
        lockstep.run_until(lambda record: record.mode != Mode.READY, within_s=5)
        lockstep.run(0.5)
        if lockstep.record.mode == Mode.FAULT:
            lockstep.request(RequestKind.RESET)
        lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=20)
        self.forget()


@pytest.fixture(scope="module", params=["ready", "hold", "gait"])
def quiet(request):
    session = Session()
    begin = {"ready": session.until_ready, "hold": session.enabled, "gait": session.walking}
    made = Quiet(begin[request.param]())
    made.forget()
    busload.fill_tables()  # as the core's warm-up does
    made.turn(WARM_CYCLES)
    return made


def test_the_warm_up_of_these_tests_is_longer_than_every_window():
    assert WARM_CYCLES > STRIDE_MAX_CYCLES


def test_a_thousand_cycles_keep_nothing(quiet):
    kept: list[int] = []
    with no_collector():
        for _ in range(3):
            gc.collect()  # empties lists of free objects: what is counted is in use
            before = sys.getallocatedblocks()
            quiet.turn(CYCLES)
            gc.collect()
            kept.append(sys.getallocatedblocks() - before)

    assert min(kept) < NOISE_BLOCKS, kept


def test_a_cycle_leaves_nothing_that_only_a_collector_can_free(quiet):
    with no_collector():
        gc.set_debug(gc.DEBUG_SAVEALL)
        try:
            quiet.turn(CYCLES)
            gc.collect()
            left = Counter(type(one).__name__ for one in gc.garbage)
        finally:
            gc.set_debug(0)
            gc.garbage.clear()

    assert not left


def test_a_bring_up_leaves_nothing_though_the_collector_is_off():
    made = Quiet(Session().until_ready())
    made.bring_up_again()
    kept: list[int] = []
    with no_collector():
        gc.collect()
        for _ in range(BRING_UPS):
            before = sys.getallocatedblocks()
            made.bring_up_again()
            kept.append(sys.getallocatedblocks() - before)
        left = gc.collect()

    assert left == 0
    assert min(kept) < NOISE_BLOCKS, kept


def test_where_the_collector_runs_by_itself_nothing_is_done(monkeypatch):
    asked: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda *_: asked.append(1) or 0)

    realtime.tidy()

    assert asked == []


def test_no_byte_of_a_frame_is_worked_out_for_the_first_time_in_service():
    busload.fill_tables()
    before = busload._stuff.cache_info().currsize

    for byte in range(256):
        for other in range(0, 256, 5):
            busload.frame_bits_exact(0x185, bytes((byte, other, byte ^ other)))

    assert busload._stuff.cache_info().currsize <= before + 8  # headers
