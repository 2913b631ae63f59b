"""Simulated time: a world, the seats (programs) on its bus, and when each seat may continue.

A `Conductor` has no socket and no clock. A seat sends frames and requests time; `step` advances
time to the first instant at which a seat may continue. In memory a `DirectLink` steps by itself
until its own seat may continue (`gaitd_lab.lockstep`); between processes `server.py` steps once
every seat that is in step waits. Both give the same frames at the same instants.

Rules:
1.  Frames take no time on this bus. A frame of a seat reaches the drives and every other seat at
    the world's present time.
2.  A wait is over at its instant; one for a frame is over at the first frame as well.
3.  Actions can be scheduled with `at` for any instant, also in the middle of a wait.
4.  `hold` stops a seat and not the world (a frozen process); `pause` stops the seat's clock with it
    (a machine that was suspended).
5.  A seat may have a computing cost, drawn when it answers its last grant: the answer is delayed by
    it, and the next wait begins there. Frames sent at a given instant, such as SYNC, leave at once.
    Seats compute at the same time, as processes do, so the order in which their messages come
    changes nothing.
"""

import heapq
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import Final, Protocol

from drives.canopen.frame import Frame
from sim_drives.world import SYNC_ID
from simtime.link import LinkLostError

UTC_OF_START_NS: Final = 1_767_225_600_000_000_000
"""Simulated UTC at time 0 of a world in memory: 2026-01-01."""
COST_MIN_NS, COST_MAX_NS = 300_000, 3_000_000


@dataclass(slots=True)
class BusTrouble:
    """Disturbance of a seat's own interface to the bus."""

    queue_full: bool = False
    """The transmit queue is full."""
    is_off: bool = False
    """The controller is off the bus: sent frames are lost, and none is received."""
    is_gone: bool = False
    """The interface does not exist: using it is an error."""
    sync_delay_ns: int = 0
    """SYNC is delayed by this time on its way to the wire."""


class World(Protocol):
    """The part of `sim_drives.world.World` that a conductor needs."""

    @property
    def now_ns(self) -> int:
        """Simulated time."""
        ...

    def receive(self, frame: Frame) -> None:
        """Deliver a frame of a seat."""
        ...

    def advance_to(self, time_ns: int) -> list[Frame]:
        """Advance time; return the frames of the drives."""
        ...

    def next_event_ns(self) -> int:
        """Return the time of the drives' next event."""
        ...


@dataclass(slots=True)
class _Wait:
    until_ns: int
    """End of the wait, in the seat's time."""
    for_frame: bool


class Seat:
    """A program on the simulated bus, as the conductor sees it."""

    def __init__(self, world: World, name: str, *, in_step: bool) -> None:
        """Use `Conductor.join` to make one."""
        self._world = world
        self.name = name
        self.in_step = in_step
        """True if time waits for the seat."""
        self.is_excused = False
        """True if the seat is in step but not waited for now: its process is stopped or hangs."""
        self.waiting: list[Frame] = []
        """Received frames that the seat has not taken."""
        self.sent: list[Frame] = []
        """Every frame that the seat has put on the wire, in order, with the world's time."""
        self.keeps_sent = True
        self.trouble = BusTrouble()
        self.behind_ns = 0
        """Offset of the seat's clock behind the world's."""
        self.utc_ahead_ns = UTC_OF_START_NS
        self.cost: Callable[[], int] | None = None
        """Draws the computing time before an answer, in ns."""
        self.wait: _Wait | None = None
        self.held_until_ns = 0
        self.owes_cost = False
        self.busy_until_ns = 0
        """End of the present computation, in the world's time."""

    def now_ns(self) -> int:
        """Return the monotonic time of the seat: the world's, less the time it was suspended."""
        return self._world.now_ns - self.behind_ns

    def utc_ns(self) -> int:
        """Return the time of the seat's wall clock."""
        return self.utc_of_ns(self.now_ns())

    def utc_of_ns(self, seat_ns: int) -> int:
        """Return the seat's wall clock, as set now, at one of its monotonic times."""
        return self.utc_ahead_ns + seat_ns

    def check(self) -> None:
        """Check that the interface exists.

        Raises:
            LinkLostError: it does not.
        """
        if self.trouble.is_gone:
            raise LinkLostError("the interface was removed")

    def hold(self, duration_ns: int) -> None:
        """Stop the seat from now on; its clock continues."""
        self.held_until_ns = max(self.held_until_ns, self._world.now_ns + duration_ns)

    def pause(self, duration_ns: int) -> None:
        """Stop the seat and its clock from now on."""
        self.behind_ns += duration_ns

    def report(self, frame: Frame) -> None:
        """Deliver an error frame of the seat's own controller."""
        self.waiting.append(frame._replace(is_error=True))

    def world_until_ns(self, seat_ns: int) -> int:
        """Return the world's time that must be reached before the seat may continue."""
        return max(seat_ns + self.behind_ns, self.held_until_ns, self.busy_until_ns)


