"""What the service finds here for `[bus] interface = "simulated"`, and nowhere else.

`daemon/system/bus_choice.py` imports this module by its name, and has its interface.
"""

from pathlib import Path

from daemon.ipc.transport import CoreChannel
from daemon.system.bus_choice import BusChoice
from simtime.bus import SimulatedBus
from simtime.clock import PageClock, SimulatedClock
from simtime.in_step import InStepChannel
from simtime.link import SocketLink
from simtime.wire import Role


def bus(channel: Path, name: str, *, is_core: bool, wall_clock_only: bool) -> BusChoice:
    """As `daemon.system.bus_choice.Simulation.bus`."""
    role = Role.IN_STEP if is_core else Role.BESIDE
    link = SocketLink(channel, role, name, wall_clock_only=wall_clock_only)

    def in_step(ipc: CoreChannel, boot_id: str, gateway_lock: Path) -> InStepChannel:
        return InStepChannel(ipc, boot_id, gateway_lock, link)

    return BusChoice(SimulatedBus(link, f"simulated:{channel}").open, SimulatedClock(link), in_step)


def page_clock(channel: Path) -> PageClock:
    """As `daemon.system.bus_choice.Simulation.page_clock`."""
    return PageClock(channel)
