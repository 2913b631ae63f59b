"""Bring-up: all drives of a bus from unknown to OPERATIONAL, one bounded step at a time.

`bring_up` is a generator: each `next` does one step of one drive (at most two SDO transfers, more
only where all drives are switched off) or waits one slice, and yields what it did, so the core can
feed its watchdog and log between steps. It ends with one `DriveReport` for each drive, or with an
error:

    BringUpRefused   identity or configuration: with drive, object, value and abort text
    DriveSilent      no answer, or a reboot during bring-up: worth another try
    DrivePowered     the drive holds the joint, and switching it off was not requested
    BusError         the bus itself

The first two name a `BootFailure`, with the letter of CiA 302-2 where that has one.

Rules:
1.  All drives are reset before any is configured, and none is started before all are configured.
2.  Boot-up messages are counted from before the reset is sent, so none can be missed; a second
    one within SETTLE_NS of the first is the same boot, any later one a reboot: DriveSilent, unless
    two nodes then answer under one number.
3.  Everything written is read back. A drive that answers with another value is refused.
4.  Nothing is enabled and no fault is reset, whatever state a drive is found in: it is reported.
    A drive that holds its joint keeps holding it until switching off is requested. Then all drives
    are identified first, and switched off within milliseconds of each other.
5.  The master's heartbeat is not sent here: the drives start to monitor it with the first one of
    the cycle.
6.  Two nodes under one number are refused. The evidence is a request that was answered twice, or a
    serial number that differs between two reads. Another try would not help.
7.  Any other node that sends SYNC, or a heartbeat under the master's number, is another master: no
    drive is brought up beside it, and the check is repeated at the next try. The bus is listened
    to before anything is sent.
8.  Where switching off was requested and a drive does not come up, or whatever else ends the
    bring-up before its last step, disable voltage is sent to all drives nevertheless: their resets
    disabled their heartbeat monitoring, so nothing else would switch them off. A drive that does
    not answer may still receive, and a bus that did not take a frame may take the next one.
"""

from bisect import bisect_right
from collections.abc import Generator, Sequence
from contextlib import ExitStack, suppress
from typing import Final, NamedTuple

from drives.bringup.objects import (
    SdoTarget,
    clear,
    examine,
    read,
    switch_off,
    write,
    write_range,
)
from drives.bringup.plan import CycleSettings, DrivePlan
from drives.bringup.port import DrivePort
from drives.bringup.presence import (
    OtherMaster,
    Texts,
    refuse_second_answer,
    refuse_second_node,
    until,
)
from drives.bringup.steps import SERIAL_NUMBER, Step, StepKind
from drives.canopen.emcy import decode_emergency
from drives.canopen.emcy_codes import meaning
from drives.canopen.nmt import NmtCommand, nmt_frame
from drives.canopen.objects import Object
from drives.cia402.pdo import PdoLayout, layouts
from drives.cia402.power_state import POWER_STAGE_OFF, decode_statusword
from drives.cia402.profile import DriveDescription
from drives.cia402.units import DriveBase, base_from_raw
from drives.errors import (
    BootFailure,
    BringUpRefused,
    DrivePowered,
    DrivesError,
    DriveSilent,
)
from drives.signals import Emergency, NmtState, PowerState

BOOT_TIMEOUT_NS: Final = 2_000_000_000
"""Limit for a boot-up message after NMT reset communication; EPOS4 needs some hundred ms."""
SETTLE_NS: Final = 50_000_000
HEARTBEAT_TIMEOUT_RATIO: Final = 4
"""In heartbeat times: limits for the first heartbeat, and for showing a new NMT state."""
FIRST_SAMPLE_SYNCS: Final = 20
"""SYNCs within which every drive must have sent a complete sample."""
SWITCH_OFF_TIMEOUT_NS: Final = 3_000_000_000
"""Time for a fault reaction that is in progress to ramp down first."""

_DISABLE_VOLTAGE: Final = Step(
    StepKind.WRITE, "disable voltage", Object.CONTROLWORD, bits=16, is_hex=True
)
_POSITION: Final = Step(StepKind.REPORT, "position", Object.POSITION, signed=True)


class Progress(NamedTuple):
    """Progress of bring-up after one step."""

    drive: str
    text: str
    done_count: int
    total_count: int


class DriveReport(NamedTuple):
    """Result of bring-up for one drive, now OPERATIONAL and answering SYNC."""

    name: str
    base: DriveBase
    """Read from the drive; input of `units.axis_scaling`."""
    power_state: PowerState
    statusword: int
    position_counts: int
    torque_raw: int
    absolute: bool
    """The encoder knows its position after power-on (axis file)."""
    serial_number: int
    """1018h:04; 0 where the manufacturer assigns none."""
    homed: bool
    """The drive reports that it is referenced (EPOS4: statusword bit 15)."""
    error_register: int
    error_code: int
    error_text: str
    emergencies: tuple[Emergency, ...]
    """EMCYs received during bring-up, oldest first."""
    reference_lost: bool
    """The error code or one of the EMCYs means that the encoder position is not reliable."""


