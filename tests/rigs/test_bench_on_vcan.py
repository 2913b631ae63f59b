"""A drive that is not ours and a virtual one on one SocketCAN interface, under the whole service.

The drive of the bench is durand's CANopen with a motor of its own, in a process of its own
(`bench_motor.py`); `gaitd sim` plays the other one, as configs/hil.toml says.
"""

import csv

import numpy as np
import pytest
from gaitd_names import Cause, Mode

from drives.signals import PowerState

SYNC_DELAY_NS = 5_000_000
pytestmark = [pytest.mark.rig_vcan, pytest.mark.timeout(3000)]


@pytest.fixture(scope="module", name="truth")
def _truth(vcan_world):
    """Rows of the plant's truth; the last line may be half a line."""
    rows = csv.DictReader(vcan_world.text("bench_truth.csv").splitlines())
    return [row for row in rows if row["programme"]]


def paired(rows, records, late):
    """Rows of the truth and the positions of the drives so many cycles before.

    The virtual drive has received a SYNC shortly after the core sent it.
    """
    received_ns = np.array([int(row["sync_mono_ns"]) for row in rows])
    for before, record in zip(records, records[late:], strict=False):
        number = np.searchsorted(received_ns, record.sync_mono_ns)
        delay_ns = received_ns[number] - record.sync_mono_ns
        if delay_ns < SYNC_DELAY_NS and record.cycle == before.cycle + late:
            yield rows[number], before


def test_both_are_brought_up_and_the_bench_s_is_not_one_of_ours(vcan_world):
    frames = [one.frame for one in vcan_world.frames("bench_up")]
    vendor = bytes.fromhex("43181001") + (0x29A).to_bytes(4, "little")

    assert vendor in [frame.data for frame in frames if frame.can_id == 0x585]
    assert vendor not in [frame.data for frame in frames if frame.can_id == 0x586]


def test_both_walk_and_the_virtual_leg_goes_with_the_motor_of_the_bench(vcan_world, truth):
    kept = vcan_world.records("bench")
    records = [record for record in kept if record.verdict.cause == Cause.NONE]
    hips = [record.drives[0].position for record in records]
    pairs = list(paired(truth, records, 2))

    assert len(records) > 300
    assert {record.mode for record in records} == {Mode.GAIT}
    assert np.ptp(hips) > 0.1
    assert len(pairs) > 200
    behind = [float(row["hip_angle_rad"]) - one.drives[0].position for row, one in pairs]
    assert np.abs(behind).max() < 2e-3
    slides = [
        float(row["slide_position_m"]) - one.drives[1].position
        for row, one in paired(truth, records, 0)
    ]
    assert np.abs(slides).max() < 1e-3


def test_a_stop_stops_the_real_and_the_virtual_drive(vcan_world):
    kept = vcan_world.records("bench")
    stopped = kept[-1]

    assert {record.verdict.cause for record in kept} == {Cause.NONE, Cause.STOP_REQUESTED}
    assert stopped.mode == Mode.FAULT
    assert all(abs(drive.velocity) < 0.05 for drive in stopped.drives)


def test_the_end_of_the_bench_s_drive_is_a_quick_stop_of_the_virtual_one(vcan_world, truth):
    stopped = vcan_world.records("bench_lost")[-1]

    assert (stopped.verdict.cause, stopped.verdict.drive) == (Cause.DRIVE_SILENT, "right/hip")
    assert stopped.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert abs(float(truth[-1]["slide_velocity_m_per_s"])) < 0.01
    assert float(truth[-1]["hip_velocity_rad_per_s"]) == 0.0
