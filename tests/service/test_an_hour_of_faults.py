"""An hour of gait with the real processes in simulated time, and a fault every few seconds."""

import sys
import tempfile
from pathlib import Path

import pytest
from gaitd_names import Cause, Mode, StopCategory
from msgspec.structs import replace
from records import record as any_record

from daemon.config.shipped import configs_folder
from daemon.ipc.record import Verdict
from gaitd_lab.process_memory import Sample
from gaitd_lab.processes import Tempo, memory_folder
from gaitd_lab.timed_service import PARTS, warm_up
from sim_drives.faults.script import parse_command
from tests.service.drawn_faults import SOURCES, Actor, FaultGenerator
from tests.service.soak import Soak, SoakedService, StopMonitor, growth_mb_per_h

SEED = 1
DURATION_S = 3600.0
MOST_MB = {"core": 200.0, "gateway": 120.0}
GROWTH_MAX_MB_PER_H = 1.0
"""Budgets of the design."""
DRIVES = ("right/hip", "right/slide")


@pytest.mark.thorough
@pytest.mark.timeout(3600)
def test_an_hour_of_gait_and_faults_has_no_stop_that_nothing_explains_and_no_growth():
    configs = configs_folder("configs", "demo.toml")
    warm_up(configs)
    with (  # a ring on a disk would count as memory of the core
        tempfile.TemporaryDirectory(prefix="gaitd-", dir=memory_folder()) as folder,
        SoakedService(configs, Path(folder), Tempo("max")) as made,
    ):
        for part in PARTS:
            made.start(part)
        found = Soak(made, SEED, DURATION_S).run()

    assert [stop for stop in found.monitor.stops if not stop.is_explained] == []
    assert found.missed == []
    assert made.endings == []
    assert found.exit_codes == dict.fromkeys(PARTS, 0)
    assert found.monitor.cycle_count > 0.5 * DURATION_S / 0.01
    assert len(found.monitor.stops) > 100
    assert found.outcomes["mode done"] > 100
    assert found.lost_count == 0, "a record that was not read may be a stop"
    lived_long = set()
    for (part, _), samples in found.memory.items():
        growth = growth_mb_per_h(samples)
        print(part, f"{samples[-1].rss_mb:.0f} MB, {growth} MB/h", file=sys.stderr)
        if part in MOST_MB:
            assert samples[-1].rss_mb <= MOST_MB[part]
            if growth is not None:
                assert growth <= GROWTH_MAX_MB_PER_H
                lived_long.add(part)
    assert lived_long == set(MOST_MB), "a process of each has lived long enough to grow"


# --- what would make it blind -------------------------------------------------------------------


def drawn(count):
    faults = FaultGenerator(1, DRIVES)
    return [faults.next(deaths=True) for _ in range(count)]


def test_every_fault_of_the_table_is_drawn_and_the_virtual_drives_know_its_words():
    found = drawn(5000)

    assert {one.name for one in found} == set(SOURCES)
    for one in found:
        if one.actor is Actor.DRIVE:
            for line in one.words.splitlines():
                assert parse_command(line).drive == one.drive


EMERGENCY = Verdict(StopCategory.S1, Cause.EMERGENCY, "right/hip")
OVERRUN = Verdict(StopCategory.S1, Cause.CYCLE_OVERRUN)


@pytest.mark.parametrize(
    ("verdicts", "name", "is_explained"),
    [
        ((EMERGENCY,), "emcy_2xxx_fault", True),
        ((EMERGENCY, OVERRUN), "emcy_2xxx_fault", False),
        ((EMERGENCY,), "hand_switch", False),
        ((EMERGENCY,), "patient_active", False),
        ((EMERGENCY,), None, False),
    ],
)
def test_a_stop_is_explained_by_each_of_its_causes_in_the_row_of_its_fault(
    verdicts, name, is_explained
):
    fault = next((one for one in drawn(5000) if one.name == name), None)
    calm = [replace(any_record(seq), mode=Mode.GAIT, verdict=Verdict()) for seq in range(1, 5)]
    stopped = [
        replace(any_record(5 + n), mode=Mode.FAULT, verdict=verdict)
        for n, verdict in enumerate(verdicts)
    ]
    monitor = StopMonitor()

    monitor.read(calm + stopped, 1.0, fault)

    (stop,) = monitor.stops
    assert stop.causes == [verdict.cause for verdict in verdicts]
    assert stop.is_explained == is_explained


@pytest.mark.parametrize(("steps", "mb_per_h"), [((1900,), 0.0), (range(0, 3600, 300), 6.0)])
def test_one_step_is_no_growth_and_a_step_again_and_again_is(steps, mb_per_h):
    own_mb = [20.0 + 0.5 * sum(t >= step for step in steps) for t in range(0, 3600, 5)]
    samples = [Sample(5.0 * n, 7, own, own, 5.0, 0.0) for n, own in enumerate(own_mb)]

    assert growth_mb_per_h(samples) == pytest.approx(mb_per_h, abs=0.3)
