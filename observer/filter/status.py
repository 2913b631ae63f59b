"""What an estimate says about itself: bits for each cycle, and a level for each axis."""

from enum import IntEnum, IntFlag
from typing import Final


class Status(IntFlag):
    """One bit for each thing that a reader of an estimate should know. Values are on record."""

    VALID = 1 << 0
    """Neither axis is BAD."""
    WARM_UP = 1 << 1
    """The filter started, or started anew, within the last WARM_UP_CYCLES."""
    PREDICT_ONLY = 1 << 2
    """At least one axis was not measured in this cycle, or its sample was not used."""
    GATED = 1 << 3
    """A sample came and was rejected: its NIS is beyond the gate."""
    STANDSTILL_HIP = 1 << 4
    """Gate a(v) < 0.5: friction and patient torque can hardly be told apart now."""
    STANDSTILL_SLIDE = 1 << 5
    NEAR_SINGULAR = 1 << 6
    """|sin| of the angle between shank and shoe is below NEAR_SINGULAR_RATIO."""
    OUT_OF_WORKSPACE = 1 << 7
    """A sigma point, or the measured pose, is where the mechanism does not close."""
    LATE = 1 << 8
    """The time step is zero, negative or long, or the caller says that the sample was late."""
    INCONSISTENT = 1 << 9
    """Windowed NIS beyond its limit, or the filter had to start anew."""
    UNREFERENCED = 1 << 10
    ARTIFICIAL = 1 << 11
    """An artificial disturbance is in the torque that the observer was given."""
    INPUT_SATURATED = 1 << 12
    NEAR_LIMIT = 1 << 13
    """At an end stop: contact forces look like a patient."""
    UNCALIBRATED = 1 << 14


class Validity(IntEnum):
    """What may be shown of one axis."""

    OK = 0
    """Patient and friction, each with its standard deviation."""
    SPLIT_UNOBSERVABLE = 1
    """At rest for longer than 100 ms: only patient minus friction (net) is observable."""
    BAD = 2
    """Nothing: out of workspace, predicted over too long, inconsistent, uncalibrated."""


WARM_UP_CYCLES: Final = 20
PREDICTED_MAX_CYCLES: Final = 10
"""An axis predicted over for more cycles is BAD."""
HOLD_AFTER_CYCLES: Final = 50
"""Predicted over for more cycles, the filter holds its state until it can start anew."""
GATED_MAX_IN_A_ROW: Final = 5
"""After as many rejected samples the next one is believed, and the filter starts anew there."""
REST_MAX_S: Final = 0.1
"""Standstill up to this long keeps the split: a gait's reversal."""
SETTLE_TIME_CONSTANTS: Final = 4.0
"""So many T1 of motion after a longer standstill bring the split back: friction meets its law."""
LATE_RATIO: Final = 1.5
"""A time step longer than this many nominal ones is late."""
GAP_MAX_S: Final = 0.1
"""A time step longer than this is not predicted over; the filter starts anew."""
NEAR_SINGULAR_RATIO: Final = 0.3
START_RATIO_MIN: Final = 0.15
"""A pose closer to the singularity is no pose to start at."""
START_KNEE_MIN_RAD: Final = -0.17
"""A knee bent backwards more than this (10 degrees) is the wrong branch or a wrong offset."""
NIS_WINDOW_SAMPLES: Final = 100
NIS_USUAL_MAX: Final = 4.0
"""Of the mean NIS per two measurements, ideally 2; above, the gate opens in proportion: what comes
all the time is no glitch, and to reject it would only hide how wrong the model is."""
NIS_WINDOW_MAX: Final = 15.0
"""Of the same mean: above, the estimate is inconsistent. Stick-slip brings it to some units."""

BAD_BITS: Final = (
    Status.OUT_OF_WORKSPACE | Status.INCONSISTENT | Status.UNREFERENCED | Status.UNCALIBRATED
)
"""Bits that make both axes BAD."""
