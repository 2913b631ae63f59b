"""One step of a bring-up: the action, its object, and the failure to report if it does not work.

`plan.py` builds lists of steps, `bringup.py` and `objects.py` execute them, `eds.py` checks them
without a drive.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from drives.canopen.objects import Object
from drives.errors import BootFailure

PDO_OFF: Final = 0x8000_0000
"""Bit 31 of a PDO's identifier: the PDO does not exist."""
NO_RTR: Final = 0x4000_0000
"""Bit 30 of a TPDO's identifier: no remote frames."""
ALL_BITS: Final = 0xFFFF_FFFF

SERIAL_NUMBER: Final = (Object.IDENTITY, 4)


class StepKind(Enum):
    """Kind of a step; the value is shown in a printed plan."""

    RESET = "reset"
    BOOT = "boot"
    POWER = "power"
    """Read the statusword; a powered drive is switched off only where that was requested."""
    CHECK = "check"
    """Read; the masked value must equal `value`."""
    ALONE = "alone"
    """Read the serial number twice, and wait for a second answer."""
    COMPARE = "compare"
    """Read; not 0 and within 1 % of `value`."""
    SWITCH_OFF = "off"
    """Read a PDO's identifier and write it back with bit 31: a drive may refuse any other value."""
    WRITE = "write"
    """Write, and read back under `mask`."""
    CLEAR = "clear"
    """Write 0, and read back; a drive without the object has nothing to clear."""
    RANGE = "range"
    """Write `value` here and `second` into the next sub-index, never crossing the present
    values."""
    SEED_POSITION = "seed"
    """Read the position and write it as the target, clamped to `value` and `second`."""
    HEAR = "hear"
    REPORT = "report"
    """Read, for the report."""
    ASK = "ask"
    """Read, for the report; 0 where the drive has no such object."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step; `index` is 0 where no object is concerned."""

    kind: StepKind
    why: str
    index: int = 0
    sub: int = 0
    bits: int = 32
    signed: bool = False
    value: int = 0
    mask: int = ALL_BITS
    second: int = 0
    is_hex: bool = False
    """Show the value in hex."""
    failure: BootFailure = BootFailure.CONFIGURATION
    """The failure to report if the drive refuses this step, or holds another value."""

    @property
    def place(self) -> str:
        """`6065h:00`, or an empty string."""
        return f"{self.index:04X}h:{self.sub:02X}" if self.index else ""

    def value_text(self, value: int) -> str:
        """Format a value of this object for the operator."""
        return f"{value:0{self.bits // 4}X}h" if self.is_hex else str(value)

    def __str__(self) -> str:
        match self.kind:
            case StepKind.CHECK | StepKind.WRITE:
                value = f"= {self.value_text(self.value)}"
            case StepKind.COMPARE:
                value = f"~ {self.value_text(self.value)}"
            case StepKind.RANGE:
                value = f"= {self.value} .. {self.second}"
            case _:
                value = ""
        return f"{self.kind.value:<8}{self.place:<10}{value:<28}{self.why}"
