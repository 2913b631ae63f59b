"""Two legs, four drives, one bus: the shipped example as real processes."""

import pytest
from gaitd_names import Mode
from long_service import TIMEOUT_S, long_lived

pytestmark = pytest.mark.thorough

LEGS = ("right", "left")
DRIVES = ["right/hip", "right/slide", "left/hip", "left/slide"]
EMERGENCY = 0x2310
RAMP_CYCLES = 400
"""Behind these a stride of 0.4 Hz has its whole amplitude."""


@pytest.fixture(scope="module")
def both_legs():
    with long_lived("two_legs.toml") as service:
        yield service


def test_both_legs_walk_half_a_stride_apart_and_a_fault_of_one_stops_both(both_legs):
    service = both_legs.bring(Mode.GAIT)
    first = service.newest().seq + RAMP_CYCLES
    service.until(lambda record: record.seq >= first + 300)
    records = [record for record in service.records(first) if record.seq > first]

    assert {record.mode for record in records} == {Mode.GAIT}
    assert [drive.name for drive in records[-1].drives] == DRIVES
    assert [leg.name for leg in records[-1].legs] == list(LEGS)
    hips = [(record.drives[0].position, record.drives[2].position) for record in records]
    right, left = zip(*hips, strict=True)
    assert max(right) - min(right) > 0.4
    assert max(left) - min(left) > 0.4
    furthest = max(range(len(right)), key=lambda index: right[index])
    assert left[furthest] < (max(left) + min(left)) / 2

    service.inject(f"emcy left/slide - {EMERGENCY}")
    record = service.until(lambda one: one.mode == Mode.FAULT, TIMEOUT_S)
    service.inject("clear emcy left/slide")
    assert record.verdict.drive == "left/slide"
    assert all(abs(drive.velocity or 0.0) < 0.05 for drive in record.drives)
