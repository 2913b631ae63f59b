"""Meaning of raw object values as text, for the operator who reads a dump.

The text comes from the standard (CiA 301, CiA 402) where it is the same for every drive, else from
the drive's profile, and from the plan of bring-up, whose steps name purpose and unit.
"""

from collections.abc import Callable
from typing import Final

from drives.bringup.plan import DrivePlan
from drives.bringup.steps import PDO_OFF, StepKind
from drives.canopen.emcy_codes import Codes, meaning
from drives.canopen.objects import Object
from drives.cia402.axis_file import InputBit, Inputs
from drives.cia402.power_state import decode_statusword
from drives.service.compare import expectations
from drives.service.dump import Address
from drives.signals import OperationMode

_PDO_COUNT: Final = 512
_PARAMETERS: Final = (Object.RPDO, Object.TPDO)
_MAPPINGS: Final = (Object.RPDO_MAPPING, Object.TPDO_MAPPING)
_CAN_ID: Final = 0x7FF
_SYNC_TYPE_MAX: Final = 240
_TYPES: Final = {0: "on an event, at the next SYNC", 254: "on an event", 255: "on an event"}
"""Transmission types (CiA 301 7.5.2.35)."""
_MODES: Final = {0: "PP", 1: "VL", 2: "PV", 3: "TQ", 5: "HM", 6: "IP", 7: "CSP", 8: "CSV", 9: "CST"}
"""Bits of 6502h (CiA 402-2)."""
_ABOUT_US: Final = frozenset((StepKind.CHECK, StepKind.SWITCH_OFF))
"""Steps whose text adds nothing to a correct value."""


class ObjectWords:
    """Texts for one drive's objects."""

    def __init__(self, plan: DrivePlan) -> None:
        self._profile = plan.description.profile
        self._inputs = plan.description.axis.inputs
        self._expected = {one.address: one for one in expectations(plan)}

    def text_of(self, index: int, sub: int, value: int) -> str:
        """Describe a value of this object; an empty string where nothing is known."""
        texts = (self._measured(index, sub, value), self._wanted((index, sub), value))
        return "; ".join(text for text in texts if text)

    def _measured(self, index: int, sub: int, value: int) -> str:
        source = self._profile.torque_source
        known = _STANDARD.get((index, sub))
        if known is not None:
            return known(value)
        if (index == Object.ERROR_HISTORY and sub) or (index, sub) == (Object.ERROR_CODE, 0):
            return _error(value & 0xFFFF, self._profile.emergency_codes)
        if (index, sub) == (Object.INPUTS, 0):
            return inputs(value, self._inputs)
        if (index, sub) == (source.index, source.sub):
            return f"torque source in {source.unit.value}"
        return pdo(index, sub, value)

    def _wanted(self, address: Address, value: int) -> str:
        expected = self._expected.get(address)
        if expected is None:
            return ""
        if not expected.is_met(value):
            return f"bring-up expects {expected.wanted}: {expected.step.why}"
        return "" if expected.step.kind in _ABOUT_US else expected.step.why


def inputs(value: int, wiring: Inputs) -> str:
    """60FDh by the axis file's names of its bits; conditions that hold are listed."""
    wired: dict[str, InputBit | None] = {
        "hand switch closed": wiring.hand_switch_closed,
        "STO released": wiring.sto_released,
        "negative limit": wiring.negative_limit,
        "positive limit": wiring.positive_limit,
    }
    held = [name for name, bit in wired.items() if bit and value >> bit.bit & 1 == bit.level]
    return ", ".join(held) or "no named input holds"


def pdo(index: int, sub: int, value: int) -> str:
    """Describe a PDO's identifier (bit 31: off), type, or mapping entry (index, sub, bits)."""
    if sub == 1 and _within(index, _PARAMETERS):
        return f"identifier {value & _CAN_ID:03X}h, {'off' if value & PDO_OFF else 'on'}"
    if sub == 2 and _within(index, _PARAMETERS):
        synchronous = "with every SYNC" if value == 1 else f"with every {value}th SYNC"
        return synchronous if 0 < value <= _SYNC_TYPE_MAX else _TYPES.get(value, "")
    if sub and value and _within(index, _MAPPINGS):
        return f"{value >> 16:04X}h:{value >> 8 & 0xFF:02X}, {value & 0xFF} bits"
    return ""


def _within(index: int, bases: tuple[int, ...]) -> bool:
    return any(base <= index < base + _PDO_COUNT for base in bases)


def _error(code: int, codes: Codes) -> str:
    return meaning(code, codes).text if code else "no error"


def _power_state(value: int) -> str:
    return decode_statusword(value).name.lower().replace("_", " ")


def _mode(value: int) -> str:
    known = {mode.value: mode.name.lower().replace("_", " ") for mode in OperationMode}
    return known.get(value, "")


def _modes(value: int) -> str:
    return ", ".join(name for bit, name in _MODES.items() if value >> bit & 1)


def _saving(value: int) -> str:
    ways = ("on command", "by itself")
    return " and ".join(way for bit, way in enumerate(ways) if value >> bit & 1) or "not at all"


def _consumer(value: int) -> str:
    node_id, time_ms = value >> 16 & 0x7F, value & 0xFFFF
    return f"node {node_id} within {time_ms} ms" if node_id and time_ms else "monitors no node"


_STANDARD: Final[dict[Address, Callable[[int], str]]] = {
    (Object.DEVICE_TYPE, 0): lambda value: f"CiA {value & 0xFFFF}",
    (Object.STORE, 1): lambda value: f"saves {_saving(value)}",
    (Object.RESTORE, 1): lambda value: f"restores {_saving(value)}",
    (Object.HEARTBEAT_CONSUMER, 1): _consumer,
    (Object.HEARTBEAT_CONSUMER, 2): _consumer,
    (Object.HEARTBEAT_PRODUCER, 0): lambda value: f"every {value} ms" if value else "no heartbeat",
    (Object.STATUSWORD, 0): _power_state,
    (Object.MODE, 0): _mode,
    (Object.MODE_DISPLAY, 0): _mode,
    (Object.SUPPORTED_MODES, 0): _modes,
}
