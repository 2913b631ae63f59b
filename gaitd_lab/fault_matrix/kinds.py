"""Kinds of fault: in the machine, on the master's bus interface, in the gateway, in time.

A fault may begin at any moment of a cycle, also while the service waits.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gaitd_names import RequestKind, Role
from msgspec.structs import replace as changed

from daemon.core.state import Axis, Core
from daemon.ipc.record import AxisSetpoint, GatewayState, Request, Setpoint
from drives.canopen.bus import Frame
from gaitd_lab.lockstep import LockstepSession

NAN: Final = float("nan")
MS: Final = 1_000_000


class KilledError(BaseException):
    """The core's process is killed. Must not be caught by handlers of the service."""


@dataclass(slots=True)
class Scene:
    """One running cell."""

    session: LockstepSession
    asked_to_end: bool = False
    """True if SIGTERM has been received."""
    undo: list[Callable[[], None]] = field(default_factory=list[Callable[[], None]])
    """Actions that end the fault, in addition to its row's."""

    @property
    def core(self) -> Core:
        """The running service's core."""
        return self.session.core

    def axis(self, name: str) -> Axis:
        """Return one axis of the core."""
        return next(axis for axis in self.core.axes if axis.name == name)


Act = Callable[[Scene, str], None]
"""Begins or ends a fault, called with (scene, axis)."""


@dataclass(frozen=True, slots=True)
class FaultAction:
    """How a fault begins and ends."""

    begin: Act
    end: Act


LASTS_S: Final = 1.4


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault: how it begins and ends, and for how long it lasts."""

    name: str
    text: str
    play: FaultAction
    of_an_axis: bool = True
    lasts_s: float = LASTS_S
    """Time until the fault ends."""


def nothing(_scene: Scene, _axis: str) -> None:
    """Do nothing: the fault ends by itself, or never."""


def undo(scene: Scene, _axis: str) -> None:
    """Undo the replacements, the newest first."""
    while scene.undo:
        scene.undo.pop()()


def _while_present(
    owner: Callable[[Scene], object], name: str, on: object, off: object
) -> FaultAction:
    """A variable of the session has one value during the fault, and another one after it."""
    return FaultAction(
        lambda scene, _axis: setattr(owner(scene), name, on),
        lambda scene, _axis: setattr(owner(scene), name, off),
    )


# --- in the machine -----------------------------------------------------------------------------


def machine(*faults: str) -> FaultAction:
    """Faults of the virtual drives: `KIND {} [DURATION [VALUE]]`, with the axis in the braces."""

    def begin(scene: Scene, axis: str) -> None:
        for fault in faults:
            scene.session.command(fault.format(axis))

    def end(scene: Scene, axis: str) -> None:
        for fault in faults:
            scene.session.command(f"clear {fault.split(maxsplit=1)[0]} {axis}")

    return FaultAction(begin, end)


def patient(programme: str) -> FaultAction:
    """A programme of the patient; `{}` stands for `hip` or `slide`."""
    return FaultAction(
        lambda scene, axis: scene.session.command(
            f"patient {programme.format(axis.rpartition('/')[2])}"
        ),
        lambda scene, _axis: scene.session.command("patient passive"),
    )


def left_in(index: int, value: int) -> FaultAction:
    """An object of the drive holds this value, as an earlier master may leave it."""

    def put(scene: Scene, axis: str, value: int) -> None:
        scene.session.machine.world.node(axis).dictionary.put(index, 0, value)

    return FaultAction(
        lambda scene, axis: put(scene, axis, value), lambda scene, axis: put(scene, axis, 0)
    )


def limit_switch_ahead() -> FaultAction:
    """The limit switch in the joint's direction of motion closes, or either if the joint stands."""

    def begin(scene: Scene, axis: str) -> None:
        joint = scene.axis(axis).sensed.joint
        sign = 1 if scene.axis(axis).scaling.counts_per_si > 0 else -1
        side = sign if joint.velocity_si >= 0 else -sign
        scene.session.command(f"limit_switch_on {axis} - {side}")

    def end(scene: Scene, axis: str) -> None:
        scene.session.command(f"clear limit_switch_on {axis}")

    return FaultAction(begin, end)


# --- on the master's bus interface ------------------------------------------------------------

BUS_OFF: Final = Frame(0x040, bytes(8))
RESTARTED: Final = Frame(0x100, bytes(8))
PASSIVE: Final = Frame(0x004, b"\0\x30\0\0\0\0\0\0")
ACTIVE: Final = Frame(0x004, b"\0\x40\0\0\0\0\0\0")
OVERFLOW: Final = Frame(0x004, b"\0\x01\0\0\0\0\0\0")


