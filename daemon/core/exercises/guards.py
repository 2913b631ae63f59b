"""Inputs of the guards of a request, collected in its cycle.

The guards of ENABLE, RESET and of the modes of a single axis are in `table.py`; that of an exercise
is in its own file (`Exercise.refuse`).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from gaitd_names import Doubt, Mode, SelfTestDue, Untested


@dataclass(frozen=True, slots=True)
class GuardInputs:
    """Inputs of the guards, collected in the cycle of the request."""

    mode: Mode
    gateway_alive: bool
    at_rest: bool
    hand_switch_closed: bool
    """Every drive that shows the hand switch shows it closed; True if none shows it."""
    hand_switch_known: bool
    """At least one drive shows the hand switch."""
    sto_released: bool
    unreferenced: tuple[tuple[str, Doubt], ...]
    """Names of the axes without a valid position, with the reason."""
    outside: tuple[str, ...]
    """Names of the axes outside their range, and of the legs near their singularity."""
    drives_powered: bool
    """All drives are enabled and their static load has been compared."""
    cadence_max_hz: float
    scenarios: Mapping[str, float]
    """Excite scenarios by name, with their longest duration in s."""
    artificial: frozenset[str]
    """Names of the scenarios with an artificial disturbance."""
    patient_configured: bool
    guidance: str
    unproven: tuple[str, ...] = ()
    """Names of the axes whose sign must be proven and is not."""
    lease_held: bool = False
    """A controller holds the lease, according to the gateway."""
    inputs_untested: tuple[tuple[str, Untested], ...] = ()
    """The axes and the states of their inputs that the daily test has still to see, if required."""
    self_test_due: SelfTestDue = SelfTestDue.NONE
    unsampled: tuple[str, ...] = ()
    """Names of the axes without a complete sample in this cycle: their standstill is unknown."""
    lost: frozenset[str] = frozenset()
    """Names of the axes whose drive is silent or got NMT stop: the next bring-up checks them."""
