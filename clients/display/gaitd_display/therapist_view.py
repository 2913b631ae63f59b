"""All that the therapist's page shows now: numbers with their standard deviation and validity."""

from collections.abc import Iterable
from enum import StrEnum, auto
from typing import Final

import msgspec
from gaitd_client import (
    Activity,
    Cause,
    Configuration,
    DriveState,
    Estimate,
    Event,
    Health,
    NotValid,
    PlanLimits,
    Priority,
    Safety,
    Stride,
)
from gaitd_client.wire import AxisEstimate
from gaitd_names import Kind, StatusBit
from gaitd_texts import Situation, key_of, situation_of, stop_of

from gaitd_display.alarm import Alarm, cause_of
from gaitd_display.controls import Control, Requestable, controls
from gaitd_display.drives import Drives, together
from gaitd_display.engineer_view import DriveView, drive_view
from gaitd_display.geometry import Geometry, geometry_of
from gaitd_display.plan_ranges import Range, plan_ranges
from gaitd_display.words import Spoken, spoken


class Number(msgspec.Struct, frozen=True):
    """A value and its standard deviation; None: not valid."""

    value: float | None
    std: float | None


UNKNOWN: Final = Number(None, None)


class AxisView(msgspec.Struct, frozen=True):
    """One axis: N·m at the hip, N at the slide."""

    validity: str | None = None
    """None: no message."""
    patient: Number = UNKNOWN
    friction: Number = UNKNOWN
    net: Number = UNKNOWN
    tremor_frequency_hz: float | None = None
    """None: none stands out."""
    tremor_amplitude: float | None = None


class LegView(msgspec.Struct, frozen=True):
    """One leg; None: not known."""

    leg: str
    time_ms: float | None = None
    """UTC of the sample, ms since 1970."""
    hip_angle_rad: float | None = None
    slide_position_m: float | None = None
    power_w: float | None = None
    """Power of the patient, both axes."""
    hip: AxisView = AxisView()
    slide: AxisView = AxisView()
    is_relative: bool = False
    """A passive baseline is taken off: values are relative to the minute with a passive patient."""


class StopView(msgspec.Struct, frozen=True):
    """The latched stop."""

    stopped: Spoken
    situation: Situation
    """State of the leg after it; names what is to be done first."""
    then: Spoken
    """How to continue."""
    again: Spoken
    """If it comes back."""
    subject: Spoken | None
    """Leg and axis in words; None: of none."""


class HealthView(msgspec.Struct, frozen=True):
    """Health of bus and cycle."""

    bus: str | None
    bus_load_ratio: float | None
    lateness_max_us: float | None
    overrun_count: int | None
    missed_count: int


class PlanState(StrEnum):
    """What is known of the released plan."""

    UNKNOWN = auto()
    """The service has not said."""
    NONE = auto()
    RELEASED = auto()


class PlanView(msgspec.Struct, frozen=True):
    """The released plan."""

    state: PlanState
    limits: PlanLimits | None = None
    """Not None if it is released."""


UNKNOWN_PLAN: Final = PlanView(PlanState.UNKNOWN)


def plan_view(limits: PlanLimits | None) -> PlanView:
    """Return a plan as the service has told it; None: none is released."""
    return PlanView(PlanState.NONE if limits is None else PlanState.RELEASED, limits)


class TherapistView(msgspec.Struct, frozen=True):
    """One frame of the therapist's page."""

    is_silent: bool
    mode: str | None
    stage: str | None
    lease_holder: str | None
    stop: StopView | None
    legs: tuple[LegView, ...]
    controls: tuple[Control, ...]
    drives: tuple[DriveView, ...]
    hand_switch_closed: bool | None
    sto_released: bool | None
    health: HealthView | None
    plan: PlanView
    geometry: Geometry | None
    ranges: dict[str, Range]
    """What a plan may allow, by field."""
    active: bool
    """The drives are enabled, or were when the trainer fell silent."""
    alarm: str | None


class StrideItem(msgspec.Struct, frozen=True, tag="stride", tag_field="kind"):
    """One stride."""

    leg: str
    time_ms: float
    """UTC of its end."""
    share_ratio: float | None
    share_ratio_std: float | None


class EventItem(msgspec.Struct, frozen=True, tag="event", tag_field="kind"):
    """One event."""

    id: str
    time_ms: float
    priority: str
    said: Spoken
    remedy: Spoken
    """Empty sentences: nothing has to be done."""
    icon: str
    """stop, medium, low or info."""


def stride_item(stride: Stride) -> StrideItem:
    """Return what a page shows of a stride."""
    return StrideItem(
        stride.leg,
        stride.sample_time_ns / 1e6,
        stride.share_ratio,
        stride.share_ratio_std,
    )


def event_item(event: Event) -> EventItem:
    """Return what a page shows of an event; a priority of a later version is shown as medium."""
    is_stop = event.kind == Kind.STOP and event.priority != Priority.INFO
    calm: dict[str, str] = {Priority.LOW: "low", Priority.INFO: "info"}
    return EventItem(
        event.id,
        event.time_ns / 1e6,
        event.priority,
        spoken(lambda texts: texts.event(event)),
        spoken(lambda texts: texts.event_remedy(event, texts.buttons())),
        "stop" if is_stop else calm.get(event.priority, "medium"),
    )


