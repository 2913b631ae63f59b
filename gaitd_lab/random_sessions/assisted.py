"""Invariants of a controller's assist, checked on the gateway states sent to the core.

1. Assist outlives its lease: assist, or mode TORQUE, is active only while the newest gateway state
   names a lease and a valid setpoint of it is fresh, and for the fade time after that.
2. Assist beyond its limit: the active assist is finite and inside the limit of its axis.

Validity is defined in this file, independent of the core's counts: of the lease, a number above all
before, finite, inside its limits, for a cycle that is neither in the future nor too old. Time is
counted in the core's own cycles with drives, as in limits.toml: a core that is stopped for a while
fades when it continues, and so does one that a reset has sent to bring its drives up again.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gaitd_names import Mode

from daemon.ipc.record import CycleRecord, GatewayState, Setpoint

MARGIN_CYCLES: Final = 2
"""Cycles from a gateway state to the record of the cycle that has read it, and one for rounding."""
NEGLIGIBLE: Final = 1e-9
WITHOUT_DRIVES: Final = frozenset({Mode.OFF, Mode.BRINGING_UP})
"""Modes in which no drive is commanded, and assist neither acts nor changes."""


class AssistBounds(NamedTuple):
    """Bounds of limits.toml."""

    most_si: tuple[float, float]
    """Assist limits, N·m, N."""
    age_max_cycles: int
    fade_cycles: int
    first_cycles: int
    """Time limit of mode TORQUE for its first setpoint."""


@dataclass
class AssistWatch:
    """Both invariants over the lives of several cores."""

    bounds: AssistBounds
    _lease: int = 0
    _seqs: dict[str, int] = field(default_factory=dict[str, int])
    """The highest valid sequence number of each leg under the lease."""
    _good_cycle: int = -(10**9)
    """The cycle of the newest valid setpoint."""
    _cycle: int = 0
    _without_count: int = 0
    """Consecutive records with drives, without a lease or without a valid fresh setpoint."""
    _unleased_count: int = 0
    _torque_count: int = 0

    def core_ended(self) -> None:
        """Reset: another core restarts the cycle count."""
        self._lease, self._cycle, self._good_cycle = 0, 0, -(10**9)
        self._without_count = self._unleased_count = self._torque_count = 0
        self._seqs.clear()

    def gateway_state_sent(self, gateway_state: GatewayState) -> None:
        """Process a gateway state on its way to the core."""
        if gateway_state.lease != self._lease:
            self._lease, self._good_cycle = gateway_state.lease, -(10**9)
            self._seqs.clear()
        for setpoint in gateway_state.setpoints:
            if self._is_good(setpoint):
                self._seqs[setpoint.leg] = setpoint.seq
                self._good_cycle = max(self._good_cycle, setpoint.for_cycle)

    def _is_good(self, setpoint: Setpoint) -> bool:
        wanted = setpoint.hip.assist, setpoint.slide.assist
        inside = all(
            abs(one) <= most for one, most in zip(wanted, self.bounds.most_si, strict=True)
        )
        return (
            inside  # false for NaN
            and 0.0 <= setpoint.stiffness_ratio <= 1.0
            and setpoint.lease == self._lease != 0
            and setpoint.seq > self._seqs.get(setpoint.leg, -1)
            and setpoint.for_cycle <= self._cycle + 1
        )

    def receive(self, record: CycleRecord) -> Iterator[tuple[str, str]]:
        """Check a record; yields the violated rule and a text."""
        bounds = self.bounds
        self._cycle = record.cycle
        fresh = record.cycle - self._good_cycle <= bounds.age_max_cycles
        self._unleased_count = 0 if self._lease else self._unleased_count + 1
        if self._lease and fresh:
            self._without_count = 0
        elif record.mode not in WITHOUT_DRIVES:
            self._without_count += 1
        for leg in record.legs:
            yield from self._check((leg.hip.assist, leg.slide.assist))
        self._torque_count = self._torque_count + 1 if record.mode == Mode.TORQUE else 0
        waited = min(self._without_count, self._torque_count)
        without = max(waited - bounds.first_cycles, self._unleased_count)
        if min(without, self._torque_count) > MARGIN_CYCLES:
            yield "assist outlives its lease", f"mode torque, {without} cycles after it"

    def _check(self, assist: tuple[float, float]) -> Iterator[tuple[str, str]]:
        said = f"{assist[0]:.4g} N m, {assist[1]:.4g} N"
        if not all(map(math.isfinite, assist)) or any(
            abs(one) > most + NEGLIGIBLE
            for one, most in zip(assist, self.bounds.most_si, strict=True)
        ):
            yield "assist beyond its limit", said
        left = any(abs(one) > NEGLIGIBLE for one in assist)
        if left and self._without_count > self.bounds.fade_cycles + MARGIN_CYCLES:
            yield "assist outlives its lease", f"{said}, {self._without_count} cycles after it"