def our_bus_off() -> FaultAction:
    """The master's controller goes bus-off and reports it; at the end it has been restarted."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.bus.trouble.is_off = True
        scene.session.bus.report(BUS_OFF)

    def end(scene: Scene, _axis: str) -> None:
        scene.session.bus.trouble.is_off = False
        scene.session.bus.report(RESTARTED)

    return FaultAction(begin, end)


def reported(frame: Frame, over: Frame | None = None) -> FaultAction:
    """The master's controller reports an error, and the end of it."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.bus.report(frame)

    def end(scene: Scene, _axis: str) -> None:
        if over is not None:
            scene.session.bus.report(over)

    return FaultAction(begin, end)


def queue_full() -> FaultAction:
    """Nothing can be sent."""
    return _while_present(lambda scene: scene.session.bus.trouble, "queue_full", on=True, off=False)


def adapter_gone() -> FaultAction:
    """The interface does not exist any more."""
    return _while_present(lambda scene: scene.session.bus.trouble, "is_gone", on=True, off=False)


def sync_waits(delay_ms: int) -> FaultAction:
    """SYNC is delayed on its way to the wire."""
    delay_ns = delay_ms * MS
    return _while_present(lambda scene: scene.session.bus.trouble, "sync_delay_ns", delay_ns, 0)


# --- time -----------------------------------------------------------------------------------------


def held(duration_ms: int) -> FaultAction:
    """The core is halted while the world and the core's clock continue."""
    return FaultAction(lambda scene, _axis: scene.session.bus.hold(duration_ms * MS), nothing)


def suspended(duration_ms: int) -> FaultAction:
    """The machine is suspended: the core and its monotonic clock stop, the world continues."""
    return FaultAction(lambda scene, _axis: scene.session.bus.pause(duration_ms * MS), nothing)


def clock_set(by_ns: int) -> FaultAction:
    """The wall clock is set; it is corrected when the fault ends."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.clock.utc_stepped_ns += by_ns

    def end(scene: Scene, _axis: str) -> None:
        scene.session.clock.utc_stepped_ns -= by_ns

    return FaultAction(begin, end)


# --- the gateway ----------------------------------------------------------------------------------


def gateway_silent() -> FaultAction:
    """The gateway sends no state: dead, stalled, or its session lost; afterwards it sends again."""
    return _while_present(lambda scene: scene.session.gateway, "silent", on=True, off=False)


def levels(change: Callable[[list[GatewayState]], list[GatewayState]]) -> FaultAction:
    """The core receives a gateway state different from the one sent."""
    return _while_present(lambda scene: scene.session.gateway, "change", change, None)


FLOOD_COUNT: Final = 100
"""Gateway states in one turn: 10 kHz."""
FOREIGN: Final = "another core"
_ENABLE: Final = Request(id=4711, kind=RequestKind.ENABLE, role=Role.UNRESTRICTED)


def flood(sent: list[GatewayState]) -> list[GatewayState]:
    """Each gateway state is repeated a hundred times."""
    return [gateway_state for gateway_state in sent for _ in range(FLOOD_COUNT)]


def foreign(sent: list[GatewayState]) -> list[GatewayState]:
    """States of a second gateway arrive, which belong to another core and request to enable it."""
    return [
        gateway_state
        for own in sent
        for gateway_state in (
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
    """Only the gateway states for another core arrive."""
    return [changed(own, core_boot_id=FOREIGN) for own in sent]


def restarted(sent: list[GatewayState]) -> list[GatewayState]:
    """The gateway is restarted: its stop count is zero, with no request and no lease."""
    return [changed(own, stop_count=0, request=Request(), setpoints=(), lease=0) for own in sent]


def lower_stop_count(sent: list[GatewayState]) -> list[GatewayState]:
    """A stop count that decreases is no stop, and hides none."""
    return [changed(own, stop_count=own.stop_count - 1) for own in sent]


def no_requests(sent: list[GatewayState]) -> list[GatewayState]:
    """No request and no lease: the gateway only signals that it is alive."""
    return [changed(own, request=Request(), setpoints=(), lease=0) for own in sent]


def nan_setpoint(sent: list[GatewayState]) -> list[GatewayState]:
    """Setpoints are NaN, under the lease of the gateway state."""
    nan = AxisSetpoint(NAN), AxisSetpoint(NAN)
    return [
        changed(
            own,
            setpoints=(Setpoint(own.lease, own.seq, own.for_cycle, *nan, "right", NAN),),
        )
        for own in sent
    ]


# --- its process ----------------------------------------------------------------------------------


def terminated() -> FaultAction:
    """SIGTERM to the core."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.asked_to_end = True

    return FaultAction(begin, nothing)


def killed() -> FaultAction:
    """SIGKILL to the core: it executes nothing any more, not even its shutdown."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.bus.trouble.is_gone = True
        raise KilledError

    return FaultAction(begin, nothing)
