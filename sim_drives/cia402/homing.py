"""Homing (mode 6): the methods as tables, and the state machine that executes them.

Rules:
1. A method is a row of METHODS: searches one after the other, each in one direction at one speed
   until one event. The end of the last search is the reference. A method without searches takes
   the present position.
2. The reference then reads 607Ch, on an EPOS4-like drive 30B0h, and the axis is referenced. Until
   the axis has come to rest, homing is attained but its target not reached.
3. Fast is 6099h:1, slow 6099h:2, both with 609Ah. An EPOS4-like drive moves on by 30B1h counts:
   away from the switch or stop that it found, else by its sign; the end of that move reads 30B0h.
4. INDEX is once per turn of the motor, where the encoder's own count is a multiple of a turn; the
   encoder latches it, so the reference is that count at any speed.
5. STALL is a motor current of 30B2h for STALL_NS; the current is limited to it in that search, so a
   threshold below the current needed to move detects a stop at the present position.
6. A search fails when its time (`homing_time_s`) runs out, the axis is blocked, an index is not
   found within INDEX_TURNS, or a limit switch that is not its target lies ahead. In the search
   for the home switch a limit switch reverses the search instead, once.
7. Halt, another mode, and whatever ends "operation enabled" interrupt; a new start is a new rising
   edge of controlword bit 4. No error of homing is a fault.

An EPOS4-like drive takes the present position by method 37 alone, the others by 35, too. Only it
has the stop methods.

Sources: CiA 402-2 homing methods as drives' manuals reproduce them; maxon's fifteen methods with
30B0h to 30B2h after the EPOS4 Firmware Specification, 3.5.3, as Imcab/EposLibDocs cites it.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple

from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.objects import Object
from sim_drives.canopen.timers import MILLISECOND
from sim_drives.cia402.measurement import (
    HOME_SWITCH,
    NEGATIVE_SWITCH,
    POSITIVE_SWITCH,
    Measurement,
    Reading,
)
from sim_drives.cia402.power_state import StatusBit
from sim_drives.cia402.scaling import Scaling
from sim_drives.plant.actuation import AxisFlag
from sim_drives.settings import DriveSettings, PersonalityName

POLL_NS: Final = 1 * MILLISECOND
"""Period at which the drive's firmware checks for the event."""
STALL_NS: Final = 20 * MILLISECOND
STALL_CURRENT_RATIO: Final = 0.95
BLOCKED_NS: Final = 1000 * MILLISECOND
BLOCKED_RATIO: Final = 0.15
"""An axis that moves less than this share of the set speed within BLOCKED_NS is blocked."""
INDEX_TURNS: Final = 1.5
HOME_OFFSET: Final = (Object.HOME_OFFSET, 0)
HOME_POSITION: Final = (Object.EPOS4_HOME_POSITION, 0)
MOVE_DISTANCE: Final = (Object.EPOS4_HOME_DISTANCE, 0)
CURRENT_THRESHOLD: Final = (Object.EPOS4_HOME_CURRENT, 0)


class Until(Enum):
    """End condition of a search: a mask of 60FDh and its required value, or another event."""

    NEGATIVE_ON = (NEGATIVE_SWITCH, True)
    NEGATIVE_OFF = (NEGATIVE_SWITCH, False)
    POSITIVE_ON = (POSITIVE_SWITCH, True)
    POSITIVE_OFF = (POSITIVE_SWITCH, False)
    HOME_ON = (HOME_SWITCH, True)
    HOME_OFF = (HOME_SWITCH, False)
    INDEX = "index pulse"
    STALL = "mechanical stop"
    DISTANCE = "30B1h"


LEFT_BEHIND: Final = (Until.NEGATIVE_ON, Until.POSITIVE_ON, Until.STALL)
"""The events from which 30B1h moves away (rule 3)."""


class Search(NamedTuple):
    """One move in one direction, as the drive counts it."""

    direction: int
    fast: bool
    until: Until


def _beside(direction: int, on: Until, off: Until) -> tuple[Search, Search]:
    """Searches that reach a switch fast, and leave it slowly."""
    return Search(direction, True, on), Search(-direction, False, off)


_NEGATIVE_LIMIT = _beside(-1, Until.NEGATIVE_ON, Until.NEGATIVE_OFF)
_POSITIVE_LIMIT = _beside(+1, Until.POSITIVE_ON, Until.POSITIVE_OFF)
_HOME_FROM_BELOW = _beside(+1, Until.HOME_ON, Until.HOME_OFF)
_HOME_FROM_ABOVE = _beside(-1, Until.HOME_ON, Until.HOME_OFF)
_NEGATIVE_STOP = (Search(-1, True, Until.STALL),)
_POSITIVE_STOP = (Search(+1, True, Until.STALL),)
_INDEX_BELOW = (Search(-1, False, Until.INDEX),)
_INDEX_ABOVE = (Search(+1, False, Until.INDEX),)

