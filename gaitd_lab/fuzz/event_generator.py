"""Random events of a session, drawn from a seed.

A session draws an `Action` at random intervals. Actions of an operator who keeps the machine
walking (`_helpful`: reset, enable, walk) alternate with arbitrary ones (`_anything`); without the
former nearly all of the time would be spent in fault.
"""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from daemon.ipc.record import Mode, ModeRequest, RequestKind
from sim_drives.faults.script import EVERY_DRIVE, FaultOrder
from sim_drives.settings import FaultKind

HELPFUL_RATIO: Final = 0.6
PAUSE_MEAN_S: Final = 0.8
PAUSE_MIN_S: Final = 0.02
STOPPED_ENABLE_RATIO: Final = 0.1
"""Share of the helpful ENABLEs with a stop from another client in the same cycle."""
FAULT_S: Final = (0.02, 2.5)


class Kind(Enum):
    """Kind of event."""

    REQUEST = "request"
    STOP = "stop"
    STOP_AND_REQUEST = "stop and a request at once"
    FAULT = "fault"
    PATIENT = "patient"
    FRAMES_LOST = "frames lost"
    LOOP_LATE = "loop late"
    GATEWAY_SILENT = "gateway silent"
    GATEWAY_RESTART = "gateway restarted"
    LEASE = "lease acquired"
    LEASE_ENDED = "lease ended"
    CONTROLLER_DEAD = "controller dead"
    CORE_KILLED = "core killed"
    CORE_ENDED = "core ended in order"
    NOTHING = "nothing"


NO_MODE: Final = ModeRequest()


@dataclass(frozen=True, slots=True)
class Action:
    """One event."""

    kind: Kind
    request: RequestKind = RequestKind.NONE
    wanted: ModeRequest = NO_MODE
    fault: FaultOrder | None = None
    programme: str = ""
    duration_s: float = 0.0
    loss_ratio: float = 0.0

    def __str__(self) -> str:
        words = [self.kind.value]
        if self.request != RequestKind.NONE:
            words.append(self.request.name.lower())
            if self.request == RequestKind.MODE:
                words.append(str(self.wanted))
        if self.fault is not None:
            fault = self.fault
            words += [fault.kind.value, fault.drive, f"{fault.duration_s:.3f}", f"{fault.value:g}"]
        words += [self.programme] * bool(self.programme)
        words += [f"for {self.duration_s:.3f} s"] * bool(self.duration_s)
        words += [f"ratio {self.loss_ratio:.3f}"] * bool(self.loss_ratio)
        return " ".join(words)


_EMCY_CODES: Final = (0x2310, 0x3210, 0x3220, 0x4310, 0x5441, 0x7320, 0x8120, 0x8611, 0xFF01)

_VALUES: Final[Mapping[FaultKind, Callable[[random.Random], float]]] = {
    FaultKind.LOST_TPDO: lambda r: r.randrange(0, 4),
    FaultKind.LATE_TPDO: lambda r: r.uniform(0.5, 25.0),
    FaultKind.TPDO_ALL_ONES: lambda r: r.randrange(1, 4),
    FaultKind.EMCY: lambda r: r.choice(_EMCY_CODES),
    FaultKind.REFUSES_OBJECT: lambda r: r.choice((0x6065, 0x607D, 0x6085, 0x1016)),
    FaultKind.WRONG_IDENTITY: lambda r: r.choice((0, 0x1234)),
    FaultKind.SLOW_STATE: lambda r: r.uniform(1.0, 200.0),
    FaultKind.ENCODER_GLITCH: lambda r: r.choice((-1, 1)) * r.choice((2, 50, 500, 20_000)),
    FaultKind.TORQUE_OFFSET: lambda r: r.uniform(-1500.0, 1500.0),
    FaultKind.HOME_SWITCH_STUCK: lambda r: r.randrange(2),
}
"""Faults with a value; all others have none."""

_ODD_NUMBERS: Final = (0.0, -1.0, math.nan, math.inf, -math.inf, 1e300, 1e-300)


