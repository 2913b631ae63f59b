"""Process and measurement noise of one step: its sources, and the states it acts on.

Process noise is given per 10 ms and grows with the root of the true time step. Beyond that:

- A patient who works is no random walk of a known size. While the filter follows too slowly,
  innovations that follow each other have the same sign; while it follows too fast, or the encoder
  is at fault, they have opposite signs. So the patient's noise of an axis follows their product,
  up to `patient_noise_max_ratio`, to where they are white: the optimal gain, whatever the noise
  (Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Trans. Automat.
  Contr. 15 (1970)). Wrong samples do not raise it: they contradict each other. It falls while
  innovations are smaller than their sigma: an encoder that is better than its noise in the file
  gives small ones that agree. Where the drive's effort ripples (below), innovations agree for that
  reason too, and are no evidence of a patient.
- A patient who begins to push biases the mean of innovations, which raises the noise at once.
- After a rejected sample that a push explains, the state's uncertainty matches the push. The masses
  of both axes are coupled, so both may have moved; but a patient's effort is expected only on an
  axis whose own error is too large for noise. Otherwise a push on one axis is found on both.
- The current that a drive samples is not its mean over the cycle where its own loops change it each
  millisecond (position mode): that ripple is an unknown effort for one step.
- A sample that is not taken exactly at its time stamp is uncertain by velocity times jitter.

At rest (gate a(v), eq. (12), near 0) only net = patient - friction is observable. With
`velocity_gated`, once a joint has rested for longer than a gait's reversal takes:
- A change of net is assigned to friction, as in Fig. 5 of the paper: friction holds the load of a
  joint at rest, and a passive patient stays passive.
- Friction at its breakaway level holds no more. Then a change is the patient's, and the joint may
  be held by a stiff drive.
- The share of a load between the two is unknown meanwhile. That uncertainty lies along (1, 1) of
  friction and patient. It is kept apart from the filter's covariance (SPLIT), so that noise cannot
  move one against the other, and is included in reported uncertainties.
- Each time that the joint has certainly moved, GIVEN_SHARE of it is added to the covariance, so
  that the filter can correct a wrong assignment within some samples: a joint that really sticks,
  whose friction was anything up to breakaway, is not taken for a patient. The rest fades as
  friction follows its law, eq. (11). All of it at once would let net follow the encoder's noise.
- A joint that creeps has moved, too: its friction follows its law, if slowly.
"""

import math
from typing import Final

from observer.filter.leg_memory import LegMemory, N, Vector
from observer.filter.leg_model import STEP_S, LegModel
from observer.jit import inline
from observer.mechanism.friction import FrictionParameters, gate
from observer.mechanism.linkage import dynamics

