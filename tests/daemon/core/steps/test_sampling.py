"""The part of a torque that a sample may miss, from the acceleration that was sent."""

import numpy as np
import pytest
from safety_inputs import JOINT
from step_inputs import a_leg, an_axis

from daemon.core.slices import Placed
from daemon.core.steps import sampling
from drives.cia402.torque import TorqueSampling

FILTERED, INSTANT, UNKNOWN = (
    *(TorqueSampling.FILTERED, TorqueSampling.INSTANT),
    TorqueSampling.UNKNOWN,
)
INERTIA = ((2.0, 3.0), (5.0, 7.0))
BOTH = INSTANT, UNKNOWN


@pytest.mark.parametrize(
    ("acceleration", "kinds", "changes", "expected"),
    [
        ((10.0, 0.0), BOTH, {}, (10.0, 25.0)),
        ((0.0, -10.0), BOTH, {}, (15.0, 35.0)),
        ((10.0, -4.0), BOTH, {}, (4.0, 11.0)),
        ((10.0, -4.0), (FILTERED, INSTANT), {}, (6.0, 14.0)),
        ((10.0, -4.0), (INSTANT, FILTERED), {}, (10.0, 25.0)),
        ((10.0, -4.0), (FILTERED, FILTERED), {}, (0.0, 0.0)),
        ((0.0, 0.0), BOTH, {}, (0.0, 0.0)),
        ((10.0, 0.0), BOTH, {"hip": False}, (0.0, 0.0)),
        ((10.0, 0.0), BOTH, {"slide": False}, (0.0, 0.0)),
        ((10.0, 0.0), BOTH, {"ratio": 0.0}, (0.0, 0.0)),
        ((10.0, 0.0), BOTH, {"ratio": -0.1}, (0.0, 0.0)),
        ((10.0, 0.0), BOTH, {"ratio": 0.1}, (10.0, 25.0)),
    ],
)
def test_half_of_the_inertia_s_effort_is_uncertain_where_a_sample_may_miss_it(
    monkeypatch, acceleration, kinds, changes, expected
):
    asked = []
    monkeypatch.setattr(
        sampling, "mass_matrix", lambda *given: asked.append(given) or np.array(INERTIA)
    )
    hip, slide = (
        an_axis(
            acceleration_si=acceleration[index],
            torque_sampling=kinds[index],
            referenced=changes.get(name, True),
            joint=JOINT._replace(position_si=0.2 + 0.3 * index),
        )
        for index, name in enumerate(("hip", "slide"))
    )
    leg = a_leg(hip, slide, placed=Placed(changes.get("ratio", 0.8)), parameters="of the leg")

    assert sampling.effort_std(leg) == pytest.approx(expected)
    for parameters, pose in asked:
        assert (parameters, list(pose)) == ("of the leg", [0.2, 0.5])
    assert bool(asked) is (expected != (0.0, 0.0))
