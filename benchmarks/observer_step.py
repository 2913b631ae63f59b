"""One step of the observer against hand-written C and against FilterPy, in one run, as ratios.

This benchmark is not installed: import it as `benchmarks.observer_step` with the repository's root
on the path, as an editable install has it. Without a C compiler, or without FilterPy, the times
of that implementation are None.
"""

import importlib
import importlib.util
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from benchmarks import c_anchor
from observer.filter.leg_model import STEP_S, Integrator
from observer.filter.leg_observer import LegObserver, ObserverTuning, Setup
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from observer.offline.batch import Columns, run

C_STEPS = 2500
PEER_STEPS = 60
REPEATS = 9


@dataclass(frozen=True, slots=True)
class StepTimes:
    """Medians over several repeats, us for one step; None for an unavailable implementation."""

    integrator: str
    substeps: int
    observer_us: float
    """Time inside compiled code, as in a replay: the whole cycle with gate, status and report."""
    live_us: float
    """Time of `LegObserver.step` from Python, with its estimate object."""
    c_us: float | None
    """Time of the filter's step alone, in hand-written C."""
    filterpy_us: float | None
    """Time of FilterPy with its model in plain Python."""
    filterpy_compiled_us: float | None
    """Time of FilterPy with its model compiled."""

    @property
    def ratio_to_c(self) -> float | None:
        """Ratio of the observer's time to that of C; the budget is at most 1."""
        return None if self.c_us is None else self.observer_us / self.c_us

    @property
    def speed_up_to_filterpy(self) -> float | None:
        """Ratio of FilterPy's time to the observer's; the budget is at least 50."""
        return None if self.filterpy_us is None else self.filterpy_us / self.observer_us


def measure(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    tuning: ObserverTuning,
) -> StepTimes:
    """Time one step of each implementation, in turns, so that other load affects all of them.

    Args:
        leg: mechanism.
        hip: friction of the hip.
        slide: friction of the slide.
        tuning: the observer's tuning; its integrator and substeps hold for all implementations.
    """
    observer = LegObserver(leg, hip, slide, tuning)
    setup = observer.setup
    measured, effort = recording(C_STEPS + 1)
    columns = Columns(np.arange(len(measured)) * STEP_S, measured, effort)
    anchor = c_anchor.build()
    contestants: dict[str, tuple[Callable[[], object], int]] = {
        "observer": (lambda: run(setup, columns), len(measured)),
        "live": (lambda: live(observer, measured, effort), len(measured)),
    }
    if anchor is not None:
        contestants["c"] = (lambda: anchor(setup, measured, effort, STEP_S), C_STEPS)
    if importlib.util.find_spec("filterpy"):
        few = (setup, measured[: PEER_STEPS + 1], effort[: PEER_STEPS + 1], STEP_S)
        for name, compiled in (("filterpy", False), ("filterpy_compiled", True)):
            contestants[name] = (peer(few, compiled=compiled), PEER_STEPS)
    medians = race(contestants)
    return StepTimes(
        tuning.integrator.name.lower(),
        tuning.substeps,
        medians["observer"],
        medians["live"],
        medians.get("c"),
        medians.get("filterpy"),
        medians.get("filterpy_compiled"),
    )


def recording(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A leg that swings slowly about mid pose, and efforts of about that motion."""
    time_s = np.arange(rows) * STEP_S
    swing = np.sin(2 * np.pi * 0.25 * time_s)
    measured = np.column_stack((0.24 + 0.15 * swing, 0.59 + 0.12 * swing))
    effort = np.column_stack((7.0 * np.cos(1.5 * time_s), 75.0 * np.cos(1.5 * time_s)))
    return measured, effort


def live(observer: LegObserver, measured: np.ndarray, effort: np.ndarray) -> None:
    observer.reset(measured[0])
    for position, torque in zip(measured, effort, strict=True):
        observer.step(position, torque, STEP_S)


def peer(
    few: tuple[Setup, np.ndarray, np.ndarray, float], *, compiled: bool
) -> Callable[[], object]:
    filterpy_peer = importlib.import_module("benchmarks.filterpy_peer")
    return lambda: filterpy_peer.run(*few, compiled=compiled)


def race(contestants: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    """Median time of each contestant, us per step, after one round to warm up."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for round_number in range(REPEATS + 1):
        for name, (contest, steps) in contestants.items():
            begun = perf_counter()
            contest()
            if round_number:
                times[name].append((perf_counter() - begun) / steps * 1e6)
    return {name: statistics.median(values) for name, values in times.items()}


INTEGRATORS = ((Integrator.SEMI_IMPLICIT, 1), (Integrator.SEMI_IMPLICIT, 2), (Integrator.RK4, 2))
"""Pairs of integrator and substeps that the benchmark measures."""
