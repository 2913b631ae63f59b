"""Tables of a calibration as text."""

from analysis.calibration.fit import Result
from analysis.calibration.session import Calibration


def values_table(calibration: Calibration) -> str:
    """One line for each quantity: before, after, its interval, or why it was not identified."""
    head = f"{'quantity':<24}{'before':>12}{'calibrated':>14}  95 %"
    return "\n".join((head, *(_line(one) for one in calibration.fit.results if one.exists)))


def _line(one: Result) -> str:
    head = f"{one.quantity.label:<24}{one.before:>12.5g}"
    if one.calibrated:
        return f"{head}{one.value:>14.5g}  ± {one.half_interval:.2g} {one.quantity.unit}"
    kept = "kept" if one.value == one.before else f"{one.value:.5g}"
    return f"{head}{kept:>14}  not identified from this recording: {one.reason}"


def scores_table(calibration: Calibration) -> str:
    """Held-out scores before and after."""
    rows = (
        (
            "minus log likelihood/sample",
            calibration.before.loss_per_sample,
            calibration.after.loss_per_sample,
        ),
        ("mean NIS (2 is ideal)", calibration.before.nis, calibration.after.nis),
        ("false hip torque, N·m rms", calibration.before.hip_rms_nm, calibration.after.hip_rms_nm),
        ("false slide force, N rms", calibration.before.slide_rms_n, calibration.after.slide_rms_n),
    )
    head = f"{f'held out: {calibration.held_out}':<40}{'before':>10}{'after':>10}"
    return "\n".join((head, *(f"{name:<40}{old:>10.4g}{new:>10.4g}" for name, old, new in rows)))
