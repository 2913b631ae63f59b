"""One CANopen node: receives and sends frames, with a CiA 402 drive as its application.

The node connects its parts: network management decides which services work, SDO and PDO access
the dictionary, SYNC samples and applies, error control watches the master. The order at a SYNC
follows the standard: sample the actual values (TPDO), then apply what came since the last SYNC
(RPDO). A torque sampled at SYNC k is therefore the one that acted up to k.
"""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.dictionary import Entry, ObjectDictionary
from sim_drives.canopen.emergency import Errors
from sim_drives.canopen.heartbeat import (
    HEARTBEAT_ID,
    HEARTBEAT_IDS,
    HeartbeatConsumer,
    HeartbeatProducer,
)
from sim_drives.canopen.line import GatedLine, Line
from sim_drives.canopen.nmt import (
    NEXT_STATE,
    NMT_ID,
    SERVICES,
    NmtCommand,
    NmtState,
    Service,
    command_for,
)
from sim_drives.canopen.objects import Object
from sim_drives.canopen.pdo_channel import Values
from sim_drives.canopen.pdo_receive import ReceivePdos
from sim_drives.canopen.pdo_transmit import TransmitPdos
from sim_drives.canopen.sdo_server import SDO_ANSWER_ID, SDO_REQUEST_ID, SdoServer
from sim_drives.canopen.storage import Storage
from sim_drives.canopen.sync import SyncConsumer
from sim_drives.canopen.timers import MILLISECOND, Timers
from sim_drives.cia402.drive import Drive
from sim_drives.cia402.personality import (
    PERSONALITIES,
    commissioned,
    rated_torque_unm,
    standard,
    unit_factors,
)
from sim_drives.cia402.power_state import POWER_STAGE_ON
from sim_drives.connection import (
    FAILURES,
    HEARTBEAT_LOST_CODE,
    PDO_TIMEOUT_CODE,
    Connection,
)
from sim_drives.plant.port import Axis
from sim_drives.settings import DriveSettings, FaultKind, PersonalityName

RESET_COMMUNICATION_NS: Final = 5 * MILLISECOND
MOTOR_DATA: Final = (Object.EPOS4_MOTOR_DATA, Object.RATED_CURRENT, Object.RATED_TORQUE)
CURRENT_LIMIT_SUB: Final = 2
"""3001h:02 may change at any time; the motor behind it is fixed."""
EVERY_TPDO: Final = 0
PRODUCT_CODE: Final = 2
SERIAL_NUMBER: Final = 4
"""Sub-indices of 1018h."""


@dataclass(slots=True)
class Disturbance:
    """Injected disturbances of this node (see `rules.py`)."""

    lost_tpdo: int | None = None
    """Number of the TPDO that is lost, or EVERY_TPDO."""
    all_ones_tpdo: int | None = None
    """Number of the TPDO whose bytes are all FFh."""
    late_ns: int = 0
    """Synchronous TPDOs are sent this much later."""
    mute: bool = False
    """No frame of the node reaches the bus."""
    unplugged: bool = False
    """No frame passes in either direction."""
    deaf: bool = False
    """No frame of the bus reaches the node."""
    bus_off: bool = False
    """No frame passes in either direction, and the node detects it."""
    held_by: set[FaultKind] = field(default_factory=set)
    """Cause that keeps the axis from moving."""

    @property
    def receives(self) -> bool:
        """True if frames of the bus reach the node."""
        return not (self.unplugged or self.bus_off or self.deaf)

    @property
    def reaches_bus(self) -> bool:
        """True if the node's frames reach the bus."""
        return not (self.unplugged or self.bus_off or self.mute)


