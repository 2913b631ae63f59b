"""The CiA 402 device: runs the power state machine of `power_state.py` on one axis.

Rules in addition to the tables:
1. A slow-down ends when the plant reports standstill; the next state is the one in STOPPING.
   During a slow-down, a command with a row of its own ends it; 0Fh ends
   that of transitions 5 and 8.
2. A fault passes "fault reaction active" even if there is nothing to slow down, for
   FAULT_REACTION_MIN_NS. A fault during a fault adds its EMCY and changes nothing else.
3. Fault reset is the rising edge of bit 7 in "fault", and is granted when every cause is gone.
4. STO open: no torque from that instant, fault, and no state gives power before STO is released and
   the fault reset.
5. Lost connection (heartbeat, RPDO watchdog) acts by 6007h: on a drive for which that is a fault,
   the slow-down that 6007h names and then "fault"; on the others the command that it names.
   Leaving NMT operational with the power stage on is that command on both.
6. On some drives a controlword not allowed in the present state is refused, with an EMCY and
   the warning bit until a valid one comes.
7. 607Eh, 608Fh, 6091h, 6092h, where the drive has them, are locked while the power stage is on. The
   last three are ratios: 0 is 06090030.
"""

from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.emergency import Errors
from sim_drives.canopen.objects import Object
from sim_drives.canopen.timers import MILLISECOND
from sim_drives.cia402.measurement import Measurement, wrap_int32
from sim_drives.cia402.motion import Mode, Motion
from sim_drives.cia402.personality import PERSONALITIES, guard_option_codes
from sim_drives.cia402.power_state import (
    DISABLE_OPTION,
    FAULT_REACTION_OPTION,
    MISPLACED,
    POWER_STAGE_ON,
    QUICK_STOP_OPTION,
    TRANSITIONS,
    AbortConnection,
    Command,
    PowerState,
    Ramp,
    StatusBit,
    Stopping,
    Transition,
    command_of,
    fault_reset_edge,
)
from sim_drives.cia402.scaling import (
    POSITION_POLARITY,
    UNIT_RATIOS,
    VELOCITY_POLARITY,
    Scaling,
)
from sim_drives.cia402.statusword import Statusword
from sim_drives.cia402.supervision import FOLLOWING_ERROR_CODE, Supervision
from sim_drives.cia402.target_monitor import TargetWatch
from sim_drives.plant.actuation import Actuation, AxisActuation, AxisFlag
from sim_drives.plant.port import Axis
from sim_drives.settings import DriveSettings

SELF_TEST_NS: Final = 200 * MILLISECOND
"""Time from power-on to transition 1."""
FAULT_REACTION_MIN_NS: Final = 1 * MILLISECOND
CONNECTION_CODE: Final = 0x8100
MISPLACED_CODE: Final = 0x6300
_VOLTAGE_OFF: Final = (PowerState.NOT_READY_TO_SWITCH_ON, PowerState.SWITCH_ON_DISABLED)
_LIMITED: Final = AxisFlag.TARGET_CLIPPED | AxisFlag.SPEED_LIMITED
_FAULTED: Final = (PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT)


