"""What a fault is, and how it begins and ends: in the machine, on our bus, in the gateway, in time.

A fault is begun at any moment of a cycle, also while the service waits.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace as changed

from daemon.core.state import Axis, Core
from daemon.ipc.record import GatewayState, Request, RequestKind, Setpoint
from drives.canopen.bus import Frame
from gaitd_lab.fault_matrix.bench import Bench

NAN: Final = float("nan")
MS: Final = 1_000_000


class KilledError(BaseException):
    """The core's process is gone: nothing of it runs any more. Not for any handler of ours."""


@dataclass(slots=True)
class Scene:
    """One cell while it plays."""

    bench: Bench
    asked_to_end: bool = False
    """SIGTERM has come."""
    undo: list[Callable[[], None]] = field(default_factory=list[Callable[[], None]])
    """What ends the fault, beside what its row says."""

    @property
    def core(self) -> Core:
        """Of the service that runs."""
        return self.bench.lockstep.core

    def axis(self, name: str) -> Axis:
        """One axis of the core."""
        return next(axis for axis in self.core.axes if axis.name == name)


Act = Callable[[Scene, str], None]
"""(scene, axis): begins or ends a fault."""


@dataclass(frozen=True, slots=True)
class Play:
    """How a fault begins and how it goes away."""

    begin: Act
    end: Act


LASTS_S: Final = 1.4


@dataclass(frozen=True, slots=True)
class Fault:
    """One row."""

    name: str
    text: str
    play: Play
    of_an_axis: bool = True
    lasts_s: float = LASTS_S
    """Then it goes away."""


def nothing(_scene: Scene, _axis: str) -> None:
    """It goes away by itself, or not at all."""


def undo(scene: Scene, _axis: str) -> None:
    """Take back what was replaced, the newest first."""
    while scene.undo:
        scene.undo.pop()()


# --- in the machine -----------------------------------------------------------------------------


def machine(fault: str) -> Play:
    """A fault of the virtual drives: `KIND {} [DURATION [VALUE]]` with the axis in the braces."""
    kind = fault.split(maxsplit=1)[0]

    def begin(scene: Scene, axis: str) -> None:
        scene.bench.machine.command(fault.format(axis))

    def end(scene: Scene, axis: str) -> None:
        scene.bench.machine.command(f"clear {kind} {axis}")

    return Play(begin, end)


def patient(programme: str) -> Play:
    """What the patient does; `{}` stands for `hip` or `slide`."""

    def begin(scene: Scene, axis: str) -> None:
        scene.bench.patient(programme.format(axis.rpartition("/")[2]))

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.patient("passive")

    return Play(begin, end)


def together(*plays: Play) -> Play:
    """Faults at the same moment."""

    def begin(scene: Scene, axis: str) -> None:
        for play in plays:
            play.begin(scene, axis)

    def end(scene: Scene, axis: str) -> None:
        for play in plays:
            play.end(scene, axis)

    return Play(begin, end)


def limit_switch_ahead() -> Play:
    """The switch comes on that the joint moves towards, or either if it stands."""

    def begin(scene: Scene, axis: str) -> None:
        joint = scene.axis(axis).joint
        sign = 1 if scene.axis(axis).scaling.counts_per_si > 0 else -1
        side = sign if joint.velocity_si >= 0 else -sign
        scene.bench.machine.command(f"limit_switch_on {axis} - {side}")

    def end(scene: Scene, axis: str) -> None:
        scene.bench.machine.command(f"clear limit_switch_on {axis}")

    return Play(begin, end)


# --- on our end of the bus ------------------------------------------------------------------------

BUS_OFF: Final = Frame(0x040, bytes(8))
RESTARTED: Final = Frame(0x100, bytes(8))
PASSIVE: Final = Frame(0x004, b"\0\x30\0\0\0\0\0\0")
ACTIVE: Final = Frame(0x004, b"\0\x40\0\0\0\0\0\0")
OVERFLOW: Final = Frame(0x004, b"\0\x01\0\0\0\0\0\0")


def our_bus_off() -> Play:
    """Our controller leaves the bus and says so; at the end it has been restarted."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.is_off = True
        scene.bench.bus.report(BUS_OFF)

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.is_off = False
        scene.bench.bus.report(RESTARTED)

    return Play(begin, end)


def reported(frame: Frame, over: Frame | None = None) -> Play:
    """Our controller says something of itself, and what ends it."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.report(frame)

    def end(scene: Scene, _axis: str) -> None:
        if over is not None:
            scene.bench.bus.report(over)

    return Play(begin, end)