LEAN_SHARE: Final = 0.1
"""Weight of a new innovation in the mean of whitened ones: some ten samples."""
LEAN_USUAL: Final = 0.3
"""One sigma of this mean is 0.23 for white noise; more counts as a change of the patient."""
LEAN_RATIO_MAX: Final = 3.0
LEAN_SAMPLE_MAX: Final = 6.0
"""Limit of a single innovation, in sigma."""
AGREEMENT_GAIN: Final = 0.07
"""Relative change of the patient's noise per cycle and unit of agreement: some 0.1 s."""
AGREEMENT_MAX: Final = 4.0
AGREEMENT_USUAL: Final = 0.02
"""Agreement at which the noise stays. Above 0 the noise returns when a patient does not work."""
AGREEMENT_SIZE_MIN: Final = 0.45
AGREEMENT_OF_SMALL: Final = -0.3
"""Two innovations whose mean square is below the first count as this agreement."""
PATIENT_RATIO_MIN: Final = 0.1
"""Without a patient the evidence falls to this; noise alone, or a wrong sensor, is then some ten
samples in a row from raising the patient's noise. Less than 1 acts as 1."""
PUSH_POSITION_SHARE: Final = 1.5
PUSH_PATIENT_SHARE: Final = 0.5
"""Uncertainty of position and patient after a push: 1 is its own effect within one more cycle. Less
for the patient avoids overshoot; the velocities' share, 1, corrects the rest."""
REST_BEGINS_S: Final = 0.07
REST_COMPLETE_S: Final = 0.12
"""A reversal of gait is over by the first time; the gate acts fully from the second on."""
LEAN_STRONG: Final = 0.6
REST_FRICTION_RATIO: Final = (0.8, 3.0)
"""The patient's noise, times this, is friction's at rest: the load of a joint that is held changes
little; a drive that pulls a joint which sticks changes it faster than a patient does. It rises from
the first to the second with the mean over LEAN_STRONG."""
SPLIT_RATIO: Final = 0.4
"""Standard deviation of friction at rest over its breakaway level: anywhere within it."""
SPLIT_GROWTH_S: Final = 0.1
RESTING_PATIENT_RATIO: Final = 0.1
"""Factor on the patient's initial uncertainty; the rest of it is in SPLIT."""
GIVEN_SHARE: Final = 0.16
"""Share of the split's variance that one detected motion adds to the covariance. With more, net
follows the encoder's noise; with less, a wrong share lasts where a stiffly held joint creeps."""
MOVED_S: Final = 0.01
MOVED_SIGMAS: Final = 5.0
"""A joint has moved when it is this long at the gate's edge speed, and this many sigma, off its
mark."""
MARK_S: Final = 0.2
"""Time constant of the mark: motion below 0.05 times the edge speed counts as rest."""


@inline
def set_process_noise(
    model: LegModel,
    process_std: Vector,
    measurement_std: Vector,
    patient_noise_max_ratio: float,
    ripple: tuple[float, float],
    velocity_gated: bool,
    m: LegMemory,
    dt_s: float,
) -> None:
    """Write the lower triangular root of this step's process noise to `m.noise`."""
    scale = math.sqrt(dt_s / STEP_S)
    for row in range(N):
        for column in range(row):
            m.noise[row, column] = 0.0
        m.noise[row, row] = scale * process_std[row]
    for axis in range(2):
        most = 1.0 if ripple[axis] > 0.0 else patient_noise_max_ratio
        if most == 1.0 or not velocity_gated:
            m.patient_rate[axis] = 0.0
        m.patient_ratio[axis] = min(max(m.patient_ratio[axis], PATIENT_RATIO_MIN), most)
        leaning = min(max(math.fabs(m.lean[axis]) / LEAN_USUAL, 1.0), LEAN_RATIO_MAX)
        ratio = max(m.patient_ratio[axis], 1.0) * leaning
        m.noise[6 + axis, 6 + axis] *= min(ratio, patient_noise_max_ratio)
    pushed = m.gated_cycles == 1.0
    if pushed or ripple[0] + ripple[1] > 0.0:
        d = dynamics(model.leg, m.mean[0], m.mean[1], 0.0, 0.0, 0.0)
        for axis in range(2):
            inertia = d.m11 if axis == 0 else d.m22
            push = m.push[axis] if pushed else 0.0
            m.noise[axis, axis] += PUSH_POSITION_SHARE * push * dt_s * dt_s
            m.noise[2 + axis, 2 + axis] = math.hypot(
                m.noise[2 + axis, 2 + axis] + push * dt_s, ripple[axis] * dt_s / inertia
            )
            m.noise[6 + axis, 6 + axis] += PUSH_PATIENT_SHARE * m.pushed[axis] * push * inertia
    if velocity_gated:
        _gate(model.hip, measurement_std[0], m, 0, dt_s)
        _gate(model.slide, measurement_std[1], m, 1, dt_s)


@inline
def rest_from_the_start(f: FrictionParameters, memory: LegMemory, axis: int) -> None:
    """Initial state at rest: friction holds the load, and the split has its largest uncertainty."""
    memory.root[6 + axis, 6 + axis] *= RESTING_PATIENT_RATIO
    memory.split[axis] = (SPLIT_RATIO * f.stribeck) ** 2


