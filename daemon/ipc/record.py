"""Records of the core and the gateway state: the structs exchanged over ipc.

The core fills one `CycleRecord` in each cycle: everything that the cycle measured, decided and
sent. The gateway, the black box, replay and the golden tests read the same record. `GatewayState`
is the gateway state: the gateway sends it to the core, whole, once a cycle. Encodings are msgspec
msgpack arrays: adding a field at the end of a struct, with a default, keeps old recordings
readable.

A record of a leg holds its axes, `hip` and `slide`, as the same struct. Positions, velocities and
efforts have no unit in their name; the kind of the joint gives it: rad, rad/s, N·m for the hip; m,
m/s, N for the slide. `_std` is the standard deviation of the field before it.
"""

from typing import Annotated, Final

import msgspec
from gaitd_names import (
    Cause,
    Finding,
    Lapse,
    Mode,
    Outcome,
    RequestKind,
    Role,
    SetpointRefusal,
    Stage,
    StopCategory,
)
from msgspec import Meta

from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.decoding import Count, Name
from daemon.ipc.report import Event, Progress, Refusal

NAN: Final = float("nan")
STATE_COUNT: Final = 8
"""States of the observer: two positions, two velocities, two frictions, two disturbances."""
SETPOINTS_MAX: Final = 8
TEXT_BYTES_MAX: Final = 400
"""Maximum size of what a drive has said: a slot has a fixed size."""


class Verdict(msgspec.Struct, frozen=True, array_like=True):
    """The verdict of a cycle, or the latched one."""

    category: StopCategory = StopCategory.NONE
    cause: Cause = Cause.NONE
    drive: str = ""
    """Name of the drive (`right/hip`) or leg of the cause; empty if none."""
    value: float = 0.0
    limit: float = 0.0
    finding: Finding = Finding.NONE
    said: str = ""
    """What the drive or the operating system has said; empty if nothing."""

    @property
    def values(self) -> tuple[float | str, ...]:
        """The values of an event or a refusal that reports this verdict."""
        return self.category, self.cause, self.value, self.limit, self.finding


class ModeRequest(msgspec.Struct, frozen=True, array_like=True):
    """Arguments of RequestKind.MODE; arguments that a mode does not use keep their defaults."""

    mode: Mode = Mode.HOLD
    cadence_hz: float = 0.0
    """Strides per second, for GAIT."""
    amplitude_ratio: float = 0.0
    """0..1 of the normative gait, for GAIT."""
    duration_s: float = 0.0
    """Mandatory for GAIT and EXCITE."""
    scenario: Name = ""
    """Name of an excite scenario of the configuration, for EXCITE."""
    axis: Name = ""
    """`LEG/AXIS`, for REFERENCE and COMMISSION."""
    witnessed: bool = False
    """For COMMISSION: the operator confirms that the axis moved as described."""
    baseline: bool = False
    """For GAIT: the patient is passive; what is estimated meanwhile is taken off from then on."""


class AxisPlan(msgspec.Struct, frozen=True, array_like=True):
    """What an operator has released for one axis."""

    assist_max: float | None = None
    """Cap of a controller's assist during the gait; None: only that of limits.toml."""


class Plan(msgspec.Struct, frozen=True, array_like=True):
    """Limits of a gait that a session may request, as an operator has released them."""

    cadence_max_hz: float
    amplitude_max_ratio: float
    duration_max_s: float
    hip: AxisPlan = AxisPlan()
    slide: AxisPlan = AxisPlan()


class Request(msgspec.Struct, frozen=True, array_like=True):
    """One request of a client; a new id makes it a new request."""

    id: Count = 0
    kind: RequestKind = RequestKind.NONE
    for_cycle: Count = 0
    """The newest cycle known to the client; a request for an old cycle is refused."""
    mode: ModeRequest = ModeRequest()
    role: Role = Role.DISPLAY
    """A gateway of an older version sends none: that is the least right."""
    plan: Plan | None = None
    """The released plan; None: none is released."""


class AxisSetpoint(msgspec.Struct, frozen=True, array_like=True):
    """A controller's wish for one axis."""

    assist: float = 0.0
    """Effort on top of g(q)."""


class Setpoint(msgspec.Struct, frozen=True, array_like=True):
    """A controller's assist for one leg, under the lease of its sender."""

    lease: Count = 0
    seq: Count = 0
    for_cycle: Count = 0
    hip: AxisSetpoint = AxisSetpoint()
    slide: AxisSetpoint = AxisSetpoint()
    leg: Name = ""
    stiffness_ratio: float = 1.0
    """0..1 of the configured stiffness of impedance guidance, for GAIT."""


