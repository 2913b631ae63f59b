"""The benchmarks measure what they say; no test here judges a time."""

import json
from pathlib import Path

import numpy as np
import pytest
from sessions import Session

from daemon.core import cycle
from gaitd.benchmark import cycle_parts, lateness, replay_speed, scaling, tables
from gaitd.benchmark.cycle_parts import PARTS, WHOLE

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture
def robot():
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml

    return load_toml(CONFIGS / "robot.toml", Robot)


def test_every_part_of_the_cycle_is_timed_in_every_cycle_and_put_back():
    session = Session().until_ready()
    before = [vars(owner)[attribute] for _, owner, attribute in PARTS]

    with cycle_parts.stopwatch() as times:
        begun = len(session.lockstep.records)
        session.lockstep.run(0.5)
        cycles = len(session.lockstep.records) - begun

    assert cycles == pytest.approx(50, abs=1)
    assert len(times[WHOLE]) == cycles
    assert all(len(values) >= cycles - 1 for values in times.values())
    assert [vars(owner)[attribute] for _, owner, attribute in PARTS] == before
    assert cycle.step.__name__ == "step"


def test_the_parts_together_are_no_more_than_the_whole():
    session = Session().until_ready()
    with cycle_parts.stopwatch() as times:
        session.lockstep.run(0.5)

    whole = sum(times[WHOLE])
    parts = sum(sum(values) for name, values in times.items() if name != WHOLE)
    assert 0 < parts < 1.2 * whole


def test_lateness_is_that_of_the_records():
    session = Session().until_ready()
    records = session.lockstep.records[-20:]

    found = lateness.of(records)

    assert found.sync_count == 20
    assert sum(found.class_count) == 20
    wanted = np.max([record.timing.lateness_ns for record in records]) / 1000
    assert found.worst_us == pytest.approx(wanted)


def test_the_speed_of_replay_is_measured_on_a_recording_that_is_valid(monkeypatch):
    from daemon.config.settings import Robot
    from daemon.config.strict import load_toml

    monkeypatch.setattr(replay_speed, "DURATION_S", 5.0)

    found = replay_speed.measure(load_toml(CONFIGS / "robot.toml", Robot))

    assert found.row_count == 500
    assert found.computing_ratio > found.with_csv_ratio > 0


def test_results_become_json_with_their_names():
    part = cycle_parts.Part("observer", 1.0, 2.0, 0.5)

    text = json.dumps(tables.plain((part, part)))

    assert json.loads(text)[0] == {
        "name": "observer",
        "median_us": 1.0,
        "high_us": 2.0,
        "share_ratio": 0.5,
    }


def test_every_number_stands_beside_its_budget():
    part = cycle_parts.Part(WHOLE, 500.0, 700.0, 1.0)

    table = tables.cycle("a cycle", (part,))

    from rich.console import Console

    console = Console(width=120)
    with console.capture() as captured:
        console.print(table)
    assert "≤ 400, ≤ 800 µs" in captured.get()
    assert "500 µs" in captured.get()


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(scaling, "ROWS", 1500)
    monkeypatch.setattr(scaling, "STEPS", 20)
    monkeypatch.setattr(scaling, "REPEATS", 1)


def test_growth_is_measured_for_every_number_of_legs_against_one(robot, few):
    found = scaling.measure(robot)

    assert [row.together_count for row in found.growth] == [1, 2, 4, 8]
    assert found.growth[0].recording_ratio == found.growth[0].leg_ratio == 1.0
    for row in found.growth:
        assert row.leg_ratio == pytest.approx(row.leg_us / found.growth[0].leg_us)
    assert "replayed row 496 bytes" in str(tables.scaling("growth", found).caption)


def test_the_compiled_step_allocates_nothing_and_python_keeps_nothing(robot, few):
    found = scaling.measure(robot).memory

    assert found.compiled_count == 0
    assert found.kept_count == 0


def test_allocations_that_there_are_would_be_counted():
    from numba import njit

    @njit
    def allocate() -> int:
        return np.zeros(3).size

    allocate()

    assert scaling._compiled_allocations(lambda: [allocate() for _ in range(7)]) == 7
