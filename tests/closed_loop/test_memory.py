"""Nothing grows while the service runs: thousands of cycles, and bring-ups, in lock-step.

The collector is off, as in the core. What a stretch of time keeps, and what only a collector could
free, is counted in the same way as the interpreter does: in blocks and in unreachable objects.
"""

import contextlib
import gc
import sys
from collections import Counter
from collections.abc import Callable

import pytest
from gaitd_names import Mode, RequestKind

from daemon.core.runtime import realtime
from daemon.core.safety.energy import STRIDE_MAX_CYCLES
from gaitd_lab.lockstep import LockstepSession

CYCLES = 300
"""Cycles of a stretch."""
TWO_STRIDES_CYCLES = 400
LONG_CYCLES = 10_000
WARM_CYCLES = STRIDE_MAX_CYCLES + 200
"""All windows over the last cycles are full: the longest has STRIDE_MAX_CYCLES."""
TRIES = 4
CYCLE_BLOCKS = CYCLES // 4
"""Floats of more or fewer digits in the plant, a list of free frames: one block in four cycles, not
in each."""
BRING_UP_BLOCKS = 100


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

    def __init__(self, session: LockstepSession) -> None:
        self.session = session

    def turn(self, cycles: int) -> None:
        for _ in range(cycles):
            self.session.loop.turn()
            self.forget()

    def forget(self) -> None:
        del self.session.records[:-2]
        self.session.bus.sent.clear()
        self.session.truth.rows.clear()

    def bring_up_again(self) -> None:
        """A drive falls silent; a reset is requested; it is brought up anew."""
        session = self.session
        session.command("silent right/hip 0.3")
        session.run_until(lambda record: record.mode != Mode.READY, within_s=5)
        session.run(0.5)
        if session.record.mode == Mode.FAULT:
            session.request(RequestKind.RESET)
        session.run_until(lambda record: record.mode == Mode.READY, within_s=20)
        self.forget()


def keeps_fewer_blocks(most: int, play: Callable[[], None]) -> bool:
    """In one of some tries."""
    kept: list[int] = []
    while len(kept) < TRIES and (not kept or kept[-1] >= most):
        before = sys.getallocatedblocks()
        play()
        kept.append(sys.getallocatedblocks() - before)
    print(kept)
    return kept[-1] < most


@pytest.fixture(
    params=[
        ("warm_fast_gait", TWO_STRIDES_CYCLES),
        pytest.param(("warm_gait", LONG_CYCLES), marks=pytest.mark.thorough),
        pytest.param(("warm_ready", LONG_CYCLES), marks=pytest.mark.thorough),
        pytest.param(("warm_hold", LONG_CYCLES), marks=pytest.mark.thorough),
    ],
    ids=lambda param: f"{param[0]}-{param[1]}",
)
def warm_mode(request):
    """A session, and the number of cycles after which a collector finds nothing."""
    name, cycles = request.param
    return request.getfixturevalue(name), cycles


def test_cycles_keep_nothing_and_leave_nothing_that_only_a_collector_can_free(warm_mode):
    session, cycles = warm_mode
    quiet = Quiet(session)
    quiet.turn(max(100, WARM_CYCLES - len(session.records)))

    def turn_and_tidy():
        quiet.turn(CYCLES)
        gc.collect()  # empties lists of free objects: what is counted is in use

    with no_collector():
        assert keeps_fewer_blocks(CYCLE_BLOCKS, turn_and_tidy)
        gc.set_debug(gc.DEBUG_SAVEALL)
        quiet.turn(cycles)
        gc.collect()

    assert not Counter(type(one).__name__ for one in gc.garbage)


def test_a_bring_up_leaves_nothing_though_the_collector_is_off(warm_ready):
    quiet = Quiet(warm_ready)
    quiet.bring_up_again()
    with no_collector():
        gc.collect()
        assert keeps_fewer_blocks(BRING_UP_BLOCKS, quiet.bring_up_again)
        assert gc.collect() == 0


def test_where_the_collector_runs_by_itself_nothing_is_done(monkeypatch):
    asked: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda *_: asked.append(1) or 0)

    realtime.tidy()

    assert asked == []
