"""All limits that a drive can hold are in it, read by python-canopen; the page names them."""

from pathlib import Path
from typing import NamedTuple

import canopen
import pytest
from bringup_bench import Bench, refused
from drive_files import CYCLE, HIP_LIMITS, drive
from sessions import CONFIGS, elmo_drives, generic_drives, new_session

from daemon.config.drive_plan import cycle_settings, drive_limits
from daemon.preflight.load import load
from drives.bringup.plan import plan
from drives.bringup.steps import StepKind
from drives.canopen.frame import Frame
from drives.canopen.objects import Object
from drives.errors import BootFailure

MS = 1_000_000
PAGE = Path(__file__).parents[2] / "docs" / "backstop.md"
MAKES = {"epos4": None, "generic": generic_drives, "elmo": elmo_drives}
NAMES = {"epos4": "EPOS4", "generic": "CiA 402", "elmo": "Elmo Gold"}
EDS = {"epos4": "epos4", "generic": "generic402", "elmo": "elmo_gold"}
MUST_HOLD = {0x1016, 0x1029, 0x6007, 0x605A, 0x605B, 0x605C, 0x605E, 0x6065, 0x6066, 0x607D, 0x6085}
"""Objects of every make; beside them the torque limit, and what only some have."""
WRITES = {StepKind.WRITE, StepKind.CLEAR, StepKind.RANGE}
COMMUNICATION = {
    Object.SYNC_WINDOW,
    Object.HEARTBEAT_PRODUCER,
    Object.SYNC_COUNTER,
    *range(Object.RPDO, 0x1A10),
    Object.MODE,
    Object.TARGET_TORQUE,
    Object.TARGET_POSITION,
}
"""Objects of PDOs, SYNC, heartbeats and initial targets: no limits, except 1400h:05."""
RPDO_TIMEOUT = (0x1400, 5)


class Limit(NamedTuple):
    """A limit as it is written and read back."""

    index: int
    sub: int
    value: int

    @property
    def place(self) -> str:
        return f"{self.index:04X}h:{self.sub:02X}"


def is_limit(step) -> bool:
    at_rpdo = (step.index, step.sub) == RPDO_TIMEOUT
    return step.kind in WRITES and (at_rpdo or step.index not in COMMUNICATION)


def limits(settings, described, axis) -> list[Limit]:
    of_axis = drive_limits(settings.limits)[axis]
    found = []
    for step in plan(described, of_axis, cycle_settings(settings.trainer.cycle)).steps:
        if is_limit(step):
            found.append(Limit(step.index, step.sub, step.value))
            if step.kind is StepKind.RANGE:
                found.append(Limit(step.index, step.sub + 1, step.second))
    return found


def configs_of(make, folder):
    return MAKES[make](folder) if MAKES[make] else CONFIGS


class LockstepNetwork(canopen.Network):
    """canopen's network on the world of a session: an answer is there when a request has left."""

    def __init__(self, world) -> None:
        super().__init__()
        self.world = world

    def send_message(self, can_id, data, remote=False):
        self.world.receive(Frame(can_id, bytes(data)))
        for frame in self.world.advance_to(self.world.now_ns + 5 * MS):
            self.notify(frame.can_id, bytearray(frame.data), frame.time_ns * 1e-9)


def read_by_canopen(session, make):
    network = LockstepNetwork(session.machine.world)
    eds = str(CONFIGS / f"drives/{EDS[make]}.eds")
    return [network.add_node(node, eds) for node in (5, 6)]


def held(node: canopen.RemoteNode, row) -> tuple[int, int]:
    data = node.sdo.upload(row.index, row.sub)
    return int.from_bytes(data, "little"), len(data)


@pytest.mark.parametrize("make", MAKES)
def test_every_limit_is_in_the_drive_after_bring_up(tmp_path, make):
    session = new_session(configs_of(make, tmp_path)).until_ready()
    leg = session.settings.legs[0]

    nodes = read_by_canopen(session, make)
    for axis, (node, described) in enumerate(zip(nodes, (leg.hip, leg.slide), strict=True)):
        expected = limits(session.settings, described, axis)
        assert {row.index for row in expected} >= MUST_HOLD
        for row in expected:
            value, size = held(node, row)
            assert value == row.value % (1 << 8 * size), row


@pytest.mark.parametrize(
    "step",
    [one for one in plan(drive("hip_generic"), HIP_LIMITS, CYCLE).steps if is_limit(one)],
    ids=lambda step: step.place,
)
def test_a_drive_that_does_not_keep_a_limit_is_refused_by_its_object(step):
    key = (step.index, step.sub)
    bench = Bench("generic", hip={"ignore_write": {key}, "stored": {key: step.value ^ 1}})

    error = refused(bench)

    assert error.failure is BootFailure.CONFIGURATION
    assert step.place in str(error)


@pytest.mark.parametrize("make", MAKES)
def test_the_page_names_every_object_that_bring_up_writes_and_no_other(tmp_path, make):
    settings = load(configs_of(make, tmp_path) / "demo.toml")
    leg = settings.legs[0]
    page = PAGE.read_text(encoding="utf-8")
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    (head,) = (line for line in lines if line[0] == "object")
    place = head.index(NAMES[make])

    named = {line[0] for line in lines if "h:" in line[0] and line[place] == "yes"}

    for axis, described in enumerate((leg.hip, leg.slide)):
        assert {limit.place for limit in limits(settings, described, axis)} == named
