"""Swapped columns and wrong signs of a recording are recognised."""

import pytest
from empty_runs import empty_run, robot_file, shipped_friction

from analysis.column_check import ARRANGEMENTS, arranged, suspicion
from analysis.replay import estimate
from analysis.replay_report import column_lines

ROBOT = robot_file()


@pytest.fixture(scope="module")
def run():
    return empty_run(shipped_friction(), duration_s=8.0)


def test_a_recording_as_it_should_be_raises_no_suspicion(run):
    assert suspicion(run, ROBOT, estimate(run, ROBOT)) is None


@pytest.mark.parametrize("wrong", ARRANGEMENTS, ids=lambda one: one.words)
def test_a_wrong_arrangement_is_named(run, wrong):
    source = arranged(run, wrong)
    made = estimate(source, ROBOT)

    found = suspicion(source, ROBOT, made)

    assert found is not None
    assert found.arrangement is wrong
    assert [wrong.words in line for line in column_lines(source, made, ROBOT)] == [True]
