"""Assist over the phase of the stride, learned within it and forgotten: what the patient lacks.

    a = sum_m psi_m(phase) w_m
    dw_m/dt = psi_m / |psi|^2 (h gain (dz(e) + lead [e outside] de/dt) / learning - a / forgetting)
    h = (s - floor) / (1 - floor),  s = stiffness of the guidance

psi are periodic Gaussians, normalised to sum 1; dz is the error outside of the dead band. Factor
psi / |psi|^2 makes the assist at the present phase change by exactly the term in parentheses. So in
the long run a = h gain forgetting / learning * dz(e): help persists only where an error does.

h: assist is learned as far as the leg is guided. An able patient whose strides keep within the dead
band on the whole, and so lose their guidance, may leave it at a reversal: that is not corrected.
Source: Wolbrecht, Chan, Reinkensmeyer, Bobrow, "Optimizing compliant, model-based robotic
assistance to promote neurorehabilitation", IEEE Trans. Neural Syst. Rehabil. Eng. 16 (2008):
sliding variable from error and error rate, forgetting by -1/tau Y^T (Y Y^T)^-1 Y a. Differs from
it: the basis is over the phase of the stride instead of the pose; there is a dead band, and h.
"""

import math
from dataclasses import dataclass
from typing import Final

from gaitd_client import Assist

from gaitd_assist.law import Pair, Sample, outside

WIDTH: Final = 1.0
"""Standard deviation of a Gaussian, in distances between two of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseRules:
    """Constants of the law; pairs are hip and slide."""

    dead_band: Pair
    """rad, m."""
    cap: Pair
    """Largest assist: N·m, N."""
    floor_ratio: float
    """Stiffness at which nothing is learned: that of `GuidanceRules`."""
    basis_count: int
    gain: Pair
    """Assist learned from a unit of error in `learning_s`: N·m/rad, N/m."""
    learning_s: float
    lead_s: float
    """Weight of the error's rate."""
    forgetting_s: float
    """Time constant with which assist fades at a phase, in time spent at that phase."""


class PhaseAssist:
    """The law for one leg."""

    def __init__(self, rules: PhaseRules) -> None:
        """Begin without assist."""
        self._rules = rules
        self.begin_gait()

    def begin_gait(self) -> None:
        """See `Law`: no assist."""
        count = self._rules.basis_count
        self._weights = [0.0] * count, [0.0] * count

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """See `Law`: add the assist of this phase, and learn from the error."""
        if sample.phase_ratio is None:
            return setpoint
        basis = self.basis(sample.phase_ratio)
        for axis, learns in enumerate(sample.learns):
            if learns:
                self._learn(axis, basis, sample, setpoint.stiffness_ratio)
        hip_nm, slide_n = (_dot(basis, weights) for weights in self._weights)
        return setpoint._replace(
            hip_nm=setpoint.hip_nm + hip_nm, slide_n=setpoint.slide_n + slide_n
        )

    def end_stride(self) -> None:
        """See `Law`: nothing, this law learns within the stride."""

    def state(self) -> dict[str, float | list[float]]:
        """See `Law`."""
        hip, slide = self._weights
        return {"weights_hip_nm": list(hip), "weights_slide_n": list(slide)}

    def basis(self, phase_ratio: float) -> list[float]:
        """Return the normalised Gaussians at this phase, shape (basis_count,), sum 1."""
        count = self._rules.basis_count
        distances = [
            ((phase_ratio * count - index + count / 2) % count - count / 2) / WIDTH
            for index in range(count)
        ]
        values = [math.exp(-0.5 * distance**2) for distance in distances]
        total = sum(values)
        return [value / total for value in values]

    def _learn(self, axis: int, basis: list[float], sample: Sample, stiffness_ratio: float) -> None:
        rules, weights = self._rules, self._weights[axis]
        guided_ratio = (stiffness_ratio - rules.floor_ratio) / (1.0 - rules.floor_ratio)
        error = outside(sample.error[axis], rules.dead_band[axis])
        if error != 0.0:
            error += rules.lead_s * sample.error_rate[axis]
        rate = rules.gain[axis] * guided_ratio * error / rules.learning_s
        rate -= _dot(basis, weights) / rules.forgetting_s
        step = rate * sample.dt_s / _dot(basis, basis)
        cap = rules.cap[axis]
        for index, part in enumerate(basis):
            weights[index] = min(max(weights[index] + step * part, -cap), cap)


def _dot(one: list[float], other: list[float]) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))
