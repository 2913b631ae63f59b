"""`gaitd drive NAME store` and `restore`: only on request, with no other master or SDO client."""

import sys
from typing import TYPE_CHECKING, Final

import typer

from daemon.config.strict import MISSING, ConfigError
from drives.bringup.configurator import Configurator
from drives.service.parameters import (
    SDO_TIMEOUT_NS,
    Keeping,
    KeepingRefusedError,
    check_bus,
    check_drive,
    reset_node,
)
from drives.service.parameters import keep as write_signature
from drives.service.scan import listen
from gaitd.station import EXIT_DIFFERENT, EXIT_SAME, shown

if TYPE_CHECKING:
    from drives.bringup.plan import DrivePlan
    from drives.canopen.bus import Bus, Clock
    from drives.canopen.sniffer import BusSniffer
    from gaitd.station import Options

RECHECK_NS: Final = 300_000_000
"""Time to listen again after the operator has confirmed: a service may have started meanwhile."""

WHAT: Final = {
    Keeping.STORE: "overwrites what it has stored with what it holds now (1010h:01)",
    Keeping.RESTORE: "gives up what it has stored for its maker's defaults (1011h:01): motor data "
    "and limits, too",
}
DONE: Final = {
    Keeping.STORE: "stored",
    Keeping.RESTORE: "will take its maker's defaults at the next power-on or NMT reset node",
}


def keep(
    action: str,
    plan: "DrivePlan",
    options: "Options",
    bus: "Bus",
    clock: "Clock",
    witness: "BusSniffer",
    master_node_id: int,
) -> int:
    """Check bus and drive, ask for confirmation, check both again, then store or restore.

    Returns: the exit code.

    Raises:
        ConfigError: there is no terminal for the confirmation, and no --yes.
        BringUpRefused, DriveSilent, BusError: as `drives/service/parameters.py`.
    """
    keeping, port = Keeping[action], Configurator(bus, clock)
    who = f"{plan.description.name} (node {plan.description.node_id})"
    try:
        check_bus(witness, master_node_id)
        check_drive(plan, keeping, port)
        if not _agreed(f"{who}: {WHAT[keeping]}", options):
            print("nothing was done")
            return EXIT_DIFFERENT
        shown(listen(bus, clock, RECHECK_NS))
        check_bus(witness, master_node_id)
        check_drive(plan, keeping, port)
        write_signature(plan, keeping, Configurator(bus, clock, SDO_TIMEOUT_NS))
    except KeepingRefusedError as refused:
        print(f"{who}: not done: {refused}", file=sys.stderr)
        return EXIT_DIFFERENT
    if options.reset:
        shown(reset_node(plan, port))
        print(f"{who}: has its maker's defaults now, and is in pre-operational")
    else:
        print(f"{who}: {DONE[keeping]}")
    return EXIT_SAME


def _agreed(what: str, options: "Options") -> bool:
    print(f"{what}.")
    if options.yes:
        return True
    if not sys.stdin.isatty():
        allowed = "to be given where there is no terminal to ask on"
        raise ConfigError("command line", "--yes", MISSING, allowed)
    return typer.confirm("Do it?", default=False)