class Node:
    """A named drive as a slave on the bus."""

    def __init__(
        self,
        name: str,
        settings: DriveSettings,
        entries: tuple[Entry, ...],
        axis: Axis,
        line: Line,
        rng: random.Random,
    ) -> None:
        """Build the node without power.

        Args:
            name: LEG/AXIS, for faults and messages.
            settings: the node's tables of plant.toml.
            entries: entries of its EDS, for its node id.
            axis: the plant's axis that the drive moves.
            line: the node's access to bus and time.
            rng: random generator of the TPDO latency.
        """
        self.name = name
        self.axis = axis
        self.disturbance = Disturbance()
        self._tpdo_ids: set[int] = set()
        self._routes: dict[int | None, Callable[[Frame], None]] = {}
        """What receives a frame, by CAN identifier. Identifiers are written by SDO or by a restore:
        no EDS file lets an RPDO map one."""
        self._routes_revision = -1
        """Revision of the dictionary of which `_routes` are."""
        self.state = NmtState.INITIALISING
        self.timers = Timers()
        self._settings = settings
        self._line = line
        self._rng = rng
        least_ns = round(settings.tpdo_delay_min_ms * MILLISECOND)
        most_ns = round(settings.tpdo_delay_max_ms * MILLISECOND)
        self._latencies_ns = range(least_ns, most_ns + 1)
        self._supply_on = False
        self._on_since_ns = 0
        personality = PERSONALITIES[settings.personality]
        dictionary = ObjectDictionary(entries)
        self.dictionary = dictionary
        factors = unit_factors(settings).items()
        dictionary.assume(standard(settings))
        dictionary.assume({address: one for address, one in factors if address in dictionary})
        for address, value in commissioned(settings).items():
            dictionary.put(*address, value)
        self.errors = Errors(
            dictionary,
            GatedLine(line, lambda: self._allows(Service.EMERGENCY)),
            generic_bit=personality.generic_error_bit,
        )
        context = NodeContext(dictionary, line, self.timers)
        self.drive = Drive(settings, context, axis, self.errors)
        self.identity = {
            sub: dictionary.value(Object.IDENTITY, sub) for sub in (PRODUCT_CODE, SERIAL_NUMBER)
        }
        """Delivered values of 1018h by sub-index."""
        self._storage = Storage(dictionary, commissioned(settings), lambda: self._power_stage_on)
        self._server = SdoServer(settings.node_id, context)
        self.connection = Connection(
            personality, dictionary, self.drive, self.errors, lambda: self.state, self._enter
        )
        self.drive.targets.on_missed = self.connection.target_missed
        self._producer = HeartbeatProducer(settings.node_id, context, lambda: self.state)
        self._consumer = HeartbeatConsumer(
            context, partial(self.connection.set_failure, HEARTBEAT_LOST_CODE)
        )
        self._sync = SyncConsumer(context, self.errors.set_warning)
        locked = personality.cob_id_locked_while_valid
        self._tpdos = TransmitPdos(
            context, self._sync, self._send_tpdo, self._tpdo_delays_ns, locked=locked
        )
        self._rpdos = ReceivePdos(
            context,
            self._sync,
            self._apply,
            self.errors.set_warning,
            partial(self.connection.set_failure, PDO_TIMEOUT_CODE),
            locked=locked,
        )
        dictionary.before_upload = self.drive.latch
        for index in MOTOR_DATA:
            dictionary.guard(index, self._check_motor_data)
        dictionary.watch(Object.EPOS4_MOTOR_DATA, lambda _: self._derive_rated_torque())

    # --- power and network management ---------------------------------------------------------

    def power_on(self) -> None:
        """Power on, also after a loss of power: origin, errors and commanded values are lost."""
        self._supply_on = True
        self._on_since_ns = self._line.now_ns
        self.timers.cancel_all()
        self._restart(communication_only=False)

    def exchange(self, identity: Mapping[int, int]) -> None:
        """Replace the drive by another one, with these sub-indices of 1018h, and power it on."""
        self.power_off()
        for subindex, value in identity.items():
            self._storage.exchange((Object.IDENTITY, subindex), value)
        self.power_on()

    def power_off(self) -> None:
        """Lose power: no frames in or out, no torque."""
        self._supply_on = False
        self.state = NmtState.INITIALISING
        self.timers.cancel_all()
        self.drive.power_off()

    def _restart(self, *, communication_only: bool) -> None:
        self.state = NmtState.INITIALISING
        self._storage.restore(communication_only=communication_only)
        self._derive_rated_torque()
        self._server.reset()
        self._sync.reset()
        self._tpdos.reset()
        self._rpdos.reset()
        self._consumer.restart()
        self._producer.stop()
        self.timers.cancel(Node)
        if communication_only:
            boot_ns = RESET_COMMUNICATION_NS
        else:
            boot_ns = round(self._settings.boot_ms * MILLISECOND)
            self.drive.power_on()
        self.timers.start(Node, self._line.now_ns + boot_ns, self._boot_up)

    def _boot_up(self) -> None:
        self._producer.boot_up()
        self.state = NmtState.PRE_OPERATIONAL

    def _command(self, command: NmtCommand) -> None:
        if command is NmtCommand.RESET_NODE:
            self.power_on()
            return
        self._enter(NEXT_STATE[command])
        if command is NmtCommand.RESET_COMMUNICATION:
            self._restart(communication_only=True)
            self.connection.reset()
            self.drive.update()

    def _enter(self, state: NmtState) -> None:
        before, self.state = self.state, state
        if not self._allows(Service.SDO):
            self._server.reset()
        if not self._allows(Service.SYNC):
            self._sync.reset()
        if before is NmtState.OPERATIONAL and state is not NmtState.OPERATIONAL:
            self._tpdos.leave_operational()
            self._rpdos.leave_operational()
            self.drive.left_operational()
            self.drive.update()
        elif before is not NmtState.OPERATIONAL and state is NmtState.OPERATIONAL:
            self._tpdos.enter_operational()

    def _allows(self, service: Service) -> bool:
        return service in SERVICES[self.state]

    # --- the bus ------------------------------------------------------------------------------

    def receive(self, frame: Frame) -> None:
        """Process any frame of the bus."""
        if self._routes_revision != self.dictionary.revision:
            self._routes = self._present_routes()
            self._routes_revision = self.dictionary.revision
        route = self._routes.get(frame.can_id)
        if route is not None and self._supply_on and self.disturbance.receives:
            route(frame)

    def _present_routes(self) -> dict[int | None, Callable[[Frame], None]]:
        """Return what receives each identifier; a later line takes precedence."""
        node_id = self._settings.node_id
        own_ids = SDO_ANSWER_ID + node_id, HEARTBEAT_ID + node_id, self.errors.can_id
        return {
            **{
                can_id: partial(self._receive_pdo, slots)
                for can_id, slots in self._rpdos.slots().items()
            },
            **dict.fromkeys(self._tpdos.can_ids, self._receive_own_pdo),
            **dict.fromkeys(HEARTBEAT_IDS, self._receive_heartbeat),
            **dict.fromkeys(own_ids, self._receive_own),
            SDO_REQUEST_ID + node_id: self._request,
            self._sync.can_id: self._synchronise,
            NMT_ID: self._network_command,
        }

    def _receive_pdo(self, slots: Sequence[int], frame: Frame) -> None:
        if self._allows(Service.PDO):
            self._rpdos.receive(slots, frame.data)

    def _receive_own_pdo(self, frame: Frame) -> None:
        """Receive a frame with the identifier of a TPDO, which an RPDO may have, too."""
        if self._allows(Service.PDO):
            self.connection.collision(of_pdo=True)
            self._rpdos.receive(self._rpdos.slots().get(frame.can_id, ()), frame.data)

    def _receive_own(self, _: Frame) -> None:
        """Receive a frame with another identifier that only this node sends."""
        self.connection.collision(of_pdo=False)

    def _receive_heartbeat(self, frame: Frame) -> None:
        if len(frame.data) == 1:
            self._consumer.received(frame.can_id - HEARTBEAT_ID, frame.data[0])

    def _network_command(self, frame: Frame) -> None:
        command = command_for(self._settings.node_id, frame.data)
        if command is not None and self.state is not NmtState.INITIALISING:
            self._command(command)

    def _request(self, frame: Frame) -> None:
        if not self._allows(Service.SDO):
            return
        self._server.receive(frame.data)
        self.changed()

    def _synchronise(self, frame: Frame) -> None:
        if not self._allows(Service.SYNC) or not self._sync.receive(frame.data):
            return
        self.drive.latch()
        if self._allows(Service.PDO):
            self._tpdos.sync()
            self._rpdos.sync()

    def _apply(self, values: Values) -> None:
        """Store the values of RPDOs (rules 2 and 5 of pdo_receive.py), then act on them at once."""
        accepts = self.dictionary.accepts
        accepted = [(address, value) for address, value in values if accepts(*address, value)]
        for address, value in accepted:
            self.dictionary.put(*address, value)
        for address, _ in accepted:
            self.dictionary.notify(*address)
        self.drive.pdos_applied()
        self.changed()

    def changed(self) -> None:
        """Update the plant's order and the TPDOs after a possible change of the drive's state."""
        if not self._supply_on:
            return
        self.drive.update()
        if self._allows(Service.PDO):
            self._tpdos.send_changes()

    def run_timers(self, now_ns: int) -> None:
        """Run all timers that are due."""
        self.timers.run_due(now_ns)
        self.changed()

    def reaches_bus(self, frame: Frame, time_ns: int) -> bool:
        """Return whether a frame that the node sends at this time reaches the bus.

        A TPDO delayed by its latency does not, if the node has left operational meanwhile.
        """
        if frame.can_id in self._tpdo_ids and self.state is not NmtState.OPERATIONAL:
            return False
        return self._supply_on and self.disturbance.reaches_bus and time_ns >= self._on_since_ns

    def _send_tpdo(self, number: int, frame: Frame, delay_ns: int) -> None:
        self._tpdo_ids.add(frame.can_id)
        if self.disturbance.all_ones_tpdo == number:
            frame = Frame(frame.can_id, b"\xff" * len(frame.data))
        if self.disturbance.lost_tpdo not in (number, EVERY_TPDO):
            self._line.send(frame, delay_ns=delay_ns)

    def _tpdo_delays_ns(self, count: int) -> list[int]:
        delays = [self._rng.choice(self._latencies_ns) for _ in range(count)]
        if not self._settings.tpdo_shuffled:
            delays.sort()
        return [delay + self.disturbance.late_ns for delay in delays]

    # --- errors of communication --------------------------------------------------------------

    def set_error(self, code: int, present: bool) -> None:
        """Begin an error, or end its cause: a lost connection acts as one, others are faults."""
        if code in FAILURES:
            self.connection.set_failure(code, present)
        elif present:
            self.drive.fault(code)
        else:
            self.errors.cause_gone(code)

    def bus_off(self) -> None:
        """Begin a bus-off: the CAN controller leaves the bus, and the drive detects it."""
        self.disturbance.bus_off = True
        self._rpdos.drop_waiting()
        self.connection.bus_off()

    def bus_back(self) -> None:
        """End a bus-off."""
        self.disturbance.bus_off = False
        self.connection.bus_back()

    # --- the node's own objects -------------------------------------------------------------------

    @property
    def _power_stage_on(self) -> bool:
        return self.drive.state in POWER_STAGE_ON

    def _check_motor_data(self, subindex: int, _: int) -> None:
        if self._power_stage_on and subindex != CURRENT_LIMIT_SUB:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _derive_rated_torque(self) -> None:
        if self._settings.personality is not PersonalityName.EPOS4:
            return
        value = self.dictionary.value
        nominal_ma, constant = (value(Object.EPOS4_MOTOR_DATA, sub) for sub in (1, 5))
        self.dictionary.put(Object.RATED_TORQUE, 0, rated_torque_unm(nominal_ma, constant))
