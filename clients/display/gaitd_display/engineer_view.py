"""All that the engineer's page shows, and what it needs of the last minute when it is opened.

Times are those of the records (UTC of their SYNC), not of this computer: time may be simulated.
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, Self

import msgspec
from gaitd_client import Activity, Cause, DriveState, Estimate, Health, NotValid, Safety
from gaitd_texts import Reader, catalogue

from gaitd_display.geometry import Geometry
from gaitd_display.truth import TrueEfforts

ENGLISH: Final = catalogue(Reader.OPERATOR, "en")
"""This page has one language."""

CURVE_S: Final = 13.0
"""Time of the curves, which show 12 s."""
MINUTE_S: Final = 65.0
"""Time of modes and health, which are shown for a minute."""


class Row(msgspec.Struct, frozen=True, array_like=True):
    """One leg at one SYNC; an array in JSON, in the order of `COLUMNS`. None: not valid."""

    time_ms: float
    """UTC of the SYNC."""
    hip_angle_rad: float | None = None
    slide_position_m: float | None = None
    hip_validity: str | None = None
    hip_patient_nm: float | None = None
    hip_patient_nm_std: float | None = None
    hip_friction_nm: float | None = None
    hip_net_nm: float | None = None
    hip_true_nm: float | None = None
    """What the virtual patient does; None: not known."""
    slide_validity: str | None = None
    slide_patient_n: float | None = None
    slide_patient_n_std: float | None = None
    slide_friction_n: float | None = None
    slide_net_n: float | None = None
    slide_true_n: float | None = None


COLUMNS: Final = Row.__struct_fields__


class LegNow(msgspec.Struct, frozen=True):
    """One leg now."""

    leg: str
    row: Row | None
    """None: the trainer is silent."""
    power_w: float | None
    """Power of the patient, both axes."""
    power_w_std: float | None


class VerdictView(msgspec.Struct, frozen=True):
    """The latched stop, with the service's own texts."""

    category: str
    cause: str
    text: str
    remedy: str


class Span(msgspec.Struct, frozen=True):
    """Mode and stop from an instant to that of the next span."""

    time_ms: float
    mode: str | None
    """None: not known."""
    category: str | None
    """Category of the latched stop; None: there is none."""
    cause: str | None

    @classmethod
    def of(cls, time_ms: float, mode: str | None, verdict: VerdictView | None) -> Self:
        """Return what is the case from an instant on."""
        if verdict is None:
            return cls(time_ms, mode, None, None)
        return cls(time_ms, mode, verdict.category, verdict.cause)


class Second(msgspec.Struct, frozen=True):
    """Health of cycle and bus in one second."""

    time_ms: float
    late_p50_us: float | None
    late_max_us: float | None
    collect_max_us: float | None
    work_max_us: float | None
    overrun_count: int | None
    bus: str | None
    bus_load_ratio: float | None


class DriveView(msgspec.Struct, frozen=True):
    """One drive; None: not known."""

    name: str
    power_state: str | None = None
    statusword: str | None = None
    effort: float | None = None
    """Measured: N·m at the hip, N at the slide."""
    temperature_degc: float | None = None
    hand_switch_closed: bool | None = None
    sto_released: bool | None = None
    emergency: str | None = None
    """Newest emergency message of the drive."""


class EngineerView(msgspec.Struct, frozen=True):
    """One frame of the engineer's page."""

    time_ms: float | None
    """UTC of the newest record; None: the trainer is silent."""
    mode: str | None
    progress: str
    lease_holder: str | None
    verdict: VerdictView | None
    legs: tuple[LegNow, ...]
    drives: tuple[DriveView, ...]
    second: Second | None
    geometry: Geometry | None
    has_truth: bool
    """The truth of a leg is known at its newest SYNC."""
    truth_trouble: str


class Past(msgspec.Struct, frozen=True):
    """What a page that is opened needs of the time before."""

    columns: tuple[str, ...]
    rows: Mapping[str, Sequence[Row]]
    """By leg."""
    spans: Sequence[Span]
    seconds: Sequence[Second]


