"""Lateness of SYNC in real time: service and virtual drives by the wall clock, at rest."""

import time
from pathlib import Path
from typing import Final

import numpy as np

from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingReader
from gaitd_lab.benchmark.burning import burners
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.processes import Tempo
from gaitd_lab.timed_service import timed_service, until_ready

READY_WITHIN_S: Final = 240.0
SETTLE_S: Final = 2.0
P999_MAX_US: Final = 500.0


def measure(configs: Path, duration_s: float, burner_count: int = 0) -> list[Figure]:
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
    return of(records, f", beside {burner_count} processes that compute" if burner_count else "")


def of(records: list[CycleRecord], beside: str = "") -> list[Figure]:
    """Return the figures of consecutive records."""
    late_us = np.array([record.timing.lateness_ns for record in records]) / 1000
    collect_us = np.array([record.timing.collect_ns for record in records]) / 1000
    median_us, p999_us, worst_us = np.quantile(late_us, (0.5, 0.999, 1.0)).tolist()
    skipped = records[-1].timing.overrun_count - records[0].timing.overrun_count
    what = f"SYNC late{beside}"
    return [
        Figure(what=f"{what}, median", value=median_us, unit="µs"),
        Figure(what=f"{what}, 99.9 %", value=p999_us, unit="µs", at_most=P999_MAX_US),
        Figure(what=f"{what}, worst", value=worst_us, unit="µs"),
        Figure(what=f"SYNCs skipped{beside}", value=skipped, unit=f"of {len(records)}"),
        Figure(
            what=f"SYNC to last TPDO{beside}, median", value=float(np.median(collect_us)), unit="µs"
        ),
    ]
