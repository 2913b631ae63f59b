"""Choice of bus and clock from the configuration: the one place that handles simulated time.

`choose_bus` is for the service; `opened` for a program that works beside it for a moment. `[bus]
interface = "simulated"` is the bus of `gaitd sim`, which controls time; `channel` is the path of
its socket. Every other interface is one of python-can, with the clock of this computer.

Simulated time belongs to the laboratory, and nothing here imports it. It is found by one fixed
name, and only for that interface: no other installed package can give the service a bus or a clock.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from typing import Final, NamedTuple, Protocol, cast

from gaitd_toml import ConfigError

from daemon.config.trainer import LABORATORY, LABORATORY_BY, SIMULATED, TrainerFile
from daemon.ipc.transport import CoreChannel, IpcChannel
from daemon.system.clock import AgeClock, Clock, MonotonicClock
from drives.canopen.bus import CanBus, OpenedBus
from drives.errors import BusError

MODULE: Final = "simtime.service"
"""Simulated time; it has the interface of `Simulation`."""


class BusChoice(NamedTuple):
    """A bus that can be opened, the clock that goes with it, and how the core keeps in step."""

    open_bus: Callable[[], OpenedBus]
    """Opens the bus; raises BusError if that fails."""
    clock: Clock
    in_step: Callable[[CoreChannel, str, Path], IpcChannel]
    """Wraps the core's channel, with its boot id and the lock file of the gateway: where time is
    simulated, the core waits for the gateway."""


class Simulation(Protocol):
    """Simulated time, as the service uses it."""

    def bus(self, channel: Path, name: str, *, is_core: bool, wall_clock_only: bool) -> BusChoice:
        """Return the bus of a `gaitd sim`.

        Args:
            channel: path of its socket.
            name: of this program, for its messages.
            is_core: time waits for this program.
            wall_clock_only: refuse a server whose time is simulated.
        """
        ...

    def page_clock(self, channel: Path) -> AgeClock:
        """Return the clock of a program that only reads the time."""
        ...


def simulation(named_by: Path | str) -> Simulation:
    """Return simulated time.

    Args:
        named_by: file or option with the interface, for the error.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        distribution(LABORATORY)
        return cast("Simulation", import_module(MODULE))
    except ModuleNotFoundError as error:  # PackageNotFoundError is one, too
        if error.name not in {LABORATORY, "simtime", MODULE}:
            raise
        allowed = (
            f"an interface of python-can; simulated time is in {LABORATORY}, which is not"
            f" installed: {LABORATORY_BY}"
        )
        raise ConfigError(named_by, "bus.interface", SIMULATED, allowed, following="") from None


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


def choose_bus(
    place: BusPlace, *, name: str, is_core: bool = False, wall_clock_only: bool = False
) -> BusChoice:
    """Choose bus and clock for the values of a configuration.

    Args:
        place: the bus.
        name: on a simulated bus, name of this program.
        is_core: on a simulated bus, time waits for this program.
        wall_clock_only: refuse a bus whose time is simulated.

    Raises:
        ConfigError: simulated time is not installed.
    """
    if place.interface == SIMULATED:
        return simulation(place.named_by).bus(
            Path(place.channel), name, is_core=is_core, wall_clock_only=wall_clock_only
        )
    return BusChoice(
        lambda: CanBus.open(place.interface, place.channel, place.bitrate_bit_per_s),
        MonotonicClock(),
        _alone,
    )


def _alone(ipc: CoreChannel, _boot_id: str, _gateway_lock: Path) -> IpcChannel:
    return ipc


@contextmanager
def opened(place: BusPlace, *, is_master: bool = False) -> Generator[tuple[OpenedBus, Clock]]:
    """Open a bus for a command, and close it in any case; yields the bus and its clock.

    Args:
        place: the bus.
        is_master: in place of a service, so that simulated time waits for the command, too; else
            beside one.

    Raises:
        ConfigError: it cannot be opened.
    """
    choice = choose_bus(place, name="gaitd", is_core=is_master)
    try:
        bus = choice.open_bus()
    except BusError as error:
        allowed = f"a {place.interface} bus that is there; this one {error.what}"
        following = "gaitd sim" if place.interface == SIMULATED else "gaitd doctor"
        raise ConfigError(
            place.named_by, place.key, place.channel, allowed, following=following
        ) from error
    try:
        yield bus, choice.clock
    finally:
        bus.close()
