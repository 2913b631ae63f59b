"""Store the resting pose of the axes, to check absolute encoders at the next start."""

from daemon.core.modes.persistent_state import with_pose
from daemon.core.state import Axis, Core
from daemon.core.steps import supervisor

NOTE_CYCLES = 100
"""Cycles between two updates of the stored pose."""


def follow(core: Core, cycle: int, utc_ns: int) -> None:
    """Store the pose periodically while no drive has power: the leg may be moved by hand."""
    if cycle % NOTE_CYCLES == 0 and not supervisor.driving(core):
        note(core, utc_ns)


def note(core: Core, utc_ns: int) -> None:
    """Store the pose of every axis that is referenced and at rest with a sample of this cycle."""
    for axis in core.axes:
        if axis.referenced and axis.joint.fresh and _rests(axis):
            core.notes = with_pose(core.notes, axis.name, axis.joint.position_si, utc_ns)


def all_rest(core: Core) -> bool:
    """True if no axis with a known position moves."""
    return all(_rests(axis) for axis in core.axes if axis.joint.known)


def _rests(axis: Axis) -> bool:
    return abs(axis.joint.velocity_si) < axis.limits.standstill_si_per_s