class _DriveState:
    """One drive during bring-up, and what its steps have read."""

    reset_ns: int
    boot_up_count: int
    """Its boot-up messages before the reset, then with those of this boot."""
    sdo_repeat_count: int
    """Its repeated SDO replies before the reset."""

    def __init__(self, plan: DrivePlan) -> None:
        self.plan = plan
        self.description: DriveDescription = plan.description
        self.name = plan.description.name
        self.node_id = plan.description.node_id
        self.booted = False
        self.values: dict[tuple[int, int], int] = {}

    def target(self, port: DrivePort) -> SdoTarget:
        """The address of this drive's SDO transfers."""
        return SdoTarget(port, self.name, self.node_id)


def bring_up(
    plans: Sequence[DrivePlan],
    port: DrivePort,
    cycle: CycleSettings,
    *,
    may_switch_off: bool = False,
) -> Generator[Progress, None, tuple[DriveReport, ...]]:
    """Run the plans of all drives of one bus; the generator's return value is the list of reports.

    Args:
        plans: one for each drive.
        port: the bus.
        cycle: grid and watches.
        may_switch_off: switching off was requested, so a drive that is found powered is switched
            off.

    Raises:
        BringUpRefused, DrivePowered, DriveSilent, BusError: see the head of this file.
    """
    drives = [_DriveState(plan) for plan in plans]
    master = OtherMaster(port, cycle.master_node_id)
    total_count = sum(len(plan.steps) for plan in plans) + 2
    done_count = 0
    for text in master.listen():
        yield Progress("", text, done_count, total_count)
    # Also where this program meets what it did not expect, or is closed between two steps.
    leave_without_power = may_switch_off
    try:
        for drive, step in _ordered(drives, together=may_switch_off):
            for text in _run(step, drive, drives if may_switch_off else (), port, cycle):
                master.check()
                yield Progress(drive.name, text, done_count, total_count)
            done_count += 1
        leave_without_power = False
    finally:
        if leave_without_power:
            _leave_without_power(drives, port)
    for texts in (_start(drives, port, cycle), _first_samples(drives, port, cycle)):
        for text in texts:
            master.check()
            yield Progress("", text, done_count, total_count)
        done_count += 1
    return tuple(_report(drive, port) for drive in drives)


def _ordered(drives: Sequence[_DriveState], *, together: bool) -> list[tuple[_DriveState, Step]]:
    """Sort the steps: all resets first, so no drive acts while another is being configured.

    With `together`, the power of all drives is switched off at once, as soon as each of them has
    been identified as the one described by the files.
    """
    phased: list[tuple[int, _DriveState, Step]] = []
    for drive in drives:
        steps = drive.plan.steps
        power = [step.kind for step in steps].index(StepKind.POWER)
        starts = (1, power, power + 1) if together else (1,)  # the reset is the first step
        phased += [(bisect_right(starts, number), drive, step) for number, step in enumerate(steps)]
    return [(drive, step) for _, drive, step in sorted(phased, key=lambda one: one[0])]


def _run(
    step: Step,
    drive: _DriveState,
    may_switch_off: Sequence[_DriveState],
    port: DrivePort,
    cycle: CycleSettings,
) -> Texts:
    """Run one step of one drive; power is switched off only where `may_switch_off` allows it."""
    match step.kind:
        case StepKind.RESET:
            _reset(drive, port)
        case StepKind.BOOT:
            yield from _await_boot(drive, port, str(step))
        case StepKind.ALONE:
            yield from _alone(drive, port, str(step))
        case StepKind.HEAR:
            yield from _await_heartbeat(drive, port, cycle, str(step))
        case StepKind.POWER:
            yield from _without_power(step, drive, may_switch_off, port)
        case StepKind.CHECK | StepKind.COMPARE | StepKind.REPORT | StepKind.ASK:
            drive.values[step.index, step.sub] = examine(step, drive.target(port))
        case StepKind.SWITCH_OFF:
            switch_off(step, drive.target(port))
        case StepKind.WRITE:
            write(step, drive.target(port), step.value)
        case StepKind.CLEAR:
            clear(step, drive.target(port))
        case StepKind.RANGE:
            write_range(step, drive.target(port))
        case StepKind.SEED_POSITION:  # pragma: no branch - the last kind
            position_counts = read(_POSITION, drive.target(port))
            write(step, drive.target(port), max(step.value, min(step.second, position_counts)))
    yield from _check_same(drive, port, str(step))
    yield str(step)