class GatewayState(msgspec.Struct, frozen=True, array_like=True):
    """The gateway state, sent whole every cycle. A wrong boot id voids everything but the stop."""

    core_boot_id: Name
    seq: Count
    for_cycle: Count
    """The newest record that the gateway had read: gives the age of this state in cycles."""
    stop_count: Count
    """Any increase stops, whatever else is in the datagram."""
    request: Request = Request()
    setpoints: Annotated[tuple[Setpoint, ...], Meta(max_length=SETPOINTS_MAX)] = ()
    """The newest setpoint of each leg."""
    lease: Count = 0
    """Number of the lease that is held now; 0: none."""
    lease_role: Role = Role.DISPLAY
    """Role of its holder. A gateway of an older version sends none: that is the least right."""


def clipped(text: str, bytes_max: int = TEXT_BYTES_MAX) -> str:
    """The text cut to so many bytes of UTF-8, between two characters."""
    if text.isascii():
        return text[:bytes_max]
    # Half of a surrogate pair has no UTF-8 bytes; it is replaced.
    return text.encode(errors="replace")[:bytes_max].decode(errors="ignore")


class RequestResult(msgspec.Struct, frozen=True, array_like=True):
    """The newest request that the core has received, and its outcome."""

    id: int = 0
    outcome: Outcome = Outcome.PENDING
    refusal: Refusal | None = None


class EmergencyRecord(msgspec.Struct, frozen=True, array_like=True):
    """One EMCY message, with its meaning by the drive's vendor."""

    code: int
    error_register: int
    vendor_bytes: str
    """Hexadecimal."""
    text: str
    reaction: str
    """The drive's own reaction."""
    alarm: bool
    """True: the message calls for a stop; false: it is a warning."""
    loses_reference: bool
    repeated: bool
    """The same code has been received since the drive last reported no error."""


class DriveRecord(msgspec.Struct, frozen=True, array_like=True):
    """One drive in one cycle, at its joint; None where the value is unknown."""

    name: str
    """`LEG/AXIS`, for example `right/hip`."""
    nmt_state: int
    power_state: int
    """drives.signals.PowerState."""
    statusword: int
    mode_display: int
    fresh: bool
    sample_age_cycles: int
    late_count: int
    heartbeat_age_ms: float
    position: float | None
    velocity: float | None
    """From encoder differences, for safety; the observer's estimate is in the leg."""
    effort: float | None
    """Effort of the drive, from its measured current or torque."""
    target_effort: float
    """Effort sent in this cycle (acts from the next SYNC); 0 unless in torque mode."""
    referenced: bool
    hand_switch_closed: bool
    sto_released: bool
    temperature_degc: float | None
    emergency_code: int
    emergency_text: str
    emergency_count: int
    protocol_error_count: int
    sign_proven: bool = False
    emergencies: tuple[EmergencyRecord, ...] = ()
    """The newest ones of this cycle; `emergency_count` counts all."""


class AxisStrideRecord(msgspec.Struct, frozen=True, array_like=True):
    """One axis in one stride, with the fields of `observer.strides.AxisStride`."""

    work_positive_j: float
    work_positive_j_std: float
    work_negative_j: float
    work_negative_j_std: float
    assist_mean: float
    assist_mean_std: float
    assist_peak: float
    assist_peak_std: float
    power_mean_w: float
    power_mean_w_std: float
    power_peak_w: float
    power_peak_w_std: float
    share_ratio: float | None
    share_ratio_std: float | None
    coverage_ratio: float


class StrideRecord(msgspec.Struct, frozen=True, array_like=True):
    """A stride that was completed in this cycle; fields of `observer.strides.Stride`, and two."""

    number: int
    """Number of this leg's stride since the core's start, from 1."""
    end_mono_ns: int
    """SYNC of its last sample; the stride is reported 150 ms later, because of smoothing."""
    duration_s: float
    cadence_hz: float
    sample_count: int
    hip: AxisStrideRecord
    slide: AxisStrideRecord
    work_positive_j: float
    work_positive_j_std: float
    work_negative_j: float
    work_negative_j_std: float
    share_ratio: float | None
    share_ratio_std: float | None
    status: int
    """observer.filter.status.Status bits of all its samples."""
    baseline_subtracted: bool
    """True if the effort of a passive run, per gait phase, was subtracted."""


