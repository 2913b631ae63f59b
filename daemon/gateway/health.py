"""Summary of many records in one `health` message: lateness, work, lost samples and records.

A sample is missed when its cycle's window closed without it. It is late when its frame came before
the next record (the drive's late count rose there), and lost when it did not.
"""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final

import msgspec
from gaitd_client import wire
from gaitd_client.wire.health_messages import BusHealth, DriveHealth
from gaitd_names import CyclePart, SetpointRefusal

from daemon.gateway.translate import Stamp, finite, head
from daemon.ipc.record import BusRecord, CycleRecord, DriveRecord

LATENESS_BOUND_US: Final = (50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000)

_OPERATIONAL: Final = 0x05
"""NMT state OPERATIONAL, in which a drive sends TPDOs."""


@dataclass(slots=True)
class _Tally:
    """Missed, late and lost samples of one drive."""

    missed_count: int = 0
    lost_count: int = 0
    late_count: int = 0
    missed_before: bool = False

    def update(self, drive: DriveRecord) -> None:
        if self.missed_before and drive.late_count == self.late_count:
            self.lost_count += 1
        self.late_count = drive.late_count
        self.missed_before = drive.nmt_state == _OPERATIONAL and not drive.fresh
        self.missed_count += self.missed_before


@dataclass(slots=True)
class Counters:
    """What the gateway itself lost, counted since its start."""

    record_missed_count: int = 0
    record_skipped_count: int = 0
    gateway_state_dropped_count: int = 0
    request_dropped_count: int = 0
    not_kept_count: int = 0
    setpoint_refused_count: Mapping[SetpointRefusal, int] = field(
        default_factory=dict[SetpointRefusal, int]
    )


@dataclass(slots=True)
class HealthWindow:
    """Collects one second of records; histogram and tallies are kept as long as the core lives."""

    counters: Counters = field(default_factory=Counters)
    _histogram: list[int] = field(default_factory=lambda: [0] * (len(LATENESS_BOUND_US) + 1))
    _records: list[CycleRecord] = field(default_factory=list)
    _wakes_ns: list[int] = field(default_factory=list)
    _estimates_ns: list[int] = field(default_factory=list)
    _tallies: dict[str, _Tally] = field(default_factory=dict)

    def core_started(self) -> None:
        """Clear what was counted of the previous core."""
        self._histogram = [0] * (len(LATENESS_BOUND_US) + 1)
        self._records.clear()
        self._tallies.clear()

    def add(self, record: CycleRecord) -> None:
        """Add one record."""
        self._records.append(record)
        self._histogram[bisect_left(LATENESS_BOUND_US, record.timing.lateness_ns / 1e3)] += 1
        for drive in record.drives:
            self._tallies.setdefault(drive.name, _Tally()).update(drive)

    def add_wake(self, work_ns: int) -> None:
        """Add the duration of one turn of the gateway's loop, in ns."""
        self._wakes_ns.append(work_ns)

    def add_estimate(self, work_ns: int) -> None:
        """Add the time from a wake-up to the first estimate, made but not yet published, in ns."""
        self._estimates_ns.append(work_ns)

    def close(self, stamp: Stamp, seq: int, keys_expiring: tuple[str, ...] = ()) -> wire.Health:
        """Make the message of the last second and begin the next."""
        records, self._records = self._records, []
        wakes_ns, self._wakes_ns = self._wakes_ns, []
        estimates_ns, self._estimates_ns = self._estimates_ns, []
        newest = records[-1] if records else None
        lateness_ns = [record.timing.lateness_ns for record in records]
        return wire.Health(
            **head(stamp, seq),
            lateness_bound_us=LATENESS_BOUND_US,
            lateness_count=tuple(self._histogram),
            lateness_p50_us=_median_us(lateness_ns),
            lateness_max_us=_max_us(lateness_ns),
            collect_max_us=_max_us([record.timing.collect_ns for record in records]),
            work_max_us=_max_us([record.timing.work_ns for record in records]),
            overrun_count=newest.timing.overrun_count if newest else None,
            overrun_by_part=_by_part(newest),
            publish_max_us=_max_us([record.timing.publish_ns for record in records]),
            record_count=len(records),
            bus_load_ratio=finite(newest.bus_load_ratio) if newest else None,
            drives=tuple(self._drive_health(drive) for drive in (newest.drives if newest else ())),
            tx_dropped_count=newest.tx_dropped_count if newest else None,
            record_missed_count=self.counters.record_missed_count,
            record_skipped_count=self.counters.record_skipped_count,
            gateway_state_dropped_count=self.counters.gateway_state_dropped_count,
            request_dropped_count=self.counters.request_dropped_count,
            not_kept_count=self.counters.not_kept_count,
            gateway_wake_max_us=_max_us(wakes_ns),
            gateway_estimate_p50_us=_median_us(estimates_ns),
            bus=_bus_health(newest.bus) if newest else None,
            setpoint_accepted_count=newest.assist.accepted_count if newest else None,
            setpoint_refused_count=_refused(self.counters, newest),
            keys_expiring=keys_expiring,
            assist_lapse_count=newest.assist.lapse_count if newest else None,
            time_is_simulated=newest.time_is_simulated if newest else None,
        )

    def _drive_health(self, drive: DriveRecord) -> DriveHealth:
        tally = self._tallies[drive.name]
        return DriveHealth(
            name=drive.name,
            missed_count=tally.missed_count,
            late_count=drive.late_count,
            lost_count=tally.lost_count,
            protocol_error_count=drive.protocol_error_count,
            heartbeat_age_ms=finite(drive.heartbeat_age_ms),
        )


def _refused(counters: Counters, newest: CycleRecord | None) -> dict[str, int]:
    """Refused setpoints by reason: the sum of the gateway's and the core's refusals."""
    by_core = newest.assist.refused_count if newest else {}
    return {
        reason: counters.setpoint_refused_count.get(reason, 0) + by_core.get(reason, 0)
        for reason in SetpointRefusal
    }


def _by_part(newest: CycleRecord | None) -> dict[str, int]:
    """Overruns by part of the cycle; empty without a record."""
    if newest is None:
        return {}
    return {part: newest.timing.overrun_by_part.get(part, 0) for part in CyclePart}


def _bus_health(bus: BusRecord) -> BusHealth:
    return BusHealth(**msgspec.structs.asdict(bus))


def _max_us(values_ns: Sequence[int]) -> float | None:
    return max(values_ns) / 1e3 if values_ns else None


def _median_us(values_ns: Sequence[int]) -> float | None:
    return median(values_ns) / 1e3 if values_ns else None