# --- waiting --------------------------------------------------------------------------------------


def _reset(drive: _DriveState, port: DrivePort) -> None:
    drive.reset_ns = port.now_ns()
    port.wait(drive.reset_ns)  # frames queued now were sent before the reset
    traffic = port.traffic(drive.node_id)
    drive.boot_up_count, drive.sdo_repeat_count = traffic.boot_up_count, traffic.sdo_repeat_count
    port.send((nmt_frame(NmtCommand.RESET_COMMUNICATION, drive.node_id),))


def _await_boot(drive: _DriveState, port: DrivePort, text: str) -> Texts:
    def booted() -> bool:
        return port.traffic(drive.node_id).boot_up_count > drive.boot_up_count

    deadline_ns = drive.reset_ns + BOOT_TIMEOUT_NS
    if not (yield from until(port, deadline_ns, text, booted)):
        waited = f"no boot-up message within {BOOT_TIMEOUT_NS / 1e9:g} s of NMT reset communication"
        if port.bus_state.alone:
            alone = f"{waited}, and no frame is acknowledged: is any drive powered and connected?"
            raise DriveSilent(drive.name, BootFailure.NO_NODE, alone)
        what = f"{waited}: no power, no cable, another node id or bit rate?"
        raise DriveSilent(drive.name, BootFailure.NO_ANSWER, what)
    yield from until(port, port.now_ns() + SETTLE_NS, text, lambda: False)
    drive.boot_up_count = port.traffic(drive.node_id).boot_up_count
    drive.booted = True


def _without_power(
    step: Step, drive: _DriveState, may_switch_off: Sequence[_DriveState], port: DrivePort
) -> Texts:
    """Check that the drive has no power, or switch off all drives that may be switched off.

    All at once: a drive that is switched off first would pull at joints that are still held.
    """

    def state(one: _DriveState = drive) -> PowerState:
        return decode_statusword(read(step, one.target(port)))

    state_text = state()
    if state_text in POWER_STAGE_OFF:
        return
    if not may_switch_off:
        raise DrivePowered(drive.name, state_text)
    deadline_ns = port.now_ns() + SWITCH_OFF_TIMEOUT_NS
    for one in [one for one in may_switch_off if state(one) not in POWER_STAGE_OFF]:
        write(_DISABLE_VOLTAGE, one.target(port), 0)
    if not (yield from until(port, deadline_ns, str(step), lambda: state() in POWER_STAGE_OFF)):
        what = f"it stays in {state().name} after disable voltage"
        raise DriveSilent(drive.name, BootFailure.WRONG_STATE, what)


def _leave_without_power(drives: Sequence[_DriveState], port: DrivePort) -> None:
    """Send disable voltage to all drives (rule 8), whatever becomes of it at each of them."""
    with ExitStack() as leaving:
        for drive in reversed(drives):
            leaving.callback(_disable_voltage, drive, port)


def _disable_voltage(drive: _DriveState, port: DrivePort) -> None:
    with suppress(DrivesError):  # refusals, and no answer
        write(_DISABLE_VOLTAGE, drive.target(port), 0)


def _await_heartbeat(drive: _DriveState, port: DrivePort, cycle: CycleSettings, text: str) -> Texts:
    before = port.traffic(drive.node_id).heartbeat_count

    def received() -> bool:
        traffic = port.traffic(drive.node_id)
        new = traffic.heartbeat_count > before
        return new and traffic.nmt_state is NmtState.PRE_OPERATIONAL

    if not (yield from until(port, _heartbeat_deadline_ns(port, cycle), text, received)):
        traffic = port.traffic(drive.node_id)
        beats = traffic.heartbeat_count > before
        failure = BootFailure.WRONG_STATE if beats else BootFailure.NO_HEARTBEAT
        what = f"no heartbeat in PRE-OPERATIONAL (it shows {traffic.nmt_state.name})"
        raise DriveSilent(drive.name, failure, what)


def _heartbeat_deadline_ns(port: DrivePort, cycle: CycleSettings) -> int:
    return port.now_ns() + HEARTBEAT_TIMEOUT_RATIO * cycle.drive_heartbeat_ms * 1_000_000


def _check_same(drive: _DriveState, port: DrivePort, text: str) -> Texts:
    """Check that the same node answers, that no second one does, and that it did not reboot."""
    refuse_second_answer(drive.target(port), drive.sdo_repeat_count)
    if not drive.booted or port.traffic(drive.node_id).boot_up_count == drive.boot_up_count:
        return
    with suppress(DriveSilent):  # silence while the drive boots is expected
        yield from _alone(drive, port, text)
    what = "it sent a boot-up message during bring-up, and has lost its configuration"
    raise DriveSilent(drive.name, BootFailure.REBOOTED, what)