METHODS: Final[Mapping[int, tuple[Search, ...]]] = MappingProxyType(
    {
        -4: _NEGATIVE_STOP,
        -3: _POSITIVE_STOP,
        -2: _NEGATIVE_STOP + _INDEX_ABOVE,
        -1: _POSITIVE_STOP + _INDEX_BELOW,
        1: _NEGATIVE_LIMIT + _INDEX_ABOVE,
        2: _POSITIVE_LIMIT + _INDEX_BELOW,
        7: _HOME_FROM_BELOW + _INDEX_BELOW,
        11: _HOME_FROM_ABOVE + _INDEX_ABOVE,
        17: _NEGATIVE_LIMIT,
        18: _POSITIVE_LIMIT,
        23: _HOME_FROM_BELOW,
        27: _HOME_FROM_ABOVE,
        33: _INDEX_BELOW,
        34: _INDEX_ABOVE,
        35: (),
        37: (),
    }
)


STALL_METHODS: Final = frozenset(number for number in METHODS if number < 0)


class Progress(Enum):
    """Homing progress; the value is the statusword's bits 10, 12 and 13."""

    NOT_STARTED = (1, 0, 0)
    SEARCHING = (0, 0, 0)
    ATTAINED = (0, 1, 0)
    """Reference found; moving by 30B1h, or decelerating."""
    DONE = (1, 1, 0)
    FAILING = (0, 0, 1)
    """Decelerating to rest."""
    FAILED = (1, 0, 1)


COMING_TO_REST: Final = {Progress.ATTAINED: Progress.DONE, Progress.FAILING: Progress.FAILED}


class Travel(NamedTuple):
    """Motion request of a running search."""

    direction: int
    speed_raw: int
    current_limit_ma: int | None
    """Torque limit below the drive's own; only towards a mechanical stop."""


