"""Shared part of `scan` and `drive`: opening the bus, progress, tables, exit codes."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeVar

if TYPE_CHECKING:
    from daemon.config.bundle import Settings
    from daemon.system.clock import Clock
    from drives.canopen.bus import CanBus
    from drives.canopen.simulated import SimulatedBus
    from drives.service.scan import Progress
    from gaitd.check import Section

T = TypeVar("T")

EXIT_SAME: Final = 0
EXIT_DIFFERENT: Final = 1
EXIT_DRIVE: Final = 3
"""The drive or the bus is not in the required state."""


class Options(NamedTuple):
    """Options of `gaitd drive` besides its action."""

    output: Path | None
    against: Path | None
    eds: bool
    everything: bool
    json: bool
    yes: bool
    reset: bool


class BusPlace(NamedTuple):
    """A bus as configured, and the file or option that named it, for error texts."""

    interface: str
    channel: str
    bitrate_bit_per_s: int
    named_by: Path | str
    key: str


class OpenBus(NamedTuple):
    """An open bus, and its clock."""

    bus: "CanBus | SimulatedBus"
    clock: "Clock"


def place_of(settings: "Settings") -> BusPlace:
    """Return the bus of a configuration."""
    bus, file = settings.trainer.bus, settings.file
    return BusPlace(bus.interface, file.channel, bus.bitrate_bit_per_s, file.path, "bus.channel")


@contextmanager
def opened(place: BusPlace) -> "Generator[OpenBus]":
    """Open the bus, and close it in any case.

    Raises:
        ConfigError: it cannot be opened.
    """
    from daemon.config.strict import ConfigError
    from daemon.system.bus_choice import choose_bus
    from drives.errors import BusError
    from simtime.wire import Role

    choice = choose_bus(
        place.interface,
        place.channel,
        place.bitrate_bit_per_s,
        role=Role.BESIDE,
        name="gaitd",
    )
    try:
        bus = choice.open_bus()
    except BusError as error:
        allowed = f"a {place.interface} bus that is there; this one {error.what}"
        raise ConfigError(place.named_by, place.key, place.channel, allowed) from error
    try:
        yield OpenBus(bus, choice.clock)
    finally:
        bus.close()


def show(tables: "tuple[Section, ...]") -> None:
    """Print tables on a terminal, aligned text in a pipe; leave out empty tables."""
    from gaitd.check import plain, print_tables

    filled = tuple(table for table in tables if table.rows)
    if sys.stdout.isatty():
        print_tables(filled)
    elif filled:
        print("\n\n".join(plain(table) for table in filled))


def shown(steps: "Generator[Progress, None, T]") -> T:
    """Run a generator of progress and return its result; shows a bar if stderr is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    columns = (TextColumn("{task.description:24}"), BarColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("")
        while True:
            try:
                step = next(steps)
            except StopIteration as stop:
                return stop.value
            bar.update(
                task, description=step.text, completed=step.done_count, total=step.total_count
            )
