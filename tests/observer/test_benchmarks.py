"""The hand-written C and FilterPy are peers indeed: they compute what the observer computes."""

import math
import shutil

import numpy as np
import pytest

from gaitd_lab.benchmark import observer_step, step_times
from gaitd_lab.peers import c_anchor, filterpy_peer
from observer.filter.leg_model import Integrator
from observer.filter.leg_observer import setup_of
from observer.offline import batch
from tests.observer.trainer import HIP, PATIENT, SLIDE_FRICTION, TUNING, encoded, gait, simulate

DT = 0.01
CYCLES = 400


@pytest.fixture(scope="module")
def walk():
    path = gait(PATIENT, np.maximum(np.arange(1, CYCLES + 1) * DT - 0.3, 0.0), 0.25)
    return encoded(simulate(PATIENT, CYCLES, reference=path, start=path[0]))


def ungated(**change):
    return setup_of(PATIENT, HIP, SLIDE_FRICTION, TUNING._replace(gate_nis=1e300, **change))


@pytest.mark.skipif(not any(map(shutil.which, c_anchor.COMPILERS)), reason="no C compiler")
@pytest.mark.parametrize(
    ("integrator", "coriolis"), [(Integrator.RK4, False), (Integrator.SEMI_IMPLICIT, True)]
)
def test_the_hand_written_c_and_the_observer_agree(walk, integrator, coriolis):
    setup = ungated(integrator=integrator, substeps=2, coriolis=coriolis)
    columns = batch.Columns(np.arange(CYCLES) * DT, walk.position, walk.effort)
    ours = batch.run(setup, columns)
    theirs = c_anchor.build()(setup, walk.position, walk.effort, DT)

    scale = np.array([1.0, 1.0, 1.0, 1.0, 10.0, 100.0, 10.0, 100.0])
    np.testing.assert_allclose(ours.state[1:] / scale, theirs.state / scale, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours.nis[1:], theirs.nis, rtol=1e-6, atol=1e-6)
    covariance = (theirs.root @ theirs.root.T)[np.tril_indices(8)]
    np.testing.assert_allclose(ours.covariance[-1], covariance, rtol=1e-6, atol=1e-12)


def test_without_a_compiler_the_anchor_says_so(monkeypatch):
    monkeypatch.setattr(c_anchor.shutil, "which", lambda name: None)

    assert c_anchor.build() is None


def test_filterpy_estimates_what_the_observer_estimates(walk):
    """Another kind of sigma points, so not the same numbers; the same motion and forces."""
    setup = ungated()
    peer = filterpy_peer.run(setup, walk.position, walk.effort, DT)
    columns = batch.Columns(np.arange(CYCLES) * DT, walk.position, walk.effort)
    ours = batch.run(setup, columns).state[1:]

    last = slice(200, None)
    np.testing.assert_allclose(peer[last, :2], ours[last, :2], rtol=0, atol=5e-5)
    assert np.sqrt(np.mean((peer[last] - ours[last]) ** 2, axis=0))[6:] == pytest.approx(
        (0.0, 0.0), abs=2.0
    )


def test_the_benchmark_gives_medians_and_ratios(monkeypatch):
    monkeypatch.setattr(observer_step, "C_STEPS", 50)
    monkeypatch.setattr(observer_step, "PEER_STEPS", 3)
    monkeypatch.setattr(step_times, "REPEATS", 1)

    c, filterpy, live = observer_step.measure(PATIENT, HIP, SLIDE_FRICTION, TUNING)

    assert (c.peer, filterpy.peer) == ("hand-written C", "FilterPy")
    assert min(c.value, filterpy.value, live.value) > 0.0
    assert filterpy.ratio == filterpy.value / filterpy.peer_value
    assert filterpy.is_met == (filterpy.ratio <= 1 / 50)
    assert math.isnan(c.ratio) or c.ratio == c.value / c.peer_value
