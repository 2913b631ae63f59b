"""The core is dead, frozen or gone wild, and each limit in the drives acts on its own.

A rogue master sends raw frames to drives that the service has brought up: nothing of ours bounds
what it asks for, and the service's loop is not turned any more.
"""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from rogue_master import (
    CSP,
    FAULT,
    FAULT_REACTION,
    NODES,
    OPERATION_ENABLED,
    QUICK_STOP_ACTIVE,
    Rogue,
)
from sessions import CONFIGS, changed_configs, elmo_drives, generic_drives, new_session

FULL = 3000
"""Per mille: more than any limit."""
COUNTS = (1, -1)
"""Signs of hip and slide."""
EFFORT_MAX, SPEED_MAX = (62.0, 480.0), (4.0, 3.5)
HIGH = (math.radians(40.0), 0.95)
DETECTION_MS = {"epos4": 100, "generic": 30, "elmo": 100}
STATE_SHOWN_MS = 4
"""An Elmo renews its statusword every 3 ms."""
RAMP_GRACE_MS = 60
"""A velocity loop has first to undo the torque that it found."""
MAKES = ("epos4", "generic", "elmo")
AXES = (0, 1)
LIMITED = {"epos4", "generic"}
"""Makes whose 6080h is written."""
POSITION_CODE, FOLLOWING_CODE = 0x8A82, 0x8611
STOPPED = {QUICK_STOP_ACTIVE, FAULT_REACTION, FAULT}


def configs_of(make: str, folder: Path) -> Path:
    makers: dict[str, Callable[[Path], Path]] = {"generic": generic_drives, "elmo": elmo_drives}
    return makers[make](folder) if make in makers else CONFIGS


@pytest.fixture(scope="module", params=MAKES)
def make(request):
    return request.param


@pytest.fixture(params=AXES, ids=("hip", "slide"))
def axis(request):
    return request.param


@pytest.fixture(scope="module")
def warm_rogue(make, tmp_path_factory):
    taken = Rogue(new_session(configs_of(make, tmp_path_factory.mktemp(make))).enable())
    taken.cycles(2)
    assert taken.states() == (OPERATION_ENABLED, OPERATION_ENABLED)
    return taken


@pytest.fixture
def rogue(warm_rogue):
    return warm_rogue


def push(rogue: Rogue, axis: int, permille: int) -> None:
    rogue.commands[NODES[axis]].torque = COUNTS[axis] * permille


def hold_other(rogue: Rogue, axis: int) -> None:
    """The other axis stays where it is, by its own position loop."""
    node = NODES[1 - axis]
    rogue.commands[node].mode = CSP
    rogue.commands[node].position = rogue.object(node, 0x6064)
    rogue.cycles(3)


# --- killed -----------------------------------------------------------------------------------


def test_a_killed_core_is_noticed_in_time_and_leaves_both_joints_braked_on_their_ramps(
    rogue, make, axis
):
    push(rogue, axis, FULL)
    rogue.cycles(4)
    before = len(rogue.shown)
    path = rogue.die(500)
    after = rogue.shown[before:]

    for drive in AXES:
        states = [shown[drive] for shown in after]
        enabled_ms = states.index(next(s for s in states if s != OPERATION_ENABLED))
        assert enabled_ms <= DETECTION_MS[make] + STATE_SHOWN_MS
        assert OPERATION_ENABLED not in states[enabled_ms:]
        assert states[enabled_ms] in STOPPED
    noticed_ms = DETECTION_MS[make] + 1
    for joint, deceleration in enumerate((14.8, 15.4)):
        ramp_ms = abs(path[noticed_ms].velocity[joint]) / deceleration * 1000
        braked = path[noticed_ms : noticed_ms + round(ramp_ms) + RAMP_GRACE_MS]
        assert min(abs(truth.velocity[joint]) for truth in braked) < 0.05 * SPEED_MAX[joint]


@pytest.mark.parametrize("make", ["generic"], indirect=True)
def test_a_drive_with_a_timeout_of_its_commands_stops_though_sync_and_heartbeat_go_on(rogue):
    rogue.sends_commands = False
    rogue.cycles(4)

    assert set(rogue.states()) <= STOPPED
    assert {code for node in NODES for code in rogue.emergencies(node)} == {0x8250}


