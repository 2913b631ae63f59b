"""The message of a completed stride; figures of an axis with too little coverage are null.

Figures of an axis with an invalid sample are NaN in the record, and null, too.
"""

from typing import Any, Final

from gaitd_client import wire

from daemon.gateway.translate import View, finite, status_names
from daemon.ipc.record import AxisStrideRecord, StrideRecord

COVERAGE_MIN_RATIO: Final = 0.5
"""Below this coverage of a stride an axis has no figures: a part does not stand for the whole."""
UNITS: Final = {"hip": "nm", "slide": "n"}


def stride(made: StrideRecord, view: View, seq: int) -> wire.Stride:
    """The message LEG/stride."""
    both = all(axis.coverage_ratio >= COVERAGE_MIN_RATIO for axis in (made.hip, made.slide))
    return wire.Stride(
        core_boot_id=view.common["core_boot_id"],
        cycle=view.common["cycle"],
        sample_time_ns=view.common["sample_time_ns"],
        seq=seq,
        leg=view.leg.name,
        mode=view.common["mode"],
        status=status_names(made.status),
        status_bits=f"0x{made.status:04X}",
        number=made.number,
        duration_s=made.duration_s,
        cadence_hz=1.0 / made.duration_s,
        sample_count=made.sample_count,
        **_axis("hip", made.hip),
        **_axis("slide", made.slide),
        **_pair("work_positive_j", made.work_positive_j if both else None),
        **_pair("work_negative_j", made.work_negative_j if both else None),
        **_pair("share_ratio", made.share_ratio if both else None),
        baseline_subtracted=made.baseline,
    )


def _axis(name: str, axis: AxisStrideRecord) -> dict[str, Any]:
    unit = UNITS[name]
    figures = {
        f"{name}_work_positive_j": axis.work_positive_j,
        f"{name}_work_negative_j": axis.work_negative_j,
        f"{name}_assist_mean_{unit}": axis.assist_mean_si,
        f"{name}_assist_peak_{unit}": axis.assist_peak_si,
        f"{name}_power_mean_w": axis.power_mean_w,
        f"{name}_power_peak_w": axis.power_peak_w,
        f"{name}_share_ratio": axis.share_ratio,
    }
    known = axis.coverage_ratio >= COVERAGE_MIN_RATIO
    message: dict[str, Any] = {}
    for key, figure in figures.items():
        message.update(_pair(key, figure if known else None))
    message[f"{name}_coverage_ratio"] = axis.coverage_ratio
    return message


def _pair(key: str, figure: tuple[float, float] | None) -> dict[str, Any]:
    """The fields of a figure and its standard deviation; null where there is none."""
    value, std = figure if figure is not None else (None, None)
    return {key: finite(value), f"{key}_std": finite(std)}
