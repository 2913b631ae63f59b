"""EMCY codes: texts, the drive's own reaction, and whether the position reference is lost.

Here are the standard's: error classes and communication codes of CiA 301, codes of CiA 402. Those
of a maker are in its profile (`drives/cia402/emergencies.py`), and come first: the same code may
differ between makers (FF10h). The texts are this project's own.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple

DEVICE_CLASS: Final = 0xFF
"""High byte of the codes that CiA 301 leaves to the maker."""
SENSOR_CLASS: Final = 0x73


class Reaction(Enum):
    """The drive's own reaction when it sends the code."""

    UNKNOWN = "not known"
    WARNING = "nothing: a warning"
    ABORT_CONNECTION = "abort connection option code, 6007h"
    FAULT_REACTION = "fault reaction option code, 605Eh"
    SWITCHED_OFF = "power stage off at once"


class CodeMeaning(NamedTuple):
    """One EMCY code."""

    text: str
    reaction: Reaction = Reaction.UNKNOWN
    loses_reference: bool = False
    """The encoder is no longer reliable: the axis must be referenced again."""


_A = Reaction.ABORT_CONNECTION
_F = Reaction.FAULT_REACTION

_CLASSES: Final = {
    0x00: "error reset or no error",
    0x10: "generic error",
    0x20: "current",
    0x21: "current, device input side",
    0x22: "current inside the device",
    0x23: "current, device output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "device temperature",
    0x43: "drive temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x73: "sensor",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x84: "speed controller",
    0x85: "position controller",
    0x86: "positioning controller",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}
"""Error classes by the code's high byte: CiA 301 7.2.7.1 and CiA 402."""

_STANDARD: Final = {
    0x2310: CodeMeaning("continuous overcurrent, output side"),
    0x2320: CodeMeaning("short circuit or earth leakage, output side"),
    0x3210: CodeMeaning("DC link overvoltage"),
    0x3220: CodeMeaning("DC link undervoltage"),
    0x4210: CodeMeaning("device too hot"),
    0x4310: CodeMeaning("motor too hot"),
    0x8110: CodeMeaning("CAN overrun, messages lost", _A),
    0x8120: CodeMeaning("CAN in error passive mode", _A),
    0x8130: CodeMeaning("life guard or heartbeat: the master's heartbeat was lost", _A),
    0x8140: CodeMeaning("recovered from bus-off", _A),
    0x8150: CodeMeaning("CAN identifier collision", _A),
    0x8210: CodeMeaning("PDO not processed, too short"),
    0x8220: CodeMeaning("PDO too long"),
    0x8230: CodeMeaning("DAM MPDO not processed"),
    0x8240: CodeMeaning("unexpected SYNC data length"),
    0x8250: CodeMeaning("RPDO timeout", _A),
    0x8611: CodeMeaning("following error", _F),
    0x8612: CodeMeaning("reference limit", _F),
}

Codes = Mapping[int, CodeMeaning]
"""The codes of a maker; empty: the standard's alone."""
STANDARD: Final[Codes] = MappingProxyType({})


def meaning(code: int, codes: Codes) -> CodeMeaning:
    """Look up a code for this kind of drive; unknown codes get the standard's error class.

    A 73xxh that is not known counts as an unreliable encoder.
    """
    found = codes.get(code) or _STANDARD.get(code)
    if found is not None:
        return found
    high = code >> 8
    text = _CLASSES.get(high) or _CLASSES.get(high & 0xF0) or "unknown class"
    return CodeMeaning(text, loses_reference=high == SENSOR_CLASS)
