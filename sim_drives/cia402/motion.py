"""Modes of operation, targets and limits of a drive, and the resulting order to the plant.

Rules:
1. 6060h takes effect MODE_SWITCH_NS later, in 6061h and in the loops together; at power-on at once,
   as delivered. A mode that 6502h does not name is refused: 06090030 by SDO, ignored by PDO. 0 is
   "no mode": the axis holds, as it does in profile position.
2. A cyclic mode follows its target (statusword bit 12) once the target has been written since
   the node became operational. Until then cyclic position and velocity hold, and cyclic torque
   gives 0. 60B0h adds to the target of cyclic position, 60B1h to the speed of cyclic position and
   velocity, 60B2h to the torque of all; none of them is a target by itself.
3. Halt (controlword bit 8, option 605Dh, where absent the slow ramp): slows down and holds, stays
   in "operation enabled", and motion resumes when the bit falls.
4. Homing begins at the rising edge of controlword bit 4; its rules are in `homing.py`.
5. Every order carries the limits in force: torque, 6080h, 6065h/6066h, and 607Dh where it clips.
   A minimum of 607Dh above its maximum is refused, in whatever order they are written: 06090036.
   Both 0 is no limit: makers deliver it so.
6. Cyclic position reaches each target on a line that takes 60C2h; some drives use that time to
   monitor the targets (`target_monitor.py`).
"""

import math
from enum import IntEnum
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.objects import Object
from sim_drives.canopen.timers import MILLISECOND
from sim_drives.cia402.homing import Homing, Progress
from sim_drives.cia402.measurement import Measurement
from sim_drives.cia402.power_state import HALT_BIT, HALT_OPTION, OPERATION_BIT_4, Ramp
from sim_drives.cia402.scaling import Scaling
from sim_drives.plant.actuation import Actuation, AxisActuation
from sim_drives.settings import DriveSettings, PositionLimit

MODE_SWITCH_NS: Final = 5 * MILLISECOND
"""Shorter than a SYNC period, longer than any answer to it: 6061h shows it one SYNC later."""
NO_POSITION_LIMITS: Final = (0, 0)
"""607Dh as EPOS4 and Nanotec deliver it."""
HARDEST_DECELERATION_SI: Final = 1e6
"""Deceleration of Ramp.LIMIT: above any joint's ability, so that the torque limit decides."""


class Mode(IntEnum):
    """Values of 6060h and 6061h that the virtual drives support."""

    NONE = 0
    PROFILE_POSITION = 1
    """Only as delivered: 6502h does not name it."""
    HOMING = 6
    CYCLIC_SYNC_POSITION = 8
    CYCLIC_SYNC_VELOCITY = 9
    CYCLIC_SYNC_TORQUE = 10


TARGETS: Final = {
    Mode.CYCLIC_SYNC_POSITION: Object.TARGET_POSITION,
    Mode.CYCLIC_SYNC_VELOCITY: Object.TARGET_VELOCITY,
    Mode.CYCLIC_SYNC_TORQUE: Object.TARGET_TORQUE,
}