def leg_view(leg: str, estimate: Estimate | NotValid, activity: Activity | NotValid) -> LegView:
    """Return what the page shows of one leg.

    Args:
        leg: right or left.
        estimate: newest message.
        activity: newest message, for the power.
    """
    if isinstance(estimate, NotValid):
        return LegView(leg)
    return LegView(
        leg,
        estimate.sample_time_ns / 1e6,
        estimate.hip.position,
        estimate.slide.position,
        activity.patient_power_w if isinstance(activity, Activity) else None,
        axis_view(estimate.hip),
        axis_view(estimate.slide),
        is_relative=StatusBit.BASELINE in estimate.status,
    )


def axis_view(axis: AxisEstimate) -> AxisView:
    """Return what the page shows of one axis."""
    return AxisView(
        axis.validity,
        Number(axis.patient, axis.patient_std),
        Number(axis.friction, axis.friction_std),
        Number(axis.net, axis.net_std),
        axis.tremor_frequency_hz,
        axis.tremor_amplitude,
    )


def health_view(health: Health | NotValid) -> HealthView | None:
    """Return what the page shows of the health; None: no message."""
    if isinstance(health, NotValid):
        return None
    return HealthView(
        bus=health.bus.condition if health.bus else None,
        bus_load_ratio=health.bus_load_ratio,
        lateness_max_us=health.lateness_max_us,
        overrun_count=health.overrun_count,
        missed_count=sum(drive.missed_count for drive in health.drives),
    )


def all_true(values: Iterable[bool | None]) -> bool | None:
    """Return False if one is False, True if all are True, else None: not known."""
    seen = set(values)
    if False in seen:
        return False
    return True if seen == {True} else None


class TherapistState:
    """What follows from the newest messages."""

    def __init__(self, run_id: str, *, has_session: bool) -> None:
        """Start without a message.

        Args:
            run_id: differs with each start of the server.
            has_session: the patient's server runs a session.
        """
        self._alarm, self._has_session = Alarm(run_id), has_session
        self.plan = UNKNOWN_PLAN
        self._geometry: Geometry | None = None
        self._ranges = plan_ranges({})

    def use(self, configuration: Configuration | None) -> None:
        """Take the configuration of the running core: the geometry, and what a plan may allow.

        Args:
            configuration: None: the core has not answered.
        """
        limits = {} if configuration is None else configuration.limits
        self._geometry = None
        if configuration is not None:
            self._geometry = geometry_of(configuration.robot, limits)
        self._ranges = plan_ranges(limits)

    def view(
        self,
        legs: tuple[LegView, ...],
        safety: Safety | NotValid,
        health: Health | NotValid,
        drives: dict[str, DriveState | NotValid],
    ) -> TherapistView:
        """Return the frame.

        Args:
            legs: in the order of the file.
            safety: newest message.
            health: newest message.
            drives: newest messages, by name.
        """
        known = safety if isinstance(safety, Safety) and safety.valid else None
        if all(leg.time_ms is None for leg in legs):
            known = None
        known_drives = [one for one in drives.values() if isinstance(one, DriveState)]
        alarm = self._alarm.take(known, known_drives, has_session=self._has_session)
        views = tuple(
            drive_view(name, drive) if known else DriveView(name) for name, drive in drives.items()
        )
        all_drives = together(drives.values())
        now = Requestable(
            mode=known.mode if known else None,
            stage=known.stage if known else None,
            lease_holder=known.lease_holder if known else None,
            hand_switch_closed=all_true(drive.hand_switch_closed for drive in views),
            sto_released=all_true(drive.sto_released for drive in views),
            is_latched=cause_of(known) != Cause.NONE,
            has_power=all_drives.may_have_power,
            knows_position=all(drive.referenced for drive in known_drives),
        )
        return TherapistView(
            is_silent=known is None,
            mode=now.mode,
            stage=now.stage,
            lease_holder=now.lease_holder,
            stop=stop_view(known, all_drives),
            legs=legs,
            controls=controls(now),
            drives=views,
            hand_switch_closed=now.hand_switch_closed,
            sto_released=now.sto_released,
            health=health_view(health),
            plan=self.plan if known else UNKNOWN_PLAN,
            geometry=self._geometry,
            ranges=self._ranges,
            active=self._alarm.was_active,
            alarm=alarm,
        )


def stop_view(safety: Safety | None, drives: Drives) -> StopView | None:
    """Return the latched stop, and what it means for the leg; None without one."""
    verdict = safety.verdict if safety else None
    if verdict is None or cause_of(safety) == Cause.NONE:
        return None
    situation = situation_of(verdict.cause, are_holding=drives.are_holding)
    key, drive = key_of(verdict.cause), verdict.drive
    return StopView(
        spoken(lambda texts: texts.text(f"stopped.{key}", cause=verdict.cause)),
        situation,
        spoken(lambda texts: texts.then(verdict.cause, texts.buttons())),
        spoken(lambda texts: texts.text(f"again.{stop_of(verdict.cause).again}")),
        None if drive is None else spoken(lambda texts: texts.subject(drive)),
    )