def _alone(drive: _DriveState, port: DrivePort, text: str) -> Texts:
    yield from refuse_second_node(drive.target(port), drive.sdo_repeat_count, text)


# --- all drives together --------------------------------------------------------------------------


def _start(drives: Sequence[_DriveState], port: DrivePort, cycle: CycleSettings) -> Texts:
    text = "NMT start"
    port.sync.restart()
    port.send([nmt_frame(NmtCommand.START, drive.node_id) for drive in drives])
    deadline_ns = _heartbeat_deadline_ns(port, cycle)
    for drive in drives:

        def started(node_id: int = drive.node_id) -> bool:
            return port.traffic(node_id).nmt_state is NmtState.OPERATIONAL

        if not (yield from until(port, deadline_ns, text, started)):
            what = "it does not become OPERATIONAL after NMT start"
            raise DriveSilent(drive.name, BootFailure.WRONG_STATE, what)
        yield from _check_same(drive, port, text)
    yield text


def _first_samples(drives: Sequence[_DriveState], port: DrivePort, cycle: CycleSettings) -> Texts:
    missing: list[str] = []
    for _ in range(FIRST_SAMPLE_SYNCS):
        before = {drive.name: _sample_counts(drive, port) for drive in drives}
        deadline_ns = port.now_ns() + cycle.period_ms * 1_000_000
        port.send((port.sync.frame(),))
        yield from until(port, deadline_ns, "first samples", lambda: False)
        missing = [
            drive.name
            for drive in drives
            if any(
                n <= b for n, b in zip(_sample_counts(drive, port), before[drive.name], strict=True)
            )
        ]
        if not missing:
            break
    for name in missing:
        what = f"no complete sample within {FIRST_SAMPLE_SYNCS} SYNCs"
        raise DriveSilent(name, BootFailure.NO_SAMPLES, what)
    for drive in drives:
        yield from _check_same(drive, port, "first samples")
        _check_lengths(drive, port)


def _cyclic(drive: _DriveState) -> tuple[PdoLayout, PdoLayout]:
    pdos = layouts(drive.description.profile, drive.node_id)
    return pdos.status, pdos.torque


def _sample_counts(drive: _DriveState, port: DrivePort) -> tuple[int, ...]:
    counts = port.traffic(drive.node_id).pdo_count
    return tuple(counts.get(layout.can_id, 0) for layout in _cyclic(drive))


def _check_lengths(drive: _DriveState, port: DrivePort) -> None:
    for layout in _cyclic(drive):
        data = port.traffic(drive.node_id).pdo_data[layout.can_id]
        if len(data) != layout.size:
            found = f"{layout} has {len(data)} bytes instead of the {layout.size} that are mapped"
            raise BringUpRefused(drive.name, BootFailure.CONFIGURATION, found)


def _report(drive: _DriveState, port: DrivePort) -> DriveReport:
    traffic = port.traffic(drive.node_id)
    status, torque = _cyclic(drive)
    statusword, position_counts, _ = status.codec.unpack(traffic.pdo_data[status.can_id])
    torque_raw, _ = torque.codec.unpack(traffic.pdo_data[torque.can_id])
    profile = drive.description.profile
    error_code = drive.values[Object.ERROR_CODE, 0]
    homed_bit = profile.referenced_bit
    codes = profile.emergency_codes
    found = meaning(error_code, codes)
    came = [decode_emergency(data, drive.node_id, codes, 0) for data in traffic.emergencies]
    emergencies = tuple(one for one in came if one is not None and one.code)
    return DriveReport(
        name=drive.name,
        base=_base(drive),
        power_state=decode_statusword(statusword),
        statusword=statusword,
        position_counts=position_counts,
        torque_raw=torque_raw,
        absolute=drive.description.axis.encoder.absolute,
        serial_number=drive.values[SERIAL_NUMBER],
        homed=homed_bit is not None and bool(statusword >> homed_bit & 1),
        error_register=drive.values[Object.ERROR_REGISTER, 0],
        error_code=error_code,
        error_text=found.text if error_code else "",
        emergencies=emergencies,
        reference_lost=found.loses_reference or any(one.loses_reference for one in emergencies),
    )


def _base(drive: _DriveState) -> DriveBase:
    base = drive.description.profile.torque_base
    torque, current, constant = (
        None if ref is None else drive.values[ref.index, ref.sub]
        for ref in (base.rated_torque, base.rated_current, base.torque_constant)
    )
    return base_from_raw(drive.description, torque, current, constant)
