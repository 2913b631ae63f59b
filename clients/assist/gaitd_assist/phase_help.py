"""Help over the phase of the stride: guidance and assist, learned from how far the leg lags.

A stride has `BINS` bins. Each has a stiffness s of the guidance, which the axes share, and for each
axis the size m of an assist along the motion of the reference. A pass through a bin has a stray n
on each axis: the mean error in dead bands, where a leg ahead of its reference has none. After it,

    s <- clip(kept(n) s + g max(n - 1, 0), floor, 1)             n of the worse axis
    m <- min(kept(n') m + gain d' max(n' - 1, 0), cap)           n' = n / ASSISTED, d' = ASSISTED d
    kept(n) = f - (f - release) max(1 - n, 0)

So help that is not needed goes fast, help that is needed fades by 1 - f against the error that
shows it, and assist is learned only where full guidance is not enough. Beyond `WALL` the guidance
stiffens at once, for a patient who loses all strength within a stride.

Assist is m times the direction of the reference, a smooth sign of its velocity. So it never brakes
a leg that moves along with its reference, and its sign does not depend on noise.

What a bin learns is from the error `lead_s` later. The service lets the stiffness rise by
`RISE_PER_S`, so guidance rises before the bin that needs it. Nothing is learned from a bin in which
the cadence rises, as in the ramps of a gait, or that was not known well enough, or of the first
stride after help begins, because the patient needs time to begin, too; no more assist where the
service gives less than what was asked for.

Sources: Emken, Benitez, Reinkensmeyer, "Human-robot cooperative movement training: learning a novel
sensory motor transformation during walking with robotic assistance-as-needed", J. NeuroEng.
Rehabil. 4:8 (2007): R' = f R - g e with f < 1, and error weighting. Wolbrecht, Chan, Reinkensmeyer,
Bobrow, "Optimizing compliant, model-based robotic assistance to promote neurorehabilitation", IEEE
Trans. Neural Syst. Rehabil. Eng. 16 (2008): assist that is learned and forgotten. Differs from
them: both over the phase of the stride; forgetting depends on the error, leads are not errors.
"""

import math
from dataclasses import dataclass
from typing import Final

from gaitd_client import Assist

from gaitd_assist.law import Pair, Sample

BINS: Final = 16
ASSISTED: Final = 1.2
"""Dead band of the assist, in that of the guidance."""
WALL: Final = 1.5
"""Stray, in dead bands, from which the guidance stiffens at once; one more, and it is full."""
RISE_PER_S: Final = 0.8
"""Rise of the stiffness that is counted on; the service's `stiffness_rate_max_ratio_per_s` is 1."""
FULL_SPEED: Final = (0.15, 0.06)
"""Speed of the reference from which the assist is whole: rad/s, m/s. At its reversal it is 0."""
KNOWN_MIN_RATIO: Final = 0.5
"""Least share of a bin in which an axis was learned from."""
STEADY_RATIO: Final = 0.005
"""Changes of the cadence that are smaller are noise; in the ramps of a gait they are larger."""
FULL: Final = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HelpRules:
    """Constants of the law; pairs are hip and slide."""

    dead_band: Pair
    """d: rad, m."""
    cap: Pair
    """Largest assist: N·m, N."""
    forgetting_ratio: float
    """f: share of the help that is kept in a stride, however large the error is."""
    release_ratio: float
    """Share of the help that is kept in a stride without an error."""
    stiffness_gain_ratio: float
    """g: stiffness gained by an error of two dead bands."""
    floor_ratio: float
    """The stiffness never falls below."""
    gain: Pair
    """Assist gained by a unit of error beyond the dead band: N·m/rad, N/m."""
    lead_s: float
    """Time that a leg needs to answer."""


