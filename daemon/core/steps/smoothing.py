"""Smoothed state of the leg 150 ms ago, and the strides computed from it.

The results are for display; a controller gets the estimate of the present cycle.
"""

from daemon.core.state import Leg
from daemon.ipc.record import AxisStrideRecord, StrideRecord
from observer.filter.leg_observer import LegEstimate
from observer.smoother import LAG
from observer.strides import AxisStride, Stride


def look_back(leg: Leg, estimate: LegEstimate, dt_s: float) -> None:
    """Pass this cycle to the smoother; `leg.stride` is the stride completed by it, or None."""
    sample = leg.smoother.take(estimate, leg.effort_used, dt_s)
    leg.stride = None if sample is None else leg.strides.take(sample)
    leg.stride_count += leg.stride is not None


def stride_record(leg: Leg, sync_ns: int, period_ns: int) -> StrideRecord | None:
    """The record of the stride completed in this cycle; None if there is none."""
    stride = leg.stride
    if stride is None:
        return None
    return StrideRecord(
        number=leg.stride_count,
        end_mono_ns=sync_ns - (LAG + 1) * period_ns,
        duration_s=stride.duration_s,
        sample_count=stride.sample_count,
        hip=_axis(stride.hip),
        slide=_axis(stride.slide),
        work_positive_j=(stride.work_positive_j, stride.work_positive_j_std),
        work_negative_j=(stride.work_negative_j, stride.work_negative_j_std),
        share_ratio=_share(stride),
        status=stride.status,
        baseline=stride.baseline,
    )


def _axis(axis: AxisStride) -> AxisStrideRecord:
    return AxisStrideRecord(
        work_positive_j=(axis.work_positive_j, axis.work_positive_j_std),
        work_negative_j=(axis.work_negative_j, axis.work_negative_j_std),
        assist_mean_si=(axis.assist_mean_si, axis.assist_mean_si_std),
        assist_peak_si=(axis.assist_peak_si, axis.assist_peak_si_std),
        power_mean_w=(axis.power_mean_w, axis.power_mean_w_std),
        power_peak_w=(axis.power_peak_w, axis.power_peak_w_std),
        share_ratio=_share(axis),
        coverage_ratio=axis.coverage_ratio,
    )


def _share(of: AxisStride | Stride) -> tuple[float, float] | None:
    if of.share_ratio is None or of.share_ratio_std is None:
        return None
    return of.share_ratio, of.share_ratio_std