class Drive:
    """Power state, statusword and the order to one axis."""

    def __init__(
        self,
        settings: DriveSettings,
        context: NodeContext,
        axis: Axis,
        errors: Errors,
    ) -> None:
        self._settings = settings
        self._personality = PERSONALITIES[settings.personality]
        self._dictionary, self._line, self._timers = context
        self._axis = axis
        self._errors = errors
        dictionary = self._dictionary
        scaling = Scaling(settings, dictionary)
        self.measurement = Measurement(settings, dictionary, scaling, axis)
        self._motion = Motion(settings, context, scaling, self.measurement)
        self._supervision = Supervision(settings, self._motion, self.measurement)
        self.targets = TargetWatch(self._line, self._timers, self._wants_targets)
        self.state = PowerState.NOT_READY_TO_SWITCH_ON
        self._stopping: Stopping | None = None
        self._after_stop: Transition | None = None
        self._arrived = False
        self.ignores_quick_stop = False
        self.slower_by_ns = 0
        self._waiting_for: Command | None = None
        self._controlword_prev = 0
        self._ordered: AxisActuation | None = None
        self._statusword = Statusword(context, self._personality.statusword_period_ns)
        dictionary.watch(Object.CONTROLWORD, lambda _: self._controlword_written())
        if self._personality.refuses_misplaced_controlword:
            dictionary.guard(Object.CONTROLWORD, lambda _, value: self._check_controlword(value))
        guard_option_codes(dictionary, self._personality)
        for index in (Object.POLARITY, *UNIT_RATIOS):
            dictionary.guard(index, lambda _, value, i=index: self._check_units(i, value))

    # --- power and connection -----------------------------------------------------------------

    def power_on(self) -> None:
        """Execute transition 0 and, after the self-test, 1."""
        self._controlword_prev = 0
        self._errors.reset_all()
        self._motion.power_on()
        self.measurement.power_on(self._line.now_ns)
        self._enter(PowerState.NOT_READY_TO_SWITCH_ON)
        self._timers.start(Drive, self._line.now_ns + SELF_TEST_NS, self._self_test_done)
        self.update()

    def power_off(self) -> None:
        """Remove the torque, in every state."""
        self._enter(PowerState.NOT_READY_TO_SWITCH_ON)
        self.update()

    def _self_test_done(self) -> None:
        if self.state is not PowerState.NOT_READY_TO_SWITCH_ON:
            return  # a fault occurred before it
        self._enter(PowerState.SWITCH_ON_DISABLED)
        if not self.measurement.sto_released:
            self.fault(self._personality.sto_error_code)

    def switch_sto(self, *, released: bool) -> None:
        """Open or release STO (rule 4)."""
        self.measurement.sto_released = released
        if released:
            self._errors.cause_gone(self._personality.sto_error_code)
        elif self.state is not PowerState.NOT_READY_TO_SWITCH_ON:
            self.fault(self._personality.sto_error_code)

    def connection_lost(self, code: int) -> None:
        """Apply rule 5; `code` is 8130h or 8250h."""
        reaction = AbortConnection(self._dictionary.value(Object.ABORT_CONNECTION))
        if reaction is AbortConnection.FAULT:
            self.fault(code)
        elif self._personality.connection_loss_is_fault and reaction:
            quick = Stopping(Ramp.QUICK)
            coast = Stopping(Ramp.COAST)
            self.fault(code, quick if reaction is AbortConnection.QUICK_STOP else coast)
        else:
            self._errors.begin(code, latched=False)
            self._abort_connection(reaction)

    def left_operational(self) -> None:
        """Apply the second half of rule 5."""
        self._motion.clear_targets()
        reaction = AbortConnection(self._dictionary.value(Object.ABORT_CONNECTION))
        if self.state not in (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE):
            return
        if reaction is AbortConnection.FAULT:
            self.fault(CONNECTION_CODE)
            self._errors.cause_gone(CONNECTION_CODE)
        else:
            self._abort_connection(reaction)

    def pdos_applied(self) -> None:
        """Note that RPDOs have been applied."""
        if self._personality.misses_targets:
            self.targets.pdos_applied(self._motion.interpolation_s)

    def _wants_targets(self) -> bool:
        return self.state is PowerState.OPERATION_ENABLED and self._motion.is_following_positions

    def _abort_connection(self, reaction: AbortConnection) -> None:
        if reaction is AbortConnection.DISABLE_VOLTAGE:
            self._execute(Command.DISABLE_VOLTAGE)
        elif reaction is AbortConnection.QUICK_STOP:
            self._execute(Command.QUICK_STOP)

    # --- faults -------------------------------------------------------------------------------

    def fault(self, code: int, stopping: Stopping | None = None) -> None:
        """Execute transition 13 with its reaction: 605Eh, or one of its own."""
        self._errors.begin(code, latched=True)
        if not self.measurement.sto_released:
            stopping = Stopping(Ramp.COAST)
        elif self.state in _FAULTED:
            return
        if self.state is PowerState.FAULT:
            return
        powered = self.state in POWER_STAGE_ON
        if stopping is None:
            stopping = FAULT_REACTION_OPTION[self._dictionary.value(Object.FAULT_REACTION)]
        self._enter(PowerState.FAULT_REACTION_ACTIVE)
        self._stop(stopping if powered else Stopping(Ramp.COAST), Transition(14, PowerState.FAULT))

    def _reset_fault(self) -> None:
        if self._errors.reset():
            self._enter(PowerState.SWITCH_ON_DISABLED)

    # --- the power state machine --------------------------------------------------------------

    def _controlword_written(self) -> None:
        controlword = self._dictionary.value(Object.CONTROLWORD)
        edge = fault_reset_edge(self._controlword_prev, controlword)
        self._controlword_prev = controlword
        if edge and self.state is PowerState.FAULT:
            self._reset_fault()
        command = command_of(controlword)
        if command is not None:
            self._receive(command)
        enabled = self.state is PowerState.OPERATION_ENABLED
        self._motion.controlword_written(controlword, enabled=enabled)

    def _check_controlword(self, controlword: int) -> None:
        """Check a controlword by rule 6, before it is stored."""
        if (self.state, command_of(controlword)) in MISPLACED:
            self._errors.begin(MISPLACED_CODE, latched=False)
            raise SdoAbortError(AbortCode.RANGE)
        self._errors.cause_gone(MISPLACED_CODE)

    def _check_units(self, index: int, value: int) -> None:
        """Check the units by rule 7."""
        if self.state in POWER_STAGE_ON:
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        if index == Object.POLARITY:
            if value & ~(POSITION_POLARITY | VELOCITY_POLARITY):
                raise SdoAbortError(AbortCode.RANGE)
        elif not value:
            raise SdoAbortError(AbortCode.RANGE)

    def _receive(self, command: Command) -> None:
        """Execute a controlword, on a slow drive later; a pending command is not repeated."""
        if not self.slower_by_ns:
            self._execute(command)
        elif command is not self._waiting_for or not self._timers.running(Command):
            self._waiting_for = command
            at_ns = self._line.now_ns + self.slower_by_ns
            self._timers.start(Command, at_ns, lambda: self._execute(command))

    def _execute(self, command: Command) -> None:
        row = TRANSITIONS.get((self.state, command))
        if row is not None:
            self._pass(row, command)
        elif self.state is PowerState.OPERATION_ENABLED:  # 0Fh: rule 1
            self._stopping = self._after_stop = None

    def _pass(self, row: Transition, command: Command) -> None:
        match row.number:
            case 3:
                self._enter(PowerState.SWITCHED_ON)
                if command is Command.ENABLE_OPERATION and self._personality.automatic_enable:
                    self._enter(PowerState.OPERATION_ENABLED)
            case 5:
                self._slow_down_enabled(Object.DISABLE, row)
            case 8:
                self._slow_down_enabled(Object.SHUTDOWN, row)
            case 11:
                self._enter(PowerState.QUICK_STOP_ACTIVE)
                stopping = QUICK_STOP_OPTION[self._dictionary.value(Object.QUICK_STOP)]
                self._stop(stopping, Transition(12, PowerState.SWITCH_ON_DISABLED))
            case 16:
                if QUICK_STOP_OPTION[self._dictionary.value(Object.QUICK_STOP)].stays:
                    self._enter(row.target)
            case _:
                self._enter(row.target)

    def _slow_down_enabled(self, option: int, row: Transition) -> None:
        if self._after_stop != row:
            self._stop(DISABLE_OPTION[self._dictionary.value(option)], row)

    def _enter(self, state: PowerState) -> None:
        self.state = state
        self._motion.homing.interrupt()
        self._stopping = self._after_stop = None
        self._arrived = False
        self._timers.cancel(PowerState)

    def _stop(self, stopping: Stopping, then: Transition) -> None:
        self._stopping, self._after_stop = stopping, then
        self._motion.homing.interrupt()
        if stopping.ramp is not Ramp.COAST:
            return
        if self.state is PowerState.FAULT_REACTION_ACTIVE:
            at_ns = self._line.now_ns + FAULT_REACTION_MIN_NS
            self._timers.start(PowerState, at_ns, self._stopped)
        else:
            self._stopped()

    def _stopped(self) -> None:
        stopping, then = self._stopping, self._after_stop
        if stopping is None or then is None:
            return
        if stopping.stays:
            self._arrived = True
        else:
            self._enter(then.target)

    # --- flags of the plant, and commands to it ---------------------------------------------------

    def _watch_plant(self) -> int:
        """React to the plant's flags and return them."""
        flags = self._axis.flags()
        if flags & AxisFlag.STANDSTILL and self._ramping and not self._arrived:
            self._stopped()
        if self.state is PowerState.OPERATION_ENABLED:
            for code in self._supervision.errors(flags):
                self._fault_once(code)
        else:
            self._supervision.reset(flags)
        return flags

    @property
    def _ramping(self) -> bool:
        """True if the plant has a slow-down order, so that its standstill answers that order."""
        ordered = self._ordered is not None and self._ordered.actuation is Actuation.RAMP
        return ordered and self._stopping is not None and self._stopping.ramp is not Ramp.COAST

    def _fault_once(self, code: int) -> None:
        """Raise a fault whose cause ends with the motion: it can be reset, and may recur."""
        self.fault(code)
        self._errors.cause_gone(code)

    def latch(self) -> None:
        """Sample all process values, and check them."""
        self.measurement.latch(self._line.now_ns)
        before = self.state, self._stopping
        flags = self._watch_plant()
        if before != (self.state, self._stopping):
            self.update()
        else:
            self._show(flags)

    def update(self) -> None:
        """Update statusword, inputs and the plant's order after a possible change of state."""
        flags = self._watch_plant()
        order = self._order()
        if order != self._ordered:
            self._ordered = order
            self._axis.order(order)
        self._show(flags)

    def _show(self, flags: int) -> None:
        self._dictionary.put(Object.INPUTS, 0, self.measurement.inputs(flags))
        self._show_demand()
        self._statusword.set(self._status_bits(flags))

    def _order(self) -> AxisActuation:
        if self.state not in POWER_STAGE_ON or not self.measurement.sto_released:
            return self._motion.coast()
        if self.ignores_quick_stop and self.state is PowerState.QUICK_STOP_ACTIVE:
            return self._motion.order()
        if self._stopping is not None:
            ramp = self._stopping.ramp
            return self._motion.coast() if ramp is Ramp.COAST else self._motion.ramp(ramp)
        return self._motion.order()

    def _show_demand(self) -> None:
        actual = self.measurement.position_counts
        demand = wrap_int32(self._motion.target_position) if self._wants_targets() else actual
        self._dictionary.put(Object.POSITION_DEMAND, 0, demand)
        following = max(-(2**31), min(2**31 - 1, demand - actual))
        self._dictionary.put(Object.FOLLOWING_ERROR, 0, following)

    # --- statusword ---------------------------------------------------------------------------

    def _status_bits(self, flags: int) -> int:
        word = self.state | StatusBit.REMOTE
        if self.measurement.sto_released and self.state not in _VOLTAGE_OFF:
            word |= StatusBit.VOLTAGE_ENABLED
        word |= StatusBit.WARNING * self._errors.warning
        word |= StatusBit.REFERENCED * self.measurement.referenced
        word |= StatusBit.TARGET_REACHED * self._arrived
        word |= StatusBit.FOLLOWING_ERROR * self._errors.active(FOLLOWING_ERROR_CODE)
        if self.state is PowerState.OPERATION_ENABLED:
            word |= self._mode_bits(flags)
        return word

    def _mode_bits(self, flags: int) -> int:
        motion = self._motion
        word = StatusBit.INTERNAL_LIMIT * (bool(flags & _LIMITED) or motion.torque_clipped())
        if motion.halted:
            return word | StatusBit.TARGET_REACHED * bool(flags & AxisFlag.STANDSTILL)
        if motion.mode is Mode.HOMING:
            return word | motion.homing.status_bits
        return word | StatusBit.FOLLOWS * motion.follows
