"""SDO abort codes of CiA 301 (table 22) that the virtual drives use."""

from enum import IntEnum


class AbortCode(IntEnum):
    """The four-byte code of an SDO abort."""

    TOGGLE_BIT = 0x0503_0000
    """Toggle bit not alternated."""
    TIMEOUT = 0x0504_0000
    COMMAND_SPECIFIER = 0x0504_0001
    """Client/server command specifier not valid or unknown."""
    BLOCK_SIZE = 0x0504_0002
    SEQUENCE_NUMBER = 0x0504_0003
    CRC = 0x0504_0004
    OUT_OF_MEMORY = 0x0504_0005
    UNSUPPORTED_ACCESS = 0x0601_0000
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_TOO_LONG = 0x0604_0042
    PARAMETER_INCOMPATIBLE = 0x0604_0043
    LENGTH = 0x0607_0010
    """Length of the service parameter does not match."""
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUBINDEX = 0x0609_0011
    RANGE = 0x0609_0030
    TOO_HIGH = 0x0609_0031
    TOO_LOW = 0x0609_0032
    MAXIMUM_BELOW_MINIMUM = 0x0609_0036
    CANNOT_STORE = 0x0800_0020
    """Data cannot be transferred or stored to the application."""
    DEVICE_STATE = 0x0800_0022
    """Data cannot be transferred or stored because of the present device state."""
    NO_DATA = 0x0800_0024
    """No data available."""


class SdoAbortError(Exception):
    """The request is refused; the server answers with the abort `code`."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(f"SDO abort {code:08X}h ({code.name})")
        self.code = code
