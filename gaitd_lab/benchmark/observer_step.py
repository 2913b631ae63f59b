"""One step of the observer against hand-written C and against FilterPy, in one run, as ratios.

Without a C compiler, or without FilterPy, the times of that implementation are NaN.
"""

import importlib
import importlib.util

from daemon.config.robot import friction_parameters, leg_parameters, observer_tuning
from daemon.config.settings import Robot
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.benchmark.step_times import Work, recording, step_times_us, walk
from gaitd_lab.peers import c_anchor
from observer.filter.leg_model import STEP_S, Integrator
from observer.filter.leg_observer import LegObserver, ObserverTuning
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from observer.offline.batch import run

C_STEPS = 2500
PEER_STEPS = 60


C_RATIO_MAX = 1.0
FILTERPY_RATIO_MAX = 1 / 50
NAN = float("nan")


def measure(
    leg: LegParameters,
    hip: FrictionParameters,
    slide: FrictionParameters,
    tuning: ObserverTuning,
) -> list[Figure]:
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
    what = f"step of the filter, {tuning.integrator.name.lower()} x{tuning.substeps}"
    return [
        Figure(
            what=what,
            value=medians["observer"],
            unit="µs",
            peer=peer,
            peer_value=medians.get(work, NAN),
            at_most=ratio_max,
        )
        for peer, work, ratio_max in (
            ("hand-written C", "c", C_RATIO_MAX),
            ("FilterPy", "filterpy", FILTERPY_RATIO_MAX),
        )
    ] + [Figure(what=f"{what}, from Python", value=medians["live"], unit="µs")]


INTEGRATORS = ((Integrator.SEMI_IMPLICIT, 1), (Integrator.SEMI_IMPLICIT, 2), (Integrator.RK4, 2))
"""Pairs of integrator and substeps that the benchmark measures."""


def measure_all(robot: Robot) -> list[Figure]:
    """Measure each integrator and number of substeps."""
    leg, frictions, tuning = (
        leg_parameters(robot),
        friction_parameters(robot),
        observer_tuning(robot),
    )
    return [
        figure
        for integrator, substeps in INTEGRATORS
        for figure in measure(
            leg, *frictions, tuning._replace(integrator=integrator, substeps=substeps)
        )
    ]