def queue_full() -> Play:
    """Nothing can be sent."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.queue_full = True

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.queue_full = False

    return Play(begin, end)


def adapter_gone() -> Play:
    """The interface is not there any more."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.is_gone = True

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.is_gone = False

    return Play(begin, end)


def sync_waits(delay_ms: int) -> Play:
    """SYNC waits for its place on the wire."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.sync_delay_ns = delay_ms * MS

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.sync_delay_ns = 0

    return Play(begin, end)


# --- time -----------------------------------------------------------------------------------------


def held(duration_ms: int) -> Play:
    """The core stands still while the world goes on, and its clock with the world."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.hold(duration_ms * MS)

    return Play(begin, nothing)


def suspended(duration_ms: int) -> Play:
    """The machine sleeps: the core and its monotonic clock stand still, the world goes on."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.pause(duration_ms * MS)

    return Play(begin, nothing)


def clock_set(by_ns: int) -> Play:
    """Somebody sets the wall clock; it is set right when the fault goes away."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.lockstep.clock.utc_stepped_ns += by_ns

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.lockstep.clock.utc_stepped_ns -= by_ns

    return Play(begin, end)


# --- the gateway ----------------------------------------------------------------------------------


def gateway_silent() -> Play:
    """No levels any more: dead, stalled, or its session lost; afterwards they come again."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.gateway.silent = True

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.gateway.silent = False

    return Play(begin, end)


def levels(change: Callable[[list[GatewayState]], list[GatewayState]]) -> Play:
    """What the core hears is another thing than was sent."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.gateway.change = change

    def end(scene: Scene, _axis: str) -> None:
        scene.bench.gateway.change = None

    return Play(begin, end)


FLOOD_COUNT: Final = 100
"""Levels in one turn: 10 kHz."""
FOREIGN: Final = "somebody else's core"
_ENABLE: Final = Request(id=4711, kind=RequestKind.ENABLE)


def flood(sent: list[GatewayState]) -> list[GatewayState]:
    """Each level a hundred times."""
    return [level for level in sent for _ in range(FLOOD_COUNT)]


def foreign(sent: list[GatewayState]) -> list[GatewayState]:
    """Beside ours those of a gateway that speaks to another core, and asks to enable it."""
    return [
        level
        for own in sent
        for level in (
            own,
            changed(
                own,
                core_boot_id=FOREIGN,
                seq=own.seq + 1_000_000,
                request=changed(_ENABLE, for_cycle=own.for_cycle),
            ),
        )
    ]


def foreign_alone(sent: list[GatewayState]) -> list[GatewayState]:
    """Only those of another core."""
    return [changed(own, core_boot_id=FOREIGN) for own in sent]


def restarted(sent: list[GatewayState]) -> list[GatewayState]:
    """A gateway that begins anew: counts stops from zero, no request, no lease."""
    return [changed(own, stop_count=0, request=Request(), setpoints=(), lease=0) for own in sent]


def lower_stop_count(sent: list[GatewayState]) -> list[GatewayState]:
    """A stop count that goes down is no stop, and hides none."""
    return [changed(own, stop_count=own.stop_count - 1) for own in sent]


def nothing_asked(sent: list[GatewayState]) -> list[GatewayState]:
    """Nobody asks for anything, and no lease is held: only that the gateway lives is said."""
    return [changed(own, request=Request(), setpoints=(), lease=0) for own in sent]


def nan_setpoint(sent: list[GatewayState]) -> list[GatewayState]:
    """Setpoints that are no numbers, under the lease of the level."""
    return [
        changed(
            own,
            setpoints=(Setpoint(own.lease, own.seq, own.for_cycle, NAN, NAN, "right", NAN),),
        )
        for own in sent
    ]


# --- its process ----------------------------------------------------------------------------------


def terminated() -> Play:
    """SIGTERM to the core."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.asked_to_end = True

    return Play(begin, nothing)


def killed() -> Play:
    """SIGKILL to the core: it does nothing any more, not even leave."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.bench.bus.trouble.is_gone = True
        raise KilledError

    return Play(begin, nothing)
