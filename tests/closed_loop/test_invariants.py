"""Each invariant of the random sessions can be broken; the sessions show that order breaks none."""

import math
import struct
from collections.abc import Iterator
from types import SimpleNamespace

import msgspec
import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind, StopCategory

from daemon.ipc.record import (
    AxisRecord,
    AxisSetpoint,
    GatewayState,
    LegRecord,
    ModeRequest,
    Request,
    RequestResult,
    Setpoint,
)
from gaitd_lab.random_sessions.assisted import AssistBounds, AssistWatch
from gaitd_lab.random_sessions.invariants import NS_PER_S, TIMEOUT_S, Watch
from gaitd_lab.random_sessions.stops import StopWatch
from gaitd_lab.random_sessions.watched_drive import AxisRules, WatchedDrive
from sim_drives.cia402.power_state import PowerState

MS = 1_000_000
NO_ANSWER = RequestResult()
BOUNDS = AssistBounds((20.0, 150.0), age_max_cycles=10, fade_cycles=20, first_cycles=50)
AT_REST = (0.2, 0.5)
"""rad, m: nothing has to be held here."""


class FakeDrive:
    def __init__(self) -> None:
        self.drive = SimpleNamespace(state=PowerState.SWITCH_ON_DISABLED)


def rules(axis: int, node_id: int) -> AxisRules:
    name = ("right/hip", "right/slide")[axis]
    return AxisRules(name, node_id, axis, "right", -0.3, 0.7, 0.02, 1500.0, 20.0)


class Bench:
    """A watch with two drives, told frame by frame what happens."""

    def __init__(self) -> None:
        self.nodes = {5: FakeDrive(), 6: FakeDrive()}
        drives = {
            node: WatchedDrive(rules(node - 5, node), fake)  # type: ignore[arg-type]
            for node, fake in self.nodes.items()
        }
        assist = AssistWatch(BOUNDS)
        self.watch = Watch(
            drives,
            period_s=0.01,
            detection_s=0.1,
            load_of=lambda position: (100.0 * (position[0] - AT_REST[0]), 0.0),
            assist=assist,
            stops=StopWatch(0.3),
        )
        self.now_ns = NS_PER_S
        self.effort = [0.0, 0.0]
        self.position = list(AT_REST)
        self.patient = [0.0, 0.0]
        self.velocity = [0.0, 0.0]
        self.seq = 0
        self.sync()

    def sync(self, after_ms: int = 10) -> None:
        self.now_ns += after_ms * MS
        self.watch.sent(self.now_ns, 0x080, b"")

    def tell(self, node: int, controlword: int, torque: int = 0, mode: int = 10) -> None:
        self.watch.sent(self.now_ns, 0x200 + node, struct.pack("<Hbi", controlword, mode, 0))
        self.watch.sent(self.now_ns, 0x300 + node, struct.pack("<h", torque))

    def both(self, controlword: int, torque: int = 0) -> None:
        self.tell(5, controlword, torque)
        self.tell(6, controlword, torque)

    def see(self, state: PowerState | None = None, after_s: float = 0.0) -> None:
        self.now_ns += round(after_s * NS_PER_S)
        for node in self.nodes.values():
            node.drive.state = node.drive.state if state is None else state
        truth = SimpleNamespace(
            effort=tuple(self.effort),
            position=tuple(self.position),
            velocity=tuple(self.velocity),
            patient=tuple(self.patient),
        )
        self.watch.check_truth(self.now_ns, {"right": truth})  # type: ignore[dict-item]

    def enabled(self) -> "Bench":
        self.watch.request_sent(1, RequestKind.ENABLE, ModeRequest())
        self.both(0x000F)
        self.see(PowerState.OPERATION_ENABLED)
        assert self.broken() == []
        return self

    def record(
        self,
        mode: Mode,
        category=StopCategory.NONE,
        answer=NO_ANSWER,
        gap=1,
        cause=Cause.NONE,
        assist=(0.0, 0.0),
    ) -> None:
        self.seq += gap
        self.watch.receive(
            SimpleNamespace(  # type: ignore[arg-type]
                seq=self.seq,
                cycle=self.seq,
                mode=mode,
                verdict=SimpleNamespace(category=category, cause=cause),
                request=answer,
                legs=(LegRecord("right", *(AxisRecord(0.0, 0.0, 0.0, one) for one in assist), 0),),
            )
        )

    def level(self, lease: int = 1, **changed: float) -> None:
        """The gateway forwards a setpoint for the newest cycle."""
        good = Setpoint(
            lease=1, seq=self.seq, for_cycle=self.seq, hip=AxisSetpoint(5.0), leg="right"
        )
        setpoint = msgspec.structs.replace(good, **changed)
        self.watch.gateway_state_sent(
            GatewayState("boot", self.seq, self.seq, 0, Request(), (setpoint,), lease)
        )

    def assisted(self, count: int, mode=Mode.GAIT, **changed: float) -> None:
        """Cycles with assist in force, and a setpoint before each."""
        for _ in range(count):
            self.level(**changed)
            self.record(mode, assist=(5.0, 0.0))

    def broken(self) -> list[str]:
        return [violation.rule for violation in self.watch.violations]


