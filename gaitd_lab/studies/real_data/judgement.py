"""Errors of an estimate in one situation, its confidence, and how fast it follows a step."""

import math
from typing import Final, NamedTuple

import numpy as np

from gaitd_lab.studies.real_data.situations import Flags, Situation, Values
from observer.filter.status import Status
from observer.offline.batch import BatchEstimates

SIGMAS: Final = 3.0
SETTLED_S: Final = 0.15
"""Time after an edge from which the false force is judged."""
COVERED_S: Final = 0.05
"""Time after an edge from which sigma must cover the error."""
RESPONSE_ROWS: Final = 45
NIS_USUAL_MAX: Final = 3.84
"""95 % quantile of chi-square with one degree of freedom."""


class Estimate(NamedTuple):
    """The estimated external force, and the confidence of an estimator that has one."""

    force_n: Values
    """Shape (n,)."""
    std_n: Values | None = None
    nis: Values | None = None
    """NaN where no sample was used."""
    lead_s: float = 0.0
    """Time after a row that its estimate uses; rows so near before an edge are not judged."""


class Score(NamedTuple):
    """Result; NaN where an estimator or a situation has none."""

    whole_n: float
    """Rms error while moving."""
    false_n: float
    """Rms error while moving, SETTLED_S after an edge."""
    early_n: float
    """The same, COVERED_S after an edge."""
    slow_n: float
    """Rms error where the axis rests or reverses, SETTLED_S after an edge."""
    slow_covered_ratio: float
    """Share within 3 sigma on the rows of `slow_n`."""
    covered_ratio: float
    """Share within 3 sigma while moving, COVERED_S after an edge."""
    sigma_n: float
    """Median sigma on the same rows."""
    nis: float
    """Mean, COVERED_S after an edge; 1 is ideal."""
    nis_band: tuple[float, float]
    """95 % band of the mean of so many independent samples."""
    nis_usual_ratio: float
    """Share up to the 95 % quantile."""
    half_s: float
    """Time after an edge to 50 % of a step, in the mean over all."""
    ninety_s: float


def of_observer(made: BatchEstimates) -> Estimate:
    """The slide's patient. The hip stands still, so that NIS is the slide's alone."""
    used = (made.status & Status.GATED) == 0
    return Estimate(made.state[:, 7], made.std[:, 7], np.where(used, made.nis, np.nan))


def judge(estimate: Estimate, situation: Situation) -> Score:
    """Compare an estimate with the truth of its situation."""
    error = estimate.force_n - situation.truth_n
    moving = situation.moving()
    settled, early = (
        situation.beyond(time_s, estimate.lead_s) for time_s in (SETTLED_S, COVERED_S)
    )
    slow = situation.slow() & settled
    slow_covered_ratio = coverage = sigma_n = math.nan
    if estimate.std_n is not None:
        covered = np.abs(error) <= SIGMAS * estimate.std_n
        slow_covered_ratio = float(np.mean(covered[slow]))
        coverage = float(np.mean(covered[moving & early]))
        sigma_n = float(np.median(estimate.std_n[moving & early]))
    half_s, ninety_s = (reached_s(estimate.force_n, situation, share) for share in (0.5, 0.9))
    return Score(
        rms(error, moving),
        rms(error, moving & settled),
        rms(error, moving & early),
        rms(error, slow),
        slow_covered_ratio,
        coverage,
        sigma_n,
        *_nis(estimate.nis, (moving | situation.slow()) & early),
        half_s,
        ninety_s,
    )


def rms(values: Values, rows: Flags) -> float:
    """Root mean square over some rows; NaN without any."""
    chosen = values[rows]
    return float(np.sqrt(np.mean(chosen**2))) if len(chosen) else math.nan


def reached_s(force_n: Values, situation: Situation, share: float) -> float:
    """Time after an edge at which the mean response reaches a share of the step."""
    times, response = mean_response(force_n, situation)
    if not len(times) or response.max() < share:
        return math.nan
    return float(np.interp(share, np.maximum.accumulate(response), times))


def mean_response(force_n: Values, situation: Situation) -> tuple[Values, Values]:
    """Mean of the estimate over all edges in parts of the step, with its times after the edge."""
    time_s, truth = situation.source.recording.time_s, situation.truth_n
    responses: list[Values] = []
    begins: list[Values] = []
    for edge_s in situation.edges_s:
        before = int(np.searchsorted(time_s, edge_s)) - 1
        if before < 0 or before + RESPONSE_ROWS > len(time_s):
            continue
        step_n = truth[before + RESPONSE_ROWS - 1] - truth[before]
        if step_n == 0.0:
            continue
        rows = slice(before, before + RESPONSE_ROWS)
        responses.append((force_n[rows] - force_n[before]) / step_n)
        begins.append(time_s[rows] - edge_s)
    if not responses:
        return np.empty(0), np.empty(0)
    return np.mean(begins, axis=0), np.mean(responses, axis=0)


def _nis(nis: Values | None, rows: Flags) -> tuple[float, tuple[float, float], float]:
    if nis is None:
        return math.nan, (math.nan, math.nan), math.nan
    used = nis[rows & np.isfinite(nis)]
    half = 1.96 * math.sqrt(2.0 / len(used))
    usual = float(np.mean(used <= NIS_USUAL_MAX))
    return float(np.mean(used)), (1.0 - half, 1.0 + half), usual
