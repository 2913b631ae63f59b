"""The mechanism as pages draw it, to scale: lengths and angles of the running service's files."""

from collections.abc import Mapping
from math import radians
from typing import Any

import msgspec


class Geometry(msgspec.Struct, frozen=True):
    """The mechanism, from the robot file of the running service."""

    thigh_m: float
    shank_m: float
    shoe_m: float
    recline_rad: float
    """Angle of the trunk from the vertical."""
    thigh_offset_rad: float
    rail_x_m: float
    """Where the slide position is 0, from the hip."""
    rail_y_m: float
    rail_angle_rad: float
    slide_min_m: float
    """Limits of the slide position."""
    slide_max_m: float


def geometry_of(robot: Mapping[str, Any], limits: Mapping[str, Any]) -> Geometry | None:
    """Return the mechanism of a running service; None: its files have no such tables."""
    try:
        lengths, slide = robot["geometry"], limits["slide"]
        return Geometry(
            thigh_m=lengths["thigh_length_m"],
            shank_m=lengths["shank_length_m"],
            shoe_m=lengths["shoe_length_m"],
            recline_rad=radians(lengths["recline_deg"]),
            thigh_offset_rad=radians(lengths["thigh_offset_deg"]),
            rail_x_m=lengths["rail_x_m"],
            rail_y_m=lengths["rail_y_m"],
            rail_angle_rad=radians(lengths["rail_angle_deg"]),
            slide_min_m=slide["position_min_m"],
            slide_max_m=slide["position_max_m"],
        )
    except KeyError:
        return None
