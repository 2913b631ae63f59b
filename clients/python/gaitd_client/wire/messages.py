"""The wire contract: every message on Zenoh as a struct, and the JSON Schemas made from them.

A message is JSON (UTF-8) on a key below `gaitd/TRAINER/`, with the encoding
`application/json;gaitd.NAME.v1`. The rules for all of them:

1. A number that is not valid is `null`, never 0 and never NaN. Silence of more than 200 ms (1.5 s
   of `safety` and `health`) means the same for all values of the key.
2. A message about a leg holds its axes, `hip` and `slide`, as the same struct. Their positions,
   velocities and efforts have no unit in their name: `joints` of `config` has the kind of each
   joint and the units. All other names of fields end in their unit. `_std` is the standard
   deviation of the field before it.
3. Modes, stages, causes and states are lower-case names, stop categories `S0` to `S2`.
4. Within v1 fields, names of enums and codes may be added; none is removed, renamed or given
   another type or unit. A reader ignores a field that it does not know, and treats a name that it
   does not know as none of those it knows; so an enum is open in its schema. Incoming messages
   (`control/*`, `setpoint`) are read strictly: an unknown field is refused.

Reading order: `fields.py` (names, types, heads), `leg_messages.py` (messages about a leg in every
cycle), `health_messages.py` (state of the service), then the other messages out, requests in, keys
and schemas.
"""

from functools import cache
from typing import Annotated, Any, Final, Literal

import msgspec
from gaitd_names import NMT_STATES, POWER_STATES
from gaitd_names.joints import Joint, open_names
from msgspec import Meta

from gaitd_client.wire.fields import (
    EFFORT,
    POSITION,
    VELOCITY,
    CategoryName,
    CauseName,
    KindName,
    ModeName,
    OutcomeName,
    PriorityName,
    Sampled,
    StageName,
    Stated,
    of_joint,
)
from gaitd_client.wire.health_messages import Health
from gaitd_client.wire.leg_messages import (
    Activity,
    ControllerState,
    Estimate,
    Friction,
    ReportedValues,
    Stride,
)

EFFORT_MAX: Final = 1500
"""Largest effort in a request; limits.toml has the maximum of each joint, which is lower."""
MARK_LENGTH_MAX: Final = 80
"""Characters of a mark: it is one line of a list."""
EXACT_MAX: Final = 2**53 - 1
"""Up to here every JSON reader represents integers exactly."""

ONE_LINE: Final = (
    r"^(?![\s\S]*[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069])"
)
"""Pattern for text from clients, which appears in events, logs and on terminals: no line breaks, no
control characters, no characters that change the direction of writing."""

# --- messages out ----------------------------------------------------------------------------


class Emergency(msgspec.Struct, frozen=True, kw_only=True):
    """One EMCY message of a drive."""

    time_ns: Annotated[int, Meta(description="UTC in ns since 1970, of its cycle.")]
    code: Annotated[str, Meta(description="Hexadecimal.")]
    text: Annotated[str, Meta(description="Its meaning, by the drive's vendor.")]
    reaction: Annotated[str, Meta(description="What the drive does by itself.")]
    alarm: Annotated[bool, Meta(description="True: it causes a stop; false: it is a warning.")]
    loses_reference: Annotated[
        bool, Meta(description="The encoder's position is invalid since then.")
    ]
    error_register: Annotated[str, Meta(description="Object 1001h, hexadecimal.")]
    vendor_bytes: Annotated[str, Meta(description="Five bytes of the vendor's, hexadecimal.")]


