"""One drive in the cycle, and all drives of a bus: frames to feedback, commands to frames.

The calls of one cycle on a `DriveGroup`, in order of time:

    feed_between(frames)   frames received before SYNC, and between two windows
    (SYNC leaves)
    feed(frames)           frames received in the window
    end_of_window(cycle)   one DriveFeedback for each drive
    frames(commands)       RPDO1 and RPDO2 of each drive
    uploads()              after them at most one SDO request

Rules:
1.  A sample is fresh only if every cyclic TPDO of the drive came inside the window, at its mapped
    length. Position and torque are always those of the last complete sample, so they belong to
    the same SYNC; statusword, mode and inputs are the newest that came inside any window.
2.  A TPDO outside a window is late: counted, not used. One identifier twice in a window means that
    the first was late, since a drive sends one for each SYNC in order: the second is used.
3.  A frame of another length than mapped is not used, and counted (what a drive would answer with
    EMCY 8210h or 8220h).
4.  EMCY, heartbeat, boot-up and TPDO3 count whenever they come.
5.  Values of TPDO3 are known until three of them are missing in a row. A temperature that no PDO
    carries is read by SDO (`temperature.py`).
"""

from collections.abc import Callable, Sequence
from typing import Final

from drives.canopen.bus import Frame
from drives.canopen.bus_state import BusMonitor
from drives.canopen.emcy import EMERGENCY_ID, EmergencyLog
from drives.canopen.emcy_codes import meaning
from drives.canopen.nmt import HEARTBEAT_ID, HeartbeatWatch
from drives.canopen.sdo import SDO_ANSWER_ID, SDO_REQUEST_ID
from drives.cia402.axis_file import InputBit
from drives.cia402.pdo import layouts
from drives.cia402.power_state import (
    STATUS_FOLLOWS,
    STATUS_WARNING,
    Sent,
    decode_statusword,
    next_word,
)
from drives.cia402.profile import DriveDescription
from drives.cia402.temperature import TemperatureTurns, TemperatureUpload
from drives.signals import (
    DriveCommand,
    DriveFeedback,
    Emergency,
    Input,
    OperationMode,
    PowerState,
)

_CYCLIC_MODES: Final = frozenset(
    (OperationMode.CYCLIC_SYNC_POSITION, 9, OperationMode.CYCLIC_SYNC_TORQUE)
)
"""Modes in which statusword bit 12 means that the drive follows; 9 is cyclic sync velocity."""

SLOW_MISSED_MAX: Final = 3
"""Number of TPDO3s in a row that may be lost."""

Handler = Callable[[bytes, int, bool], bool]
"""Arguments: data, time, whether a window is open; True asks for an immediate reaction."""