class Conductor:
    """A world and its seats."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.seats: list[Seat] = []
        self._agenda: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    # --- seats --------------------------------------------------------------------------------

    def join(self, name: str, *, in_step: bool = True) -> Seat:
        """Add a seat."""
        seat = Seat(self.world, name, in_step=in_step)
        self.seats.append(seat)
        return seat

    def leave(self, seat: Seat) -> None:
        """Remove a seat; frames already sent remain on the bus."""
        self.seats.remove(seat)

    def at(self, world_ns: int, action: Callable[[], None]) -> None:
        """Schedule an action at a time of the world, independent of the seats."""
        heapq.heappush(self._agenda, (world_ns, next(self._order), action))

    def send(self, seat: Seat, frames: Sequence[Frame]) -> int:
        """Send frames of a seat; return the number that did not fit into its queue.

        Raises:
            LinkLostError: its interface does not exist.
        """
        seat.check()
        if seat.trouble.queue_full:
            return len(frames)
        if seat.cost is not None and seat.owes_cost:
            seat.owes_cost = False
            seat.busy_until_ns = self.world.now_ns + seat.cost()
        for frame in frames:
            if seat.busy_until_ns > self.world.now_ns:
                self.at(seat.busy_until_ns, partial(self._place, seat, frame))
            else:
                self._place(seat, frame)
        return 0

    def _place(self, seat: Seat, frame: Frame) -> None:
        if seat.trouble.sync_delay_ns and frame.can_id == SYNC_ID:
            at_ns = self.world.now_ns + seat.trouble.sync_delay_ns
            self.at(at_ns, lambda: self._deliver(seat, frame))
        elif not seat.trouble.is_off:
            self._deliver(seat, frame)

    def _deliver(self, seat: Seat, frame: Frame) -> None:
        if seat.keeps_sent:
            seat.sent.append(Frame(frame.can_id, frame.data, self.world.now_ns, frame.is_error))
        self.world.receive(frame)
        for other in self.seats:
            if other is not seat and not other.trouble.is_off:
                other.waiting.append(frame._replace(time_ns=other.utc_ns()))

    # --- time ---------------------------------------------------------------------------------

    def start_wait(self, seat: Seat, until_ns: int, *, for_frame: bool) -> None:
        """Let a seat wait until an instant of its clock, or until the first frame."""
        if for_frame or until_ns >= seat.now_ns() or seat.busy_until_ns > self.world.now_ns:
            seat.wait = _Wait(until_ns, for_frame)

    def missing(self) -> Seat | None:
        """Return a seat that time waits for; None: time may pass."""
        for seat in self.seats:
            if seat.in_step and seat.wait is None and not seat.is_excused:
                return seat
        return None

    def step(self, limit_ns: int | None = None) -> list[Seat]:
        """Advance time to the first instant at which a seat may continue; return those seats.

        Args:
            limit_ns: time passes no further.
        """
        targets = [(seat, self._target_ns(seat, seat.wait)) for seat in self.seats if seat.wait]
        if not targets and limit_ns is None:
            return []
        goal_ns = _goal_ns(targets, limit_ns)
        while self._agenda and self._agenda[0][0] <= goal_ns:
            due_ns, _, action = heapq.heappop(self._agenda)
            self._advance(max(due_ns, self.world.now_ns))
            action()
            goal_ns = _goal_ns(targets, limit_ns)
        self._advance(max(goal_ns, self.world.now_ns))
        return [
            seat
            for seat, target_ns in targets
            if seat.world_until_ns(target_ns) <= self.world.now_ns and _goes_on(seat)
        ]

    def _target_ns(self, seat: Seat, wait: _Wait) -> int:
        """Return how far, in its own time, a seat's wait lets time pass in one step."""
        if not wait.for_frame:
            return wait.until_ns
        if seat.waiting:
            return seat.now_ns()
        event_ns = self.world.next_event_ns()
        if self._agenda:
            event_ns = min(event_ns, self._agenda[0][0])
        return min(max(event_ns - seat.behind_ns, seat.now_ns()), wait.until_ns)

    def _advance(self, world_ns: int) -> None:
        for timed in self.world.advance_to(world_ns):
            for seat in self.seats:
                if not seat.trouble.is_off:
                    stamp_ns = seat.utc_ahead_ns + timed.time_ns - seat.behind_ns
                    seat.waiting.append(Frame(timed.can_id, timed.data, stamp_ns))


def _goes_on(seat: Seat) -> bool:
    """Return whether a seat's wait is over at the instant of the step."""
    wait = seat.wait
    if wait is None:
        return False
    if wait.for_frame and not seat.waiting and seat.now_ns() < wait.until_ns:
        return False
    seat.wait = None
    seat.owes_cost = bool(seat.waiting)
    return True


def _goal_ns(targets: Sequence[tuple[Seat, int]], limit_ns: int | None) -> int:
    """Return the first instant at which one of these seats may continue, or the limit."""
    reached = [seat.world_until_ns(target_ns) for seat, target_ns in targets]
    if limit_ns is not None:
        reached.append(limit_ns)
    return min(reached)


def computing_cost(seed: int, seat: str) -> Callable[[], int]:
    """Return a generator of computing times before an answer, in ns; one stream per seat."""
    draw = random.Random(f"{seed}/{seat}")
    return lambda: draw.randint(COST_MIN_NS, COST_MAX_NS)


class DirectLink:
    """A `simtime.link.Link` in the process of the world: it advances time by itself."""

    def __init__(self, conductor: Conductor, seat: Seat) -> None:
        self._conductor, self._seat = conductor, seat
        self.now_ns = seat.now_ns
        """As `Link.now_ns`."""
        self.utc_ns = seat.utc_ns
        """As `Link.utc_ns`."""
        self.open = self.check = seat.check
        """As `Link.open` and `Link.check`."""

    @property
    def is_in_step(self) -> bool:
        """As `Link.is_in_step`: always."""
        return True

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Link.send`."""
        return self._conductor.send(self._seat, frames)

    def wait(self, until_ns: int, *, for_frame: bool) -> None:
        """As `Link.wait`."""
        self._conductor.start_wait(self._seat, until_ns, for_frame=for_frame)
        while self._seat.wait is not None:
            self._conductor.step()

    def take(self) -> list[Frame]:
        """As `Link.take`."""
        frames, self._seat.waiting = self._seat.waiting, []
        return frames
