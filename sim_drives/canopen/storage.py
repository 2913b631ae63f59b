"""Saving and restoring parameters: 1010h and 1011h (CiA 301 7.5.2.13, 14).

Rules:
1. 1010h = "save" keeps parameters for the next reset; 1011h = "load" makes the next reset take the
   delivered ones. Sub-index 1 means all of them, 2 those of communication, 3 those of the device
   profile, 4, a maker's own, all of them, as far as the drive has these. Any other value is
   08000020. Both are refused with 08000022 while the power stage is on.
2. Reset node restores all, reset communication 1000h to 1FFFh.
3. Delivered parameters are the EDS's values with the motor data set at commissioning.
4. Commanded values (controlword, mode, targets and their offsets) are never saved.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.dictionary import COMMUNICATION_AREA, Address, ObjectDictionary, Value
from sim_drives.canopen.objects import Object

SAVE_SIGNATURE: Final = int.from_bytes(b"save", "little")
LOAD_SIGNATURE: Final = int.from_bytes(b"load", "little")
AREAS: Final[Mapping[int, range]] = MappingProxyType(
    {
        1: range(0x1000, 0x10000),
        2: COMMUNICATION_AREA,
        3: range(0x6000, 0xA000),
        4: range(0x1000, 0x10000),
    }
)
"""Index range that a sub-index of 1010h and 1011h covers."""
NEVER_KEPT: Final = frozenset(
    {
        Object.ERROR_HISTORY,
        Object.STORE,
        Object.RESTORE,
        Object.CONTROLWORD,
        Object.MODE,
        Object.TARGET_TORQUE,
        Object.TARGET_POSITION,
        Object.POSITION_OFFSET,
        Object.VELOCITY_OFFSET,
        Object.TORQUE_OFFSET,
        Object.TARGET_VELOCITY,
    }
)


class Storage:
    """The non-volatile memory of one drive."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        commissioned: Mapping[Address, Value],
        power_stage_on: Callable[[], bool],
    ) -> None:
        self._dictionary = dictionary
        self._commissioned = dict(commissioned)
        self._power_stage_on = power_stage_on
        self._saved: dict[Address, Value] = {}
        self._to_deliver: set[int] = set()
        """Sub-indices of 1011h that the next reset applies."""
        for index, signature in ((Object.STORE, SAVE_SIGNATURE), (Object.RESTORE, LOAD_SIGNATURE)):
            dictionary.guard(index, lambda _, value, s=signature: self._check(value, s))
        dictionary.watch(Object.STORE, self._save)
        dictionary.watch(Object.RESTORE, self._load_delivered)

    def restore(self, *, communication_only: bool) -> None:
        """Restore parameters by rule 2."""
        for area in self._to_deliver:
            self._saved = {a: v for a, v in self._saved.items() if a[0] not in AREAS[area]}
        self._to_deliver.clear()
        parameters = self._dictionary.defaults() | self._commissioned | self._saved
        self._dictionary.restore(parameters, communication_only=communication_only)

    def exchange(self, address: Address, value: Value) -> None:
        """Replace the drive by one delivered with this value; acts from the next reset on."""
        self._commissioned[address] = value

    def _check(self, value: int, signature: int) -> None:
        if self._power_stage_on():
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        if value != signature:
            raise SdoAbortError(AbortCode.CANNOT_STORE)

    def _save(self, area: int) -> None:
        self._dictionary.put(Object.STORE, area, 1)
        for address, value in self._dictionary.parameters().items():
            if address[0] in AREAS[area] and address[0] not in NEVER_KEPT:
                self._saved[address] = value

    def _load_delivered(self, area: int) -> None:
        self._dictionary.put(Object.RESTORE, area, 1)
        self._to_deliver.add(area)