def test_without_heartbeats_drives_stop_though_sync_and_commands_go_on(rogue):
    rogue.heartbeat = False
    rogue.cycles(13)

    assert set(rogue.states()) <= STOPPED
    assert all(0x8130 in rogue.emergencies(node) for node in NODES)


# --- frozen: the same command for ever, with a living timer ---------------------------------------


@pytest.mark.parametrize("sign", [1, -1])
def test_a_frozen_core_gets_neither_torque_nor_speed_beyond_the_limits_that_the_drive_keeps(
    rogue, make, axis, sign
):
    push(rogue, axis, sign * FULL)
    rogue.cycles(8)
    efforts = [abs(truth.effort[axis]) for truth in rogue.path]
    assert max(efforts) == pytest.approx(EFFORT_MAX[axis], rel=0.01)
    for _ in range(32):
        rogue.cycle()
        if rogue.states()[axis] != OPERATION_ENABLED:
            break

    pushed = [
        sign * truth.velocity[axis]
        for truth, shown in zip(rogue.path, rogue.shown, strict=True)
        if shown[axis] == OPERATION_ENABLED
    ]
    if make in LIMITED:
        assert max(pushed) < 1.1 * SPEED_MAX[axis]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_frozen_core_is_stopped_at_the_position_limit(rogue, axis, sign):
    hold_other(rogue, axis)
    push(rogue, axis, sign * FULL)
    rogue.cycles(60)

    assert POSITION_CODE in rogue.emergencies(NODES[axis])
    assert rogue.states()[axis] in STOPPED


@pytest.mark.parametrize("make", ["elmo"], indirect=True)
def test_a_drive_without_a_speed_limit_is_shown_to_keep_none(rogue):
    hold_other(rogue, 1)
    push(rogue, 1, -FULL)
    rogue.cycles(40)

    assert max(abs(truth.velocity[1]) for truth in rogue.path) > 1.1 * SPEED_MAX[1]


def test_a_target_far_away_is_a_following_error_of_that_drive(rogue, axis):
    node = NODES[axis]
    hold_other(rogue, axis)
    there = rogue.object(node, 0x6064)
    window = rogue.object(node, 0x6065)
    rogue.commands[node].mode = CSP
    rogue.commands[node].position = there
    rogue.cycles(3)
    rogue.commands[node].position = there - COUNTS[axis] * 3 * window
    rogue.cycles(30)

    assert FOLLOWING_CODE in rogue.emergencies(node)
    assert rogue.states()[axis] in STOPPED


def test_a_target_outside_the_position_limits_is_not_followed(rogue, axis):
    node = NODES[axis]
    hold_other(rogue, axis)
    low = rogue.object(node, 0x607D, 1)
    rogue.commands[node].mode = CSP
    rogue.commands[node].position = rogue.object(node, 0x6064)
    rogue.cycles(3)
    rogue.commands[node].position = low - 10
    rogue.cycles(10)

    assert POSITION_CODE in rogue.emergencies(node)
    assert rogue.states()[axis] in STOPPED


def test_limits_that_a_plant_clips_are_clipped(tmp_path):
    clipping = changed_configs(
        tmp_path, ("plant.toml", 'position_limit = "fault"', 'position_limit = "clip"')
    )
    rogue = Rogue(new_session(clipping).enable())
    rogue.cycles(2)
    high = rogue.object(NODES[0], 0x607D, 2)
    rogue.commands[NODES[0]].mode = CSP
    rogue.commands[NODES[0]].position = rogue.object(NODES[0], 0x6064)
    hold_other(rogue, 0)
    for target in range(rogue.commands[NODES[0]].position, high + 200, 40):
        rogue.commands[NODES[0]].position = target
        rogue.cycle()
    rogue.cycles(60)

    assert rogue.object(NODES[0], 0x6064) <= high + 5
    assert max(truth.position[0] for truth in rogue.path) < HIGH[0] + math.radians(1.0)
