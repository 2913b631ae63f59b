"""Records with nothing remarkable in them, for tests that change one thing."""

from collections.abc import Iterable

import msgspec
from gaitd_names import Mode

from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import (
    AxisRecord,
    CycleRecord,
    DriveRecord,
    LegRecord,
    RequestResult,
    Verdict,
)
from daemon.ipc.ring_clip import ClipWriter
from daemon.ipc.transport import SLOT_COUNT, SLOT_SIZE, RingHeader

HEADER = RingHeader(
    core_boot_id="boot",
    start_utc_ns=1_700_000_000_000_000_000,
    period_ns=10_000_000,
    trainer="trainer",
    drive_names=("right/hip", "right/slide"),
    leg_names=("right",),
    config_hashes={"demo.toml": "00" * 32},
    version="0.1.0",
    robot={},
    limits={},
)


def drive(name: str) -> DriveRecord:
    """A drive that is enabled and well."""
    return DriveRecord(
        name=name,
        nmt_state=5,
        power_state=5,
        statusword=0x1237,
        mode_display=10,
        fresh=True,
        sample_age_cycles=0,
        late_count=0,
        heartbeat_age_ms=5.0,
        position=0.2,
        velocity=0.1,
        effort=3.0,
        target_effort=3.0,
        referenced=True,
        hand_switch_closed=True,
        sto_released=True,
        temperature_degc=30.0,
        emergency_code=0,
        emergency_text="",
        emergency_count=0,
        protocol_error_count=0,
    )


def leg(name: str) -> LegRecord:
    """A leg whose estimate is valid."""
    hip = AxisRecord(
        measured_position=0.2,
        effort=3.0,
        reference_position=0.2,
        validity=0,
        position=0.2,
        position_std=1e-4,
        velocity=0.1,
        velocity_std=1e-2,
        friction=6.0,
        friction_std=0.5,
        patient=4.0,
        patient_std=0.5,
        net=-2.0,
        net_std=0.2,
        innovation=1e-5,
    )
    slide = AxisRecord(
        measured_position=0.5,
        effort=30.0,
        reference_position=0.5,
        validity=0,
        position=0.5,
        position_std=1e-4,
        velocity=0.2,
        velocity_std=1e-2,
        friction=65.0,
        friction_std=5.0,
        patient=20.0,
        patient_std=5.0,
        net=-45.0,
        net_std=2.0,
        innovation=2e-5,
    )
    return LegRecord(name=name, hip=hip, slide=slide, status=1, covariance=(0.01,) * 36, nis=2.0)


def both(of_leg: LegRecord, field: str) -> tuple[float, float]:
    """A field of hip and slide."""
    return getattr(of_leg.hip, field), getattr(of_leg.slide, field)


def states_of(leg: LegRecord, end: str = "") -> list[float]:
    """The estimate in the order of the observer's states; `_std`: their standard deviations."""
    names = ("position", "velocity", "friction", "patient")
    return [value for name in names for value in both(leg, name + end)]


def record(seq: int) -> CycleRecord:
    """A record in the middle of a gait."""
    return CycleRecord(
        seq=seq,
        cycle=seq,
        sync_mono_ns=seq * 10_000_000,
        sync_utc_ns=1_700_000_000_000_000_000 + seq * 10_000_000,
        dt_s=0.01,
        mode=Mode.GAIT,
        verdict=Verdict(),
        events=(),
        request=RequestResult(),
        progress=None,
        gateway_age_cycles=1,
        stop_count=0,
        gait_phase=0.5,
        drives=(drive("right/hip"), drive("right/slide")),
        legs=(leg("right"),),
        timing=CycleTiming(
            lateness_ns=10_000, collect_ns=500_000, work_ns=300_000, overrun_count=0
        ),
    )


def cut_out(records: Iterable[CycleRecord]) -> ClipWriter:
    """Records as the black box takes them out of a ring."""
    cutting = ClipWriter(SLOT_COUNT * SLOT_SIZE)
    for one in records:
        cutting.add(one.seq, msgspec.msgpack.encode(one))
    return cutting
