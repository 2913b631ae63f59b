"""Help over the phase of the stride: guidance, learned from how far the leg lags, and assist.

A stride has `BINS` bins. Each has a stiffness s of the guidance, which the axes share, and for each
axis the size m of an assist along the motion of the reference. A pass through a bin has a stray n
on each axis: the mean error in dead bands d, where a leg ahead of its reference has none. After it,

    s <- clip(kept(n) s + g max(n - 1, 0), floor, 1)             n of the worse axis
    m <- min(kept(n') m + s gain d' max(n' - 1, 0), cap)         n' = n / ASSISTED, d' = ASSISTED d
    kept(n) = f - (f - release) max(1 - n, 0)

That is the law of the stray. With the law of the estimate, m is a mean of that value and of what
the patient lacks (`lack.py`), weighted by the estimate's sigma; where the estimate is not known, it
is that value alone. A leg answers `lead_s` later, so the lack of a bin is the larger one of two: at
its own phase, and `lead_s` later; if one is not known, as where the leg turns, it is the other.

So help that is not needed goes fast, help that is needed fades by 1 - f against the error that
shows it, and assist is learned as far as the leg is guided: where guidance has faded, it comes back
first. Beyond `WALL` the guidance stiffens at once, for a patient who loses all strength within a
stride.

Assist is m times the direction of the reference's velocity v, which is v in the speed V of the pass
from which m was learned, from -1 to 1. So it never brakes a leg that moves along with its
reference, its sign does not depend on noise, and in a slower or smaller gait it is less, in
proportion. After a pass that is slower than V, m is that share of it.

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

from gaitd_assist.lack import Guided, helping, lacking, weight
from gaitd_assist.law import Memory, Pair, Sample

BINS: Final = 16
ASSISTED: Final = 1.25
"""Dead band of the assist, in that of the guidance: with the example's numbers, the stray at which
full guidance settles, 1 + (1 - f) / g."""
WALL: Final = 1.5
"""Stray, in dead bands, from which the guidance stiffens at once; one more, and it is full."""
RISE_PER_S: Final = 0.8
"""Rise of the stiffness that is counted on; the service's `stiffness_rate_max_ratio_per_s` is 1."""
TURNING_SPEED: Final = (0.15, 0.06)
"""V is at least this, so that assist is 0 where the reference turns: rad/s, m/s."""
BIN_KNOWN_MIN_RATIO: Final = 0.5
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
    stiffness: Pair | None = None
    """K, of the guidance in full: N·m/rad, N/m. None: assist is learned from the stray alone."""


