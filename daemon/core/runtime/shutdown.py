"""The end: axes come to rest without power; after a bug, drives are stopped without feedback."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Final

from daemon.core.period import cycles
from daemon.core.runtime.bus_link import Line
from daemon.core.runtime.commands import SEND_MARGIN_NS
from daemon.core.runtime.loop_settings import LoopSettings
from daemon.core.safety.joints import is_at_rest
from daemon.core.state import Axis, Core
from daemon.core.steps import impedance
from daemon.system.clock import Clock
from drives.canopen.nmt import NmtCommand, heartbeat_frame, nmt_frame
from drives.cia402.power_state import CANNOT_EXERT_TORQUE
from drives.errors import BusError

POWER_OFF_CYCLES: Final = cycles(0.5)
"""Longest time at shutdown until the drives show that they are without power."""
SETTLE_CYCLES: Final = cycles(1.5)
"""Longest time at shutdown until the leg is at rest; its pose is checked at the next start."""
STOP_WITHOUT_FEEDBACK_CYCLES: Final = cycles(0.5)


class PowerOff:
    """The wait at shutdown until the axes are without power and at rest."""

    def __init__(self) -> None:
        self._cycle_count = 0

    def is_over(self, axes: Sequence[Axis]) -> bool:
        """True if all axes are without power and at rest, or after a timeout; asked each cycle."""
        self._cycle_count += 1
        if may_exert_torque(axes):
            return self._cycle_count > POWER_OFF_CYCLES
        at_rest = all(
            is_at_rest(one.sensed.joint, one.limits) for one in axes if one.sensed.joint.known
        )
        return at_rest or self._cycle_count > SETTLE_CYCLES


def may_exert_torque(axes: Iterable[Axis]) -> bool:
    """True if a statusword shows an axis that can exert torque."""
    states = {axis.sensed.feedback.power_state for axis in axes if axis.sensed.feedback is not None}
    return bool(states - CANNOT_EXERT_TORQUE)


def shows_no_power(axis: Axis) -> bool:
    """True if a statusword shows that the axis cannot exert torque."""
    return (
        axis.sensed.feedback is not None and axis.sensed.feedback.power_state in CANNOT_EXERT_TORQUE
    )


def end_watch(line: Line, axes: Iterable[Axis], deadline_ns: int) -> None:
    """Send NMT reset communication, so that the missing heartbeat causes no drive fault.

    Raises:
        BusError: the bus is down.
    """
    resets = [nmt_frame(NmtCommand.RESET_COMMUNICATION, axis.node_id) for axis in axes]
    line.send_urgent(resets, deadline_ns)


def stop_without_feedback(core: Core, line: Line, clock: Clock, settings: LoopSettings) -> None:
    """Send quick stop repeatedly without reading feedback, for the duration of a stop."""
    if not line.is_open or core.drives is None:
        return
    stops = impedance.stop_without_feedback(core)
    own = heartbeat_frame(settings.master_node_id)
    # If the bus is lost as well, the drives stop by their own detection.
    with suppress(BusError):
        for _ in range(STOP_WITHOUT_FEEDBACK_CYCLES):
            next_ns = clock.now_ns() + settings.period_ns
            frames = [line.sync.frame(), own, *core.drives.frames(stops)]
            line.send_urgent(frames, next_ns - SEND_MARGIN_NS)
            clock.sleep_until(next_ns)
