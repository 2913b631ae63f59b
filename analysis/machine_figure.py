"""Drawing of the trainer from the side: links, coordinates, signs and zeros, from a robot file."""

import math
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing import BAD, DPI, ESTIMATE, FAINT, FRICTION, GOOD, MEASURED, TEXT
from observer.mechanism.linkage import pose
from observer.mechanism.parameters import LegParameters

HIP_RAD: Final = math.radians(14.0)
SLIDE_M: Final = 0.59
"""The drawn pose: about the middle of a gait."""
TRUNK_M: Final = 0.5
RAIL_M: Final = 0.95

Point = NDArray[np.float64]


def draw(p: LegParameters, recline_rad: float, path: Path) -> None:
    """Draw the machine at the middle of a gait.

    Args:
        p: of the leg.
        recline_rad: of the trunk from the vertical.
        path: the PNG file.

    Raises:
        OSError: the file cannot be written.
    """
    figure = Figure(figsize=(8.5, 6.0), layout="constrained")
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.axis("off")
    at = pose(p, HIP_RAD, SLIDE_M)
    hip, knee = np.zeros(2), np.array([at.knee_x, at.knee_y])
    ankle = knee + np.array([at.shank_x, at.shank_y])
    along = np.array([p.rail_cos, p.rail_sin])
    zero = np.array([p.rail_x_m, p.rail_y_m])
    slide = zero + SLIDE_M * along
    trunk = TRUNK_M * np.array([-math.sin(recline_rad), math.cos(recline_rad)])

    _line(axes, zero - 0.04 * along, zero + RAIL_M * along, FAINT, 7)
    _line(axes, hip, trunk, MEASURED, 9)
    for begin, end, name in ((hip, knee, "thigh"), (knee, ankle, "shank"), (ankle, slide, "shoe")):
        _line(axes, begin, end, ESTIMATE, 6)
        across = np.array([begin[1] - end[1], end[0] - begin[0]])
        _text(axes, 0.5 * (begin + end) + 0.17 * across + np.array([-0.05, 0.0]), name, ESTIMATE)
    for point, name, shift in (
        (hip, "hip: drive, origin", (-0.22, -0.08)),
        (knee, "knee", (0.02, 0.03)),
        (ankle, "ankle", (-0.09, -0.06)),
        (slide, "slide: drive", (0.05, -0.01)),
    ):
        axes.plot(*point, "o", color="white", markeredgecolor=TEXT, markersize=11, zorder=4)
        _text(axes, point + np.array(shift), name, TEXT)
    _text(axes, trunk + np.array([-0.06, 0.04]), "trunk", MEASURED)

    _hip_angle(axes, p, trunk)
    offset = 0.06 * np.array([along[1], -along[0]])
    _arrow(axes, zero + offset, slide + offset, FRICTION)
    _text(axes, 0.5 * (zero + slide) + 2.0 * offset, "s > 0, force F > 0", FRICTION)
    axes.plot(*zero, "|", color=FRICTION, markersize=16)
    _text(axes, zero + np.array([-0.36, 0.03]), "s = 0: rail_x_m, rail_y_m", FRICTION)
    _arrow(axes, np.array([-0.45, -0.75]), np.array([-0.25, -0.75]), FAINT)
    _arrow(axes, np.array([-0.45, -0.75]), np.array([-0.45, -0.55]), FAINT)
    _text(axes, np.array([-0.23, -0.76]), "x", FAINT)
    _text(axes, np.array([-0.46, -0.53]), "y", FAINT)
    _arrow(axes, np.array([-0.10, -0.50]), np.array([-0.10, -0.75]), BAD)
    _text(axes, np.array([-0.08, -0.64]), "weight", BAD)
    figure.savefig(path, dpi=DPI, format="png")


def _hip_angle(axes: Axes, p: LegParameters, trunk: Point) -> None:
    """Draw where the thigh points at hip angle 0, and the angle from there."""
    zero_rad = p.thigh_angle_rad
    end = 0.40 * np.array([math.cos(zero_rad), math.sin(zero_rad)])
    axes.plot([0.0, end[0]], [0.0, end[1]], "--", color=GOOD, linewidth=1.2)
    _text(axes, end + np.array([-0.24, -0.06]), "φ = 0: in line with the trunk", GOOD)
    arc = np.linspace(zero_rad, zero_rad + HIP_RAD, 30)
    axes.plot(0.30 * np.cos(arc), 0.30 * np.sin(arc), color=GOOD, linewidth=2)
    tip, before = arc[-1], arc[-4]
    _arrow(
        axes,
        0.30 * np.array([math.cos(before), math.sin(before)]),
        0.30 * np.array([math.cos(tip), math.sin(tip)]),
        GOOD,
    )
    _text(axes, np.array([0.06, 0.10]), "φ > 0, torque τ > 0: flexion", GOOD)
    axes.plot([0.0, 0.0], [0.0, TRUNK_M], ":", color=FAINT)
    _text(axes, 0.5 * trunk + np.array([0.05, 0.14]), "recline_deg", MEASURED)


def _line(axes: Axes, begin: Point, end: Point, colour: str, width: float) -> None:
    axes.plot(
        [begin[0], end[0]],
        [begin[1], end[1]],
        color=colour,
        linewidth=width,
        solid_capstyle="round",
    )


def _arrow(axes: Axes, begin: Point, end: Point, colour: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6}
    axes.annotate("", xy=tuple(end), xytext=tuple(begin), arrowprops=style)


def _text(axes: Axes, at: Point, text: str, colour: str) -> None:
    axes.text(at[0], at[1], text, color=colour, fontsize=9)
