"""The rows of emergency messages: one of each error class, as a message alone and as a fault."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from gaitd_lab.fault_matrix import kinds
from gaitd_lab.fault_matrix.kinds import Fault

EMERGENCY_LASTS_S: Final = 0.6

EMERGENCIES: Final[Mapping[int, tuple[int, str]]] = MappingProxyType(
    {
        0x1: (0x1000, "generic error"),
        0x2: (0x2310, "overcurrent"),
        0x3: (0x3210, "overvoltage"),
        0x4: (0x4210, "power stage too hot"),
        0x5: (0x5280, "hardware defect"),
        0x6: (0x6320, "software parameter"),
        0x7: (0x7320, "position sensor"),
        0x8: (0x8611, "following error"),
        0x9: (0x9000, "external error"),
        0xF: (0xFF0B, "system peak overloaded"),
    }
)
"""One code of each error class of CiA 301 (table of 7.2.7.1), with its meaning on an EPOS4."""
WARNING_CODE: Final = 0xFF01
"""The only code that an EPOS4 sends without stopping: system overloaded."""


def emergencies() -> Iterator[Fault]:
    """Return two rows for each class, and the warning."""
    for error_class, (code, meaning) in EMERGENCIES.items():
        name, text = f"emcy_{error_class:x}xxx", f"EMCY {code:04X}h ({meaning}), and the drive goes"
        yield _emergency(f"{name}_fault", f"{text} into fault", f"emcy {{}} - {code:#06x}")
        yield _emergency(f"{name}_told", f"{text} on as before", f"emcy_warning {{}} - {code:#06x}")
    yield _emergency(
        "emcy_warning",
        f"EMCY {WARNING_CODE:04X}h, which its maker calls a warning",
        f"emcy_warning {{}} - {WARNING_CODE:#06x}",
    )


def _emergency(name: str, text: str, words: str) -> Fault:
    return Fault(name, text, kinds.machine(words), lasts_s=EMERGENCY_LASTS_S)