class Motion:
    """Modes, targets and limits of one drive."""

    def __init__(
        self,
        settings: DriveSettings,
        context: NodeContext,
        scaling: Scaling,
        measurement: Measurement,
    ) -> None:
        self._dictionary, self._line, self._timers = context
        self._scaling = scaling
        self._measurement = measurement
        self._clips = settings.position_limit is PositionLimit.CLIP
        self._written: set[int] = set()
        self._bit_4_prev = False
        self.halted = False
        """Controlword bit 8 requests a halt."""
        self.homing = Homing(settings, context, scaling, measurement)
        self.mode = Mode.NONE
        self._requested: int = Mode.NONE
        dictionary = self._dictionary
        dictionary.guard(Object.MODE, self._check_mode)
        dictionary.watch(Object.MODE, lambda _: self._request_mode())
        dictionary.guard(Object.HOMING_METHOD, self._check_homing_method)
        dictionary.guard(Object.POSITION_LIMITS, self._check_position_limit)
        for target in TARGETS.values():
            dictionary.watch(target, lambda _, target=target: self._written.add(target))

    def power_on(self) -> None:
        """Reset to the delivered mode and no target."""
        self._written.clear()
        self._bit_4_prev = False
        self.halted = bool(self._dictionary.value(Object.CONTROLWORD) & HALT_BIT)
        self._switch(Mode(self._dictionary.value(Object.MODE)))

    def clear_targets(self) -> None:
        """Clear the commanded values: the node has left operational (rule 2)."""
        self._written.clear()

    @property
    def interpolation_s(self) -> float:
        """Interpolation time 60C2h; 0 where it has not been set."""
        is_set = self._dictionary.value(Object.INTERPOLATION_TIME, 1) != 0
        return self._scaling.factors.interpolation_s if is_set else 0.0

    @property
    def is_following_positions(self) -> bool:
        """True if cyclic position has a target, and no halt."""
        return self.mode is Mode.CYCLIC_SYNC_POSITION and self.follows

    # --- modes --------------------------------------------------------------------------------

    def _check_mode(self, _: int, value: int) -> None:
        supported = self._dictionary.value(Object.SUPPORTED_MODES)
        if value != Mode.NONE and (value < 0 or not supported >> (value - 1) & 1):
            raise SdoAbortError(AbortCode.RANGE)

    def _check_homing_method(self, _: int, value: int) -> None:
        if value not in self.homing.methods:
            raise SdoAbortError(AbortCode.RANGE)

    def _request_mode(self) -> None:
        requested = self._dictionary.value(Object.MODE)
        if requested == self.mode:
            self._timers.cancel(Object.MODE)
        elif not self._timers.running(Object.MODE) or requested != self._requested:
            self._requested = requested
            at_ns = self._line.now_ns + MODE_SWITCH_NS
            self._timers.start(Object.MODE, at_ns, lambda: self._switch(Mode(requested)))

    def _switch(self, mode: Mode) -> None:
        self.mode = mode
        self.homing.reset()
        self._dictionary.put(Object.MODE_DISPLAY, 0, mode)

    # --- homing and halt ----------------------------------------------------------------------

    def controlword_written(self, controlword: int, *, enabled: bool) -> None:
        """Halt or move on by rule 3, start homing by rule 4."""
        self.halted = bool(controlword & HALT_BIT)
        bit_4 = bool(controlword & OPERATION_BIT_4)
        rising = bit_4 and not self._bit_4_prev
        self._bit_4_prev = bit_4
        if self.halted:
            self.homing.interrupt()
        elif rising and enabled and self.mode is Mode.HOMING:
            self.homing.start()

    @property
    def follows(self) -> bool:
        """True if the active mode follows its target (rule 2)."""
        return TARGETS.get(self.mode) in self._written and not self.halted

    # --- the command --------------------------------------------------------------------------

    def order(self) -> AxisActuation:
        """Return the order of the active mode, in "operation enabled"."""
        if self.halted:
            return self.ramp(HALT_OPTION[self._dictionary.value_or(Object.HALT, 0, 1)].ramp)
        if self.mode is Mode.CYCLIC_SYNC_TORQUE:
            effort_si = self._scaling.effort_si(self.target_permille) if self.follows else 0.0
            return self._actuation(Actuation.TORQUE, effort_si=effort_si)
        if self.is_following_positions:
            return self._position_order()
        if self.mode is Mode.CYCLIC_SYNC_VELOCITY and self.follows:
            return self._velocity_order()
        if self.mode is Mode.HOMING and self.homing.progress is not Progress.NOT_STARTED:
            return self._homing_order()
        return self._actuation(Actuation.HOLD)

    def _position_order(self) -> AxisActuation:
        """Order of cyclic position, with the velocity and torque offsets of the master."""
        return self._actuation(
            Actuation.POSITION,
            position_si=self._joint(self.target_position),
            velocity_si=self._speed_si(Object.VELOCITY_OFFSET),
            effort_si=self._scaling.effort_si(self._dictionary.value(Object.TORQUE_OFFSET)),
        )

    def _velocity_order(self) -> AxisActuation:
        """Order of cyclic velocity; the master's targets are the ramp."""
        return self._actuation(
            Actuation.VELOCITY,
            velocity_si=self._speed_si(Object.TARGET_VELOCITY)
            + self._speed_si(Object.VELOCITY_OFFSET),
            effort_si=self._scaling.effort_si(self._dictionary.value(Object.TORQUE_OFFSET)),
        )

    def _speed_si(self, index: int) -> float:
        return self._scaling.velocity_si(self._dictionary.value(index))

    def _homing_order(self) -> AxisActuation:
        """Order of the running search, or at rest after the last one."""
        acceleration_si = self._scaling.speed_si(self._dictionary.value(Object.HOMING_ACCELERATION))
        travel = self.homing.travel
        if travel is None:
            return self._actuation(Actuation.RAMP, deceleration_si=acceleration_si)
        order = self._actuation(
            Actuation.VELOCITY,
            velocity_si=self._scaling.velocity_si(travel.direction * travel.speed_raw),
            deceleration_si=acceleration_si,
        )
        if travel.current_limit_ma is None:
            return order
        limit_si = self._scaling.current_si(travel.current_limit_ma)
        return order._replace(effort_limit_si=min(order.effort_limit_si, limit_si))

    def coast(self) -> AxisActuation:
        """Return the order for a power stage that is off."""
        return self._actuation(Actuation.COAST)

    def ramp(self, ramp: Ramp) -> AxisActuation:
        """Return the order to slow down and hold; `ramp` is not COAST."""
        return self._actuation(Actuation.RAMP, deceleration_si=self._deceleration_si(ramp))

    def _deceleration_si(self, ramp: Ramp) -> float:
        if ramp is Ramp.SLOW:
            return self._scaling.speed_si(self._dictionary.value(Object.DECELERATION))
        if ramp is Ramp.QUICK:
            return self._scaling.speed_si(self._dictionary.value(Object.QUICK_STOP_DECELERATION))
        return HARDEST_DECELERATION_SI

    def _actuation(
        self,
        actuation: Actuation,
        *,
        effort_si: float = 0.0,
        position_si: float = 0.0,
        velocity_si: float = 0.0,
        deceleration_si: float = HARDEST_DECELERATION_SI,
    ) -> AxisActuation:
        lower_si, upper_si = self._position_limits_si()
        factors = self._scaling.factors
        return AxisActuation(
            actuation=actuation,
            target_effort_si=effort_si,
            target_position_si=position_si,
            target_velocity_si=velocity_si,
            deceleration_si=deceleration_si,
            interpolation_s=factors.interpolation_s,
            effort_limit_si=factors.effort_limit_si,
            velocity_limit_si=factors.velocity_limit_si,
            following_error_si=factors.following_window_si,
            following_error_time_s=factors.following_time_s,
            position_min_si=lower_si,
            position_max_si=upper_si,
        )

    @property
    def target_permille(self) -> int:
        """6071h with its offset 60B2h."""
        value = self._dictionary.value
        return value(Object.TARGET_TORQUE) + value(Object.TORQUE_OFFSET)

    @property
    def target_position(self) -> int:
        """607Ah with its offset 60B0h."""
        value = self._dictionary.value
        return value(Object.TARGET_POSITION) + value(Object.POSITION_OFFSET)

    def _joint(self, position_units: int) -> float:
        counts = self._scaling.units_counts(position_units)
        return self._scaling.position_si(counts + self._measurement.origin_counts)

    def _position_limits_si(self) -> tuple[float, float]:
        if not self._clips:
            return -math.inf, math.inf
        limits = self._limits()
        if limits == NO_POSITION_LIMITS:
            return -math.inf, math.inf
        lower_si, upper_si = sorted(map(self._joint, limits))
        return lower_si, upper_si

    def _limits(self) -> tuple[int, int]:
        value = self._dictionary.value
        return value(Object.POSITION_LIMITS, 1), value(Object.POSITION_LIMITS, 2)

    def _check_position_limit(self, subindex: int, value: int) -> None:
        lower, upper = self._limits()
        crossed = (subindex == 1 and value > upper) or (subindex == 2 and value < lower)
        if crossed:
            raise SdoAbortError(AbortCode.MAXIMUM_BELOW_MINIMUM)

    # --- exceeded limits --------------------------------------------------------------------------

    def torque_clipped(self) -> bool:
        """True if the torque target exceeds the limit in force."""
        if self.mode is not Mode.CYCLIC_SYNC_TORQUE or not self.follows:
            return False
        wanted_si = abs(self._scaling.effort_si(self.target_permille))
        return wanted_si > self._scaling.factors.effort_limit_si

    def outside_position_limits(self) -> bool:
        """True if the position, or in cyclic position mode its target, lies outside 607Dh."""
        lower, upper = limits = self._limits()
        if limits == NO_POSITION_LIMITS:
            return False
        if not lower <= self._measurement.position_counts <= upper:
            return True
        return self.is_following_positions and not lower <= self.target_position <= upper
