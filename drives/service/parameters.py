"""Storing a drive's parameters (1010h), and restoring the manufacturer's defaults (1011h).

Only on request, and only if (rules, checked in this order):
1.  The bus is not in use: no SYNC, no heartbeat of the master, no NMT command, no SDO request of
    another client was received while listening.
2.  The drive is the one that the files describe.
3.  Its motor has no power (6041h).
4.  It supports storing on command: bit 0 of 1010h:01 or 1011h:01 (CiA 301 7.5.2.13, 7.5.2.14).
The signature is written once and not repeated; a drive may take seconds to answer. Restored values
take effect after NMT reset node or the next power-on.
"""

from collections.abc import Generator
from enum import Enum
from typing import Final

from drives.bringup.objects import SdoTarget, examine, read
from drives.bringup.plan import DrivePlan
from drives.bringup.port import DrivePort
from drives.bringup.steps import Step, StepKind
from drives.canopen.nmt import NmtCommand, nmt_frame
from drives.canopen.objects import Object
from drives.canopen.sniffer import BusSniffer
from drives.cia402.power_state import POWER_STAGE_OFF, decode_statusword
from drives.errors import BootFailure, DrivesError, DriveSilent, SdoAborted, SdoGarbled, SdoTimeout
from drives.service.scan import DEVICE_TYPE, VENDOR, Progress

SDO_TIMEOUT_NS: Final = 5_000_000_000
"""Limit for the answer to a signature: the drive writes its memory first."""
BOOT_TIMEOUT_NS: Final = 5_000_000_000
"""Limit after NMT reset node, which restarts the drive's firmware."""

_SLICE_NS: Final = 50_000_000
_ON_COMMAND: Final = 1
_IDENTITY: Final = (DEVICE_TYPE[0], VENDOR[0])
_STATUSWORD: Final = Step(StepKind.REPORT, "statusword", Object.STATUSWORD, bits=16, is_hex=True)


class Command(Enum):
    """Requested operation; the values are the object and its signature."""

    STORE = (Object.STORE, b"save")
    RESTORE = (Object.RESTORE, b"load")

    @property
    def index(self) -> int:
        """Index of the object; sub-index 1 covers all parameters."""
        return self.value[0]

    @property
    def signature(self) -> bytes:
        """Value to write, which prevents accidental use."""
        return self.value[1]


class ParameterRefusedError(DrivesError):
    """The program or the drive refuses the request; nothing has been written or changed."""


def check_bus(sniffer: BusSniffer, master_node_id: int) -> None:
    """Check rule 1.

    Raises:
        ParameterRefusedError: the bus is in use.
    """
    foreign_count = sum(traffic.foreign_request_count for traffic in sniffer.nodes.values())
    traffic = {
        "the master's heartbeat": sniffer.node(master_node_id).heartbeat_count,
        "SYNC": sniffer.sync_count,
        "NMT commands": sniffer.nmt_count,
        "SDO requests of another client": foreign_count,
    }
    for what, count in traffic.items():
        if count:
            text = f"the bus is in use: {what}, {count} times. Stop the service first"
            raise ParameterRefusedError(text)


def check_drive(plan: DrivePlan, command: Command, port: DrivePort) -> None:
    """Check rules 2 to 4.

    Raises:
        BringUpRefused: it is another drive.
        ParameterRefusedError: it has power, or does not support it on command.
        DriveSilent: it does not answer.
        BusError: the bus is down.
    """
    target = SdoTarget(port, plan.description.name, plan.description.node_id)
    for step in plan.steps:
        if step.kind is StepKind.CHECK and step.index in _IDENTITY:
            examine(step, target)
    state = decode_statusword(read(_STATUSWORD, target))
    if state not in POWER_STAGE_OFF:
        words = state.name.lower().replace("_", " ")
        raise ParameterRefusedError(f"it is in {words}: it must not be enabled")
    ways = read(Step(StepKind.REPORT, "ways of storing", command.index, 1, is_hex=True), target)
    if not ways & _ON_COMMAND:
        place = f"{command.index:04X}h:01 = {ways:08X}h"
        raise ParameterRefusedError(f"{place}: this drive does not store on command (bit 0)")


def execute(plan: DrivePlan, command: Command, port: DrivePort) -> None:
    """Write the signature. `port` must wait SDO_TIMEOUT_NS for an answer.

    Raises:
        ParameterRefusedError: the drive refuses, with its abort text.
        DriveSilent: no answer: the result is unknown.
        BusError: the bus is down.
    """
    name, node_id = plan.description.name, plan.description.node_id
    try:
        port.write(node_id, command.index, 1, command.signature)
    except SdoAborted as abort:
        raise ParameterRefusedError(f"the drive refuses: {abort}") from abort
    except (SdoTimeout, SdoGarbled) as error:
        raise DriveSilent(
            name, BootFailure.NO_ANSWER, f"{error}: it is unknown whether it was done"
        ) from error


def reset_node(plan: DrivePlan, port: DrivePort) -> Generator[Progress, None, None]:
    """Send NMT reset node and wait for the boot-up message.

    Raises:
        DriveSilent: it did not boot within BOOT_TIMEOUT_NS.
        BusError: the bus is down.
    """
    node_id = plan.description.node_id
    before = port.traffic(node_id).boot_up_count
    port.send((nmt_frame(NmtCommand.RESET_NODE, node_id),))
    end_ns = port.now_ns() + BOOT_TIMEOUT_NS
    while port.traffic(node_id).boot_up_count == before:
        if port.now_ns() >= end_ns:
            waited = f"no boot-up message within {BOOT_TIMEOUT_NS / 1e9:g} s of NMT reset node"
            raise DriveSilent(plan.description.name, BootFailure.NO_ANSWER, waited)
        port.wait(min(end_ns, port.now_ns() + _SLICE_NS))
        yield Progress("waiting for its boot-up", 0, 1)
