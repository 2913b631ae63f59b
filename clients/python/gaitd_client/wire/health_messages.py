"""The message on the service itself, published once a second; part of the wire contract."""

from typing import Annotated

import msgspec
from gaitd_names.joints import open_names
from msgspec import Meta

from gaitd_client.wire.fields import Stated


class DriveHealth(msgspec.Struct, frozen=True, kw_only=True):
    """Communication with one drive."""

    name: Annotated[str, Meta(description="LEG/AXIS")]
    missed_count: Annotated[
        int, Meta(description="Cycles without its sample, since gateway start.")
    ]
    late_count: Annotated[int, Meta(description="TPDOs after their window, since bring-up.")]
    lost_count: Annotated[int, Meta(description="Missed and not late: never received.")]
    protocol_error_count: Annotated[int, Meta(description="Frames that could not be used.")]
    heartbeat_age_ms: Annotated[float | None, Meta(description="Since its last heartbeat.")]


class BusHealth(msgspec.Struct, frozen=True, kw_only=True):
    """The CAN controller and other nodes on the bus; counts since the core's start."""

    condition: Annotated[
        str,
        Meta(
            description="Fault confinement state, ISO 11898-1.",
            extra_json_schema=open_names(["active", "warning", "error passive", "bus-off"]),
        ),
    ]
    bus_off_count: Annotated[int, Meta(description="Times the controller left the bus.")]
    passive_count: Annotated[int, Meta(description="Reports of error passive.")]
    warning_count: Annotated[int, Meta(description="Reports of many errors.")]
    restart_count: Annotated[int, Meta(description="Times it was restarted after bus-off.")]
    no_ack_count: Annotated[int, Meta(description="Frames that no node acknowledged.")]
    overflow_count: Annotated[int, Meta(description="Times the controller lost frames.")]
    foreign_master_count: Annotated[
        int, Meta(description="SYNCs of another master, and heartbeats with our node id.")
    ]
    stray_count: Annotated[int, Meta(description="Frames of unknown nodes, since bring-up.")]
    load_ratio: Annotated[
        float, Meta(description="Measured in the last second, 0..1; bus_load_ratio is the worst.")
    ]


class Health(Stated, frozen=True, kw_only=True):
    """State of the service itself, once a second."""

    lateness_bound_us: Annotated[
        tuple[int, ...],
        Meta(description="Upper bounds of the histogram's classes; one more: above."),
    ]
    lateness_count: Annotated[
        tuple[int, ...], Meta(description="SYNCs per class of lateness since the core's start.")
    ]
    lateness_p50_us: Annotated[
        float | None, Meta(description="Median lateness of SYNC in the last second.")
    ]
    lateness_max_us: Annotated[
        float | None, Meta(description="Largest lateness of SYNC in the last second.")
    ]
    collect_max_us: Annotated[float | None, Meta(description="SYNC to last TPDO, last second.")]
    work_max_us: Annotated[float | None, Meta(description="Python work of a cycle, last second.")]
    overrun_count: Annotated[int | None, Meta(description="Grid points missed since core start.")]
    overrun_by_part: Annotated[
        dict[str, int],
        Meta(
            description="The same by the part of the cycle that took longest beyond what it may: "
            "wake_up, window, work, publish."
        ),
    ]
    publish_max_us: Annotated[
        float | None, Meta(description="Ring, state file and systemd; last second.")
    ]
    record_count: Annotated[int, Meta(description="Records in the last second; 100 is right.")]
    bus_load_ratio: Annotated[float | None, Meta(description="0..1 of the CAN bit rate.")]
    drives: Annotated[tuple[DriveHealth, ...], Meta(description="Communication, by drive.")]
    tx_dropped_count: Annotated[int | None, Meta(description="CAN frames not sent.")]
    record_missed_count: Annotated[int, Meta(description="Records that this gateway missed.")]
    record_skipped_count: Annotated[int, Meta(description="Records too old to publish.")]
    gateway_state_dropped_count: Annotated[
        int, Meta(description="Gateway states that the core did not accept.")
    ]
    request_dropped_count: Annotated[int, Meta(description="Queries never answered: too many.")]
    not_kept_count: Annotated[
        int, Meta(description="Times that black box or request log could not be written.")
    ]
    gateway_wake_max_us: Annotated[
        float | None, Meta(description="Longest work of the gateway on one wake, last second.")
    ]
    gateway_estimate_p50_us: Annotated[
        float | None,
        Meta(description="Median from the gateway's wake to its first estimate, last second."),
    ]
    bus: Annotated[BusHealth | None, Meta(description="The CAN controller; null: unknown.")]
    setpoint_accepted_count: Annotated[
        int | None, Meta(description="By the core, since its start.")
    ]
    setpoint_refused_count: Annotated[
        dict[str, int],
        Meta(description="By reason (docs/control_by_others.md); gateway and core together."),
    ]
    assist_lapse_count: Annotated[
        int | None, Meta(description="Times that assist ended for want of a lease or setpoints.")
    ]
    keys_expiring: Annotated[
        tuple[str, ...],
        Meta(
            description="Clients, `gateway` or `authority`, whose certificate ends within 30 days."
        ),
    ] = ()
    time_is_simulated: Annotated[
        bool | None,
        Meta(description="The drives are virtual, and time is granted by `gaitd sim`."),
    ] = None
