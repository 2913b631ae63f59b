"""All that the therapist's page shows: numbers with their standard deviation and validity."""

from collections.abc import Iterable
from enum import StrEnum, auto
from typing import Final

import msgspec
from gaitd_client import (
    Activity,
    Cause,
    DriveState,
    Event,
    Friction,
    Health,
    NotValid,
    PlanLimits,
    Safety,
    Stride,
)

from gaitd_display.alarm import Alarm, cause_of


class Number(msgspec.Struct, frozen=True):
    """A value and its standard deviation; None: not valid."""

    value: float | None
    std: float | None


UNKNOWN: Final = Number(None, None)


class AxisView(msgspec.Struct, frozen=True):
    """One axis: N·m at the hip, N at the slide."""

    validity: str | None
    """None: no message."""
    patient: Number
    friction: Number
    net: Number
    effort: float | None
    """Torque or force of the drive."""


class LegView(msgspec.Struct, frozen=True):
    """One leg."""

    leg: str
    hip: AxisView
    slide: AxisView
    sample_time_ms: float | None
    """UTC of the sample, ms since 1970."""


class VerdictView(msgspec.Struct, frozen=True):
    """The latched stop, with the service's own texts."""

    category: str
    cause: str
    text: str
    remedy: str


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
    progress: str | None
    lease_holder: str | None
    verdict: VerdictView | None
    legs: tuple[LegView, ...]
    health: HealthView | None
    plan: PlanView
    active: bool
    """The drives are enabled, or were when the trainer fell silent."""
    alarm: str | None


class StrideItem(msgspec.Struct, frozen=True, tag="stride", tag_field="kind"):
    """One stride."""

    leg: str
    number: int
    boot: str
    time_ms: float
    """UTC of its end."""
    cadence_hz: float
    share_ratio: float | None
    share_ratio_std: float | None
    work_j: float | None
    work_j_std: float | None


class EventItem(msgspec.Struct, frozen=True, tag="event", tag_field="kind"):
    """One event."""

    id: str
    time_ms: float
    priority: str
    text: str
    remedy: str


def stride_item(stride: Stride) -> StrideItem:
    """Return what the page shows of a stride."""
    return StrideItem(
        stride.leg,
        stride.number,
        stride.core_boot_id,
        stride.sample_time_ns / 1e6,
        stride.cadence_hz,
        stride.share_ratio,
        stride.share_ratio_std,
        stride.work_positive_j,
        stride.work_positive_j_std,
    )


def event_item(event: Event) -> EventItem:
    """Return what the page shows of an event."""
    return EventItem(event.id, event.time_ns / 1e6, event.priority, event.text, event.remedy)


def leg_view(
    leg: str,
    activity: Activity | NotValid,
    friction: Friction | NotValid,
    drives: Iterable[DriveState | NotValid],
) -> LegView:
    """Return the numbers of one leg.

    Args:
        leg: right or left.
        activity: newest message.
        friction: newest message.
        drives: of hip and slide.
    """
    known = activity if isinstance(activity, Activity) else None
    rubbing = friction if isinstance(friction, Friction) else None
    efforts = [
        drive.effort_si if isinstance(drive, DriveState) and drive.fresh else None
        for drive in drives
    ]
    hip = AxisView(
        validity=known.hip_validity if known else None,
        patient=Number(known.hip_patient_nm, known.hip_patient_nm_std) if known else UNKNOWN,
        friction=Number(rubbing.hip_friction_nm, rubbing.hip_friction_nm_std)
        if rubbing
        else UNKNOWN,
        net=Number(known.hip_net_nm, known.hip_net_nm_std) if known else UNKNOWN,
        effort=efforts[0],
    )
    slide = AxisView(
        validity=known.slide_validity if known else None,
        patient=Number(known.slide_patient_n, known.slide_patient_n_std) if known else UNKNOWN,
        friction=Number(rubbing.slide_friction_n, rubbing.slide_friction_n_std)
        if rubbing
        else UNKNOWN,
        net=Number(known.slide_net_n, known.slide_net_n_std) if known else UNKNOWN,
        effort=efforts[1],
    )
    return LegView(leg, hip, slide, known.sample_time_ns / 1e6 if known else None)


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

    def view(
        self,
        legs: tuple[LegView, ...],
        safety: Safety | NotValid,
        health: Health | NotValid,
        drives: Iterable[DriveState | NotValid],
    ) -> TherapistView:
        """Return the frame."""
        known = safety if isinstance(safety, Safety) and safety.valid else None
        if all(leg.hip.validity is None for leg in legs):
            known = None
        verdict = known.verdict if known else None
        stopped = verdict if cause_of(known) != Cause.NONE else None
        spoken = [drive for drive in drives if isinstance(drive, DriveState)]
        alarm = self._alarm.take(known, spoken, has_session=self._has_session)
        return TherapistView(
            is_silent=known is None,
            mode=known.mode if known else None,
            progress=known.progress if known else None,
            lease_holder=known.lease_holder if known else None,
            verdict=VerdictView(stopped.category, stopped.cause, stopped.text, stopped.remedy)
            if stopped
            else None,
            legs=legs,
            health=health_view(health),
            plan=UNKNOWN_PLAN if known is None else self.plan,
            active=self._alarm.was_active,
            alarm=alarm,
        )