@pytest.fixture
def bench() -> Iterator[Bench]:
    yield Bench()


def test_an_enabling_controlword_without_a_request_is_found(bench):
    bench.tell(5, 0x000F)
    assert bench.broken() == ["enables unasked"]


def test_enabling_after_the_core_was_killed_is_found(bench):
    bench.enabled().watch.core_ended()
    bench.both(0x000F)

    assert set(bench.broken()) == {"enables unasked"}


def test_a_new_core_that_forgets_what_was_latched_is_found(bench):
    bench.record(Mode.FAULT, StopCategory.S1, cause=Cause.SPASM)
    bench.watch.core_ended()
    bench.record(Mode.OFF)
    assert bench.broken() == []
    bench.record(Mode.READY)
    assert bench.broken() == ["verdict milder"]


# Setpoints that count for nothing, as the watch judges them.
@pytest.mark.parametrize(
    "changed",
    [
        {"lease": 0},
        {"seq": 3},
        {"for_cycle": 3},
        {"hip": AxisSetpoint(math.nan)},
        {"slide": AxisSetpoint(150.1)},
        {"stiffness_ratio": 1.1},
        {"for_cycle": 10**6},
    ],
)
def test_assist_that_outlives_its_last_good_setpoint_is_found(bench, changed):
    bench.assisted(40)
    bench.assisted(20, **changed)
    assert bench.broken() == []
    bench.assisted(13, **changed)
    assert set(bench.broken()) == {"assist outlives its lease"}


@pytest.mark.parametrize("assist", [(20.1, 0.0), (0.0, -150.1), (math.nan, 0.0)])
def test_assist_beyond_its_limit_is_found(bench, assist):
    bench.assisted(3)
    bench.level()
    bench.record(Mode.GAIT, assist=assist)
    assert "assist beyond its limit" in bench.broken()


def test_a_drive_that_is_enabled_by_itself_is_found(bench):
    bench.see(PowerState.OPERATION_ENABLED)
    assert set(bench.broken()) == {"powered unasked"}


def test_torque_without_power_is_found(bench):
    bench.effort = [2.0, 0.0]
    bench.see()
    assert bench.broken() == ["torque without power"]


def test_a_drive_that_stays_enabled_in_silence_is_found(bench):
    bench.enabled().see(after_s=0.11)
    assert bench.broken() == []
    bench.see(after_s=0.02)
    assert set(bench.broken()) == {"left enabled in silence"}


@pytest.mark.parametrize(("stopped", "left"), [(5, 6), (6, 5)])
def test_one_axis_stopped_while_the_other_goes_on_is_found_whichever_is_told_first(
    bench, stopped, left
):
    bench.enabled()
    for node in (5, 6):
        bench.tell(node, 0x000F if node == left else 0x000B)
    bench.sync()
    assert bench.broken() == ["stops apart"]


