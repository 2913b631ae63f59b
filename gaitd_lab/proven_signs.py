"""The state file of a trainer whose signs were proven in the empty machine before a session."""

from daemon.config.bundle import Settings
from daemon.core.modes.persistent_state import PersistentState, prove, with_proof
from daemon.core.runtime.build import wiring_of
from sim_drives.build import Machine
from sim_drives.canopen.objects import Object

MOVED_RAD_OR_M = 0.04


def proven_signs(settings: Settings, machine: Machine) -> PersistentState:
    """Return a state with a proof for each drive of the virtual machine."""
    persistent = PersistentState()
    for drive in settings.drives:
        serial_number = machine.world.node(drive.name).dictionary.value(Object.IDENTITY, 4)
        moved = (MOVED_RAD_OR_M, -MOVED_RAD_OR_M)
        proof = prove(wiring_of(drive), serial_number, moved, utc_ns=0)
        persistent = with_proof(persistent, drive.name, proof)
    return persistent