class Drive:
    """State of one drive, and what its next commands depend on."""

    def __init__(self, description: DriveDescription, armed_ns: int) -> None:
        """Start from the end of bring-up, `armed_ns`, when the drive was last received."""
        profile = description.profile
        self.node_id = description.node_id
        self.heartbeat = HeartbeatWatch(armed_ns)
        self.emergencies = EmergencyLog(self.node_id, profile.emergency_codes)
        self._pdos = layouts(profile, self.node_id)
        self._resume = profile.resume_from_quick_stop
        uploaded = profile.uploaded_temperature
        self._temperature = None if uploaded is not None else profile.temperature
        self.upload = None if uploaded is None else TemperatureUpload(self.node_id, uploaded)
        self._maps_error_code = profile.pdo.error_code
        self._codes = profile.emergency_codes
        self._input_bits = _input_bits(description)
        self._always_zero = profile.inputs_always_zero
        self._input_mask = sum(1 << bit.bit for _, bit in self._input_bits)
        self._decoded_inputs: dict[int, Input] = {}
        self._sent = Sent()
        # the newest received inside a window
        self._power_state = PowerState.UNKNOWN
        self._statusword = 0
        self._mode_display = 0
        self._inputs = Input.NONE
        self._temperature_degc: float | None = None
        self._error_code, self._error_text = 0, ""
        self._windows_since_slow = 0
        # this window, not complete yet
        self._has_status = False
        self._has_torque = False
        self._window_position_counts = 0
        self._window_torque_raw = 0
        # the last complete sample
        self._position_counts = 0
        self._torque_raw = 0
        self._sample_cycle: int | None = None
        """Cycle of the last complete sample; initially the cycle before the first window."""
        self._last_cycle = 0
        self._late_count = 0
        self._protocol_error_count = 0

    @property
    def cyclic_ids(self) -> tuple[int, int]:
        """Identifiers of the TPDOs that a complete sample needs."""
        return self._pdos.status.can_id, self._pdos.torque.can_id

    @property
    def controlword(self) -> int:
        """Controlword of the last RPDO1."""
        return self._sent.controlword

    def handlers(self) -> dict[int, Handler]:
        """Handlers by identifier of the frames of this drive, and to its SDO server."""
        upload = self.upload
        by_sdo: dict[int, Handler] = (
            {}
            if upload is None
            else {
                SDO_ANSWER_ID + self.node_id: upload.on_answer,
                SDO_REQUEST_ID + self.node_id: upload.on_foreign_request,
            }
        )
        return by_sdo | {
            self._pdos.status.can_id: self._on_status,
            self._pdos.torque.can_id: self._on_torque,
            self._pdos.slow.can_id: self._on_slow,
            EMERGENCY_ID + self.node_id: self._on_emergency,
            HEARTBEAT_ID + self.node_id: self._on_heartbeat,
        }

    def end_of_window(self, cycle: int, now_ns: int) -> DriveFeedback:
        """Close this cycle's window and return the feedback."""
        fresh = self._has_status and self._has_torque
        self._last_cycle = cycle
        if self._sample_cycle is None:
            # Bring-up has received samples, so a missing one has not been missing for long.
            self._sample_cycle = cycle - 1
        if fresh:
            self._position_counts = self._window_position_counts
            self._torque_raw = self._window_torque_raw
            self._sample_cycle = cycle
        self._has_status = self._has_torque = False
        self._windows_since_slow += 1
        if self._is_slow_overdue():
            self._temperature_degc = None
            self._error_code, self._error_text = 0, ""
        return self._feedback(now_ns, fresh=fresh, news=self.emergencies.take_news())

    def peek(self, now_ns: int) -> DriveFeedback:
        """Return the state between two windows: the last sample, without news."""
        return self._feedback(now_ns, fresh=False)

    def _feedback(
        self, now_ns: int, *, fresh: bool, news: tuple[tuple[Emergency, bool], ...] = ()
    ) -> DriveFeedback:
        mode, word, upload = self._mode_display, self._statusword, self.upload
        return DriveFeedback(
            node_id=self.node_id,
            nmt_state=self.heartbeat.state,
            power_state=self._power_state,
            statusword=word,
            following=word & STATUS_FOLLOWS != 0 and mode in _CYCLIC_MODES,
            warning=word & STATUS_WARNING != 0,
            mode_display=mode,
            position_counts=self._position_counts,
            torque_raw=self._torque_raw,
            inputs=self._inputs,
            temperature_degc=self._temperature_degc if upload is None else upload.degc,
            fresh=fresh,
            sample_age_cycles=self._last_cycle - (self._sample_cycle or 0),
            late_count=self._late_count,
            heartbeat_age_ns=self.heartbeat.age_ns(now_ns),
            rebooted=self.heartbeat.boot_up_count > 0,
            emergency=self.emergencies.open,
            emergency_count=self.emergencies.count,
            protocol_error_count=self._protocol_error_count,
            alarm_count=self.emergencies.alarm_count,
            alarm=self.emergencies.alarm,
            temperature_overdue=(
                upload.overdue
                if upload is not None
                else self._temperature is not None and self._is_slow_overdue()
            ),
            error_code=self._untold_error_code(),
            error_text=self._error_text,
            reference_lost=self.emergencies.reference_lost,
            news=news,
        )

    def _untold_error_code(self) -> int:
        code = self._error_code
        return code if code and not self.emergencies.has_told(code) else 0

    def _is_slow_overdue(self) -> bool:
        """True if TPDO3 is overdue, counted in windows: without SYNC none is due."""
        return self._windows_since_slow > SLOW_MISSED_MAX * self._pdos.slow.transmission_type

    def frames(self, command: DriveCommand) -> tuple[Frame, Frame]:
        """RPDO1 and RPDO2 for this command; the controlword follows the last displayed state."""
        self._sent = next_word(self._power_state, command.power, self._sent, resume=self._resume)
        control, torque = self._pdos.control, self._pdos.target_torque
        return (
            Frame(
                control.can_id,
                control.codec.pack(
                    self._sent.controlword, command.mode, command.target_position_counts
                ),
            ),
            Frame(torque.can_id, torque.codec.pack(command.target_torque_permille)),
        )

    def _on_status(self, data: bytes, _now_ns: int, in_window: bool) -> bool:
        if not self._usable(len(data) == self._pdos.status.size, in_window, self._has_status):
            return False
        word, self._window_position_counts, self._mode_display = self._pdos.status.codec.unpack(
            data
        )
        self._has_status = True
        self._statusword = word
        self._power_state = decode_statusword(word)
        self._protocol_error_count += self._power_state is PowerState.UNKNOWN
        return False

    def _on_torque(self, data: bytes, _now_ns: int, in_window: bool) -> bool:
        if not self._usable(len(data) == self._pdos.torque.size, in_window, self._has_torque):
            return False
        self._window_torque_raw, bits = self._pdos.torque.codec.unpack(data)
        self._has_torque = True
        if bits & self._always_zero:
            self._inputs = Input.IMPOSSIBLE
            return False
        bits &= self._input_mask
        inputs = self._decoded_inputs.get(bits)
        if inputs is None:
            inputs = self._decoded_inputs[bits] = _decode_inputs(bits, self._input_bits)
        self._inputs = inputs
        return False

    def _on_slow(self, data: bytes, _now_ns: int, _in_window: bool) -> bool:
        if len(data) != self._pdos.slow.size:
            self._protocol_error_count += 1
        else:
            self._windows_since_slow = 0
            values = self._pdos.slow.codec.unpack(data)
            if self._temperature is not None:
                self._temperature_degc = values[0] * self._temperature.degc_per_count
            if self._maps_error_code and values[-1] != self._error_code:
                self._error_code = values[-1]
                self._error_text = meaning(self._error_code, self._codes).text
        return False

    def _on_emergency(self, data: bytes, now_ns: int, _in_window: bool) -> bool:
        self._protocol_error_count += self.emergencies.feed(data, now_ns) is None
        return self.emergencies.has_alarm

    def _on_heartbeat(self, data: bytes, now_ns: int, _in_window: bool) -> bool:
        strange = self.heartbeat.strange_count
        changed = self.heartbeat.feed(data, now_ns)
        self._protocol_error_count += self.heartbeat.strange_count - strange
        return changed

    def _usable(self, length_ok: bool, in_window: bool, again: bool) -> bool:
        if not length_ok:
            self._protocol_error_count += 1
            return False
        if again or not in_window:
            self._late_count += 1
        return in_window


