"""One step of the observer against hand-written C and against FilterPy, in one run, as ratios.

A benchmark, not a part of what is installed: import it as `benchmarks.observer_step` with the
repository's root on the path, as an editable install has it. Without a C compiler, or without
FilterPy, that competitor's times are None.
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
    """Medians over some repeats, us for one step; None where the competitor is not there."""

    integrator: str
    substeps: int
    observer_us: float
    """Inside compiled code, as replay calls it: the whole cycle with gate, status and report."""
    live_us: float
    """`LegObserver.step` from Python, with its estimate object."""
    c_us: float | None
    """The filter's step alone, in hand-written C."""
    filterpy_us: float | None
    """With its model in plain Python."""
    filterpy_compiled_us: float | None
    """With its model compiled."""

    @property
    def ratio_to_c(self) -> float | None:
        """At most 1 is the budget."""
        return None if self.c_us is None else self.observer_us / self.c_us

    @property
    def speed_up_to_filterpy(self) -> float | None:
        """At least 50 is the budget."""
        return None if self.filterpy_us is None else self.filterpy_us / self.observer_us


def measure(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    tuning: ObserverTuning,
) -> StepTimes:
    """Times of one step, all competitors taking turns, so that a busy machine is busy for all.

    Args:
        leg: mechanism.
        hip: friction of the hip.
        slide: friction of the slide.
        tuning: of the observer; integrator and substeps hold for all competitors.
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
    """A leg that swings slowly about mid pose, and efforts that roughly go with it."""
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
    """Median us per step of each, after one round to warm up."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for round_number in range(REPEATS + 1):
        for name, (contest, steps) in contestants.items():
            begun = perf_counter()
            contest()
            if round_number:
                times[name].append((perf_counter() - begun) / steps * 1e6)
    return {name: statistics.median(values) for name, values in times.items()}


INTEGRATORS = ((Integrator.SEMI_IMPLICIT, 1), (Integrator.SEMI_IMPLICIT, 2), (Integrator.RK4, 2))
"""What the bench shows: pairs of integrator and substeps."""
