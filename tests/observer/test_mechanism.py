"""The closed form of the leg against numbers of others, another derivation, and laws of physics."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.jit import kernel
from observer.mechanism import (
    Dampers,
    Link,
    Slide,
    Springs,
    WorkspaceError,
    acceleration,
    bounded_acceleration,
    closes,
    coriolis,
    damping,
    gravity,
    joint_positions,
    kinetic_energy,
    knee_angle,
    leg_parameters,
    mass_matrix,
    pose,
    potential_energy,
    rates,
    singularity_ratio,
    slide_position_for_knee,
    smallest_inertia,
    with_patient,
)
from tests.observer.lagrangian import Reference
from tests.observer.trainer import (
    DAMPERS,
    EXOSKELETON,
    GEOMETRY,
    HIP_DRIVE_INERTIA,
    PATIENT,
    PROTOTYPE,
    SLIDE,
    gait,
)

SPRINGS = Springs(20.0, 2.0, 120.0, 1.2)
# Composite links of exoskeleton and leg, as the golden vectors give them (observer.md 2.6).
GOLDEN_LINKS = (
    Link(12.0, 0.438426153, 0.023868249, 0.227826954),
    Link(6.22, 0.459498474, -0.038127365, 0.109953498),
    Link(4.16, 0.447764659, 0.239867432, 0.052787001),
)
GOLDEN_LEG = leg_parameters(GEOMETRY, GOLDEN_LINKS, SLIDE, HIP_DRIVE_INERTIA, SPRINGS, DAMPERS)
EFFORT = np.array([20.0, 80.0])
ZERO = np.zeros(2)
TOLERANCE = 2e-8
"""The composite links are given to nine digits."""

FIRST = (np.array([0.20943951, 0.5]), np.array([1.1, -0.7]))
SECOND = (np.array([-0.13962634, 0.2]), np.array([-2.0, 0.9]))
THIRD = (np.array([0.52359878, 0.9]), np.array([0.5, 1.5]))


def upper(matrix):
    return matrix[[0, 0, 1], [0, 1, 1]]


def test_golden_vector_one():
    q, dq = FIRST

    ankle = joint_positions(GOLDEN_LEG, q)[2]
    delta = -singularity_ratio(GOLDEN_LEG, q) * 0.43788 * 0.25
    np.testing.assert_allclose(ankle, (0.7058063866, -0.4619142934), atol=TOLERANCE)
    assert delta == pytest.approx(-0.1079221547, abs=TOLERANCE)
    np.testing.assert_allclose(
        upper(mass_matrix(GOLDEN_LEG, q)),
        (1.7636329928, 0.2896938494, 15.7769169100),
        atol=TOLERANCE,
    )
    np.testing.assert_allclose(
        gravity(GOLDEN_LEG, q), (7.665372744, -2.4863927461), atol=5 * TOLERANCE
    )
    np.testing.assert_allclose(
        damping(GOLDEN_LEG, q, dq), (3.0810460911, -3.2828324494), atol=TOLERANCE
    )
    np.testing.assert_allclose(
        coriolis(GOLDEN_LEG, q, dq), (4.230034718, 2.5269424867), atol=TOLERANCE
    )
    assert kinetic_energy(GOLDEN_LEG, q, dq) == pytest.approx(4.7092783396, abs=TOLERANCE)
    np.testing.assert_allclose(
        acceleration(GOLDEN_LEG, q, dq, EFFORT, ZERO, True),
        (1.9877350282, 5.2397086559),
        atol=TOLERANCE,
    )


def test_the_potential_energy_of_golden_vector_one_is_met():
    assert potential_energy(GOLDEN_LEG, FIRST[0]) == pytest.approx(12.1409800377, abs=1e-6)
