"""`gaitd torture`: some minutes of the random hour, and proof that its invariants can be broken."""

import random
import struct
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from sessions import CONFIGS

from daemon.record import Mode, ModeRequest, Outcome, RequestKind, RequestResult, StopCategory
from gaitd.random_hour.chances import Chances, Kind
from gaitd.random_hour.invariants import (
    NS_PER_S,
    PATIENCE_S,
    Watch,
)
from gaitd.random_hour.report import page, rerun, summary, told
from gaitd.random_hour.series import session, sessions
from gaitd.random_hour.tally import Broken, Tally
from gaitd.random_hour.variants import VARIANTS
from gaitd.random_hour.watched import AxisRules, WatchedDrive
from sim_drives.power_state import PowerState
from sim_drives.settings import FaultKind

MS = 1_000_000
NO_ANSWER = RequestResult()
SESSION_S = 20.0
SEEDS = range(100, 100 + len(VARIANTS))


@pytest.mark.parametrize("seed", SEEDS)
def test_random_commands_and_faults_break_no_invariant(seed):
    played = session(CONFIGS, seed, SESSION_S)

    assert not played.tally.broken, told(played.tally.broken[0])
    assert played.tally.simulated_s >= SESSION_S
    assert played.tally.cycle_count > 0.8 * SESSION_S * 100


def test_the_same_seed_is_the_same_session():
    first, second = (session(CONFIGS, 3, 8.0).tally for _ in range(2))

    assert first == second
    assert first.events


def test_sessions_take_turns_with_makes_and_guidance_and_fill_the_time():
    played = list(sessions(CONFIGS, 7, 5.0, 2.0))

    assert [one.seed for one in played] == [7, 8, 9]
    assert len({one.variant for one in played}) == 3
    assert [round(one.tally.simulated_s) for one in played] == [2, 2, 1]


# --- each invariant can be broken ---------------------------------------------------------------


class FakeDrive:
    def __init__(self) -> None:
        self.drive = SimpleNamespace(state=PowerState.SWITCH_ON_DISABLED)


def rules(axis: int, node_id: int) -> AxisRules:
    name = ("right/hip", "right/slide")[axis]
    return AxisRules(name, node_id, axis, "right", -0.3, 0.7, 0.02, 1500.0)


class Bench:
    """A watch with two drives, told frame by frame what happens."""

    def __init__(self) -> None:
        self.nodes = {5: FakeDrive(), 6: FakeDrive()}
        drives = {
            node: WatchedDrive(rules(node - 5, node), fake)  # type: ignore[arg-type]
            for node, fake in self.nodes.items()
        }
        self.watch = Watch(drives, period_s=0.01, detection_s=0.1)
        self.now_ns = NS_PER_S
        self.effort = [0.0, 0.0]
        self.position = [0.2, 0.5]
        self.patient = [0.0, 0.0]
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
            node.drive.state = state or node.drive.state
        truth = SimpleNamespace(
            effort=tuple(self.effort), position=tuple(self.position), patient=tuple(self.patient)
        )
        self.watch.see(self.now_ns, {"right": truth})  # type: ignore[dict-item]

    def enabled(self) -> "Bench":
        self.watch.asks(1, RequestKind.ENABLE, ModeRequest())
        self.both(0x000F)
        self.see(PowerState.OPERATION_ENABLED)
        assert self.broken() == []
        return self

    def record(self, mode: Mode, category=StopCategory.NONE, answer=NO_ANSWER, gap=1) -> None:
        self.seq += gap
        self.watch.hear(
            SimpleNamespace(  # type: ignore[arg-type]
                seq=self.seq,
                mode=mode,
                verdict=SimpleNamespace(category=category),
                request=answer,
            )
        )

    def broken(self) -> list[str]:
        return [violation.rule for violation in self.watch.violations]


@pytest.fixture
def bench() -> Iterator[Bench]:
    yield Bench()


def test_an_enabling_controlword_that_nobody_asked_for_is_found(bench):
    bench.tell(5, 0x000F)
    assert bench.broken() == ["enables unasked"]


def test_enabling_again_after_a_stop_needs_reset_and_enable(bench):
    bench.enabled().both(0x000B)
    bench.watch.asks(2, RequestKind.ENABLE, ModeRequest())
    bench.tell(5, 0x000F)

    assert bench.broken() == ["enables unasked"]