class DriveGroup:
    """All drives of one bus, in the order in which feedback and commands are listed."""

    def __init__(self, drives: Sequence[Drive]) -> None:
        self.drives = tuple(drives)
        self.bus_state = BusMonitor()
        self.stray_count = 0
        """Frames with an identifier of no configured drive."""
        self.cyclic_ids = frozenset(can_id for drive in drives for can_id in drive.cyclic_ids)
        """Identifiers of a complete window: the loop may close the window early once all came.

        After a window with a missing TPDO it must not: the first one to arrive may be the late one.
        """
        uploads = [drive.upload for drive in self.drives if drive.upload is not None]
        self._turns = TemperatureTurns(uploads)
        self._handlers = {
            can_id: handler for drive in drives for can_id, handler in drive.handlers().items()
        }

    def feed(self, frames: Sequence[Frame], now_ns: int) -> bool:
        """Take frames of this cycle's window; True if one asks for an immediate reaction."""
        return self._feed(frames, now_ns, True)

    def feed_between(self, frames: Sequence[Frame], now_ns: int) -> bool:
        """Take frames from outside a window; True if one asks for an immediate reaction.

        That is an EMCY that is a new alarm, a boot-up message, a change of NMT state, or a change
        of the controller's condition (bus-off).
        """
        return self._feed(frames, now_ns, False)

    def end_of_window(self, cycle: int, now_ns: int) -> tuple[DriveFeedback, ...]:
        """Close this cycle's window and return one feedback for each drive."""
        return tuple([drive.end_of_window(cycle, now_ns) for drive in self.drives])

    def peek(self, now_ns: int) -> tuple[DriveFeedback, ...]:
        """Return the state between two windows: current EMCY and heartbeat, no fresh sample."""
        return tuple([drive.peek(now_ns) for drive in self.drives])

    def frames(self, commands: Sequence[DriveCommand]) -> list[Frame]:
        """RPDOs of all drives: controlwords and positions of all drives before any torque."""
        pairs = [
            drive.frames(command) for drive, command in zip(self.drives, commands, strict=True)
        ]
        return [control for control, _ in pairs] + [torque for _, torque in pairs]

    def uploads(self) -> list[Frame]:
        """At most one SDO request; call once in a cycle, and send it after the commands."""
        return self._turns.request()

    def _feed(self, frames: Sequence[Frame], now_ns: int, in_window: bool) -> bool:
        alarm = False
        for frame in frames:
            if frame.is_error:
                alarm |= self.bus_state.feed(frame)
                continue
            handler = self._handlers.get(frame.can_id)
            if handler is None:
                self.stray_count += 1
            elif handler(frame.data, now_ns, in_window):
                alarm = True
        return alarm


def _input_bits(description: DriveDescription) -> tuple[tuple[Input, InputBit], ...]:
    inputs = description.axis.inputs
    named = (
        (Input.HAND_SWITCH_CLOSED, inputs.hand_switch_closed),
        (Input.STO_RELEASED, inputs.sto_released),
        (Input.NEGATIVE_LIMIT, inputs.negative_limit),
        (Input.POSITIVE_LIMIT, inputs.positive_limit),
    )
    return tuple((meaning, bit) for meaning, bit in named if bit is not None)


def _decode_inputs(bits: int, input_bits: tuple[tuple[Input, InputBit], ...]) -> Input:
    inputs = Input.NONE
    for one, bit in input_bits:
        if (bits >> bit.bit) & 1 == bit.level:
            inputs |= one
    return inputs
