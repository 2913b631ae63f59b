"""When SYNC leaves: the real processes on the loopback bus, measured by the core itself."""

import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from daemon.record import Mode
from daemon.seam import RING_NAME, RingReader
from gaitd.demonstration.stage import stage

EDGES_US = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)
READY_S = 30.0


class Grid(NamedTuple):
    """Of the cycles with SYNC."""

    cycle_count: int
    overrun_count: int
    lateness_us: tuple[float, float, float, float]
    """Median, 99 %, 99.9 %, worst."""
    collect_us: tuple[float, float, float, float]
    """From SYNC to the last sample of both drives."""
    histogram: tuple[int, ...]
    """Cycles up to each of EDGES_US, and beyond."""


class NotReadyError(Exception):
    """The service did not reach mode ready on this machine."""


def measure(configs: Path, seconds: float) -> Grid:
    """Run service and virtual drives for a while in mode ready.

    Raises:
        NotReadyError: it was not reached.
    """
    with stage(configs, empty=False) as act:
        ring = act.folder / "run" / RING_NAME
        _await_ready(ring)
        time.sleep(seconds)
        reader = RingReader(ring)
        records = [r for r in reader.since(0) if r.mode == Mode.READY and r.timing.collect_ns]
        reader.close()
    late_us = np.array([r.timing.lateness_ns for r in records]) * 1e-3
    collect_us = np.array([r.timing.collect_ns for r in records]) * 1e-3
    counts, _ = np.histogram(late_us, bins=[-np.inf, *EDGES_US, np.inf])
    overruns = records[-1].timing.overrun_count - records[0].timing.overrun_count
    return Grid(
        len(records), overruns, _four(late_us), _four(collect_us), tuple(int(n) for n in counts)
    )


def _await_ready(ring: Path) -> None:
    end_s = time.monotonic() + READY_S
    while time.monotonic() < end_s:
        time.sleep(0.2)
        if not ring.exists():
            continue
        reader = RingReader(ring)
        record = reader.read(reader.newest_seq())
        reader.close()
        if record is not None and record.mode == Mode.READY:
            return
    raise NotReadyError(f"mode ready was not reached within {READY_S:g} s")


def _four(values: np.ndarray) -> tuple[float, float, float, float]:
    median, p99, p999, worst = (float(x) for x in np.percentile(values, (50, 99, 99.9, 100)))
    return median, p99, p999, worst
