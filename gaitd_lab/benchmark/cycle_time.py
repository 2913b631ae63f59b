"""Python time of a cycle: the real cycle in lock-step, timed.

The virtual machine computes between two cycles, so caches are as cold as in service.
"""

import contextlib
import gc
import time
from collections.abc import Generator
from typing import Final

import numpy as np

from daemon.config.bundle import Settings
from daemon.core import cycle
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.lockstep import LockstepSession

WALK_S: Final = 4.0
MEASURED_S: Final = 20.0
MEDIAN_MAX_US: Final = 400.0
HIGH_MAX_US: Final = 800.0


def measure(settings: Settings) -> list[Figure]:
    """Measure the whole cycle in gait with two drives."""
    session = LockstepSession(settings).walk(duration_s=WALK_S)
    with quiet(), stopwatch() as times_ns:
        session.run(MEASURED_S)
    median_us, high_us = (np.quantile(times_ns, (0.5, 0.999)) / 1000).tolist()
    what = "Python work of a cycle"
    return [
        Figure(what=f"{what}, median", value=median_us, unit="µs", at_most=MEDIAN_MAX_US),
        Figure(what=f"{what}, 99.9 %", value=high_us, unit="µs", at_most=HIGH_MAX_US),
    ]


@contextlib.contextmanager
def quiet() -> Generator[None]:
    """Disable garbage collection, as in the core."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@contextlib.contextmanager
def stopwatch() -> Generator[list[int]]:
    """Time each cycle, in ns, until the end of the context."""
    times_ns: list[int] = []
    step, now = cycle.step, time.perf_counter_ns

    def timed(*arguments: object, **options: object) -> object:
        begun_ns = now()
        result = step(*arguments, **options)  # type: ignore[arg-type]
        times_ns.append(now() - begun_ns)
        return result

    cycle.step = timed  # type: ignore[assignment]
    try:
        yield times_ns
    finally:
        cycle.step = step