class Passed:
    """A pass through a bin; efforts are along the reference's motion."""

    def __init__(self) -> None:
        """Begin a pass."""
        self._dwell_s, self._moved = 0.0, [0.0, 0.0]
        self._sums = [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]

    def add(self, sample: Sample, velocities: Pair) -> None:
        """Add a sample.

        Args:
            sample: the leg now.
            velocities: of the reference: rad/s, m/s.
        """
        dt_s = sample.dt_s
        self._dwell_s += dt_s
        for axis, velocity in enumerate(velocities):
            self._moved[axis] += dt_s * velocity
            needed, patient = sample.needed[axis], sample.patient[axis]
            std = sample.patient_std[axis]
            if not sample.learns[axis] or needed is None or patient is None or std is None:
                continue
            along_s = dt_s * _direction(velocity, axis)
            for at, part in enumerate((dt_s, along_s * needed, along_s * patient, dt_s * std)):
                self._sums[axis][at] += part

    def velocity(self, axis: int) -> float:
        """Return the mean velocity of the reference: rad/s or m/s."""
        return self._moved[axis] / self._dwell_s if self._dwell_s else 0.0

    def lack(self, axis: int) -> tuple[float, float] | None:
        """Return what the patient lacked in the mean, and its sigma; None: not known."""
        known_s, *totals = self._sums[axis]
        if known_s <= BIN_KNOWN_MIN_RATIO * self._dwell_s:
            return None
        needed, patient, std = (total / known_s for total in totals)
        return lacking(needed, patient), std


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
        self._learned_velocity = [0.0] * BINS, [0.0] * BINS
        """Mean of the reference's in the pass that the assist was learned from: rad/s, m/s."""
        self.begin_gait()

    def begin_gait(self) -> None:
        """See `Law`: the help of the gait before goes on."""
        self._bin, self._last_hz = -1, 0.0
        self._passed_bin = -1
        self._passed = [Passed() for _ in range(BINS)]
        self._ended_count = -1
        """Bins that have ended in this gait; the first end, at -1, is of none."""
        self._clear()

    def answer(self, sample: Sample, setpoint: Assist) -> Assist:
        """See `Law`: guide and assist at this phase, and learn from the error."""
        if sample.phase_ratio is None or sample.cadence_hz is None:
            return setpoint
        phase_ratio = sample.phase_ratio
        felt_ratio = phase_ratio - self._rules.lead_s * sample.cadence_hz
        felt = math.floor(felt_ratio * BINS) % BINS
        if felt != self._bin:
            self._end_bin()
            self._bin = felt
        self._dwell_s += sample.dt_s
        self._strides += sample.dt_s * sample.cadence_hz
        velocities = _reference_velocities(sample)
        self._felt.add(sample, velocities)
        self._pass(int(phase_ratio * BINS) % BINS, sample, velocities)
        farthest_ratio = max(self._feel(axis, sample, velocities[axis]) for axis in (0, 1))
        hip_nm, slide_n = (self._effort(axis, phase_ratio, velocities[axis]) for axis in (0, 1))
        guided_ratio = self._guided(phase_ratio, sample.cadence_hz)
        return Assist(
            setpoint.hip_nm + hip_nm,
            setpoint.slide_n + slide_n,
            min(max(guided_ratio, farthest_ratio - WALL), FULL),
        )

    def end_stride(self) -> None:
        """See `Law`: nothing, this law learns after each bin."""

    def state(self) -> Memory:
        """See `Law`."""
        hip, slide = self.assist
        return Memory(
            values={
                "stiffness_ratio": sum(self.stiffness) / BINS,
                "stiffness_of_phase_ratio": list(self.stiffness),
            },
            hip={"assist": list(hip)},
            slide={"assist": list(slide)},
        )

    def _pass(self, at: int, sample: Sample, velocities: Pair) -> None:
        """Add a sample to the pass through the bin of its own phase."""
        if at != self._passed_bin:
            self._passed_bin, self._passed[at] = at, Passed()
        self._passed[at].add(sample, velocities)

    def _feel(self, axis: int, sample: Sample, velocity: float) -> float:
        """Sum up what this bin teaches; return the stray now, in dead bands."""
        error = sample.error[axis]
        ahead = min(error * _direction(velocity, axis), 0.0)
        stray_ratio = (abs(error) + ahead) / self._rules.dead_band[axis]
        if sample.learns[axis]:
            self._known_s[axis] += sample.dt_s
            self._stray_s[axis] += sample.dt_s * stray_ratio
            # No windup: more of an assist that is cut would change nothing.
            lacking_ratio = min(stray_ratio, 1.0) if sample.is_cut[axis] else stray_ratio
            self._lacking_s[axis] += sample.dt_s * lacking_ratio
        return stray_ratio

    def _effort(self, axis: int, phase_ratio: float, velocity: float) -> float:
        learned = _between(self._learned_velocity[axis], phase_ratio)
        return _between(self.assist[axis], phase_ratio) * _clipped(velocity / _speed(learned, axis))

    def _guided(self, phase_ratio: float, cadence_hz: float) -> float:
        """Return what this phase needs, and what the ones to come need now."""
        fall = RISE_PER_S / (BINS * cadence_hz)
        at = int(phase_ratio * BINS)
        return max(self.stiffness[(at + ahead) % BINS] - ahead * fall for ahead in range(BINS))

    def _end_bin(self) -> None:
        last_hz, self._last_hz = self._last_hz, self._strides / (self._dwell_s or 1.0)
        self._ended_count += 1
        if self._ended_count > BINS and _is_same(self._last_hz, last_hz):
            self._learn()
        self._clear()

    def _learn(self) -> None:
        rules, at, strays = self._rules, self._bin, list[float]()
        for axis, known_s in enumerate(self._known_s):
            if known_s <= BIN_KNOWN_MIN_RATIO * self._dwell_s:
                continue
            strays.append(self._stray_s[axis] / known_s)
            velocities, velocity = self._learned_velocity[axis], self._passed[at].velocity(axis)
            slowed = min(_speed(velocity, axis) / _speed(velocities[at], axis), 1.0)
            lacking_ratio = self._lacking_s[axis] / known_s / ASSISTED
            size = self._size(axis, slowed * self.assist[axis][at], lacking_ratio)
            self.assist[axis][at], velocities[at] = min(size, rules.cap[axis]), velocity
        if strays:
            ratio = adapted(self.stiffness[at], max(strays), rules, rules.stiffness_gain_ratio)
            self.stiffness[at] = min(max(ratio, rules.floor_ratio), FULL)

    def _size(self, axis: int, before: float, stray_ratio: float) -> float:
        """Return the size of the assist that a pass teaches.

        Args:
            axis: 0 the hip, 1 the slide.
            before: size in the pass: N·m or N.
            stray_ratio: of the pass, n'.
        """
        rules, stiffness_ratio = self._rules, self.stiffness[self._bin]
        gain, tolerated = rules.gain[axis], ASSISTED * rules.dead_band[axis]
        by_stray = adapted(before, stray_ratio, rules, stiffness_ratio * gain * tolerated)
        both = self._passed[self._bin].lack(axis), self._felt.lack(axis)
        lacks = [lack for lack in both if lack is not None]
        if rules.stiffness is None or not lacks:
            return by_stray
        lack, std = map(max, zip(*lacks, strict=True))
        stiffness = rules.stiffness[axis]
        settled_ratio = gain / (gain + (1.0 - rules.forgetting_ratio) * stiffness)
        guided = Guided(stiffness * tolerated, settled_ratio, stiffness_ratio)
        by_estimate = helping(lack, before, stray_ratio, guided)
        share = weight(std, guided.effort)
        return share * by_estimate + (1.0 - share) * by_stray

    def _clear(self) -> None:
        self._felt = Passed()
        """What is felt of this bin, `lead_s` after its own phase."""
        self._dwell_s = self._strides = 0.0
        self._known_s, self._stray_s, self._lacking_s = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]