@pytest.mark.parametrize(("cycles", "found"), [(3, []), (4, ["stop not done"])])
def test_a_stop_that_is_not_done_is_found(bench, cycles, found):
    bench.enabled().record(Mode.GAIT)
    bench.watch.requests_stop()
    for _ in range(cycles):
        bench.record(Mode.GAIT)
    bench.record(Mode.STOPPING, StopCategory.S2, cause=Cause.STOP_REQUESTED)
    assert bench.broken() == found


@pytest.mark.parametrize(("after_s", "found"), [(0.29, []), (0.31, ["enabled still"] * 2)])
def test_a_drive_that_never_obeys_its_last_word_is_found_once(bench, after_s, found):
    bench.enabled().both(0x000B)
    for _ in range(round(after_s / 0.01)):
        bench.sync()
    bench.see()
    bench.see(after_s=0.01 if found else 0.0)
    assert bench.broken() == found


def test_a_joint_beyond_its_limit_is_found_when_the_drives_could_have_held_it(bench):
    bench.enabled()
    bench.now_ns += 4 * NS_PER_S
    bench.sync()
    bench.position[0] = 0.75
    bench.see()
    assert bench.broken() == ["beyond the limit"]


@pytest.mark.parametrize(("torque", "found"), [(1000, []), (-1000, []), (0, ["torque jumps"])])
def test_a_first_torque_far_from_what_holds_the_leg_is_found(bench, torque, found):
    bench.position[0] = 0.4  # 20 N·m, 1000 counts
    bench.see()
    bench.watch.request_sent(1, RequestKind.ENABLE, ModeRequest())
    bench.tell(5, 0x000F, torque=torque)

    assert bench.broken() == found


def test_the_first_torque_behind_a_position_mode_is_not_one_of_a_drive_that_begins(bench):
    bench.position[0] = 0.4
    bench.see()
    bench.watch.request_sent(1, RequestKind.ENABLE, ModeRequest())
    bench.tell(5, 0x000F, mode=8)
    bench.tell(5, 0x000F, mode=10)

    assert bench.broken() == []


def test_a_stop_and_a_request_in_the_same_cycle_allow_nothing(bench):
    bench.watch.request_sent(1, RequestKind.ENABLE, ModeRequest())
    bench.watch.requests_stop()
    bench.tell(5, 0x000F)

    assert bench.broken() == ["enables unasked"]


def test_a_jump_of_the_commanded_torque_is_found(bench):
    bench.enabled()
    bench.sync()
    bench.both(0x000F, 700)  # 14 N m, of 15 that are allowed
    assert bench.broken() == []
    bench.sync()
    bench.tell(5, 0x000F, -100)
    assert bench.broken() == ["torque jumps"]


def test_a_verdict_that_becomes_milder_is_found(bench):
    bench.record(Mode.STOPPING, StopCategory.S1)
    bench.record(Mode.FAULT, StopCategory.S2)
    assert bench.broken() == ["verdict milder"]


def test_a_missing_record_is_found(bench):
    bench.record(Mode.READY)
    bench.record(Mode.READY, gap=2)
    assert bench.broken() == ["records"]


def test_a_request_that_is_answered_twice_is_found(bench):
    bench.watch.request_sent(1, RequestKind.RESET, ModeRequest())
    bench.record(Mode.READY, answer=RequestResult(1, Outcome.DONE))
    bench.record(Mode.READY, answer=RequestResult(1, Outcome.REFUSED))
    assert bench.broken() == ["answers"]


def test_a_request_that_is_never_answered_is_found(bench):
    bench.watch.request_sent(1, RequestKind.RESET, ModeRequest())
    for _ in range(round(TIMEOUT_S) + 1):
        bench.watch.waits(1.0, 1)
    assert bench.broken() == ["answers"]
