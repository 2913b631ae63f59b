"""Quality of an estimate: status bits for each cycle, and a validity for each axis."""

from enum import IntEnum, IntFlag
from typing import Final


class Status(IntFlag):
    """Status bits of an estimate. Their values are part of the recorded format.

    The texts say when a bit is set; those of `gaitd_names.StatusBit` what a display does about it.
    `make tables` writes both into docs/bits.md.
    """

    VALID = 1 << 0
    """Neither axis is bad."""
    WARM_UP = 1 << 1
    """The filter started, or restarted, within the last 0.2 s; or it has no estimate yet."""
    PREDICT_ONLY = 1 << 2
    """At least one axis was not measured in this cycle, or its sample was not used."""
    GATED = 1 << 3
    """A sample was rejected: its NIS is beyond `gate_nis` of the robot file."""
    STANDSTILL_HIP = 1 << 4
    """The hip rests, gate a(v) < 0.5: friction and patient are hardly distinguishable."""
    STANDSTILL_SLIDE = 1 << 5
    """The slide rests: the same."""
    NEAR_SINGULAR = 1 << 6
    """Shank and shoe are nearly in line: |sin| of the angle between them is below 0.3."""
    OUT_OF_WORKSPACE = 1 << 7
    """A sigma point, or the measured pose, is where the mechanism does not close."""
    LATE = 1 << 8
    """The time step is zero, negative or longer than 1.5 cycles, or the sample came late."""
    INCONSISTENT = 1 << 9
    """The mean NIS is beyond its limit; or the filter restarted, or was out of the workspace, a
    short time ago."""
    UNREFERENCED = 1 << 10
    """An axis has no known position: it is not homed, or its encoder lost its reference."""
    ARTIFICIAL = 1 << 11
    """The torque given to the observer contains an artificial disturbance."""
    INPUT_SATURATED = 1 << 12
    """The effort sent to a drive is at its configured limit."""
    NEAR_LIMIT = 1 << 13
    """At an end stop: contact forces look like a patient."""
    UNCALIBRATED = 1 << 14
    """The caller says that friction was not measured on this machine."""
    BASELINE = 1 << 15
    """A passive baseline is taken off the estimate of the patient."""


class Validity(IntEnum):
    """Which numbers of one axis may be shown."""

    OK = 0
    """Patient and friction may be shown, each with its standard deviation."""
    SPLIT_UNOBSERVABLE = 1
    """At rest for longer than 100 ms: only patient minus friction (net) is observable."""
    BAD = 2
    """No numbers: out of workspace, predicted for too long, inconsistent, uncalibrated."""


WARM_UP_CYCLES: Final = 20
PREDICTED_MAX_CYCLES: Final = 10
"""Cycles of prediction without a sample after which an axis is BAD."""
HOLD_AFTER_CYCLES: Final = 50
"""Cycles of prediction without a sample after which the state is held until a restart."""
GATED_MAX_IN_A_ROW: Final = 5
"""Number of consecutive rejections after which the filter restarts at the next sample."""
REST_MAX_S: Final = 0.1
"""Standstill up to this long keeps the split valid: a gait's reversal."""
REST_TIME_CONSTANTS: Final = 2.5
PUSH_TIME_CONSTANTS: Final = 4.0
"""T1 of motion, after a longer standstill or a push, until the split is valid again at the
earliest."""
SPLIT_KNOWN_RATIO: Final = 0.04
"""Sigma of the split over breakaway friction up to which it is valid again: a tenth of the largest
one, to which a standstill brings it."""
LATE_RATIO: Final = 1.5
"""A time step longer than this many nominal ones is late."""
GAP_MAX_S: Final = 0.1
"""A longer time step is not predicted; the filter restarts."""
NEAR_SINGULAR_RATIO: Final = 0.3
START_RATIO_MIN: Final = 0.15
"""Closer to the singularity the filter does not start."""
START_KNEE_MIN_RAD: Final = -0.17
"""A knee bent backwards more than this (10 degrees) is the wrong branch or a wrong offset."""
NIS_WINDOW_SAMPLES: Final = 100
NIS_USUAL_MAX: Final = 4.0
"""Limit of the mean NIS per two measurements, ideally 2; above, the gate opens in proportion: a
persistent error is no glitch, and rejecting it would only hide an error of the model."""
NIS_WINDOW_MAX: Final = 15.0
"""Limit of the same mean: above, the estimate is inconsistent. Stick-slip brings it to some
units."""

BAD_BITS: Final = (
    Status.OUT_OF_WORKSPACE | Status.INCONSISTENT | Status.UNREFERENCED | Status.UNCALIBRATED
)
"""Bits that make both axes BAD."""
