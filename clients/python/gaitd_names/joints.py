"""Joints of a leg: kind and units; and the schema of a name that a later version may add."""

from collections.abc import Iterable
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta


def open_names(names: Iterable[str]) -> dict[str, Any]:
    """Schema of a name from a list that a later version may extend; so any string is valid."""
    return {"anyOf": [{"type": "string", "enum": [*names]}, {"type": "string"}]}


class Joint(msgspec.Struct, frozen=True, kw_only=True):
    """Kind of a joint, and the units of its fields; names as in ROS's JointState and URDF."""

    kind: Annotated[
        str,
        Meta(
            description="Kind of the joint.",
            extra_json_schema=open_names(["revolute", "prismatic"]),
        ),
    ]
    position: Annotated[str, Meta(description="Unit of its positions.")]
    velocity: Annotated[str, Meta(description="Unit of its velocities.")]
    effort: Annotated[str, Meta(description="Unit of its efforts.")]


JOINTS: Final[dict[str, Joint]] = {
    "hip": Joint(kind="revolute", position="rad", velocity="rad/s", effort="N·m"),
    "slide": Joint(kind="prismatic", position="m", velocity="m/s", effort="N"),
}
"""The joints of a leg, by the name of their field in a message."""