class Homing:
    """Homing state of one drive."""

    def __init__(
        self,
        settings: DriveSettings,
        context: NodeContext,
        scaling: Scaling,
        measurement: Measurement,
    ) -> None:
        self._dictionary, self._line, self._timers = context
        self._scaling = scaling
        self._measurement = measurement
        self._counts_per_rev = settings.counts_per_rev
        self._time_ns = round(settings.homing_time_s * 1e9)
        epos4 = settings.personality is PersonalityName.EPOS4
        self.methods = METHODS.keys() - ({35} if epos4 else STALL_METHODS)
        self.progress = Progress.NOT_STARTED
        self._method: tuple[Search, ...] = ()
        self._searches: list[Search] = []
        self._ends_ns = 0
        self._turned = False
        self._goal_counts = 0
        self._begin_watch(Reading(0, 0))

    # --- interface --------------------------------------------------------------------------------

    @property
    def status_bits(self) -> int:
        """Bits 10, 12 and 13 of the statusword."""
        reached, attained, error = self.progress.value
        return (
            StatusBit.TARGET_REACHED * reached
            | StatusBit.FOLLOWS * attained
            | StatusBit.FOLLOWING_ERROR * error
        )

    @property
    def moves(self) -> bool:
        """True while the axis moves for a homing, or decelerates after it."""
        return self.progress not in (Progress.NOT_STARTED, Progress.DONE, Progress.FAILED)

    @property
    def travel(self) -> Travel | None:
        """The running search; None to come to rest."""
        if not self._searches:
            return None
        search = self._searches[0]
        threshold = self._dictionary.value(*CURRENT_THRESHOLD) if self._stalls else None
        return Travel(search.direction, self._speed_raw(search), threshold)

    def start(self) -> None:
        """Start homing at the rising edge of controlword bit 4; method 0, as delivered, is none."""
        method = self._dictionary.value(Object.HOMING_METHOD)
        if method not in METHODS:
            return
        self._method = METHODS[method]
        self._searches = list(self._method)
        self._turned = False
        self._ends_ns = self._line.now_ns + self._time_ns
        self.progress = Progress.SEARCHING
        reading = self._measurement.read()
        self._begin_watch(reading)
        if not self._searches:
            self._attain(reading.counts)
        self._poll_again()

    def interrupt(self) -> None:
        """Interrupt homing (rule 7); a reference already set stays."""
        if self.moves:
            self.reset()

    def reset(self) -> None:
        """Reset to "not started" when homing mode is entered again."""
        self._timers.cancel(Homing)
        self._searches = []
        self.progress = Progress.NOT_STARTED

    # --- the search ---------------------------------------------------------------------------

    @property
    def _stalls(self) -> bool:
        return self._searches[0].until is Until.STALL

    def _speed_raw(self, search: Search) -> int:
        return self._dictionary.value(Object.HOMING_SPEEDS, 1 if search.fast else 2)

    def _poll_again(self) -> None:
        if self.moves:
            self._timers.start(Homing, self._line.now_ns + POLL_NS, self._poll)

    def _poll(self) -> None:
        reading = self._measurement.read()
        if self._searches:
            self._check_event(reading)
        elif self._measurement.flags() & AxisFlag.STANDSTILL:
            self._arrive()
        self._reading = reading
        self._poll_again()

    def _check_event(self, reading: Reading) -> None:
        search = self._searches[0]
        found_counts = self._event_counts(search, reading)
        if found_counts is not None:
            self._next_search(found_counts, reading)
        elif self._turns_round(search):
            self._turned = True
            self._searches[0] = search._replace(direction=-search.direction)
            self._begin_watch(reading)
        elif self._has_failed(search, reading):
            self._searches = []
            self.progress = Progress.FAILING

    def _next_search(self, found_counts: int, reading: Reading) -> None:
        search = self._searches.pop(0)
        self._begin_watch(reading)
        if not self._searches and search.until is not Until.DISTANCE:
            self._attain(found_counts)

    def _attain(self, reference_counts: int) -> None:
        """Set the reference (rules 2 and 3)."""
        self.progress = Progress.ATTAINED
        distance = self._move_distance()
        self._goal_counts = reference_counts + distance
        if distance:
            self._searches = [Search(1 if distance > 0 else -1, False, Until.DISTANCE)]
        elif not self._method:
            self._arrive()

    def _move_distance(self) -> int:
        distance = self._dictionary.value_or(*MOVE_DISTANCE, 0)
        if self._method and self._method[0].until in LEFT_BEHIND:
            return -self._method[0].direction * abs(distance)
        return distance

    def _arrive(self) -> None:
        self.progress = COMING_TO_REST[self.progress]
        if self.progress is Progress.DONE:
            home = HOME_POSITION if HOME_POSITION in self._dictionary else HOME_OFFSET
            self._measurement.home(self._goal_counts, self._dictionary.value(*home))

    # --- events -------------------------------------------------------------------------------

    def _event_counts(self, search: Search, reading: Reading) -> int | None:
        """Return the encoder counts of the search's event once it has happened."""
        match search.until:
            case Until.INDEX:
                return self._index(search.direction, reading.counts)
            case Until.STALL:
                return reading.counts if self._stalled(reading) else None
            case Until.DISTANCE:
                left = (self._goal_counts - reading.counts) * search.direction
                return reading.counts if left <= 0 else None
            case _:
                mask, level = search.until.value
                inputs = self._inputs()
                return reading.counts if bool(inputs & mask) is level else None

    def _index(self, direction: int, counts: int) -> int | None:
        """Return the counts of an index (rule 4)."""
        turn = self._counts_per_rev
        if (counts - self._reading.counts) * direction <= 0:
            return None
        if counts // turn == self._reading.counts // turn:
            return None
        return (counts // turn if direction > 0 else -(-counts // turn)) * turn

    def _stalled(self, reading: Reading) -> bool:
        """Return the counts of a stall (rule 5)."""
        threshold_ma = self._dictionary.value(*CURRENT_THRESHOLD)
        if abs(reading.current_ma) < STALL_CURRENT_RATIO * threshold_ma:
            self._pressed_since_ns = self._line.now_ns
        return self._line.now_ns - self._pressed_since_ns >= STALL_NS

    def _turns_round(self, search: Search) -> bool:
        ahead = self._switch_ahead(search.direction)
        return search.until is Until.HOME_ON and ahead and not self._turned

    def _inputs(self) -> int:
        return self._measurement.inputs(self._measurement.flags())

    def _switch_ahead(self, direction: int) -> bool:
        ahead = POSITIVE_SWITCH if direction > 0 else NEGATIVE_SWITCH
        return bool(self._inputs() & ahead)

    def _has_failed(self, search: Search, reading: Reading) -> bool:
        """Return whether the search has failed (rule 6)."""
        if self._line.now_ns >= self._ends_ns:
            return True
        travelled = abs(reading.counts - self._begun_counts)
        if search.until is Until.INDEX and travelled > INDEX_TURNS * self._counts_per_rev:
            return True
        if search.until in (Until.INDEX, Until.HOME_ON) and self._switch_ahead(search.direction):
            return True
        return search.until is not Until.STALL and self._blocked(search, reading)

    def _blocked(self, search: Search, reading: Reading) -> bool:
        self._lowest = min(self._lowest, reading.counts)
        self._highest = max(self._highest, reading.counts)
        elapsed_ns = self._line.now_ns - self._watched_since_ns
        if elapsed_ns < BLOCKED_NS:
            return False
        counts_per_s = self._scaling.counts_per_s(self._speed_raw(search))
        least = BLOCKED_RATIO * counts_per_s * elapsed_ns * 1e-9
        blocked = self._highest - self._lowest < least
        self._watch_travel(reading)
        return blocked

    def _begin_watch(self, reading: Reading) -> None:
        """Reset the watch at the start of a search."""
        self._reading = reading
        self._begun_counts = reading.counts
        self._pressed_since_ns = self._line.now_ns
        self._watch_travel(reading)

    def _watch_travel(self, reading: Reading) -> None:
        self._watched_since_ns = self._line.now_ns
        self._lowest = self._highest = reading.counts
