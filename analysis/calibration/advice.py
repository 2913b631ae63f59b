"""Advice on what to record for quantities that a recording does not identify."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.fit import DECIDED, Result
from analysis.calibration.motion import Motion
from analysis.calibration.quantities import AXES
from analysis.calibration.start import FAST, extent

UNITS: Final = (("rad", "rad/s"), ("m", "m/s"))
REVERSALS_MIN: Final = 4
GAIT_ACCELERATION: Final = (3.0, 2.0)
"""Accelerations of a gait of 0.5 Hz, rad/s^2 and m/s^2, that a held-out part must reach."""


def advice(motion: Motion, results: tuple[Result, ...]) -> list[str]:
    """One line for each axis and kind of quantity that the recording does not identify."""
    lines: list[str] = []
    for axis, name in enumerate(AXES):
        shown = [one for one in results if one.quantity.axis == axis and one.exists]
        unidentified = [one for one in shown if one.reason not in ("", *DECIDED)]
        if unidentified:
            lines += _of_axis(motion, axis, name, unidentified)
    return lines


def slower_than_gait(judged: Motion, rows: NDArray[np.bool_]) -> list[str]:
    """One line for each axis whose inertia the held-out rows do not judge.

    Args:
        judged: the recording that the result is judged on.
        rows: the rows of it that count, shape (n,).
    """
    return [
        f"the held-out part accelerates the {AXES[axis]} by {fastest:.2g} {unit}/s, a gait by "
        f"{needed:g}: its inertia is not judged; hold out a run with faster reversals, too, as in "
        f"excite friction_{AXES[axis]}"
        for axis, ((_, unit), needed) in enumerate(zip(UNITS, GAIT_ACCELERATION, strict=True))
        if extent(judged, axis).enough(axis)
        and (fastest := _fastest(judged.smooth[rows & judged.settled, 4 + axis])) < needed
    ]


def _fastest(acceleration: NDArray[np.float64]) -> float:
    return float(np.quantile(np.abs(acceleration), 0.99)) if len(acceleration) else 0.0


def _of_axis(motion: Motion, axis: int, name: str, unidentified: list[Result]) -> list[str]:
    how = extent(motion, axis)
    length, speed = UNITS[axis]
    if not how.enough(axis):
        return [
            f"the {name} moved over {how.range_si:.2g} {length} for {how.moving_s:.2g} s, "
            f"no faster than {how.top_speed_si:.2g} {speed}: its friction cannot be identified "
            f"from this recording; record excite friction_{name}"
        ]
    lines: list[str] = []
    kinds = " ".join(one.quantity.key for one in unidentified)
    if "viscous" in kinds or "coulomb" in kinds:
        lines.append(
            f"the {name} was no faster than {how.top_speed_si:.2g} {speed}: for its viscous "
            "friction let it move longer "
            f"above {2 * FAST[axis]:.2g} {speed}, as in excite friction_{name}"
        )
    if any(word in kinds for word in ("stribeck", "transition", "peak", "edge", "time_constant")):
        few = " only" if how.reversal_count < REVERSALS_MIN else ""
        lines.append(
            f"the {name} reversed{few} {how.reversal_count} times: for the rise and the hump "
            "of its law record more slow reversals through standstill, as in excite open_loop"
        )
    if "bristle" in kinds:
        lines.append(
            f"the {name} reversed {how.reversal_count} times: for its bristles record more "
            f"reversals from standstill, as in excite friction_{name}"
        )
    if "spring" in kinds:
        lines.append(
            f"the {name} moved over {how.range_si:.2g} {length}: for its spring record a "
            "wider range"
        )
    if "slope" in kinds or "effort_offset" in kinds:
        lines.append(
            f"the {name} moved over {how.range_si:.2g} {length}: for its friction over position "
            "and its drive's offset record a wider range, in both directions"
        )
    if "drive_inertia" in kinds or "drive_mass" in kinds:
        lines.append(f"for the {name} drive's inertia record faster reversals (0.7 Hz and more)")
    return lines
