"""Choice of bus and clock from the configuration: the one place that handles simulated time.

`choose_bus` is for the service; `opened` for a program that works beside it for a moment. `[bus]
interface = "simulated"` is the bus of `gaitd sim`, which controls time; `channel` is the path of
its socket. Every other interface is one of python-can, with the clock of this computer.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from daemon.config.strict import ConfigError
from daemon.config.trainer import SIMULATED, TrainerFile
from daemon.system.clock import Clock, MonotonicClock, SimulatedClock
from drives.canopen.bus import CanBus
from drives.canopen.simulated import SimulatedBus
from drives.errors import BusError
from simtime.link import SocketLink
from simtime.wire import Role


class BusChoice(NamedTuple):
    """A bus that can be opened, and the clock that goes with it."""

    open_bus: Callable[[], CanBus | SimulatedBus]
    """Opens the bus; raises BusError if that fails."""
    clock: Clock
    is_in_step: Callable[[], bool]
    """True if time is simulated now."""
    send_alive: Callable[[], None]
    """Notifies the time server that this program is alive although it requests no time yet."""


def choose_bus(
    interface: str,
    channel: str,
    bitrate_bit_per_s: int,
    *,
    role: Role,
    name: str,
    wall_clock_only: bool = False,
) -> BusChoice:
    """Choose bus and clock for the values of a configuration.

    Args:
        interface: `simulated`, or one of python-can.
        channel: channel of the interface.
        bitrate_bit_per_s: of the bus.
        role: on a simulated bus, the role of this program in simulated time.
        name: on a simulated bus, name of this program's seat.
        wall_clock_only: refuse a bus whose time is simulated.
    """
    if interface != SIMULATED:
        return BusChoice(
            lambda: CanBus.open(interface, channel, bitrate_bit_per_s),
            MonotonicClock(),
            lambda: False,
            lambda: None,
        )
    link = SocketLink(Path(channel), role, name, wall_clock_only=wall_clock_only)
    bus = SimulatedBus(link, f"{SIMULATED}:{channel}")
    return BusChoice(bus.open, SimulatedClock(link), lambda: link.is_in_step, link.send_alive)


class BusPlace(NamedTuple):
    """A bus as configured, and the file or option that named it, for error texts."""

    interface: str
    channel: str
    bitrate_bit_per_s: int
    named_by: Path | str
    key: str


def bus_of(file: TrainerFile) -> BusPlace:
    """Return the bus of a trainer file."""
    bus = file.trainer.bus
    return BusPlace(bus.interface, file.channel, bus.bitrate_bit_per_s, file.path, "bus.channel")


@contextmanager
def opened(place: BusPlace) -> Generator[tuple[CanBus | SimulatedBus, Clock]]:
    """Open a bus beside a service, and close it in any case; yields the bus and its clock.

    Raises:
        ConfigError: it cannot be opened.
    """
    interface, channel, bitrate_bit_per_s = place[:3]
    choice = choose_bus(interface, channel, bitrate_bit_per_s, role=Role.BESIDE, name="gaitd")
    try:
        bus = choice.open_bus()
    except BusError as error:
        allowed = f"a {interface} bus that is there; this one {error.what}"
        following = "gaitd sim" if interface == SIMULATED else "gaitd doctor"
        raise ConfigError(
            place.named_by, place.key, channel, allowed, following=following
        ) from error
    try:
        yield bus, choice.clock
    finally:
        bus.close()
