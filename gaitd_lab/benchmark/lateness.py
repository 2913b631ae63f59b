"""Lateness of SYNC in real time: service and virtual drives by the wall clock, at rest."""

import time
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingReader
from gaitd_lab.benchmark.burning import burners
from gaitd_lab.processes import Tempo
from gaitd_lab.timed_service import timed_service, until_ready

READY_WITHIN_S: Final = 240.0
SETTLE_S: Final = 2.0
BOUNDS_US: Final = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)


class Lateness(NamedTuple):
    """Statistics of all SYNCs of a period."""

    sync_count: int
    median_us: float
    p99_us: float
    p999_us: float
    worst_us: float
    overrun_count: int
    """Skipped grid points."""
    bound_us: tuple[int, ...]
    class_count: tuple[int, ...]
    """Number of SYNCs up to each bound, and one class above."""
    collect_median_us: float
    """Time from SYNC to the last TPDO of both drives."""


def measure(configs: Path, duration_s: float, burner_count: int = 0) -> Lateness:
    """Run in real time, in mode ready, and read the black box.

    Args:
        configs: the project's folder of configurations.
        duration_s: duration of the measurement.
        burner_count: number of load processes meanwhile.

    Raises:
        ServiceError: a process ended, or the service was not ready in time.
    """
    with timed_service(configs, Tempo(wall_clock=True)) as made:
        until_ready(made, READY_WITHIN_S)
        ring = RingReader(made.ring_path)
        with burners(burner_count):
            time.sleep(SETTLE_S)
            begun = ring.newest_seq()
            time.sleep(duration_s)
        made.check()
        records = ring.since(begun)
        ring.close()
    return of(records)


def of(records: list[CycleRecord]) -> Lateness:
    """Return the statistics of consecutive records."""
    late_us = np.array([record.timing.lateness_ns for record in records]) / 1000
    collect_us = np.array([record.timing.collect_ns for record in records]) / 1000
    classes = np.searchsorted(BOUNDS_US, late_us)
    median_us, p99_us, p999_us, worst_us = np.quantile(late_us, (0.5, 0.99, 0.999, 1.0)).tolist()
    return Lateness(
        len(records),
        median_us,
        p99_us,
        p999_us,
        worst_us,
        records[-1].timing.overrun_count - records[0].timing.overrun_count,
        BOUNDS_US,
        tuple(np.bincount(classes, minlength=len(BOUNDS_US) + 1).tolist()),
        float(np.median(collect_us)),
    )
