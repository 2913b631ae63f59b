"""One CANopen node: frames of the bus in, frames out, with a CiA 402 drive as its application.

Here the parts are put together: network management decides which service works, SDO and PDO reach
the dictionary, SYNC samples and applies, error control watches the master. The order at a SYNC is
the standard's: sample what was (TPDO), then apply what came since the last SYNC (RPDO), so a torque
sampled at SYNC k is the one that acted up to k.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from sim_drives.aborts import AbortCode, SdoAbortError
from sim_drives.dictionary import Entry, ObjectDictionary
from sim_drives.drive import Drive
from sim_drives.emergency import CAN_ID_MASK, Errors
from sim_drives.frame import Frame
from sim_drives.heartbeat import HEARTBEAT_ID, HeartbeatConsumer, HeartbeatProducer
from sim_drives.line import Line
from sim_drives.nmt import (
    NEXT_STATE,
    NMT_ID,
    SERVICES,
    NmtCommand,
    NmtState,
    Service,
    command_for,
)
from sim_drives.pdo import ReceivePdos, TransmitPdos, Values
from sim_drives.personality import PERSONALITIES, Personality, commissioned
from sim_drives.plant_port import Axis
from sim_drives.power_state import POWER_STAGE_ON
from sim_drives.sdo_server import SdoServer
from sim_drives.settings import DriveSettings, FaultKind, PersonalityName
from sim_drives.storage import Storage
from sim_drives.timers import MILLISECOND, Timers

SDO_REQUEST_ID: Final = 0x600
SDO_ANSWER_ID: Final = 0x580
COB_ID_SYNC: Final = 0x1005
SYNC_PRODUCER_BITS: Final = 0x6000_0000
RESET_COMMUNICATION_NS: Final = 5 * MILLISECOND
HEARTBEAT_LOST_CODE: Final = 0x8130
PDO_TIMEOUT_CODE: Final = 0x8250
PASSIVE_CODE: Final = 0x8120
CONNECTION_CODES: Final = (HEARTBEAT_LOST_CODE, PDO_TIMEOUT_CODE, PASSIVE_CODE)
SYNC_LENGTH_CODE: Final = 0x8240
SYNC_MAX_BYTES: Final = 1
MOTOR_DATA: Final = (0x3001, 0x6075, 0x6076)
CURRENT_LIMIT_SUB: Final = 2
"""3001h:02 may change at any time; the motor behind it may not."""
PRE_OPERATIONAL_ON_ERROR: Final = 0
STOPPED_ON_ERROR: Final = 2
"""1029h:1; 1 changes nothing."""
EVERY_TPDO: Final = 0
PRODUCT_CODE: Final = 2
SERIAL_NUMBER: Final = 4
"""Sub-indices of 1018h."""


@dataclass(slots=True)
class Disturbance:
    """What is wrong around this node (see `fault_rules.py`)."""

    lost_tpdo: int | None = None
    """Number of the TPDO that gets lost, or EVERY_TPDO."""
    late_ns: int = 0
    """Synchronous TPDOs leave this much later."""
    mute: bool = False
    """Nothing that the node sends reaches the bus."""
    unplugged: bool = False
    """Neither way."""
    deaf: bool = False
    """Nothing of the bus reaches the node."""
    motor_sense: int = 1
    encoder_sense: int = 1
    """-1: connected the wrong way round."""
    held_by: set[FaultKind] = field(default_factory=set)
    """What keeps the axis from moving."""


class Node:
    """A drive with its name, as a slave on the bus."""

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
            settings: its tables of plant.toml.
            entries: of its EDS, for its node id.
            axis: its side of the plant.
            line: its end of the bus.
            rng: of the TPDOs' latency.
        """
        self.name = name
        self.axis = axis
        self.disturbance = Disturbance()
        self._tpdo_ids: set[int] = set()
        self.state = NmtState.INITIALISING
        self.timers = Timers()
        self._settings = settings
        self._line = line
        self._rng = rng
        self._powered = False
        self._powered_since_ns = 0
        personality = PERSONALITIES[settings.personality]
        self._personality: Personality = personality
        dictionary = ObjectDictionary(entries)
        self.dictionary = dictionary
        for address, value in commissioned(settings).items():
            dictionary.put(*address, value)
        self.errors = Errors(
            dictionary,
            _Gate(line, lambda: self._allows(Service.EMERGENCY)),
            generic_bit=personality.generic_error_bit,
        )
        self.drive = Drive(settings, dictionary, axis, line, self.timers, self.errors)
        self.identity = {
            sub: dictionary.value(0x1018, sub) for sub in (PRODUCT_CODE, SERIAL_NUMBER)
        }
        """As delivered: 1018h by sub-index."""
        self.drive.on_target_missed = lambda: self._rpdo_timeout(True)
        self._storage = Storage(dictionary, commissioned(settings), lambda: self._power_stage_on)
        self._server = SdoServer(dictionary)
        self._producer = HeartbeatProducer(
            settings.node_id, dictionary, line, self.timers, lambda: self.state
        )
        self._consumer = HeartbeatConsumer(
            dictionary, line, self.timers, self._master_lost, self._master_back
        )
        self._tpdos, self._rpdos = self._build_pdos()
        dictionary.before_upload = self.drive.latch
        self._guard_objects()

    def _build_pdos(self) -> tuple[TransmitPdos, ReceivePdos]:
        parts = self.dictionary, self._line, self.timers
        locked = self._personality.cob_id_locked_while_valid
        transmit = TransmitPdos(*parts, self._send_tpdo, self._tpdo_delays_ns, locked=locked)
        receive = ReceivePdos(
            *parts, self._apply, self._length_error, self._rpdo_timeout, locked=locked
        )
        return transmit, receive

    def _guard_objects(self) -> None:
        self.dictionary.guard(COB_ID_SYNC, self._judge_sync_cob_id)
        for index in MOTOR_DATA:
            self.dictionary.guard(index, self._judge_motor_data)
        self.dictionary.watch(0x3001, lambda _: self._derive_rated_torque())

    # --- power and network management ---------------------------------------------------------

    def power_on(self) -> None:
        """Start, or start again after a loss of power: origin, errors and what was commanded go."""
        self._powered = True
        self._powered_since_ns = self._line.now_ns
        self.timers.cancel_all()
        self._restart(communication_only=False)

    def exchange(self, identity: Mapping[int, int]) -> None:
        """Put another drive in its place, with these sub-indices of 1018h, and switch it on."""
        self.power_off()
        for subindex, value in identity.items():
            self._storage.exchange((0x1018, subindex), value)
        self.power_on()

    def power_off(self) -> None:
        """Lose the power: silent, deaf and without torque."""
        self._powered = False
        self.state = NmtState.INITIALISING
        self.timers.cancel_all()
        self.drive.power_off()

    def _restart(self, *, communication_only: bool) -> None:
        self.state = NmtState.INITIALISING
        self._storage.restore(communication_only=communication_only)
        self._derive_rated_torque()
        self._server.reset()
        self._tpdos.reset()
        self._rpdos.reset()
        self._consumer.restart()
        self._producer.restart()
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
            for code in CONNECTION_CODES:
                self.errors.cause_gone(code)
            self.drive.update()

    def _enter(self, state: NmtState) -> None:
        before, self.state = self.state, state
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
        """Take any frame of the bus."""
        if not self._powered or self.disturbance.unplugged or self.disturbance.deaf:
            return
        node_id = self._settings.node_id
        can_id, data = frame
        if can_id == NMT_ID:
            self._network_command(data)
        elif can_id == self.dictionary.value(COB_ID_SYNC) & CAN_ID_MASK:
            self._sync(data)
        elif can_id == SDO_REQUEST_ID + node_id:
            self._request(data)
        elif HEARTBEAT_ID < can_id < HEARTBEAT_ID + 0x80 and len(data) == 1:
            self._consumer.heard(can_id - HEARTBEAT_ID)
        elif self._allows(Service.PDO):
            self._rpdos.receive(frame)

    def _network_command(self, data: bytes) -> None:
        command = command_for(self._settings.node_id, data)
        if command is not None and self.state is not NmtState.INITIALISING:
            self._command(command)

    def _request(self, data: bytes) -> None:
        if not self._allows(Service.SDO):
            return
        answer = self._server.feed(data)
        if answer is not None:
            self._line.send(Frame(SDO_ANSWER_ID + self._settings.node_id, answer))
        self.changed()

    def _sync(self, data: bytes) -> None:
        if not self._allows(Service.SYNC):
            return
        self._length_error(SYNC_LENGTH_CODE, len(data) > SYNC_MAX_BYTES)
        self.drive.latch()
        if self._allows(Service.PDO):
            self._tpdos.sync()
            self._rpdos.sync()

    def _apply(self, values: Values) -> None:
        """Store what RPDOs carried (pdo.py rules 4 and 6), then act on all of it at once."""
        accepts = self.dictionary.accepts
        accepted = [(address, value) for address, value in values if accepts(*address, value)]
        for address, value in accepted:
            self.dictionary.put(*address, value)
        for address, _ in accepted:
            self.dictionary.notify(*address)
        self.errors.cause_gone(PDO_TIMEOUT_CODE)
        self.drive.pdo_came()
        self.changed()

    def changed(self) -> None:
        """Something may have changed the drive's state: order the plant, tell the bus."""
        if not self._powered:
            return
        self.drive.update()
        if self._allows(Service.PDO):
            self._tpdos.look_for_changes()

    def run_timers(self, now_ns: int) -> None:
        """Run what is due."""
        self.timers.run_due(now_ns)
        self.changed()

    def is_heard(self, frame: Frame, time_ns: int) -> bool:
        """Whether a frame of the node's that leaves at this time reaches the bus.

        A TPDO that waited for its latency does not if the node has left operational meanwhile.
        """
        if frame.can_id in self._tpdo_ids and self.state is not NmtState.OPERATIONAL:
            return False
        cut = self.disturbance.mute or self.disturbance.unplugged
        return self._powered and not cut and time_ns >= self._powered_since_ns

    def _send_tpdo(self, number: int, frame: Frame, delay_ns: int) -> None:
        self._tpdo_ids.add(frame.can_id)
        if self.disturbance.lost_tpdo not in (number, EVERY_TPDO):
            self._line.send(frame, delay_ns=delay_ns)

    def _tpdo_delays_ns(self, count: int) -> list[int]:
        low_ns = round(self._settings.tpdo_delay_min_ms * MILLISECOND)
        high_ns = round(self._settings.tpdo_delay_max_ms * MILLISECOND)
        delays = [self._rng.randint(low_ns, high_ns) for _ in range(count)]
        if not self._settings.tpdo_shuffled:
            delays.sort()
        return [delay + self.disturbance.late_ns for delay in delays]

    # --- errors of communication --------------------------------------------------------------

    def _length_error(self, code: int, wrong: bool) -> None:
        if wrong:
            self.errors.begin(code, latched=False)
        else:
            self.errors.cause_gone(code)

    def _rpdo_timeout(self, missing: bool) -> None:
        self._connection(PDO_TIMEOUT_CODE, lost=missing)

    def _master_lost(self) -> None:
        self._connection(HEARTBEAT_LOST_CODE, lost=True)

    def _master_back(self) -> None:
        if not self._personality.connection_loss_is_fault:
            self._connection(HEARTBEAT_LOST_CODE, lost=False)

    def _connection(self, code: int, *, lost: bool) -> None:
        if not lost:
            self.errors.cause_gone(code)
            return
        self.drive.connection_lost(code)
        behaviour = self.dictionary.value(0x1029, 1)
        if behaviour == STOPPED_ON_ERROR:
            self._enter(NmtState.STOPPED)
        elif behaviour == PRE_OPERATIONAL_ON_ERROR and self.state is NmtState.OPERATIONAL:
            self._enter(NmtState.PRE_OPERATIONAL)

    def begin_error(self, code: int) -> None:
        """An error from outside: a lost connection acts as one, all others are faults."""
        if code in CONNECTION_CODES:
            self._connection(code, lost=True)
        else:
            self.drive.fault(code)

    def end_error(self, code: int) -> None:
        """Its cause has gone; some drives end a lost connection at reset communication alone."""
        if code not in CONNECTION_CODES or not self._personality.connection_loss_is_fault:
            self.errors.cause_gone(code)

    # --- objects of the node's own ------------------------------------------------------------

    @property
    def _power_stage_on(self) -> bool:
        return self.drive.state in POWER_STAGE_ON

    def _judge_sync_cob_id(self, _: int, value: int) -> None:
        if value & SYNC_PRODUCER_BITS:  # a producer, or a 29-bit identifier: this slave is neither
            raise SdoAbortError(AbortCode.RANGE)

    def _judge_motor_data(self, subindex: int, _: int) -> None:
        if self._power_stage_on and subindex != CURRENT_LIMIT_SUB:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _derive_rated_torque(self) -> None:
        if self._settings.personality is not PersonalityName.EPOS4:
            return
        nominal_ma, constant = (self.dictionary.value(0x3001, sub) for sub in (1, 5))
        self.dictionary.put(0x6076, 0, nominal_ma * constant // 1000)


class _Gate:
    """A line that only carries what the present NMT state allows."""

    def __init__(self, line: Line, is_open: Callable[[], bool]) -> None:
        self._line = line
        self._is_open = is_open

    @property
    def now_ns(self) -> int:
        return self._line.now_ns

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        if self._is_open():
            self._line.send(frame, delay_ns=delay_ns)