@inline
def _gate(f: FrictionParameters, std: float, m: LegMemory, axis: int, dt_s: float) -> None:
    """Gate the noise of friction and patient of one axis by its time at rest."""
    friction, patient = 4 + axis, 6 + axis
    split = 0.0
    if _has_moved(f, std, m, axis, dt_s):
        if m.quiet_s[axis] > 0.0:
            split = GIVEN_SHARE * m.split[axis]
            m.split[axis] -= split
        fade = math.exp(-gate(f, m.mean[2 + axis]) * dt_s / f.time_constant_s)
        m.split[axis] *= fade * fade
        m.quiet_s[axis] = 0.0
    else:
        m.quiet_s[axis] += dt_s
        m.patient_rate[axis] = 0.0
    rested = (m.quiet_s[axis] - REST_BEGINS_S) / (REST_COMPLETE_S - REST_BEGINS_S)
    resting = min(max(rested, 0.0), 1.0)
    limit = SPLIT_RATIO * f.stribeck
    room = max(limit * limit - m.split[axis], 0.0)
    m.split[axis] += room * resting * min(dt_s / SPLIT_GROWTH_S, 1.0)
    if math.fabs(m.mean[friction]) >= f.stribeck:
        resting = 0.0  # friction holds no more
    surprise = math.fabs(m.lean[axis]) / LEAN_STRONG
    ratio = min(max(surprise, REST_FRICTION_RATIO[0]), REST_FRICTION_RATIO[1])
    of_friction = math.hypot(
        m.noise[friction, friction], m.noise[patient, patient] * resting * ratio
    )
    of_patient = m.noise[patient, patient] * (1.0 - resting)
    # The root of diag(of_friction^2, of_patient^2) + split (1, 1)(1, 1)'
    first = math.sqrt(of_friction * of_friction + split)
    m.noise[friction, friction] = first
    m.noise[patient, friction] = split / first
    m.noise[patient, patient] = math.hypot(of_patient, math.sqrt(split) * of_friction / first)


@inline
def _has_moved(f: FrictionParameters, std: float, m: LegMemory, axis: int, dt_s: float) -> bool:
    """True if the joint has certainly moved since the last detection.

    The check uses samples, not the estimate: a step of torque that friction holds appears there as
    velocity for some cycles. A sample must leave a mark that follows slowly.
    """
    away = m.measured[axis] - m.mark[axis]
    if not math.isfinite(away):
        return False
    if math.fabs(away) > max(MOVED_S * f.edge, MOVED_SIGMAS * std):
        m.mark[axis] = m.measured[axis]
        return True
    m.mark[axis] += away * min(dt_s / MARK_S, 1.0)
    return False


@inline
def set_measurement_noise(measurement_std: Vector, sample_jitter_s: float, m: LegMemory) -> None:
    """Write the standard deviations of this step's samples to `m.seen_std`."""
    for axis in range(2):
        m.seen_std[axis] = math.hypot(measurement_std[axis], sample_jitter_s * m.mean[2 + axis])


@inline
def add_lean(m: LegMemory, state: int, row: int) -> None:
    """Add the innovation in this row of the measurement to its axis' running mean."""
    variance = 0.0
    for k in range(row + 1):
        variance += m.innovation_root[row, k] * m.innovation_root[row, k]
    sigmas = m.innovation[row] / math.sqrt(variance)
    sigmas = min(max(sigmas, -LEAN_SAMPLE_MAX), LEAN_SAMPLE_MAX)
    m.lean[state] += LEAN_SHARE * (sigmas - m.lean[state])
    # The product of two innovations, if they agree in size too: a single large one is a glitch.
    before = m.whitened[state]
    size = 0.5 * (sigmas * sigmas + before * before)
    agreement = sigmas * before / max(size / AGREEMENT_MAX, 1.0)
    if size < AGREEMENT_SIZE_MIN:
        agreement = AGREEMENT_OF_SMALL
    m.patient_ratio[state] *= math.exp(AGREEMENT_GAIN * (agreement - AGREEMENT_USUAL))
    m.whitened[state] = sigmas
