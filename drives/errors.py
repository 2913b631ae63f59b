"""Exceptions of drives and their bus, by who has to act.

operator   DescriptionError: a profile or axis file contains an impossible value.
machine    BusError: the interface is not there, went away, or does not work.
           BusOff: it is there, and the controller has left the bus.
drive      DriveSilent: it does not answer (unpowered, unplugged): worth another try.
           Both it and BringUpRefused carry a BootFailure, which names what failed.
           BringUpRefused: it answers, but is not the drive that the files describe, or refuses a
           setting: another try would fail the same way.
           DrivePowered: it holds the joint; switching it off was not requested.
           SdoAborted, SdoTimeout, SdoGarbled: one SDO transfer; becomes one of the two above.
software   CommandNotFinite: NaN or infinity was about to be sent to a motor.
"""
# ruff: noqa: N818 - the names state what happened, without an "Error" suffix

from enum import Enum
from typing import Final

from drives.signals import PowerState


class DrivesError(Exception):
    """Base class of everything that this package raises on purpose."""


class DescriptionError(DrivesError):
    """A profile or axis file is wrong; the loader adds the name of the file.

    `part` is "profile" or "axis"; `key` is dotted; `allowed` says what would have been right.
    """

    def __init__(self, part: str, key: str, value: object, allowed: str) -> None:
        self.part = part
        self.key = key
        self.value = value
        self.allowed = allowed
        super().__init__(f"{part}: {key} = {value!r}: {allowed}")


class BusError(DrivesError):
    """The CAN interface cannot be opened or has stopped working."""

    def __init__(self, channel: str, what: str) -> None:
        self.channel = channel
        self.what = what
        super().__init__(f"CAN bus {channel}: {what}")


class BusOff(BusError):
    """The controller has left the bus (ISO 11898-1); nothing is sent until it is restarted."""


class SdoAborted(DrivesError):
    """The drive answered an SDO request with an abort code (CiA 301 7.2.4.3.17)."""

    def __init__(self, index: int, sub: int, code: int, text: str) -> None:
        self.index = index
        self.sub = sub
        self.code = code
        self.text = text
        super().__init__(f"{index:04X}h:{sub:02X} aborted with {code:08X}h, {text}")


class SdoTimeout(DrivesError):
    """The drive did not answer an SDO request in time."""

    def __init__(self, index: int, sub: int, waited_ns: int) -> None:
        self.index = index
        self.sub = sub
        self.waited_ns = waited_ns
        super().__init__(f"no answer for {index:04X}h:{sub:02X} within {waited_ns / 1e6:.0f} ms")


class SdoGarbled(DrivesError):
    """The drive answered an SDO request with a frame that is no valid answer to it."""

    def __init__(self, index: int, sub: int, what: str) -> None:
        self.index = index
        self.sub = sub
        super().__init__(f"{index:04X}h:{sub:02X}: {what}")


class BootFailure(Enum):
    """Kind of failure in bringing up one node; the value starts the operator's message."""

    NO_ANSWER = "no answer"
    NO_NODE = "no other node is on the bus"
    WRONG_DEVICE_TYPE = "wrong device type"
    WRONG_VENDOR = "wrong vendor"
    WRONG_PRODUCT = "wrong product"
    WRONG_REVISION = "wrong revision"
    WRONG_SERIAL_NUMBER = "wrong serial number"
    MISSING_MODE = "a mode of operation is missing"
    WRONG_MOTOR_DATA = "wrong motor data"
    CONFIGURATION = "configuration failed"
    NO_HEARTBEAT = "no heartbeat"
    WRONG_STATE = "wrong state"
    NO_SAMPLES = "no samples"
    REBOOTED = "rebooted while being configured"
    DUPLICATE_NODE = "duplicate node"
    FOREIGN_MASTER = "another master on the bus"

    @property
    def letter(self) -> str:
        """Error status of CiA 302-2's process boot NMT slave, or "" where it has none."""
        return _LETTERS.get(self, "")

    def __str__(self) -> str:
        return f"{self.value} (CiA 302 {self.letter})" if self.letter else self.value


_LETTERS: Final = {
    BootFailure.NO_ANSWER: "B",
    BootFailure.WRONG_DEVICE_TYPE: "C",
    BootFailure.WRONG_VENDOR: "D",
    BootFailure.WRONG_STATE: "E",
    BootFailure.CONFIGURATION: "J",
    BootFailure.NO_HEARTBEAT: "K",
    BootFailure.WRONG_PRODUCT: "M",
    BootFailure.WRONG_REVISION: "N",
    BootFailure.WRONG_SERIAL_NUMBER: "O",
}
"""Letters as in Lely's CANopen library (`co_nmt_es2str`). Not used: A (every drive is in our
files), F (no node guarding), G to I (no software download), L (every drive is reset first)."""


class DriveSilent(DrivesError):
    """A drive does not answer, or rebooted during bring-up, which may be tried again.

    `drive` is empty where the failure is about the bus.
    """

    def __init__(self, drive: str, failure: BootFailure, what: str) -> None:
        self.drive = drive
        self.failure = failure
        self.what = what
        whose = f"drive {drive}: " if drive else ""
        super().__init__(f"{failure}: {whose}{what}")


class BringUpRefused(DrivesError):
    """A drive is not what the files describe, or refuses a setting; nothing was enabled.

    `place` is `index:sub` in hex, or empty when no object is concerned; `value` is the expected or
    the found one; `reason` holds the abort text or the comparison that failed.
    """

    def __init__(
        self, drive: str, failure: BootFailure, reason: str, *, place: str = "", value: str = ""
    ) -> None:
        self.drive = drive
        self.failure = failure
        self.place = place
        self.value = value
        self.reason = reason
        what = f" {place} = {value}" if place else ""
        super().__init__(f"{failure}: drive {drive}{what}: {reason}")


class DrivePowered(DrivesError):
    """A drive still holds the joint after an earlier stop; switching it off needs a request."""

    def __init__(self, drive: str, state: PowerState) -> None:
        self.drive = drive
        self.state = state
        super().__init__(f"drive {drive}: found powered, in {state.name}")


class CommandNotFinite(DrivesError):
    """A command that is not finite was about to be sent: a software error, never replaced by 0."""

    def __init__(self, quantity: str, value: float) -> None:
        self.quantity = quantity
        self.value = value
        super().__init__(f"{quantity} to be sent is {value}")