class AxisRecord(msgspec.Struct, frozen=True, array_like=True):
    """One axis in one cycle: what the observer was given, and what it has found."""

    measured_position: float
    """Position given to the observer; NaN for a missing sample."""
    effort: float
    """Effort of the drive given to the observer, after any artificial disturbance."""
    reference_position: float
    """Reference of the mode; the present position when the mode has none."""
    assist: float = 0.0
    """A controller's assist in force, inside limit, rate and power."""
    assist_wanted: float = 0.0
    """Assist of the setpoint that is followed, or was until it became stale."""
    validity: int = 2
    """observer.filter.status.Validity; 2: bad."""
    position: float = NAN
    position_std: float = NAN
    velocity: float = NAN
    velocity_std: float = NAN
    friction: float = NAN
    friction_std: float = NAN
    patient: float = NAN
    patient_std: float = NAN
    net: float = NAN
    """Patient minus friction, which stays observable at standstill."""
    net_std: float = NAN
    innovation: float = NAN
    """Measured minus predicted position."""
    artificial: float = 0.0
    """The artificial disturbance of EXCITE: effort = that of the drive - this."""
    drift_correlation: float = NAN
    """Correlation of the patient's effort with the direction of motion; NaN while unknown."""
    friction_error: float = NAN
    """Estimated excess of friction over its law, if there is no patient."""
    needed: float = NAN
    """Effort that the reference's motion needs beyond the load, and what a baseline explains
    besides; NaN where nothing is guided."""


class LegRecord(msgspec.Struct, frozen=True, array_like=True):
    """One leg in one cycle; the estimate is that of `observer/filter/leg_observer.py`."""

    name: str
    hip: AxisRecord
    slide: AxisRecord
    status: int
    """observer.filter.status.Status bits."""
    covariance: tuple[float, ...] = ()
    """Lower triangle, row by row: 36 values, states as in observer/filter/states.py; empty before
    the first estimate."""
    nis: float = NAN
    mean_nis: float = NAN
    """Mean NIS of the last hundred cycles or so, for two measurements: ideally 2."""
    gait_phase: float = -1.0
    """0..1 of this leg's stride, or -1 when no gait runs; legs are half a stride apart."""
    stiffness_ratio: float = 1.0
    """Stiffness in force, as a ratio of the configured stiffness of guidance."""
    setpoint_seq: int = -1
    """`seq` of the newest accepted setpoint under the current lease; -1: none."""
    stride: StrideRecord | None = None

    @property
    def axes(self) -> tuple[AxisRecord, AxisRecord]:
        """Hip and slide."""
        return self.hip, self.slide


class AssistRecord(msgspec.Struct, frozen=True, array_like=True):
    """Setpoints of controllers, counted since core start."""

    accepted_count: int = 0
    refused_count: dict[SetpointRefusal, int] = {}
    """Setpoints refused by the core, by reason; reasons without one are absent."""
    lapse_count: int = 0
    """Times that assist ended because the lease ended or setpoints were stale."""
    lapse_reason: Lapse = Lapse.NONE
    """Reason of the newest lapse."""


class BusRecord(msgspec.Struct, frozen=True, array_like=True):
    """State of the CAN controller, and counts since the core's start."""

    condition: str = "active"
    """drives.canopen.bus_state.BusCondition."""
    bus_off_count: int = 0
    passive_count: int = 0
    warning_count: int = 0
    restart_count: int = 0
    no_ack_count: int = 0
    """Frames without an acknowledgement from any node."""
    overflow_count: int = 0
    """Frames lost in the controller."""
    foreign_master_count: int = 0
    """SYNCs of another node, and heartbeats with our own node id."""
    stray_count: int = 0
    """Frames that belong to none of our drives, since bring-up."""
    load_ratio: float = 0.0
    """Bus load in the last whole second, from all frames sent and received, with bit stuffing."""


class CycleRecord(msgspec.Struct, frozen=True, array_like=True):
    """Everything that one cycle measured, decided and sent."""

    seq: Count
    """Number of the record: also counts records written while there is no SYNC."""
    cycle: Count
    """Number of the cycle on the 10 ms grid since start."""
    sync_mono_ns: Count
    sync_utc_ns: Count
    dt_s: float
    """Measured time since the previous SYNC."""
    mode: Mode
    verdict: Verdict
    """Latched: the most severe since the last reset."""
    events: tuple[Event, ...]
    """Events of this cycle; the gateway adds identity and time."""
    request: RequestResult
    progress: Progress | None
    """None: nothing beside mode and stage."""
    gateway_age_cycles: int
    stop_count: int
    gait_phase: float
    """Phase of the first leg: 0..1 of the stride, or -1 when no gait runs."""
    drives: tuple[DriveRecord, ...]
    legs: tuple[LegRecord, ...]
    timing: CycleTiming
    bus_load_ratio: float = 0.0
    tx_dropped_count: int = 0
    bus: BusRecord = BusRecord()
    assist: AssistRecord = AssistRecord()
    stage: Stage | None = None
    """Stage of the mode's exercise; None when there is none."""
    time_is_simulated: bool = False
    """The drives are virtual, and time passes as `gaitd sim` grants it."""
