"""Strides of a trial beside the truth: the patient's work and share at the hip."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from analysis.replay import Source, columns_of, estimate_smoothed
from gaitd_lab.studies.report import Cell, measured
from gaitd_lab.trial import Trial
from observer.filter.states import PATIENT, VELOCITY
from observer.strides import strides_of

SIGMAS: Final = 3.0
BEGIN_STRIDES: Final = 2
"""First strides, in which the patient's script begins to follow the gait."""
HEAD: Final = (
    *("cadence", "seeds", "strides", "true work with the motion", "error of the work"),
    *("within 3σ", "true work against it", "its error", "true share", "error of the share"),
    "correlation of found and true work",
)


class JudgedStride(NamedTuple):
    """Hip of one stride, found and true; sigma is the observer's own."""

    work_j: float
    work_std_j: float
    true_work_j: float
    against_j: float
    true_against_j: float
    share_ratio: float
    true_share_ratio: float


def judged(trial: Trial) -> list[JudgedStride]:
    """Compare the strides of a trial, from the third one on, with the truth of all their samples.

    A share is None on the wire where there is hardly any work; it is NaN here.
    """
    source = Source(trial.recording, None, "", None)
    found = strides_of(estimate_smoothed(source, trial.robot), columns_of(source))
    steps_s = np.diff(trial.recording.time_s, prepend=trial.recording.time_s[0])
    made: list[JudgedStride] = []
    for begin, stride in found[BEGIN_STRIDES:]:
        rows = slice(begin, begin + stride.sample_count)
        way = trial.truth[rows, VELOCITY][:, 0] * steps_s[rows]
        patient_j = trial.truth[rows, PATIENT][:, 0] * way
        drive_j = float(np.sum(np.maximum(trial.recording.effort[rows, 0] * way, 0.0)))
        true_j = float(np.sum(np.maximum(patient_j, 0.0)))
        share = stride.hip.share_ratio
        made.append(
            JudgedStride(
                stride.hip.work_positive_j,
                stride.hip.work_positive_j_std,
                true_j,
                stride.hip.work_negative_j,
                float(np.sum(np.minimum(patient_j, 0.0))),
                math.nan if share is None else share,
                true_j / (true_j + drive_j),
            )
        )
    return made


def row(cadence_hz: float, seeds: Sequence[Sequence[JudgedStride]]) -> tuple[Cell, ...]:
    """One row of the table, over the strides of all seeds: the range is over all of them."""
    table = np.array([stride for one in seeds for stride in one])
    work, std, true, against, true_against, share, true_share = table.T
    return (
        f"{cadence_hz:g} Hz",
        str(len(seeds)),
        str(len(table)),
        measured(true, "J"),
        measured(100.0 * (work / true - 1.0), "%"),
        float(np.mean(np.abs(work - true) <= SIGMAS * std)),
        measured(true_against, "J"),
        measured(against - true_against, "J"),
        measured(100.0 * true_share, "%"),
        measured(100.0 * (share - true_share), "points"),
        float(np.corrcoef(work, true)[0, 1]),
    )
