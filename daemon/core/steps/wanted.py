"""What each drive should do now, from mode, stops and homing. Nothing here changes state."""

from gaitd_names import Mode

from daemon.core.modes.table import rules_of
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Axis, Core, Leg
from daemon.core.steps import single_axis
from drives.signals import OperationMode


def is_driving(core: Core) -> bool:
    """True if a drive is, or may still be, powered by the core's request."""
    if core.mode.active or core.mode == Mode.STOPPING:
        return True
    held = {Step.HOLD, Step.QUICK_STOP}
    return core.mode == Mode.FAULT and any(a.stop and a.stop.step in held for a in core.axes)


def enable_wanted(core: Core, axis: Axis) -> bool:
    """True if this drive should be enabled and produce torque."""
    if axis.stop is not None:
        return axis.stop.step == Step.HOLD
    run = core.single_axis
    return core.mode.active and (run is None or run.axis == axis.name)


def enable_wanted_of(core: Core, leg: Leg) -> bool:
    """True if one of the leg's drives should be enabled."""
    hip, slide = leg.axes
    return enable_wanted(core, hip) or enable_wanted(core, slide)


def mode_wanted(core: Core, axis: Axis) -> OperationMode:
    """The mode of operation that this drive should be in; a stop does not change the mode."""
    if axis.stop is not None:
        return axis.sent.mode
    if single_axis.is_homing(core, axis):
        return OperationMode.HOMING
    by_torque = rules_of(core.mode).by_torque or core.single_axis is not None
    if by_torque or not core.config.by_position:
        return OperationMode.CYCLIC_SYNC_TORQUE
    return OperationMode.CYCLIC_SYNC_POSITION


def is_mode_changing(core: Core) -> bool:
    """True if a drive has not yet been sent the mode wanted; all legs begin together."""
    return any(axis.sent.mode != mode_wanted(core, axis) for axis in core.axes)


def is_silenced(core: Core) -> bool:
    """True in the last step of escalation: SYNC and heartbeat are no longer sent."""
    return any(axis.stop is not None and axis.stop.step == Step.SILENCE for axis in core.axes)


def nmt_stopped(core: Core) -> tuple[int, ...]:
    """Node ids of the drives to which NMT stop is sent."""
    return tuple(a.node_id for a in core.axes if a.stop and a.stop.step >= Step.NMT_STOP)
