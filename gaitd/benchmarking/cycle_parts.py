"""Python time of one cycle by part: the product's own loop in lock-step, with stopwatches."""

import statistics
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple, ParamSpec, TypeVar
from unittest import mock

import numpy as np

from daemon.config.load import load
from daemon.core import conduct, cycle, guidance, inbox, recording
from daemon.core.build import ring_header
from daemon.record import Mode, ModeRequest, RequestKind
from daemon.seam import RING_NAME, RingWriter
from drives.drive import DriveGroup
from gaitd.lockstep import Lockstep
from gaitd.virtual_machine import virtual_machine

P = ParamSpec("P")
R = TypeVar("R")

WARM_S = 12.0
MEASURED_S = 20.0

PARTS: tuple[tuple[str, object, str], ...] = (
    ("decode frames", DriveGroup, "feed"),
    ("close window", DriveGroup, "end_of_window"),
    ("joints, g(q)", cycle, "sense"),
    ("observer", cycle, "observe"),
    ("hear", inbox, "hear"),
    ("judge", cycle, "judge"),
    ("modes, plans", conduct, "change_mode"),
    ("guidance, bound", guidance, "command"),
    ("encode frames", DriveGroup, "frames"),
    ("record", recording, "record"),
)
"""In the order of the cycle: what it is called, where it lives, its name there."""
RING = "ring"
WHOLE = "whole cycle"


class PartTime(NamedTuple):
    """One part over all measured cycles."""

    name: str
    median_us: float
    p999_us: float


def measure(configs: Path) -> list[PartTime]:
    """Walk in lock-step and take the time of each part; the last row is the whole cycle."""
    settings = load(configs / "demo.toml")
    lockstep = Lockstep(settings, virtual_machine(settings.file).world)
    lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=10)
    lockstep.run(0.5)
    lockstep.request(RequestKind.ENABLE)
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.25, amplitude_ratio=1.0, duration_s=600.0)
    lockstep.request(RequestKind.MODE, gait)
    lockstep.run(WARM_S)
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder, _stopwatches(times):
        begun = len(lockstep.records)
        lockstep.run(MEASURED_S)
        ring = RingWriter(Path(folder) / RING_NAME, ring_header(settings, "bench", 0, ""))
        for record in lockstep.records[begun:]:
            started_s = time.perf_counter()
            ring.write(record)
            times.setdefault(RING, []).append(time.perf_counter() - started_s)
        ring.close()
    names = [name for name, _, _ in PARTS] + [RING, WHOLE]
    return [_part(name, times[name]) for name in names]


@contextmanager
def _stopwatches(times: dict[str, list[float]]) -> Generator[None]:
    with ExitStack() as stack:
        for name, home, attribute in (*PARTS, (WHOLE, cycle, "step")):
            timed = _timed(getattr(home, attribute), times.setdefault(name, []))
            stack.enter_context(mock.patch.object(home, attribute, timed))
        yield


def _timed(function: Callable[P, R], taken: list[float]) -> Callable[P, R]:
    def timed(*arguments: P.args, **named: P.kwargs) -> R:
        started_s = time.perf_counter()
        result = function(*arguments, **named)
        taken.append(time.perf_counter() - started_s)
        return result

    return timed


def _part(name: str, taken_s: list[float]) -> PartTime:
    return PartTime(
        name, statistics.median(taken_s) * 1e6, float(np.percentile(taken_s, 99.9)) * 1e6
    )