class EventGenerator:
    """The random generator of one session."""

    def __init__(
        self,
        rng: random.Random,
        drives: Sequence[str],
        programmes: Sequence[str],
        scenarios: Sequence[str],
        cadence_max_hz: float,
    ) -> None:
        self._rng = rng
        self._drives = tuple(drives)
        self._programmes = tuple(programmes)
        self._scenarios = tuple(scenarios)
        self._cadence_max_hz = cadence_max_hz

    def pause_s(self) -> float:
        """Draw the time until the next action."""
        return max(PAUSE_MIN_S, self._rng.expovariate(1.0 / PAUSE_MEAN_S))

    def next(self, mode: Mode, *, lease_held: bool = False) -> Action:
        """Draw the next action."""
        helpful = self._rng.random() < HELPFUL_RATIO
        return self._helpful(mode, lease_held=lease_held) if helpful else self._anything()

    def _helpful(self, mode: Mode, *, lease_held: bool) -> Action:
        """Draw an action that brings the machine closer to walking."""
        if mode == Mode.FAULT:
            return Action(Kind.REQUEST, RequestKind.RESET)
        if mode == Mode.READY:
            with_stop = self._rng.random() < STOPPED_ENABLE_RATIO
            kind = Kind.STOP_AND_REQUEST if with_stop else Kind.REQUEST
            return Action(kind, RequestKind.ENABLE)
        if mode == Mode.HOLD:
            return self._leave_hold(lease_held=lease_held)
        if mode == Mode.GAIT and not lease_held and self._rng.random() < 0.5:
            return Action(Kind.LEASE)
        return Action(Kind.NOTHING)

    def _leave_hold(self, *, lease_held: bool) -> Action:
        """Draw a mode after HOLD: mostly gait, else torque, hand guiding or a daily test."""
        drawn = self._rng.choices(tuple(_FROM_HOLD), tuple(_FROM_HOLD.values()))[0]
        if drawn == Mode.GAIT:
            return Action(Kind.REQUEST, RequestKind.MODE, self._walk())
        if drawn == Mode.TORQUE and not lease_held:
            return Action(Kind.LEASE)
        return Action(Kind.REQUEST, RequestKind.MODE, ModeRequest(drawn))

    def _walk(self) -> ModeRequest:
        rng = self._rng
        return ModeRequest(
            Mode.GAIT,
            cadence_hz=rng.uniform(0.1, 1.0) * self._cadence_max_hz,
            amplitude_ratio=rng.uniform(0.3, 1.0),
            duration_s=rng.uniform(5.0, 60.0),
        )

    def _anything(self) -> Action:
        rng = self._rng
        kind = rng.choices(tuple(_WEIGHTS), tuple(_WEIGHTS.values()))[0]
        if kind in {Kind.REQUEST, Kind.STOP_AND_REQUEST}:
            asked = rng.choice([k for k in RequestKind if k != RequestKind.NONE])
            return Action(kind, asked, self._any_mode())
        if kind is Kind.FAULT:
            return Action(kind, fault=self._fault())
        if kind is Kind.PATIENT:
            return Action(kind, programme=rng.choice(self._programmes))
        if kind is Kind.FRAMES_LOST:
            ratio = rng.choice((0.01, 0.05, 0.3))
            return Action(kind, duration_s=rng.uniform(0.05, 1.0), loss_ratio=ratio)
        if kind is Kind.LOOP_LATE:
            return Action(kind, duration_s=rng.choice((0.003, 0.012, 0.035, 0.09, 0.3, 2.0)))
        if kind in {Kind.GATEWAY_SILENT, Kind.GATEWAY_RESTART}:
            return Action(kind, duration_s=rng.uniform(0.05, 1.0))
        if kind is Kind.CORE_KILLED:
            return Action(kind, duration_s=rng.uniform(0.02, 2.0))
        return Action(kind)

    def _any_mode(self) -> ModeRequest:
        rng = self._rng
        if rng.random() < 0.3:
            return self._walk()
        return ModeRequest(
            rng.choice(tuple(Mode)),
            cadence_hz=self._number(self._cadence_max_hz),
            amplitude_ratio=self._number(1.0),
            duration_s=self._number(20.0),
            scenario=rng.choice((*self._scenarios, "", "unknown")),
            axis=rng.choice((*self._drives, "", "left/knee")),
            witnessed=rng.random() < 0.2,
        )

    def _number(self, usual: float) -> float:
        odd = self._rng.random() < 0.25
        return self._rng.choice(_ODD_NUMBERS) if odd else self._rng.uniform(0.0, 1.2) * usual

    def _fault(self) -> FaultOrder:
        rng = self._rng
        kind = rng.choice(tuple(FaultKind))
        draw = _VALUES.get(kind)
        return FaultOrder(
            rng.choice((*self._drives, EVERY_DRIVE))
            if kind in _OF_ALL
            else rng.choice(self._drives),
            kind,
            rng.uniform(*FAULT_S),
            0.0 if draw is None else float(draw(rng)),
        )


_OF_ALL: Final = frozenset(
    {
        FaultKind.LOST_TPDO,
        FaultKind.LATE_TPDO,
        FaultKind.SILENT,
        FaultKind.UNPLUGGED,
        FaultKind.DEAF,
        FaultKind.REBOOT,
        FaultKind.STO_OPEN,
        FaultKind.HAND_SWITCH_OPEN,
        FaultKind.EMCY,
    }
)
"""Faults that may affect all drives at once: of the bus, the supply, and the safety chain."""

_FROM_HOLD: Final = {Mode.GAIT: 10, Mode.TORQUE: 8, Mode.HAND_GUIDING: 3, Mode.SELF_TEST: 3}

_WEIGHTS: Final = {
    Kind.REQUEST: 30,
    Kind.FAULT: 30,
    Kind.PATIENT: 10,
    Kind.STOP: 6,
    Kind.STOP_AND_REQUEST: 4,
    Kind.FRAMES_LOST: 6,
    Kind.LOOP_LATE: 6,
    Kind.GATEWAY_SILENT: 4,
    Kind.GATEWAY_RESTART: 3,
    Kind.LEASE: 5,
    Kind.LEASE_ENDED: 4,
    Kind.CONTROLLER_DEAD: 4,
    Kind.CORE_KILLED: 3,
    Kind.CORE_ENDED: 2,
}
