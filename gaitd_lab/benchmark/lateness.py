"""Lateness of SYNC in real time: service and virtual drives by the wall clock, at rest.

A bare timer of the same priority runs at the same time (`bare_timer.py`). What delays it, too, is
the machine: where that alone comes near the budget, the core has a budget of its own beyond it.
"""

import json
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from daemon.core.runtime.build import NS_PER_MS
from daemon.core.runtime.grid import LATE_MAX_NS
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingReader
from daemon.preflight.load import load
from gaitd_lab.benchmark import bare_timer
from gaitd_lab.benchmark.burning import burners
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.processes import Tempo, tied
from gaitd_lab.timed_service import timed_service, until_ready

READY_WITHIN_S: Final = 240.0
SETTLE_S: Final = 2.0
P999_MAX_US: Final = 500.0
BEYOND_TIMER_MAX_US: Final = 250.0
"""The core's part of the budget, where the bare timer needs more than the rest of it."""
BARE: Final = "bare timer"
QUANTILES: Final = {"median": 0.5, "99.9 %": 0.999, "worst": 1.0}


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
        cycle = load(made.config).trainer.cycle
        ring = RingReader(made.ring_path)
        with burners(burner_count):
            time.sleep(SETTLE_S)
            begun = ring.newest_seq()
            bare_ns = _bare_timer(cycle.realtime_priority, cycle.period_ms * NS_PER_MS, duration_s)
        made.check()
        records = ring.since(begun)
        ring.close()
    beside = f", beside {burner_count} processes that compute" if burner_count else ""
    return of(records, bare_ns, beside)


def _bare_timer(priority: int, period_ns: int, duration_s: float) -> list[int]:
    words = ("-m", bare_timer.__name__, str(priority), str(period_ns), str(duration_s))
    return json.loads(subprocess.check_output(tied(*words)))


def of(records: list[CycleRecord], bare_ns: Sequence[int], beside: str = "") -> list[Figure]:
    """Return the figures of consecutive records, and of a bare timer at the same time."""
    late_us = np.array([record.timing.lateness_ns for record in records]) / 1000
    bare_us = np.array(bare_ns) / 1000
    collect_us = np.array([record.timing.collect_ns for record in records]) / 1000
    skipped = records[-1].timing.overrun_count - records[0].timing.overrun_count
    what = f"SYNC late{beside}"
    made = [
        Figure(
            what=f"{what}, {name}",
            value=float(np.quantile(late_us, quantile)),
            unit="µs",
            peer=BARE,
            peer_value=float(np.quantile(bare_us, quantile)),
        )
        for name, quantile in QUANTILES.items()
    ]
    at_most_us = max(P999_MAX_US, made[1].peer_value + BEYOND_TIMER_MAX_US)
    return [
        *made,
        made[1]._replace(what=f"{what}, 99.9 %, budget", peer="", at_most=at_most_us),
        Figure(
            what=f"SYNCs skipped{beside}",
            value=skipped,
            unit=f"of {len(records)}",
            peer=BARE,
            peer_value=int(np.sum(np.array(bare_ns) > LATE_MAX_NS)),
        ),
        Figure(
            what=f"SYNC to last TPDO{beside}, median", value=float(np.median(collect_us)), unit="µs"
        ),
    ]
