"""All limits that a drive can hold are in it: read by python-canopen, which is not ours."""

from pathlib import Path

import canopen
import pytest
from bringup_bench import Bench, refused
from drive_files import CYCLE, HIP_LIMITS, drive
from sessions import CONFIGS, elmo_drives, generic_drives, new_session

from daemon.preflight.load import load
from drives.bringup.plan import plan
from drives.bringup.steps import StepKind
from drives.canopen.frame import Frame
from drives.errors import BootFailure
from gaitd_lab.backstop_page import COMMUNICATION, WRITES, page, rows, source_of

MS = 1_000_000
PAGE = Path(__file__).parents[2] / "docs" / "backstop.md"
MAKES = {"epos4": None, "generic": generic_drives, "elmo": elmo_drives}
NAMES = {"epos4": "EPOS4", "generic": "CiA 402", "elmo": "Elmo Gold"}
EDS = {"epos4": "epos4", "generic": "generic402", "elmo": "elmo_gold"}
MUST_HOLD = {0x1016, 0x1029, 0x6007, 0x605A, 0x605B, 0x605C, 0x605E, 0x6065, 0x6066, 0x607D, 0x6085}
"""Objects of every make; beside them the torque limit, and what only some have."""


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
        expected = rows(session.settings, described, axis)
        assert {row.index for row in expected} >= MUST_HOLD
        for row in expected:
            value, size = held(node, row)
            assert value == row.value % (1 << 8 * size), row


@pytest.mark.parametrize("make", MAKES)
def test_a_drive_notices_silence_within_a_tenth_of_a_second(tmp_path, make):
    settings = load(configs_of(make, tmp_path) / "demo.toml")
    leg = settings.legs[0]

    for axis, described in enumerate((leg.hip, leg.slide)):
        watch = {(row.index, row.sub): row.value for row in rows(settings, described, axis)}[
            0x1016, 1
        ]
        assert watch >> 16 == settings.trainer.cycle.master_node_id
        assert 0 < watch & 0xFFFF <= 100


@pytest.mark.parametrize("kind", ["epos4", "generic", "elmo"])
def test_whatever_bring_up_writes_is_a_limit_or_communication(kind):
    described = drive(f"hip_{kind}")

    for step in plan(described, HIP_LIMITS, CYCLE).steps:
        if step.kind in WRITES:
            known = source_of(step, described.profile.torque_limit) is not None
            assert known or step.index in COMMUNICATION, str(step)


def limit_steps(kind):
    described = drive(f"hip_{kind}")
    return [
        step
        for step in plan(described, HIP_LIMITS, CYCLE).steps
        if source_of(step, described.profile.torque_limit) is not None
    ]


@pytest.mark.parametrize(
    ("kind", "step"),
    [
        pytest.param(kind, step, id=f"{kind}-{step.place}")
        for kind in ("epos4", "generic", "elmo")
        for step in limit_steps(kind)
    ],
)
def test_a_drive_that_does_not_keep_a_limit_is_refused_by_its_object(kind, step):
    key = (step.index, step.sub)
    bench = Bench(kind, hip={"ignore_write": {key}, "stored": {key: step.value ^ 1}})

    error = refused(bench)

    assert error.failure is BootFailure.CONFIGURATION
    assert step.place in str(error)


def test_the_page_of_the_docs_is_what_bring_up_does(tmp_path, request):
    makes = {NAMES[make]: load(configs_of(make, tmp_path / make) / "demo.toml") for make in MAKES}
    written = page(makes)
    if request.config.getoption("--write-traces"):
        PAGE.write_text(written, encoding="utf-8")

    assert PAGE.read_text(encoding="utf-8") == written, "`make golden` writes it anew"
    assert StepKind.WRITE in WRITES
