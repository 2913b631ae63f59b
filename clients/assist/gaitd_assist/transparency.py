"""Friction fed forward, so that a leg feels lighter; an option, off by default.

    a = ratio F gate(v) share,  0 where F does not oppose the motion, at rest, and when not ok

F is the observer's friction, at most the calibrated level, so that a patient's effort that is taken
for friction is not fed forward. The gate rises from 0 at rest to 1 at a slow speed.

An energy tank bounds what friction that is wrong can do. Friction certainly takes (1 - error) F v;
the tank is filled by that and emptied by a v, the power that the law puts in. It holds little, and
as it empties, the law's share goes to 0. So what the leg gives to the patient is never more than
what the tank holds at the start.
Sources: Franken, Stramigioli, Misra, Secchi, Macchelli, "Bilateral telemanipulation with time
delays: a two-layer approach combining passivity and transparency", IEEE Trans. Robot. 27 (2011):
energy tank with a limit. Franken, Misra, Stramigioli, "Improved transparency in energy-based
bilateral telemanipulation", Mechatronics (2011): it may be filled by friction that is
underestimated. Differs from them: one axis, and no master.
"""

from dataclasses import dataclass

from gaitd_client import Assist

from gaitd_assist.law import Memory, Pair, Sample


class EnergyTank:
    """Energy of one axis that may be put into the motion."""

    def __init__(self, size_j: float) -> None:
        """Begin full.

        Args:
            size_j: energy that it holds; also what friction that is wrong may put in at most.
        """
        self._size_j = self.energy_j = size_j

    def update(self, taken_w: float, put_in_w: float, dt_s: float) -> None:
        """Fill and empty it over a time.

        Args:
            taken_w: power that friction certainly takes from the motion.
            put_in_w: power that the law puts into the motion.
            dt_s: the time.
        """
        energy_j = self.energy_j + (taken_w - put_in_w) * dt_s
        self.energy_j = min(max(energy_j, 0.0), self._size_j)

    def share(self) -> float:
        """Return the share of the law that the tank allows: 1 when half full, 0 when empty."""
        return min(2.0 * self.energy_j / self._size_j, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransparencyRules:
    """Constants of the law; pairs are hip and slide."""

    friction_max: Pair
    """Calibrated level of friction: N·m, N."""
    full_speed: Pair
    """Speed from which friction is fed forward in full: rad/s, m/s."""
    tank_j: Pair
    """Energy that a tank holds."""
    feedforward_ratio: float
    error_ratio: float
    """The estimated friction may be wrong by this share."""


class Transparency:
    """The law for one leg."""

    def __init__(self, rules: TransparencyRules) -> None:
        """Begin with full tanks."""
        self._rules = rules
        self._tanks = tuple(EnergyTank(size_j) for size_j in rules.tank_j)
        self._efforts = [0.0, 0.0]
        """Sent with the sample before: N·m, N."""

    def begin_gait(self) -> None:
        """See `Law`: nothing; a tank that was refilled here would be energy from nowhere."""

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """See `Law`: add friction in the direction of motion."""
        for axis in (0, 1):
            self._efforts[axis] = self._effort(axis, sample)
        return setpoint._replace(
            hip_nm=setpoint.hip_nm + self._efforts[0], slide_n=setpoint.slide_n + self._efforts[1]
        )

    def end_stride(self) -> None:
        """See `Law`: nothing, this law does not learn."""

    def state(self) -> Memory:
        """See `Law`."""
        hip, slide = self._tanks
        return Memory(hip={"tank_j": hip.energy_j}, slide={"tank_j": slide.energy_j})

    def _effort(self, axis: int, sample: Sample) -> float:
        rules, tank, velocity = self._rules, self._tanks[axis], sample.velocity[axis]
        friction = _limited(sample.friction[axis], velocity, rules.friction_max[axis])
        # An effort against the motion fills nothing: it may not be in force yet.
        put_in_w = max(self._efforts[axis] * velocity, 0.0)
        taken_w = (1.0 - rules.error_ratio) * friction * velocity
        tank.update(taken_w, put_in_w, sample.dt_s)
        gate = min(abs(velocity) / rules.full_speed[axis], 1.0)
        return rules.feedforward_ratio * friction * gate * tank.share()


def _limited(friction: float | None, velocity: float, friction_max: float) -> float:
    """Return friction that opposes the motion, at most its calibrated level; else 0."""
    if friction is None or friction * velocity <= 0.0:
        return 0.0
    return min(max(friction, -friction_max), friction_max)