class DriveState(Sampled, frozen=True, kw_only=True):
    """One drive at 10 Hz, its values at the joint. Null: unknown."""

    name: Annotated[str, Meta(description="LEG/AXIS, for example right/hip")]
    nmt_state: Annotated[
        str, Meta(description="CiA 301 state.", extra_json_schema=open_names(NMT_STATES.values()))
    ]
    power_state: Annotated[
        str, Meta(description="CiA 402 state.", extra_json_schema=open_names(POWER_STATES))
    ]
    statusword: Annotated[str | None, Meta(description="Object 6041h, hexadecimal.")]
    mode_display: Annotated[int | None, Meta(description="Object 6061h: 10 torque, 8 position.")]
    fresh: Annotated[bool, Meta(description="All its samples arrived in this cycle's window.")]
    sample_age_cycles: Annotated[int, Meta(description="Cycles since the last whole sample.")]
    late_count: Annotated[int, Meta(description="TPDOs after their window, since bring-up.")]
    heartbeat_age_ms: Annotated[float | None, Meta(description="Since its last heartbeat.")]
    position: Annotated[float | None, of_joint(POSITION, "Measured.")]
    velocity: Annotated[float | None, of_joint(VELOCITY, "From encoder differences.")]
    effort: Annotated[float | None, of_joint(EFFORT, "From measured current.")]
    target_effort: Annotated[float | None, of_joint(EFFORT, "Sent in this cycle.")]
    referenced: Annotated[bool, Meta(description="The axis is referenced.")]
    hand_switch_closed: Annotated[bool | None, Meta(description="As the drive input reads it.")]
    sto_released: Annotated[bool | None, Meta(description="Safe torque off is not active.")]
    temperature_degc: Annotated[float | None, Meta(description="Temperature of the power stage.")]
    emergency_code: Annotated[
        str | None, Meta(description="Newest EMCY code, hexadecimal; null when there is none.")
    ]
    emergency_text: Annotated[str, Meta(description="Its meaning; empty when there is none.")]
    emergency_count: Annotated[int, Meta(description="EMCY messages since bring-up.")]
    protocol_error_count: Annotated[int, Meta(description="Frames that could not be used.")]
    sign_proven: Annotated[
        bool, Meta(description="Torque and motion agree in sign; confirmed by a person, too.")
    ]
    emergencies: Annotated[
        tuple[Emergency, ...],
        Meta(description="EMCY messages since the core's start, the newest 32, oldest first."),
    ]


class Judgement(msgspec.Struct, frozen=True, kw_only=True):
    """The verdict: stop category, cause and finding; latched until reset."""

    category: CategoryName
    cause: CauseName
    drive: Annotated[str | None, Meta(description="Drive or leg of the cause; null if of none.")]
    value: Annotated[float | None, Meta(description="Measured value, in the unit of the limit.")]
    limit: Annotated[float | None, Meta(description="The limit.")]
    finding: Annotated[str, Meta(description="What it was found by, or none.")]
    said: Annotated[
        str, Meta(description="What the drive or the operating system has said, or empty.")
    ]


Values = dict[str, float | str | None]
"""Values of a code by name: numbers in SI units, names of members of enums; null: not known."""


class Progress(msgspec.Struct, frozen=True, kw_only=True):
    """The present step of a bring-up or an exercise. A later version may send another code."""

    code: Annotated[str, Meta(description="For example setting_up.")]
    subject: Annotated[str | None, Meta(description="Drive or leg; null if of none.")]
    values: Annotated[Values, Meta(description="By name, for example `done_count`.")]


class Safety(Stated, frozen=True, kw_only=True):
    """Safety state of the machine: published on change, and once a second."""

    valid: Annotated[
        bool,
        Meta(
            description="False: no records from the core; all that follows is null, but `progress`"
            " while the core starts."
        ),
    ]
    mode: Annotated[ModeName | None, Meta(description="Null when not valid.")]
    active: Annotated[bool | None, Meta(description="The drives are enabled on purpose.")]
    verdict: Annotated[Judgement | None, Meta(description="Null when not valid.")]
    stage: Annotated[StageName | None, Meta(description="Null: no exercise, or not valid.")]
    progress: Annotated[
        Progress | None, Meta(description="What the machine does now; null: nothing, or not known.")
    ]
    lease_holder: Annotated[
        str | None, Meta(description="Client that may command torque; null: none.")
    ]
    gateway_age_cycles: Annotated[
        int | None, Meta(description="Age of the newest gateway state at the core.")
    ]
    stop_count: Annotated[int | None, Meta(description="Stop requests that the core has received.")]
    limits: Annotated[
        dict[str, Any] | None, Meta(description="Limits in force: limits.toml as it was read.")
    ]


class Refusal(msgspec.Struct, frozen=True, kw_only=True):
    """Why a request is refused, or not known to be done. A later version may send another code."""

    code: Annotated[str, Meta(description="For example hand_switch_open.")]
    subject: Annotated[str | None, Meta(description="Leg or axis, the first of several.")]
    values: Annotated[Values, Meta(description="By name, for example `highest`.")]
    said: Annotated[
        str, Meta(description="Names that are known, or what a library has said; or empty.")
    ]


