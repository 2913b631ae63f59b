"""The kinds of fault of one virtual drive: one row of RULES for each.

A row describes the fault and the meaning of its value, and holds the function that begins it
(`on`) and ends it. `script.py` and `one_leg.py` decide which drive has which fault and until when.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Final

from sim_drives.canopen.timers import MILLISECOND
from sim_drives.connection import PASSIVE_CODE
from sim_drives.node import PRODUCT_CODE, SERIAL_NUMBER, Node
from sim_drives.settings import FaultKind

Switch = Callable[[Node, float, bool], None]
"""(node, value, whether the fault begins)."""


@dataclass(frozen=True, slots=True)
class FaultRule:
    """One kind of fault."""

    text: str
    switch: Switch
    value_text: str = ""
    """Meaning of the value; empty when there is none."""
    value_low: float = 0.0
    value_high: float = 0.0
    value_needed: bool = False
    is_whole: bool = True
    """The value is a number of something, and no quantity."""
    momentary: bool = False
    """True if the fault is over at once unless a duration is given."""


# --- between the node and the bus -------------------------------------------------------------


def _lose_tpdo(node: Node, value: float, on: bool) -> None:
    node.disturbance.lost_tpdo = int(value) if on else None


def _delay_tpdo(node: Node, value: float, on: bool) -> None:
    node.disturbance.late_ns = round(value * MILLISECOND) if on else 0


def _fill_tpdo(node: Node, value: float, on: bool) -> None:
    node.disturbance.all_ones_tpdo = int(value) if on else None


def _mute(node: Node, _: float, on: bool) -> None:
    node.disturbance.mute = on


def _unplug(node: Node, _: float, on: bool) -> None:
    node.disturbance.unplugged = on


def _deafen(node: Node, _: float, on: bool) -> None:
    node.disturbance.deaf = on


def _leave_bus(node: Node, _: float, on: bool) -> None:
    if on:
        node.bus_off()
    else:
        node.bus_back()


def _be_passive(node: Node, _: float, on: bool) -> None:
    node.set_error(PASSIVE_CODE, on)


def _refuse_object(node: Node, value: float, on: bool) -> None:
    node.dictionary.refused_index = int(value) if on else None


# --- the drive itself -------------------------------------------------------------------------


def _emergency(node: Node, value: float, on: bool) -> None:
    node.set_error(int(value), on)


def _warn(node: Node, value: float, on: bool) -> None:
    node.errors.set_warning(int(value), on)


def _reboot(node: Node, _: float, on: bool) -> None:
    if on:
        node.power_off()
    else:
        node.power_on()


def _exchange(node: Node, value: float, on: bool) -> None:
    own = node.identity
    product_code = int(value) or own[PRODUCT_CODE]
    another = {SERIAL_NUMBER: own[SERIAL_NUMBER] + 1, PRODUCT_CODE: product_code}
    node.exchange(another if on else own)


def _ignore_quick_stop(node: Node, _: float, on: bool) -> None:
    node.drive.ignores_quick_stop = on


def _slow_down(node: Node, value: float, on: bool) -> None:
    node.drive.slower_by_ns = round(value * MILLISECOND) if on else 0


def _open_sto(node: Node, _: float, on: bool) -> None:
    node.drive.switch_sto(released=not on)


# --- sensors, inputs, mechanics ---------------------------------------------------------------


def _freeze_encoder(node: Node, _: float, on: bool) -> None:
    node.drive.measurement.encoder_frozen = on


def _glitch(node: Node, value: float, on: bool) -> None:
    if on:
        node.drive.measurement.begin_glitch(int(value))
    else:
        node.drive.measurement.end_glitch()


def _offset_current(node: Node, value: float, on: bool) -> None:
    node.drive.measurement.offset_current(value if on else 0.0)


def _stick_home_switch(node: Node, value: float, on: bool) -> None:
    node.drive.measurement.home_switch_stuck = bool(value) if on else None


def _hold_limit_switch(node: Node, value: float, on: bool) -> None:
    node.drive.measurement.switch_held = int(value) if on else 0


def _open_hand_switch(node: Node, _: float, on: bool) -> None:
    node.drive.measurement.hand_switch_closed = not on


def _turn_motor(node: Node, _: float, on: bool) -> None:
    node.axis.wire_motor(-1 if on else 1)


def _turn_encoder(node: Node, _: float, on: bool) -> None:
    node.axis.wire_encoder(-1 if on else 1)


def _hold(cause: FaultKind, node: Node, _: float, on: bool) -> None:
    held_by = node.disturbance.held_by
    if on:
        held_by.add(cause)
    else:
        held_by.discard(cause)
    node.axis.block(blocked=bool(held_by))


RULES: Final[Mapping[FaultKind, FaultRule]] = MappingProxyType(
    {
        FaultKind.LOST_TPDO: FaultRule(
            "TPDOs do not reach the bus", _lose_tpdo, "TPDO number, 0: all", 0, 4
        ),
        FaultKind.LATE_TPDO: FaultRule(
            "synchronous TPDOs leave later",
            _delay_tpdo,
            "delay in ms",
            0.001,
            1000,
            is_whole=False,
            value_needed=True,
        ),
        FaultKind.TPDO_ALL_ONES: FaultRule(
            "every byte of a TPDO is FFh", _fill_tpdo, "TPDO number", 1, 4, value_needed=True
        ),
        FaultKind.SILENT: FaultRule("nothing of the node reaches the bus", _mute),
        FaultKind.UNPLUGGED: FaultRule("cut off from the bus, both ways", _unplug),
        FaultKind.BUS_OFF: FaultRule("its CAN controller is bus-off", _leave_bus),
        FaultKind.BUS_PASSIVE: FaultRule("its CAN controller is error-passive", _be_passive),
        FaultKind.DEAF: FaultRule("receives nothing, but sends", _deafen),
        FaultKind.REFUSES_OBJECT: FaultRule(
            "writing one object by SDO is aborted with 08000020",
            _refuse_object,
            "index",
            0x1000,
            0xFFFF,
            value_needed=True,
        ),
        FaultKind.EMCY: FaultRule(
            "a fault with this code; its cause lasts as long as the fault here",
            _emergency,
            "error code",
            0x100,
            0xFFFF,
            value_needed=True,
        ),
        FaultKind.EMCY_WARNING: FaultRule(
            "an EMCY with this code, and the drive continues as before; 0000h when it ends",
            _warn,
            "error code",
            0x100,
            0xFFFF,
            value_needed=True,
        ),
        FaultKind.REBOOT: FaultRule(
            "loses its power; boots after the duration, or at once", _reboot, momentary=True
        ),
        FaultKind.WRONG_IDENTITY: FaultRule(
            "another drive, with another serial number, is in its place and boots",
            _exchange,
            "its product code; 0: the same",
            0,
            0xFFFF_FFFF,
        ),
        FaultKind.IGNORES_QUICK_STOP: FaultRule(
            "shows quick stop active, and continues as before", _ignore_quick_stop
        ),
        FaultKind.SLOW_STATE: FaultRule(
            "reacts late to a controlword",
            _slow_down,
            "delay in ms",
            0.001,
            60_000,
            is_whole=False,
            value_needed=True,
        ),
        FaultKind.STO_OPEN: FaultRule("safe torque off becomes active", _open_sto),
        FaultKind.FROZEN_ENCODER: FaultRule(
            "the reported position does not change", _freeze_encoder
        ),
        FaultKind.ENCODER_GLITCH: FaultRule(
            "the next position that is sampled is wrong; with a duration, all of them",
            _glitch,
            "counts",
            -(2**31),
            2**31 - 1,
            value_needed=True,
            momentary=True,
        ),
        FaultKind.ENCODER_REVERSED: FaultRule(
            "the encoder counts in reverse, also for the drive's own loops", _turn_encoder
        ),
        FaultKind.WRONG_SIGN: FaultRule(
            "the motor is connected in reverse: torque moves the joint in the opposite direction",
            _turn_motor,
        ),
        FaultKind.TORQUE_OFFSET: FaultRule(
            "the current sensor reads too much, so the motor current is too low",
            _offset_current,
            "offset in mA",
            -100_000,
            100_000,
            is_whole=False,
            value_needed=True,
        ),
        FaultKind.HOME_SWITCH_STUCK: FaultRule(
            "the home switch does not change", _stick_home_switch, "0: off, 1: on", 0, 1
        ),
        FaultKind.HAND_SWITCH_OPEN: FaultRule(
            "the patient releases the hand switch", _open_hand_switch
        ),
        FaultKind.LIMIT_SWITCH_ON: FaultRule(
            "a limit switch is on wherever the joint is",
            _hold_limit_switch,
            "-1: the negative, 1: the positive one, in the drive's direction",
            -1,
            1,
            value_needed=True,
        ),
        FaultKind.BLOCKED_ROTOR: FaultRule(
            "the joint is jammed", partial(_hold, FaultKind.BLOCKED_ROTOR)
        ),
        FaultKind.BRAKE_STUCK: FaultRule(
            "the brake does not open: the axis does not move", partial(_hold, FaultKind.BRAKE_STUCK)
        ),
    }
)
