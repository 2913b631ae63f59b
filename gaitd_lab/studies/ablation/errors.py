"""The same recordings through observers with one design choice turned off.

A trial is replayed with each choice (`choices.py`), and its estimates are compared with
the truth. Errors are given separately where a joint truly moves, where the observer itself calls an
axis OK, and at rest.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from analysis.replay import filter_setup
from gaitd_lab.studies.ablation.choices import CHOICES, DELAY_MS, JITTER_S, RIPPLE, Choice
from gaitd_lab.trial import (
    Flags,
    Pair,
    Trial,
    Values,
    on_the_grid,
    with_glitches,
    with_jitter,
    with_late_efforts,
    with_ripple,
)
from observer.filter.leg_model import STEP_S
from observer.filter.states import FRICTION, PATIENT, VELOCITY
from observer.filter.status import REST_MAX_S, Status, Validity
from observer.offline import batch
from observer.offline.batch import BatchEstimates, Columns

SIGMAS: Final = 3.0
SEED: Final = 5
GLITCH_INTERVAL_S: Final = 1.0
GLITCH_SIZE: Final = (0.01, 0.3)
"""rad; metres at the slide."""
ENCODER_NOISE: Final = (5e-5, 2e-5)
ENCODER_QUANTUM: Final = (1.534e-5, 1.2207e-5)
"""Resolution of the virtual encoders, rad and m: 409 600 counts a turn, 12 288 in 0.15 m."""

JITTER_TRUE: Final = "jitter 1 ms, true times"
JITTER_NOMINAL: Final = "jitter 1 ms, nominal times"
LATE: Final = "efforts one cycle late"
RIPPLED: Final = "ripple on the efforts"
GLITCHES: Final = "glitches of the encoders"


class Errors(NamedTuple):
    """Root mean squares of estimate minus truth, and the observer's own confidence.

    Pairs are hip and slide; NaN where there is nothing to compare.
    """

    patient: Pair
    """While the joint truly moves: N·m, N."""
    patient_ok: Pair
    """While the axis is OK according to the observer."""
    patient_at_rest: Pair
    """While the joint has truly rested for longer than REST_MAX_S."""
    friction: Pair
    """While the joint truly moves."""
    net: Pair
    """Patient minus friction, always."""
    velocity: Pair
    """Always: rad/s, m/s."""
    patient_covered: Pair
    """Share within 3 sigma, while the axis is OK according to the observer."""
    patient_at_rest_covered: Pair
    """Share within 3 sigma, at rest."""
    net_covered: Pair
    """Share within 3 sigma, always."""
    velocity_covered: Pair
    ok_share: Pair
    """Share of samples with an OK axis."""
    nis: float
    """Mean of samples that were used; 2 is ideal."""


Results = dict[tuple[str, str], list[Errors]]
"""By situation and choice: the errors of every draw of all noise."""


def rest_counts(trial: Trial) -> tuple[int, int]:
    """Count the compared samples at rest, hip and slide: errors at rest of few are uncertain."""
    hip, slide = np.count_nonzero(_resting(trial) & trial.judged[:, None], axis=0)
    return int(hip), int(slide)


def errors_of(trial: Trial, made: BatchEstimates) -> Errors:
    """Compare the selected rows of a trial with the truth."""
    moving, resting = trial.moving, _resting(trial)
    wrong = made.state - trial.truth
    net = made.net - (trial.truth[:, PATIENT] - trial.truth[:, FRICTION])
    ok = made.validity == Validity.OK
    used = np.isfinite(made.nis) & ((made.status & Status.GATED) == 0) & trial.judged
    everywhere = np.ones_like(moving)
    patient, patient_std = wrong[:, PATIENT], made.std[:, PATIENT]

    def rms(values: Values, rows: Flags) -> Pair:
        return _per_axis(_rms, values, rows & trial.judged[:, None])

    def covered(values: Values, std: Values, rows: Flags) -> Pair:
        within = (np.abs(values) <= SIGMAS * std).astype(float)
        within[np.isnan(values)] = np.nan
        return _per_axis(_mean, within, rows & trial.judged[:, None])

    return Errors(
        patient=rms(patient, moving),
        patient_ok=rms(patient, ok),
        patient_at_rest=rms(patient, resting),
        friction=rms(wrong[:, FRICTION], moving),
        net=rms(net, everywhere),
        velocity=rms(wrong[:, VELOCITY], everywhere),
        patient_covered=covered(patient, patient_std, ok),
        patient_at_rest_covered=covered(patient, patient_std, resting),
        net_covered=covered(net, made.net_std, everywhere),
        velocity_covered=covered(wrong[:, VELOCITY], made.std[:, VELOCITY], everywhere),
        ok_share=_per_axis(_mean, ok.astype(float), trial.judged[:, None] & everywhere),
        nis=_mean(made.nis, used),
    )


def replayed(trial: Trial, choice: Choice) -> BatchEstimates:
    """Run the observer of a choice over a trial."""
    made = trial.recording
    setup = filter_setup(choice.change(trial.robot))
    return batch.run(setup, Columns(made.time_s, made.position, made.effort))


def ablate(trial: Trial, choices: Sequence[Choice] = CHOICES) -> dict[tuple[str, str], Errors]:
    """Run every choice over one trial."""
    return {
        (trial.name, choice.name): errors_of(trial, replayed(trial, choice)) for choice in choices
    }


def disturbed(trial: Trial, seed: int = SEED) -> tuple[Trial, ...]:
    """Variants of a trial with the disturbances of real machines, each under its own name."""
    jittered = with_jitter(trial, JITTER_S, ENCODER_NOISE, ENCODER_QUANTUM, seed)
    late_cycles = round(1e-3 * DELAY_MS / STEP_S)
    return (
        jittered.named(JITTER_TRUE),
        on_the_grid(jittered, trial).named(JITTER_NOMINAL),
        with_late_efforts(trial, late_cycles).named(LATE),
        with_ripple(trial, RIPPLE, seed).named(RIPPLED),
        with_glitches(trial, GLITCH_INTERVAL_S, GLITCH_SIZE, seed).named(GLITCHES),
    )


def _resting(trial: Trial) -> Flags:
    """Mark rows, by axis, in which the joint has not moved for longer than REST_MAX_S."""
    rows = np.arange(1, len(trial.moving) + 1)[:, None]
    moved = np.maximum.accumulate(np.where(trial.moving, rows, 0))
    return rows - moved > round(REST_MAX_S / STEP_S)


def _per_axis(summary: Callable[[Values, Flags], float], values: Values, rows: Flags) -> Pair:
    return summary(values[:, 0], rows[:, 0]), summary(values[:, 1], rows[:, 1])


def _mean(values: Values, rows: Flags) -> float:
    known = values[rows & np.isfinite(values)]
    return float(np.mean(known)) if len(known) else float("nan")


def _rms(values: Values, rows: Flags) -> float:
    return float(np.sqrt(_mean(values**2, rows)))