class Event(Stated, frozen=True, kw_only=True):
    """One event. A bounded history reaches late joiners (AdvancedSubscriber)."""

    id: Annotated[str, Meta(description="BOOT-RECORD-INDEX; the same if an event is sent twice.")]
    time_ns: Annotated[int, Meta(description="UTC in ns since 1970.")]
    priority: PriorityName
    kind: KindName
    code: Annotated[str, Meta(description="What happened, for example mode_changed.")]
    cause: Annotated[CauseName | None, Meta(description="Cause of a stop; else null.")]
    subject: Annotated[str | None, Meta(description="Drive or leg; null if of none.")]
    values: Annotated[Values, Meta(description="Values of the code, by name.")]
    said: Annotated[
        str, Meta(description="What a drive or the operating system has said, or empty.")
    ]


class Reply(Stated, frozen=True, kw_only=True):
    """Answer to a request that acts: leases, requests to the machine, plan, mark, restart."""

    request: Annotated[str, Meta(description="NAME of control/NAME.")]
    outcome: OutcomeName
    refusal: Annotated[
        Refusal | None,
        Meta(description="Why it is not done, or what it has not reached; null: it is done."),
    ] = None
    mode: Annotated[ModeName | None, Meta(description="The present mode; null when unknown.")]
    lease: Annotated[
        int | None,
        Meta(description="After acquire: the number for setpoints, a secret. Else null."),
    ] = None
    lease_duration_ms: Annotated[
        int | None,
        Meta(description="After acquire: duration of the lease without an accepted setpoint."),
    ] = None


class AxisPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is released for one axis."""

    assist_max: Annotated[
        Annotated[float, Meta(ge=0, le=EFFORT_MAX)] | None,
        of_joint(EFFORT, "Cap of assist during the gait; null: only that of the configuration."),
    ] = None


class PlanLimits(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of a gait that a session may request, and of a controller's assist during it."""

    cadence_max_hz: Annotated[float, Meta(gt=0, le=2, description="Strides per second.")]
    amplitude_max_ratio: Annotated[float, Meta(gt=0, le=1, description="Share of the full gait.")]
    duration_max_s: Annotated[float, Meta(gt=0, le=7200, description="Duration of one gait.")]
    hip: Annotated[AxisPlan, Meta(description="For the hip.")] = AxisPlan()
    slide: Annotated[AxisPlan, Meta(description="For the slide.")] = AxisPlan()


class Status(Stated, frozen=True, kw_only=True):
    """Answer to status: the present state of the machine and the newest events."""

    version: Annotated[str | None, Meta(description="Version of the core.")]
    safety: Annotated[Safety, Meta(description="As published now.")]
    drives: Annotated[tuple[DriveState, ...], Meta(description="As published now.")]
    legs: Annotated[tuple[Activity, ...], Meta(description="As published now.")]
    plan: Annotated[
        PlanLimits | None, Meta(description="Released limits of a session's gait; null: none.")
    ] = None
    events: Annotated[tuple[Event, ...], Meta(description="The newest, oldest first.")]


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """A live link of a client, as the gateway's Zenoh session has it."""

    protocol: Annotated[str, Meta(description="tcp, tls, unixsock-stream, ...")]
    address: Annotated[str, Meta(description="Address of the client.")]
    certificate: Annotated[str | None, Meta(description="Common name; null without TLS.")]
    client: Annotated[
        str | None,
        Meta(
            description="Entry of the register with the certificate's name; null: a local link,"
            " or no entry."
        ),
    ]


class Configuration(Stated, frozen=True, kw_only=True):
    """Answer to config: the configuration of the service."""

    version: Annotated[str | None, Meta(description="Version of the core.")]
    trainer: Annotated[str, Meta(description="TRAINER in the keys.")]
    listen: Annotated[tuple[str, ...], Meta(description="Zenoh endpoints of this service.")]
    period_ns: Annotated[int | None, Meta(description="Period of the cycle.")]
    drive_names: Annotated[tuple[str, ...], Meta(description="drives/NAME")]
    leg_names: Annotated[tuple[str, ...], Meta(description="LEG in the keys.")]
    joints: Annotated[
        dict[str, Joint], Meta(description="Kind and units of each axis of a leg, by its name.")
    ]
    config_hashes: Annotated[dict[str, str], Meta(description="SHA-256 by file.")]
    robot: Annotated[dict[str, Any], Meta(description="robot.toml as it was read.")]
    limits: Annotated[dict[str, Any], Meta(description="limits.toml as it was read.")]
    guidance: Annotated[
        dict[str, Any],
        Meta(description="[gait.impedance] of the trainer file: stiffness and damping by axis."),
    ] = msgspec.field(default_factory=dict)
    keys: Annotated[bool, Meta(description="Clients need keys.")] = False
    keys_expiring: Annotated[
        tuple[str, ...],
        Meta(description="Clients, `gateway` or `authority`, whose certificate ends soon."),
    ] = ()
    links: Annotated[tuple[Link, ...], Meta(description="Live links of clients.")] = ()