def adapted(value: float, stray_ratio: float, rules: HelpRules, gain: float) -> float:
    """Return a help after a pass: less of it where the leg strays little, more where it does.

    Args:
        value: the help before; not negative.
        stray_ratio: of this pass, in dead bands.
        rules: with what is kept.
        gain: of a stray of two dead bands.
    """
    released = (rules.forgetting_ratio - rules.release_ratio) * max(1.0 - stray_ratio, 0.0)
    return (rules.forgetting_ratio - released) * value + gain * max(stray_ratio - 1.0, 0.0)


def _is_same(cadence_hz: float, before_hz: float) -> bool:
    return abs(cadence_hz - before_hz) < STEADY_RATIO * cadence_hz


def _reference_velocities(sample: Sample) -> Pair:
    (hip, slide), (hip_rate, slide_rate) = sample.velocity, sample.error_rate
    return hip + hip_rate, slide + slide_rate


def _speed(velocity: float, axis: int) -> float:
    return max(abs(velocity), TURNING_SPEED[axis])


def _direction(velocity: float, axis: int) -> float:
    return _clipped(velocity / TURNING_SPEED[axis])


def _clipped(share: float) -> float:
    return min(max(share, -1.0), 1.0)


def _between(values: list[float], phase_ratio: float) -> float:
    """Return the value at a phase, linear between the middles of the bins."""
    place = phase_ratio * BINS - 0.5
    before = int(place // 1)
    part = place - before
    return (1.0 - part) * values[before % BINS] + part * values[(before + 1) % BINS]
