"""The motion of an axis whose drive is not simulated: that of the positions heard on the bus.

A drive on the bench has no leg. Its axis of the plant is *led*: it moves as the drive says, with
whatever load, and the other axis feels that motion through the mechanism. The samples of the SYNCs
are the control points of a uniform cubic B-spline, whose acceleration is continuous, and exact for
a constant one. Its piece between the samples k - 2 and k - 1 is played from SYNC k on, so the plant
has the motion of two cycles ago:

    LAG    20 ms with a cycle of 10 ms

After a lost sample the axis keeps its speed, for COASTED_CYCLES at most; then it rests where it is.
A position that the axis cannot have reached since the last one (the first one of all, one after a
silence, a home that moves the origin) is approached slowly, and one outside the end stops ends
there: the virtual axis is not thrown about by a motion that no motor has made.
"""

from typing import Final

import numpy as np

from observer.jit import kernel

LEAD: Final = np.dtype(
    [
        ("points", "f8", 4),  # control points, the newest last
        ("begin_s", "f8"),  # SYNC of the newest, since the plant's start
        ("period_s", "f8"),
        ("met", "i8"),  # the axis is where its drive says
    ]
)
"""How one axis is led."""

COASTED_CYCLES: Final = 3
"""As many samples may be missing in a row: the service stops both axes after the next one."""
FASTEST_SI: Final = 8.0
"""A position farther away than this speed allows, rad/s or m/s, is no motion of the axis."""
APPROACH_SI: Final = 0.5
"""Speed towards it."""


def unled(period_s: float) -> tuple[tuple[float, ...], float, float, int]:
    """The LEAD record of an axis whose drive has sent nothing yet; `period_s` is the cycle."""
    return (0.0,) * 4, -2.0 * (1 + COASTED_CYCLES) * period_s, period_s, 0


@kernel
def led_motion(lead: np.void, at_s: float, here: float) -> tuple[float, float]:
    """Return position and velocity of a led axis at a time.

    Args:
        lead: its LEAD record.
        at_s: time since the plant's start.
        here: its position now, which it keeps without new samples.
    """
    period_s = lead["period_s"]
    share = (at_s - lead["begin_s"]) / period_s
    if share > 1.5 + COASTED_CYCLES:  # a sample arrives some time after its SYNC
        return here, 0.0
    s = min(share, 1.0)
    rest = 1.0 - s
    points = lead["points"]
    a, b, c, d = points[0], points[1], points[2], points[3]
    position = rest * rest * rest * a + (3.0 * s * s * s - 6.0 * s * s + 4.0) * b
    position += (1.0 + 3.0 * s * (1.0 + s - s * s)) * c + s * s * s * d
    velocity = s * s * d - rest * rest * a + s * (3.0 * s - 4.0) * b
    velocity += (1.0 + s * (2.0 - 3.0 * s)) * c
    velocity /= 2.0 * period_s
    return position / 6.0 + velocity * (share - s) * period_s, velocity


def follow(
    lead: np.void, sampled_s: float, position: float, here: float, ends: tuple[float, float]
) -> None:
    """Take a position that a drive has sent.

    Args:
        lead: LEAD record of its axis, written.
        sampled_s: time of the SYNC of the sample, since the plant's start.
        position: position of the joint at that time.
        here: position of the led axis now.
        ends: end stops of the axis.
    """
    points, period_s = lead["points"], lead["period_s"]
    cycles = round((sampled_s - lead["begin_s"]) / period_s)
    if cycles < 1:
        return
    if cycles > 1 + COASTED_CYCLES:
        points[:], lead["met"], cycles = here, 0, 1
    begin = points[-1]
    way = min(max(position, ends[0]), ends[1]) - begin
    if abs(way) > FASTEST_SI * cycles * period_s:
        lead["met"] = 0
    if not lead["met"]:
        most = APPROACH_SI * cycles * period_s
        lead["met"] = abs(way) <= most
        way = min(max(way, -most), most)
    for number in range(1, cycles + 1):
        points[:-1] = points[1:]
        points[-1] = begin + way * number / cycles
    lead["begin_s"] = sampled_s