def row_of(estimate: Estimate, true: TrueEfforts | None) -> Row:
    """Return what the page shows of an estimate, and of the truth at the same SYNC."""
    hip, slide = estimate.hip, estimate.slide
    return Row(
        time_ms=estimate.sample_time_ns / 1e6,
        hip_angle_rad=hip.position,
        slide_position_m=slide.position,
        hip_validity=hip.validity,
        hip_patient_nm=hip.patient,
        hip_patient_nm_std=hip.patient_std,
        hip_friction_nm=hip.friction,
        hip_net_nm=hip.net,
        hip_true_nm=true.hip_patient_nm if true else None,
        slide_validity=slide.validity,
        slide_patient_n=slide.patient,
        slide_patient_n_std=slide.patient_std,
        slide_friction_n=slide.friction,
        slide_net_n=slide.net,
        slide_true_n=true.slide_patient_n if true else None,
    )


def leg_now(leg: str, row: Row | None, activity: Activity | NotValid) -> LegNow:
    """Return what the page shows of a leg now."""
    if row is None or isinstance(activity, NotValid):
        return LegNow(leg, row, None, None)
    return LegNow(leg, row, activity.patient_power_w, activity.patient_power_w_std)


def drive_view(name: str, state: DriveState | NotValid) -> DriveView:
    """Return what the page shows of a drive; nothing is known of a silent one."""
    if isinstance(state, NotValid):
        return DriveView(name)
    emergency = f"{state.emergency_code} {state.emergency_text}" if state.emergency_code else None
    return DriveView(
        name,
        state.power_state,
        state.statusword,
        state.effort if state.fresh else None,
        state.temperature_degc,
        state.hand_switch_closed,
        state.sto_released,
        emergency,
    )


def second_of(health: Health) -> Second | None:
    """Return what the page shows of a second; None: it has no time, because no core runs."""
    if health.sample_time_ns is None:
        return None
    return Second(
        health.sample_time_ns / 1e6,
        health.lateness_p50_us,
        health.lateness_max_us,
        health.collect_max_us,
        health.work_max_us,
        health.overrun_count,
        health.bus.condition if health.bus else None,
        health.bus_load_ratio,
    )


def verdict_of(safety: Safety | None) -> VerdictView | None:
    """Return the latched stop; None without one."""
    verdict = None if safety is None else safety.verdict
    if verdict is None or verdict.cause == Cause.NONE:
        return None
    text, remedy = ENGLISH.verdict(verdict), ENGLISH.remedy(verdict.cause)
    return VerdictView(verdict.category, verdict.cause, text, remedy)


class Memory:
    """Rows, spans and seconds of the last minute, by the time of the records."""

    def __init__(self, legs: Iterable[str]) -> None:
        """Start empty."""
        self._rows: dict[str, deque[Row]] = {leg: deque() for leg in legs}
        self._spans: deque[Span] = deque()
        self._seconds: deque[Second] = deque()
        self._newest_ms = 0.0

    def add_row(self, leg: str, row: Row | None) -> None:
        """Add a leg's newest row; None: nothing is known since the last one."""
        rows = self._rows[leg]
        if row is None:
            if rows and rows[-1].hip_validity is not None:
                rows.append(Row(rows[-1].time_ms))
            return
        if rows and row.time_ms == rows[-1].time_ms and rows[-1].hip_validity is not None:
            return
        self._now(row.time_ms)
        rows.append(row)

    def add_span(self, span: Span) -> None:
        """Add what is the case now, if it is something else than before."""
        last = self._spans[-1] if self._spans else None
        if last is None or msgspec.structs.replace(span, time_ms=last.time_ms) != last:
            self._spans.append(span)

    def add_second(self, second: Second) -> None:
        """Add the newest second."""
        if not self._seconds or second.time_ms > self._seconds[-1].time_ms:
            self._seconds.append(second)

    @property
    def newest_ms(self) -> float:
        """UTC of the newest record."""
        return self._newest_ms

    def past(self) -> Past:
        """Return all of it."""
        rows = {leg: list(kept) for leg, kept in self._rows.items()}
        return Past(COLUMNS, rows, list(self._spans), list(self._seconds))

    def _now(self, time_ms: float) -> None:
        """Forget what is too old, and all that is later: another run with an earlier clock."""
        if time_ms < self._newest_ms - CURVE_S * 1e3:
            for kept in (*self._rows.values(), self._spans, self._seconds):
                kept.clear()
        self._newest_ms = time_ms
        for rows in self._rows.values():
            while rows and rows[0].time_ms < time_ms - CURVE_S * 1e3:
                rows.popleft()
        while self._seconds and self._seconds[0].time_ms < time_ms - MINUTE_S * 1e3:
            self._seconds.popleft()
        # The span that was in force a minute ago is still needed.
        while len(self._spans) > 1 and self._spans[1].time_ms < time_ms - MINUTE_S * 1e3:
            self._spans.popleft()
