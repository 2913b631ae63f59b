"""One step of the observer against hand-written C and against FilterPy, in one run, as ratios.

Without a C compiler, or without FilterPy, the times of that implementation are None.
"""

import importlib
import importlib.util
from dataclasses import dataclass

from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from gaitd_lab.benchmark.step_times import Work, recording, step_times_us, walk
from gaitd_lab.peers import c_anchor
from observer.filter.leg_model import STEP_S, Integrator
from observer.filter.leg_observer import LegObserver, ObserverTuning
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from observer.offline.batch import run

C_STEPS = 2500
PEER_STEPS = 60


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
    columns = recording(C_STEPS + 1)
    measured, effort = columns.position, columns.effort
    anchor = c_anchor.build()
    works: dict[str, Work] = {
        "observer": (lambda: run(setup, columns), len(measured)),
        "live": (lambda: walk([observer], columns), len(measured)),
    }
    if anchor is not None:
        works["c"] = (lambda: anchor(setup, measured, effort, STEP_S), C_STEPS)
    if importlib.util.find_spec("filterpy"):
        peer = importlib.import_module("gaitd_lab.peers.filterpy_peer")
        few = (setup, measured[: PEER_STEPS + 1], effort[: PEER_STEPS + 1], STEP_S)
        works["filterpy"] = (lambda: peer.run(*few), PEER_STEPS)
    medians = step_times_us(works)
    return StepTimes(
        tuning.integrator.name.lower(),
        tuning.substeps,
        medians["observer"],
        medians["live"],
        medians.get("c"),
        medians.get("filterpy"),
    )


INTEGRATORS = ((Integrator.SEMI_IMPLICIT, 1), (Integrator.SEMI_IMPLICIT, 2), (Integrator.RK4, 2))
"""Pairs of integrator and substeps that the benchmark measures."""


def measure_all(robot: Robot) -> tuple[StepTimes, ...]:
    """Measure one row for each integrator and number of substeps."""
    leg, frictions, tuning = (
        leg_parameters(robot),
        friction_parameters(robot),
        observer_tuning(robot),
    )
    return tuple(
        measure(leg, *frictions, tuning._replace(integrator=integrator, substeps=substeps))
        for integrator, substeps in INTEGRATORS
    )
