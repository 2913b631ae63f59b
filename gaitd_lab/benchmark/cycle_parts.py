"""Python time of the parts of a cycle: the real cycle in lock-step, each part timed.

The timer wraps each part of `daemon/core/cycle.py` for the duration of the measurement. The virtual
machine computes between two cycles, so caches are as cold as in service.
"""

import contextlib
import gc
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from daemon.config.bundle import Settings
from daemon.core import cycle, cycle_record, inputs
from daemon.core.safety import checks
from daemon.core.steps import estimation, impedance, monitors, sensing, supervisor
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingHeader, RingWriter
from drives.cia402.drive import DriveGroup
from gaitd_lab.lockstep import LockstepSession

WHOLE: Final = "the whole cycle"
PARTS: Final[tuple[tuple[str, Any, str], ...]] = (
    ("drives: feed frames", DriveGroup, "feed"),
    ("drives: end of window", DriveGroup, "end_of_window"),
    ("units, mechanism", sensing, "sense"),
    ("monitors", monitors, "update"),
    ("observer", estimation, "estimate"),
    ("gateway states", inputs, "receive"),
    ("safety: inputs", cycle, "safety_inputs"),
    ("safety: checks", checks, "check"),
    ("modes", supervisor, "supervise"),
    ("reference, bound, units", impedance, "command"),
    ("drives: make frames", DriveGroup, "frames"),
    ("record", cycle_record, "record"),
    (WHOLE, cycle, "step"),
)
"""Title, the module where the function is looked up, and its name there."""
RING: Final = "ring of records (after the frames are sent)"
WALK_S: Final = 4.0
MEASURED_S: Final = 20.0


class Part(NamedTuple):
    """Times of one part, one value for each cycle in gait."""

    name: str
    median_us: float
    high_us: float
    """99.9 % are not longer."""
    share_ratio: float
    """Share of the whole cycle's median."""


def measure(settings: Settings) -> tuple[Part, ...]:
    """Measure the parts of the cycle in gait with two drives; the last but one is the whole."""
    session = LockstepSession(settings).walk(duration_s=WALK_S)
    with quiet(), stopwatch() as times:
        session.run(MEASURED_S)
    times[RING] = _ring_times(session.records[-1000:])
    whole_us = float(np.median(times[WHOLE])) / 1000
    return tuple(_part(name, values, whole_us) for name, values in times.items())


def _part(name: str, values_ns: list[int], whole_us: float) -> Part:
    values_us = np.array(values_ns) / 1000
    median_us = float(np.median(values_us))
    return Part(name, median_us, float(np.quantile(values_us, 0.999)), median_us / whole_us)


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
def stopwatch() -> Generator[dict[str, list[int]]]:
    """Wrap every part in a timer; removes the timers again."""
    times: dict[str, list[int]] = {}
    with contextlib.ExitStack() as restoring:
        for name, owner, attribute in PARTS:
            function = vars(owner)[attribute]
            times[name] = []
            setattr(owner, attribute, _timed(function, times[name]))
            restoring.callback(setattr, owner, attribute, function)
        yield times


def _timed(function: Callable[..., Any], times: list[int]) -> Callable[..., Any]:
    now = time.perf_counter_ns

    def timed(*arguments: object, **options: object) -> object:
        begun = now()
        result = function(*arguments, **options)
        times.append(now() - begun)
        return result

    return timed


def _ring_times(records: list[CycleRecord]) -> list[int]:
    header = RingHeader("bench", 0, 0, "bench", (), (), {}, "bench", {}, {})
    times: list[int] = []
    with tempfile.TemporaryDirectory() as folder:
        ring = RingWriter(Path(folder) / "bench.ring", header)
        write = _timed(ring.write, times)
        for record in records * 2:
            write(record)
        ring.close()
    return times[len(records) :]
