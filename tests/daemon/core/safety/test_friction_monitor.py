"""Friction against its calibration: which estimates are used."""

from types import SimpleNamespace

import pytest

from daemon.core.safety import friction_monitor
from observer.drift import NO_DRIFT
from observer.filter.status import Status, Validity
from observer.mechanism.friction import FrictionParameters

LAW = FrictionParameters(
    stribeck=8.0,
    coulomb=5.0,
    viscous=0.0,
    transition=0.02,
    peak=0.05,
    edge=0.01,
    time_constant_s=0.1,
)
STATE = (0.3, 0.6, 0.5, -0.2, 0.0, 0.0, 4.0, 40.0)
STD = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 3.0)


def updated(index=0, status=Status(0), validity=(Validity.OK, Validity.OK)):  # noqa: B008 - frozen
    estimate = SimpleNamespace(state=STATE, std=STD, status=status, validity=validity)
    return friction_monitor.update(NO_DRIFT, LAW, estimate, index, 0.01)


@pytest.mark.parametrize(
    ("index", "place", "effort", "std", "direction"),
    [(0, 0.3, 4.0, 0.2, 1), (1, 0.6, 40.0, 3.0, -1)],
)
def test_each_axis_adds_its_own_place_speed_and_effort(index, place, effort, std, direction):
    drift = updated(index)

    assert drift is not None
    assert drift.patient_s == pytest.approx(effort * 0.01)
    assert drift.direction_s == pytest.approx(direction * 0.01)
    assert drift.place_s == pytest.approx(place * 0.01)
    assert drift.variance_s == pytest.approx(std**2 * 0.01)


@pytest.mark.parametrize("status", [Status.ARTIFICIAL, Status.NEAR_LIMIT, Status.INPUT_SATURATED])
def test_a_doubtful_estimate_is_left_out(status):
    assert updated(status=status) is None


def test_another_status_does_not_matter():
    others = [one for one in Status if not one & friction_monitor.DOUBTFUL]

    assert others
    assert all(updated(status=one) is not None for one in others)


@pytest.mark.parametrize("bad", [one for one in Validity if one is not Validity.OK])
def test_an_axis_whose_estimate_is_not_valid_is_left_out_and_the_other_is_not(bad):
    assert updated(0, validity=(bad, Validity.OK)) is None
    assert updated(1, validity=(bad, Validity.OK)) is not None
