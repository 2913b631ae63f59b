"""One PDO as configured by its dictionary objects (CiA 301 7.5.2.35 to 38)."""

from collections.abc import Callable
from itertools import starmap
from typing import Final, NamedTuple

from sim_drives.canopen.dictionary import Address, ObjectDictionary
from sim_drives.canopen.pdo_rules import (
    PDO_COUNT,
    SUB_EVENT_TIMER,
    SUB_INHIBIT,
    SUB_SYNC_START,
    SUB_TYPE,
    Direction,
    Layout,
    PdoObjects,
)
from sim_drives.canopen.timers import MILLISECOND

LAST_SYNCHRONOUS_TYPE: Final = 240
_INHIBIT_STEP_NS: Final = 100_000
Values = list[tuple[Address, int]]


class Settings(NamedTuple):
    """The configuration of one PDO, read from its objects."""

    valid: bool
    """False without a mapped object, too."""
    can_id: int
    type: int
    synchronous: bool
    inhibit_ns: int
    event_timer_ns: int
    sync_start: int
    layout: Layout


class Channel:
    """One PDO; its settings are read again only after one of its objects has been written."""

    def __init__(self, objects: PdoObjects, written: Callable[[int], None]) -> None:
        """`written` receives the PDO's number, from 0, when one of its objects has been written."""
        self._objects = objects
        self._written = written
        self._settings: Settings | None = None
        objects.install_guards()
        for index in (objects.parameters, objects.mapping):
            objects.dictionary.watch(index, lambda _: self.invalidate())

    @property
    def number(self) -> int:
        """PDO number, counted from 1."""
        return self._objects.number + 1

    @property
    def can_id(self) -> int | None:
        """CAN identifier; None if the PDO does not exist, or has no mapped object."""
        return self._objects.can_id if self._objects.used else None

    @property
    def settings(self) -> Settings:
        """Return the present configuration."""
        if self._settings is None:
            self._settings = self._read()
        return self._settings

    def invalidate(self) -> None:
        """Drop the cached configuration: parameters have changed."""
        self._settings = None
        self._written(self._objects.number)

    def pack(self) -> bytes:
        """Pack the mapped values in their order."""
        packing, addresses = self.settings.layout
        return packing.pack(*starmap(self._objects.dictionary.value, addresses))

    def _read(self) -> Settings:
        objects = self._objects
        kind = objects.dictionary.value(objects.parameters, SUB_TYPE)
        return Settings(
            valid=objects.used,
            can_id=objects.can_id,
            type=kind,
            synchronous=kind <= LAST_SYNCHRONOUS_TYPE,
            inhibit_ns=self._optional(SUB_INHIBIT) * _INHIBIT_STEP_NS,
            event_timer_ns=self._optional(SUB_EVENT_TIMER) * MILLISECOND,
            sync_start=self._optional(SUB_SYNC_START),
            layout=objects.layout(),
        )

    def _optional(self, subindex: int) -> int:
        return self._objects.dictionary.value_or(self._objects.parameters, subindex, 0)


def channels(
    dictionary: ObjectDictionary,
    direction: Direction,
    written: Callable[[int], None],
    *,
    locked: bool,
) -> list[Channel]:
    """Return all PDOs of one direction."""
    return [
        Channel(PdoObjects(dictionary, direction, number, locked), written)
        for number in range(PDO_COUNT)
    ]
