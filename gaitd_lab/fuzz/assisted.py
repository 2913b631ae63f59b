"""What must never be of a controller's assist, judged from what the gateway told the core.

1. Assist outlives its lease: assist, or mode TORQUE, is in force only while the newest level names
   a lease and a good setpoint of it is fresh, and for the time of the fade after that.
2. Assist beyond its limit: what is in force is finite and inside the limit of its axis.

Good is what this file says, not what the core has counted: of the lease, a number above all before,
finite, inside its limits, for a cycle that is neither to come nor too old. Time is counted in the
core's own cycles, as limits.toml has it: a core that is stopped for a while fades when it goes on.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from daemon.ipc.record import CycleRecord, GatewayState, Mode, Setpoint

MARGIN_CYCLES: Final = 2
"""From a level to the record of the cycle that has heard it, and one for rounding."""
NEGLIGIBLE: Final = 1e-9


class AssistBounds(NamedTuple):
    """From limits.toml."""

    most_si: tuple[float, float]
    """N·m, N."""
    age_max_cycles: int
    fade_cycles: int
    first_cycles: int
    """Mode TORQUE waits so long for its first setpoint."""


@dataclass
class AssistWatch:
    """Both rules over the lives of several cores."""

    bounds: AssistBounds
    checked: Counter[str] = field(default_factory=Counter)
    _lease: int = 0
    _seqs: dict[str, int] = field(default_factory=dict[str, int])
    """The highest good one of each leg under the lease."""
    _good_cycle: int = -(10**9)
    """That the newest good setpoint was for."""
    _cycle: int = 0
    _without_count: int = 0
    """Records in a row without a lease, or without a good setpoint that is fresh."""
    _unleased_count: int = 0
    _torque_count: int = 0

    def core_gone(self) -> None:
        """Another core counts its cycles anew."""
        self._lease, self._cycle, self._good_cycle = 0, 0, -(10**9)
        self._without_count = self._unleased_count = self._torque_count = 0
        self._seqs.clear()

    def tells(self, level: GatewayState) -> None:
        """A level on its way to the core."""
        if level.lease != self._lease:
            self._lease, self._good_cycle = level.lease, -(10**9)
            self._seqs.clear()
        for setpoint in level.setpoints:
            if self._is_good(setpoint):
                self._seqs[setpoint.leg] = setpoint.seq
                self._good_cycle = max(self._good_cycle, setpoint.for_cycle)

    def _is_good(self, setpoint: Setpoint) -> bool:
        wanted = setpoint.hip_assist_nm, setpoint.slide_assist_n
        inside = all(
            abs(one) <= most for one, most in zip(wanted, self.bounds.most_si, strict=True)
        )
        return (
            inside  # NaN is not
            and 0.0 <= setpoint.stiffness_ratio <= 1.0
            and setpoint.lease == self._lease != 0
            and setpoint.seq > self._seqs.get(setpoint.leg, -1)
            and setpoint.for_cycle <= self._cycle + 1
        )

    def hear(self, record: CycleRecord) -> Iterator[tuple[str, str]]:
        """Rule and words of what is broken in this record."""
        bounds = self.bounds
        self._cycle = record.cycle
        fresh = record.cycle - self._good_cycle <= bounds.age_max_cycles
        self._unleased_count = 0 if self._lease else self._unleased_count + 1
        self._without_count = 0 if self._lease and fresh else self._without_count + 1
        self.checked["assist outlives its lease"] += 1
        self.checked["assist beyond its limit"] += 1
        for leg in record.assist.legs:
            yield from self._judge(leg.assist)
        self._torque_count = self._torque_count + 1 if record.mode == Mode.TORQUE else 0
        waited = min(self._without_count, self._torque_count)
        without = max(waited - bounds.first_cycles, self._unleased_count)
        if min(without, self._torque_count) > MARGIN_CYCLES:
            yield "assist outlives its lease", f"mode torque, {without} cycles after it"

    def _judge(self, assist: tuple[float, float]) -> Iterator[tuple[str, str]]:
        said = f"{assist[0]:.4g} N m, {assist[1]:.4g} N"
        if not all(map(math.isfinite, assist)) or any(
            abs(one) > most + NEGLIGIBLE
            for one, most in zip(assist, self.bounds.most_si, strict=True)
        ):
            yield "assist beyond its limit", said
        left = any(abs(one) > NEGLIGIBLE for one in assist)
        if left and self._without_count > self.bounds.fade_cycles + MARGIN_CYCLES:
            yield "assist outlives its lease", f"{said}, {self._without_count} cycles after it"
