"""The wait at shutdown ends when all axes are at rest without power, or after its time."""

from types import SimpleNamespace

import pytest
from safety_inputs import FEEDBACK, JOINT, LIMITS

from daemon.core.runtime.shutdown import POWER_OFF_CYCLES, SETTLE_CYCLES, PowerOff
from drives.signals import PowerState


def axis(power_state, velocity_si=0.0):
    sensed = SimpleNamespace(
        feedback=FEEDBACK._replace(power_state=power_state) if power_state else None,
        joint=JOINT._replace(velocity_si=velocity_si),
    )
    return SimpleNamespace(sensed=sensed, limits=LIMITS)


OFF, ON = PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED


def waited(*axes):
    power_off = PowerOff()
    return next(cycle for cycle in range(1, 10_000) if power_off.is_over(axes))


@pytest.mark.parametrize(
    ("axes", "cycles"),
    [
        ((axis(OFF), axis(OFF)), 1),
        ((axis(OFF), axis(ON)), POWER_OFF_CYCLES + 1),
        ((axis(OFF), axis(OFF, velocity_si=1.0)), SETTLE_CYCLES + 1),
        ((axis(OFF), axis(None)), 1),
    ],
)
def test_the_wait_is_as_long_as_the_axes_need_but_limited(axes, cycles):
    assert waited(*axes) == cycles