class PhaseHelp:
    """The law for one leg."""

    def __init__(self, rules: HelpRules) -> None:
        """Begin with full stiffness and no assist."""
        self._rules = rules
        self.forget()

    def forget(self) -> None:
        """Full stiffness and no assist: it is another patient."""
        self.stiffness = [FULL] * BINS
        self.assist = [0.0] * BINS, [0.0] * BINS
        self._cadence_hz = 0.0
        """At which the help was learned."""
        self.begin_gait()

    def begin_gait(self) -> None:
        """See `Law`: the help of the gait before goes on."""
        self._bin, self._last_hz = -1, 0.0
        self._ended_count = -1
        """Bins that have ended in this gait; the first end, at -1, is of none."""
        self._clear()

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """See `Law`: guide and assist at this phase, and learn from the error."""
        if sample.phase_ratio is None or sample.cadence_hz is None:
            return setpoint
        direction = _direction(sample)
        felt_ratio = sample.phase_ratio - self._rules.lead_s * sample.cadence_hz
        felt = math.floor(felt_ratio * BINS) % BINS
        if felt != self._bin:
            self._end_bin()
            self._bin = felt
        self._dwell_s += sample.dt_s
        self._strides += sample.dt_s * sample.cadence_hz
        farthest = 0.0
        for axis, learns in enumerate(sample.learns):
            error, dead_band = sample.error[axis], self._rules.dead_band[axis]
            stray = abs(error) + min(error * direction[axis], 0.0)
            farthest = max(farthest, stray / dead_band)
            if sample.is_cut[axis]:
                stray = min(stray, dead_band)
            if learns:
                self._known_s[axis] += sample.dt_s
                self._stray[axis] += sample.dt_s * stray
        scale = self._scale(sample.cadence_hz)
        hip_nm, slide_n = (
            scale * along * _between(sizes, sample.phase_ratio)
            for along, sizes in zip(direction, self.assist, strict=True)
        )
        return Assist(
            setpoint.hip_nm + hip_nm,
            setpoint.slide_n + slide_n,
            min(max(self._guided(sample.phase_ratio, sample.cadence_hz), farthest - WALL), FULL),
        )

    def end_stride(self) -> None:
        """See `Law`: nothing, this law learns after each bin."""

    def state(self) -> dict[str, float | list[float]]:
        """See `Law`."""
        hip, slide = self.assist
        return {
            "stiffness_ratio": sum(self.stiffness) / BINS,
            "stiffness_of_phase_ratio": list(self.stiffness),
            "assist_hip_nm": list(hip),
            "assist_slide_n": list(slide),
        }

    def _guided(self, phase_ratio: float, cadence_hz: float) -> float:
        """Return what this phase needs, and what the ones to come need now."""
        fall = RISE_PER_S / (BINS * cadence_hz)
        at = int(phase_ratio * BINS)
        return max(self.stiffness[(at + ahead) % BINS] - ahead * fall for ahead in range(BINS))

    def _end_bin(self) -> None:
        last_hz, self._last_hz = self._last_hz, self._strides / (self._dwell_s or 1.0)
        self._ended_count += 1
        if self._ended_count > BINS and _is_same(self._last_hz, last_hz):
            if not _is_same(self._last_hz, self._cadence_hz):
                # From now on the assist is of this cadence: it goes on as it is.
                scale, self._cadence_hz = self._scale(self._last_hz), self._last_hz
                for sizes in self.assist:
                    sizes[:] = [scale * size for size in sizes]
            self._learn()
        self._clear()

    def _scale(self, cadence_hz: float) -> float:
        """Return the share of the assist that a slower gait needs: inertia goes with the square."""
        return min(cadence_hz / (self._cadence_hz or cadence_hz), 1.0) ** 2

    def _learn(self) -> None:
        rules, at, worst = self._rules, self._bin, None
        for axis, known_s in enumerate(self._known_s):
            if known_s > KNOWN_MIN_RATIO * self._dwell_s:
                sizes, dead_band = self.assist[axis], rules.dead_band[axis]
                stray = self._stray[axis] / known_s / dead_band
                gain = rules.gain[axis] * ASSISTED * dead_band
                sizes[at] = min(adapted(sizes[at], stray / ASSISTED, rules, gain), rules.cap[axis])
                worst = max(worst or 0.0, stray)
        if worst is not None:
            ratio = adapted(self.stiffness[at], worst, rules, rules.stiffness_gain_ratio)
            self.stiffness[at] = min(max(ratio, rules.floor_ratio), FULL)

    def _clear(self) -> None:
        self._dwell_s = self._strides = 0.0
        self._known_s, self._stray = [0.0, 0.0], [0.0, 0.0]


def adapted(value: float, stray: float, rules: HelpRules, gain: float) -> float:
    """Return a help after a pass: less of it where the leg strays little, more where it does.

    Args:
        value: the help before; not negative.
        stray: of this pass, in dead bands.
        rules: with what is kept.
        gain: of a stray of two dead bands.
    """
    released = (rules.forgetting_ratio - rules.release_ratio) * max(1.0 - stray, 0.0)
    return (rules.forgetting_ratio - released) * value + gain * max(stray - 1.0, 0.0)


def _is_same(cadence_hz: float, before_hz: float) -> bool:
    return abs(cadence_hz - before_hz) < STEADY_RATIO * cadence_hz


def _direction(sample: Sample) -> Pair:
    hip, slide = (
        min(max((rate + velocity) / full, -1.0), 1.0)
        for rate, velocity, full in zip(sample.error_rate, sample.velocity, FULL_SPEED, strict=True)
    )
    return hip, slide


def _between(values: list[float], phase_ratio: float) -> float:
    """Return the value at a phase, linear between the middles of the bins."""
    place = phase_ratio * BINS - 0.5
    before = int(place // 1)
    part = place - before
    return (1.0 - part) * values[before % BINS] + part * values[(before + 1) % BINS]