class Schemas(Stated, frozen=True, kw_only=True):
    """Answer to schema: the JSON Schema of each message by its full name."""

    schemas: Annotated[
        dict[str, dict[str, Any]], Meta(description="By `gaitd.NAME.v1`, as in the encodings.")
    ]


# --- requests in -----------------------------------------------------------------------------


UNNAMED_CLIENT: Final = "unnamed"
"""Client name of a request that gives none."""


class Ask(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/*; an empty payload means `{}`."""

    client: Annotated[
        str,
        Meta(max_length=64, pattern=ONE_LINE, description="Name of the client, for the event."),
    ] = UNNAMED_CLIENT
    for_cycle: Annotated[
        Annotated[int, Meta(ge=0, le=EXACT_MAX)] | None,
        Meta(description="Newest cycle known to the client; too old is refused. Null: now."),
    ] = None


class AcquireAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/acquire; `client` must name the holder of the lease."""

    lease: Annotated[
        Annotated[int, Meta(ge=1, le=EXACT_MAX)] | None,
        Meta(description="Lease number that this client holds, to renew it. Null: a new lease."),
    ] = None
    duration_ms: Annotated[
        Annotated[int, Meta(ge=20, le=60_000)] | None,
        Meta(description="Requested duration without an accepted setpoint. Null: as configured."),
    ] = None


class ReleaseAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/release, with the `client` that acquired."""

    lease: Annotated[int, Meta(ge=1, le=EXACT_MAX, description="Number from the reply to acquire.")]


class ReportAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/report: publish the state of the lease's holder.

    The service publishes it as `ControllerState`, and reads nothing of it.
    """

    lease: Annotated[int, Meta(ge=1, le=EXACT_MAX, description="Number from the reply to acquire.")]
    leg: Annotated[str, Meta(max_length=16, pattern=ONE_LINE, description="right or left")]
    values: Annotated[ReportedValues, Meta(description="State of the leg.")] = msgspec.field(
        default_factory=dict
    )
    hip: Annotated[ReportedValues, Meta(description="State of the hip.")] = msgspec.field(
        default_factory=dict
    )
    slide: Annotated[ReportedValues, Meta(description="State of the slide.")] = msgspec.field(
        default_factory=dict
    )


class ModeAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/mode."""

    mode: Annotated[
        Literal[
            "hold",
            "gait",
            "torque",
            "excite",
            "hand_guiding",
            "self_test",
            "reference",
            "commission",
        ],
        Meta(description="The mode to go to."),
    ]
    cadence_hz: Annotated[float, Meta(ge=0, le=2, description="Strides per second, gait.")] = 0.0
    amplitude_ratio: Annotated[float, Meta(ge=0, le=1, description="Share of the full gait.")] = 0.0
    duration_s: Annotated[
        float, Meta(ge=0, le=7200, description="Mandatory for gait and excite.")
    ] = 0.0
    scenario: Annotated[
        str,
        Meta(max_length=64, pattern=ONE_LINE, description="Name in the configuration, excite."),
    ] = ""
    axis: Annotated[
        str,
        Meta(max_length=16, pattern=ONE_LINE, description="LEG/AXIS, reference and commission."),
    ] = ""
    witnessed: Annotated[
        bool, Meta(description="Commission: a person confirms that the axis moved as described.")
    ] = False
    baseline: Annotated[
        bool,
        Meta(
            description="Gait: the patient is passive. What is estimated meanwhile is taken off"
            " from then on."
        ),
    ] = False


class AskedAxisPlan(AxisPlan, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is to be released for one axis."""


class AskedPlan(PlanLimits, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of a gait that are to be released; a limit that is not known is refused."""

    hip: Annotated[AskedAxisPlan, Meta(description="For the hip.")] = AskedAxisPlan()
    slide: Annotated[AskedAxisPlan, Meta(description="For the slide.")] = AskedAxisPlan()


class PlanAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/plan: release a plan for sessions, or withdraw it.

    It is in force at once; the answer waits for the disk, and its outcome is done. If the disk does
    not take it, `refusal` says what a restart of the gateway may change.
    """

    plan: Annotated[AskedPlan | None, Meta(description="Null: withdraw it; no gait is allowed.")]


class MarkAsk(Ask, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Payload of a query to control/mark: publish a remark as an event, with the present time.

    The event has the code `mark` and the text in `said`. The service reads nothing of it.
    """

    text: Annotated[
        str,
        Meta(
            min_length=1,
            max_length=MARK_LENGTH_MAX,
            pattern=ONE_LINE,
            description="The remark; without a name or a birth date of the patient.",
        ),
    ]


class AxisSetpoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A controller's wish for one axis."""

    assist: Annotated[
        float, Meta(ge=-EFFORT_MAX, le=EFFORT_MAX), of_joint(EFFORT, "On top of gravity.")
    ]


class SetpointMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A controller's assist for one leg, LEG/setpoint, in mode torque or gait."""

    lease: Annotated[int, Meta(ge=1, le=EXACT_MAX, description="Number from the reply to acquire.")]
    seq: Annotated[int, Meta(ge=0, le=EXACT_MAX, description="Strictly rising, for each leg.")]
    for_cycle: Annotated[
        int, Meta(ge=0, le=EXACT_MAX, description="`cycle` of the estimate that it answers.")
    ]
    hip: Annotated[AxisSetpoint, Meta(description="For the hip.")]
    slide: Annotated[AxisSetpoint, Meta(description="For the slide.")]
    stiffness_ratio: Annotated[
        float,
        Meta(
            ge=0,
            le=1,
            description="Share of the configured stiffness of the guidance; for mode gait.",
        ),
    ] = 1.0


# --- tables and schemas ----------------------------------------------------------------------

MESSAGES: Final[dict[str, type[msgspec.Struct]]] = {
    "estimate": Estimate,
    "activity": Activity,
    "friction": Friction,
    "stride": Stride,
    "controller": ControllerState,
    "drives": DriveState,
    "safety": Safety,
    "events": Event,
    "health": Health,
    "reply": Reply,
    "status": Status,
    "config": Configuration,
    "schema": Schemas,
    "ask": Ask,
    "mode": ModeAsk,
    "acquire": AcquireAsk,
    "release": ReleaseAsk,
    "report": ReportAsk,
    "plan": PlanAsk,
    "mark": MarkAsk,
    "setpoint": SetpointMessage,
}
"""NAME in `gaitd.NAME.v1` of each message."""

_DECODERS: Final = tuple(map(msgspec.json.Decoder, MESSAGES.values()))
"""Made once on import: msgspec looks at a type when it is first decoded, and crashes the process if
two threads do so at once."""

NAME_OF: Final = {kind: name for name, kind in MESSAGES.items()}

ALIVE: Final = "alive"
"""Key of the liveliness token of a gateway, below `gaitd/TRAINER/`."""
EVENTS: Final = "events"
"""Key of `Event`, below `gaitd/TRAINER/`."""
HEALTH: Final = "health"
"""Key of `Health`, below `gaitd/TRAINER/`."""
SAFETY: Final = "safety"
"""Key of `Safety`, below `gaitd/TRAINER/`."""
CONTROL: Final = "control"
"""Key of requests, below `gaitd/TRAINER/`: the name of the request follows."""
SETPOINT: Final = "setpoint"
"""Key of `SetpointMessage`, below `gaitd/TRAINER/LEG/`: from the owner of the lease."""
CONTROLLER: Final = "controller"
"""Key of `ControllerState`, below `gaitd/TRAINER/LEG/`."""
READING: Final = frozenset({"status", "config", "schema"})
"""Queries that every client may send and that change nothing."""


def key(trainer: str, *parts: str) -> str:
    """A Zenoh key, for example `gaitd/trainer/right/activity`."""
    return "/".join(("gaitd", trainer, *parts))


def schema_name(kind: type[msgspec.Struct]) -> str:
    """Name of a message's schema in its encoding: `gaitd.NAME.v1`."""
    return f"gaitd.{NAME_OF[kind]}.v1"


def encoding(kind: type[msgspec.Struct]) -> str:
    """The Zenoh encoding of a message."""
    return f"application/json;{schema_name(kind)}"


def schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """JSON Schema of a message, its root object inlined (readers such as Foxglove require it)."""
    made = msgspec.json.schema(kind)
    definitions: dict[str, Any] = dict(made.get("$defs", {}))
    root: dict[str, Any] = definitions.pop(kind.__name__)
    root["$id"] = schema_name(kind)
    return {**root, "$defs": definitions} if definitions else root


@cache
def schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema of every message by its full name; made once, because that takes 30 ms."""
    return {schema_name(kind): schema(kind) for kind in MESSAGES.values()}