def test_reset_and_enable_make_it_well(bench):
    bench.enabled().both(0x000B)
    bench.watch.asks(2, RequestKind.RESET, ModeRequest())
    bench.watch.asks(3, RequestKind.ENABLE, ModeRequest())
    bench.both(0x000F)

    assert bench.broken() == []


def test_enabling_after_the_core_was_killed_is_found(bench):
    bench.enabled().watch.core_gone()
    bench.both(0x000F)

    assert set(bench.broken()) == {"enables unasked"}


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


def test_axes_that_do_not_stop_between_the_same_two_syncs_are_found(bench):
    bench.enabled().tell(5, 0x000B)
    bench.sync()
    assert bench.broken() == ["stops apart"]


def test_axes_that_stop_in_the_same_cycle_are_well(bench):
    bench.enabled().tell(5, 0x000B)
    bench.watch.sent(bench.now_ns, 0x000, bytes((0x02, 6)))
    bench.sync()
    assert bench.broken() == []


def test_a_joint_beyond_its_limit_is_found_when_the_drives_could_have_held_it(bench):
    bench.enabled()
    bench.now_ns += 4 * NS_PER_S
    bench.sync()
    bench.position[0] = 0.75
    bench.see()
    assert bench.broken() == ["beyond the limit"]


@pytest.mark.parametrize("excuse", ["pushed", "free", "blind"])
def test_what_no_drive_could_have_held_is_no_violation(bench, excuse):
    bench.enabled()
    bench.now_ns += 4 * NS_PER_S
    bench.sync()
    bench.position[0] = 0.75
    if excuse == "pushed":
        bench.patient[0] = 5.0
    elif excuse == "free":
        bench.nodes[6].drive.state = PowerState.SWITCH_ON_DISABLED
    else:
        bench.watch.injects(FaultKind.FROZEN_ENCODER, "right/slide", bench.now_ns)
    bench.see()
    assert bench.broken() == []


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


def test_a_fault_that_is_left_without_reset_is_found(bench):
    bench.record(Mode.FAULT, StopCategory.S1)
    bench.record(Mode.OFF)
    assert bench.broken() == ["verdict milder"]


def test_a_missing_record_is_found(bench):
    bench.record(Mode.READY)
    bench.record(Mode.READY, gap=2)
    assert bench.broken() == ["records"]


def test_a_request_that_is_answered_twice_is_found(bench):
    bench.watch.asks(1, RequestKind.RESET, ModeRequest())
    bench.record(Mode.READY, answer=RequestResult(1, Outcome.DONE))
    bench.record(Mode.READY, answer=RequestResult(1, Outcome.REFUSED))
    assert bench.broken() == ["answers"]


def test_a_request_that_is_never_answered_is_found(bench):
    bench.watch.asks(1, RequestKind.RESET, ModeRequest())
    for _ in range(round(PATIENCE_S) + 1):
        bench.watch.waits(1.0, 1)
    assert bench.broken() == ["answers"]


# --- what is told -------------------------------------------------------------------------------


def test_a_violation_is_told_with_its_last_seconds_and_the_command_to_see_it_again(bench):
    bench.tell(5, 0x000F)
    broken = Broken(bench.watch.violations[0], 41, "EPOS4, position", 90.0, ("one", "two"))

    assert rerun(broken) == "gaitd torture --seed 41 --minutes 1.5"
    for text in ("seed 41", "enables unasked", "one", "two", rerun(broken)):
        assert text in told(broken)
    assert "Violations: **1**" in page(Tally(broken=[broken]), "gaitd torture")
    assert "violations: 1" in summary(Tally(broken=[broken]))


def test_every_kind_of_event_has_been_drawn_within_an_hour_of_dice():
    chances = Chances(random.Random(1), ("right/hip",), ("passive",), ("paper",), 0.5)
    drawn = [chances.next(Mode.GAIT) for _ in range(3000)]

    assert {action.kind for action in drawn} == set(Kind)
    assert {action.fault.kind for action in drawn if action.fault} == set(FaultKind)
    assert {action.wanted.mode for action in drawn} >= set(Mode)
