"""The rank of the observability matrix, and that the status bits say the same."""

import itertools

import numpy as np
import pytest

from daemon.gateway.translate import _observable_rank as rank_of
from observer.filter.leg_model import LegModel
from observer.filter.leg_observer import LegObserver
from observer.filter.status import Status
from observer.mechanism.friction import STANDSTILL_GATE, gate_of, static_friction_of
from tests.observer.observability import null_vectors, rank
from tests.observer.trainer import (
    HIP,
    MID_POSE,
    PATIENT,
    PROTOTYPE,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    simulate,
)

LAWS = (HIP, SLIDE_FRICTION)
SPEEDS = list(itertools.product((0.0, 0.1, 0.5, -1.2), (0.0, 0.05, 0.3, -0.9)))


def moving_at(hip, slide, leg=PATIENT):
    """Model and state in steady motion: friction is what its law says."""
    state = np.array((*MID_POSE, hip, slide, 0.0, 0.0, 3.0, -20.0))
    for axis, law in enumerate(LAWS):
        state[4 + axis] = static_friction_of(law, state[2 + axis])
    return LegModel(leg, *LAWS, 1.0), state


@pytest.mark.parametrize(("hip", "slide"), SPEEDS)
@pytest.mark.parametrize("leg", [PATIENT, PROTOTYPE], ids=["patient", "empty"])
def test_each_axis_at_rest_costs_one_rank(leg, hip, slide):
    model, state = moving_at(hip, slide, leg)

    assert rank(model, state) == 8 - (hip == 0.0) - (slide == 0.0)


@pytest.mark.parametrize(("hip", "slide"), SPEEDS)
def test_the_status_bits_tell_the_rank(hip, slide):
    model, state = moving_at(hip, slide)
    status = Status(0)
    for axis, bit in enumerate((Status.STANDSTILL_HIP, Status.STANDSTILL_SLIDE)):
        if gate_of(LAWS[axis], state[2 + axis]) < STANDSTILL_GATE:
            status |= bit

    assert rank_of(status) == rank(model, state)


def test_at_rest_friction_and_patient_of_an_axis_hide_each_other():
    model, state = moving_at(0.0, 0.0)

    hidden = null_vectors(model, state)

    assert hidden.shape == (2, 8)
    for axis in range(2):
        together = np.zeros(8)
        together[[4 + axis, 6 + axis]] = 1.0 / np.sqrt(2.0)
        assert np.linalg.norm(hidden @ together) == pytest.approx(1.0, abs=1e-3)


def test_on_a_walk_the_bits_and_the_rank_at_the_estimate_agree_away_from_reversals():
    cycles = 400
    path = gait(PATIENT, np.maximum(np.arange(1, cycles + 1) * 0.01 - 1.0, 0.0), 0.25)
    recorded = encoded(simulate(PATIENT, cycles, reference=path, start=path[0]))
    observer = LegObserver(PATIENT, *LAWS, TUNING)
    compared = 0
    for k, (position, effort) in enumerate(zip(recorded.position, recorded.effort, strict=True)):
        estimate = observer.step(position, effort, 0.01)
        state = np.array(estimate.state)
        gates = [gate_of(LAWS[axis], state[2 + axis]) for axis in range(2)]
        if k % 10 or any(0.02 < gate < 0.9 for gate in gates):
            continue
        state[2:4] = [v if gate > 0.5 else 0.0 for v, gate in zip(state[2:4], gates, strict=True)]
        assert rank(LegModel(PATIENT, *LAWS, 1.0), state) == rank_of(estimate.status)
        compared += 1
    assert compared > 20
