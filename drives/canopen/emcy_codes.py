"""EMCY codes: texts, the drive's own reaction, and whether the position reference is lost.

A profile names one of these tables; codes that are not in it are looked up in the standard's.

    standard  CiA 301 table of error classes and communication codes; CiA 402 codes
    epos4     reaction classes of its firmware specification as public documents reproduce them
    elmo      codes of Elmo drives on CAN, and which of them stop the motor: the table of
              github.com/PyLabRobot/pylabrobot, pylabrobot/paa/kx2 (its KX2 robot has Elmo drives),
              and Elmo's MAN-CAN301IG chapter 6

The same code may differ between manufacturers (FF10h). The texts are this project's own.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Final, Literal, NamedTuple

EmergencyTable = Literal["standard", "epos4", "elmo"]


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
    is_sto: bool = False
    """Safe torque off was requested by a switch: no defect of the drive."""


_A = Reaction.ABORT_CONNECTION
_F = Reaction.FAULT_REACTION
_D = Reaction.SWITCHED_OFF
_W = Reaction.WARNING

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
    0x8130: CodeMeaning("life guard or heartbeat error: the master's heartbeat was lost", _A),
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

_EPOS4: Final = {
    0x1000: CodeMeaning("generic error", _D),
    0x1090: CodeMeaning("firmware incompatible", _D),
    0x2310: CodeMeaning("overcurrent", _D),
    0x2320: CodeMeaning("power stage protection", _D),
    0x3210: CodeMeaning("overvoltage", _D),
    0x3220: CodeMeaning("undervoltage", _D),
    0x4210: CodeMeaning("power stage too hot", _D),
    0x4380: CodeMeaning("motor too hot", _D),
    0x5113: CodeMeaning("logic supply voltage too low", _D),
    0x5280: CodeMeaning("hardware defect", _D),
    0x5281: CodeMeaning("hardware incompatible", _D),
    0x5282: CodeMeaning("STO card not detected", _D),
    0x6080: CodeMeaning("extension: does not respond", _D),
    0x6081: CodeMeaning("extension: watchdog", _A),
    0x6320: CodeMeaning("software parameter", _F),
    0x6380: CodeMeaning("stored parameters corrupt", _D),
    0x7320: CodeMeaning("position sensor: position no longer valid", _D, True),
    0x7380: CodeMeaning("position sensor: breach or bad signals", _D, True),
    0x7381: CodeMeaning("position sensor: wrong resolution", _D, True),
    0x7382: CodeMeaning("position sensor: index not found", _D, True),
    0x7388: CodeMeaning("Hall sensor", _D, True),
    0x7389: CodeMeaning("Hall sensor not found", _D, True),
    0x738A: CodeMeaning("Hall angle detection", _D, True),
    0x738C: CodeMeaning("SSI sensor", _D, True),
    0x738D: CodeMeaning("SSI sensor frame", _D, True),
    0x7390: CodeMeaning("main sensor missing", _D, True),
    0x7391: CodeMeaning("commutation sensor missing", _D, True),
    0x7392: CodeMeaning("main sensor counts in the wrong direction", _D, True),
    0x8110: CodeMeaning("CAN overrun, object lost", _A),
    0x8111: CodeMeaning("CAN overrun", _A),
    0x8120: CodeMeaning("CAN passive mode", _A),
    0x8130: CodeMeaning("CAN heartbeat: the master's heartbeat was lost", _A),
    0x8150: CodeMeaning("CAN PDO identifier collision", _A),
    0x81FD: CodeMeaning("CAN bus turned off", _A),
    0x81FE: CodeMeaning("CAN receive queue overflow", _A),
    0x81FF: CodeMeaning("CAN transmit queue overflow", _A),
    0x8210: CodeMeaning("CAN PDO too short", _A),
    0x8250: CodeMeaning("RPDO timeout: no PDO within the interpolation period", _A),
    0x8611: CodeMeaning("following error", _F),
    0x8A80: CodeMeaning("negative limit switch", _F),
    0x8A81: CodeMeaning("positive limit switch", _F),
    0x8A82: CodeMeaning("software position limit", _F),
    0x8A88: CodeMeaning("safe torque off came while enabled", _D, is_sto=True),
    0x8A8A: CodeMeaning("STO card ready to release", _D),
    0x8A8B: CodeMeaning("STO card in error or without power", _D),
    0xFF01: CodeMeaning("system overloaded", _W),
    0xFF02: CodeMeaning("watchdog: the drive reset itself", _D, True),
    0xFF0B: CodeMeaning("system peak overloaded", _D),
    0xFF10: CodeMeaning("controller gains", _F),
}
_EPOS4_RANGES: Final = (
    (0x1080, 0x1088, CodeMeaning("initialisation failed", _D)),
    (0x5480, 0x5483, CodeMeaning("hardware error", _D)),
    (0x6180, 0x61F0, CodeMeaning("internal software error", _D)),
    (0xFF11, 0xFF24, CodeMeaning("auto tuning", _D)),
)

_ELMO: Final = {
    0x2340: CodeMeaning("short circuit of motor or wiring", _D),
    0x3120: CodeMeaning("supply voltage too low", _D),
    0x3310: CodeMeaning("supply voltage too high", _D),
    0x4310: CodeMeaning("drive too hot", _D),
    0x5280: CodeMeaning("ECAM table"),
    0x5281: CodeMeaning("timing error"),
    0x5400: CodeMeaning("motor cannot be started"),
    0x5441: CodeMeaning("stopped by a switch: emergency stop", _D),
    0x6180: CodeMeaning("processor: stack overflow"),
    0x6181: CodeMeaning("processor: exception"),
    0x6200: CodeMeaning("user program aborted"),
    0x6300: CodeMeaning("object of an RPDO refused"),
    0x6320: CodeMeaning("start refused: parameters do not agree"),
    0x7121: CodeMeaning("motor powered but not moving", _D),
    0x7300: CodeMeaning("resolver or analogue encoder failed", _D, True),
    0x7380: CodeMeaning("encoder and Hall sensors do not agree", _D, True),
    0x7381: CodeMeaning("two Hall sensors changed at once", _D, True),
    0x8110: CodeMeaning("CAN message lost"),
    0x8130: CodeMeaning("heartbeat: the master's heartbeat was lost", _A),
    0x8200: CodeMeaning("unknown NMT request"),
    0x8210: CodeMeaning("RPDO that is not configured"),
    0x8311: CodeMeaning("peak current exceeded", _D),
    0x8380: CodeMeaning("electrical zero of the motor not found"),
    0x8381: CodeMeaning("current offsets cannot be tuned"),
    0x8480: CodeMeaning("speed tracking error", _D),
    0x8481: CodeMeaning("speed limit exceeded", _D),
    0x8611: CodeMeaning("position tracking error", _D),
    0x8680: CodeMeaning("position limit exceeded", _D),
    0xFF00: CodeMeaning("motion queue"),
    0xFF01: CodeMeaning("requested by the user program", _W),
    0xFF02: CodeMeaning("interpolated motion"),
    0xFF10: CodeMeaning("motor cannot be started"),
    0xFF20: CodeMeaning("safe torque off: a safety input is open", _D, is_sto=True),
}


class _Table(NamedTuple):
    codes: Mapping[int, CodeMeaning]
    ranges: tuple[tuple[int, int, CodeMeaning], ...] = ()


_TABLES: Final[Mapping[EmergencyTable, _Table]] = {
    "standard": _Table(_STANDARD),
    "epos4": _Table(_EPOS4, _EPOS4_RANGES),
    "elmo": _Table(_ELMO),
}


def meaning(code: int, table: EmergencyTable) -> CodeMeaning:
    """Look up a code for this kind of drive; unknown codes get the standard's error class.

    A 73xxh that is in no table counts as an unreliable encoder.
    """
    own = _TABLES[table]
    if code in own.codes:
        return own.codes[code]
    for first, last, found in own.ranges:
        if first <= code <= last:
            return found
    if code in _STANDARD:
        return _STANDARD[code]
    high = code >> 8
    text = _CLASSES.get(high) or _CLASSES.get(high & 0xF0) or "unknown class"
    return CodeMeaning(text, loses_reference=high == 0x73)
