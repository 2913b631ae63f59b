"""Float types that name a unit where it depends on the axis or would clutter a formula."""

from typing import TypeAlias

Effort: TypeAlias = float
"""N m of the hip, N of the slide."""
Speed: TypeAlias = float
"""rad/s of the hip, m/s of the slide."""
Viscosity: TypeAlias = float
"""Effort per speed."""
Position: TypeAlias = float
"""rad of the hip, m of the slide."""
Stiffness: TypeAlias = float
"""Effort per position."""
Length: TypeAlias = float
"""m."""
Area: TypeAlias = float
"""m^2."""
Mass: TypeAlias = float
"""kg; times link lengths also kg m."""
Inertia: TypeAlias = float
"""kg m^2 of angles, kg of the slide, kg m between them."""
Number: TypeAlias = float
"""Dimensionless."""
TurnRate: TypeAlias = float
"""Angular rate of a link per driven rate: rad/rad, rad/m."""
