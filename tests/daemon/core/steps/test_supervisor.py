"""Verdicts, requests and setpoints applied to the state of a core that has no bus."""

import math
from dataclasses import replace

import pytest
from safety_inputs import FEEDBACK, JOINT
from sessions import CONFIGS

from daemon.core.inputs import NO_INPUTS, CommandInputs
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.runtime.build import build
from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Core
from daemon.core.steps import controllers, exercises, impedance, supervisor, wanted
from daemon.ipc.record import (
    Cause,
    Mode,
    Outcome,
    Request,
    RequestKind,
    Setpoint,
    StopCategory,
    Verdict,
)
from daemon.preflight.load import load
from drives.signals import PowerRequest, PowerState

SETTINGS = load(CONFIGS / "demo.toml")
AT_REST = JOINT._replace(position_si=0.2, velocity_si=0.0, effort_si=0.0)
OPENED = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip")
JUMPED = Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/hip")
MANY_CYCLES = 400
"""Longer than any stop takes."""
FIRST_LEASE, NEXT_LEASE = 7, 8


class Bench:
    """A core that holds its leg; its drives show what a test says."""

    def __init__(self) -> None:
        self.core: Core = build(SETTINGS, "test", PersistentState()).core
        self.core.mode, self.core.load_checked = Mode.HOLD, True
        self.cycle, self._request_id = 100, 0
        self.show(PowerState.OPERATION_ENABLED)
        for axis in self.core.axes:
            axis.referenced = axis.reached_enabled = True
        exercises.hold_here(self.core)

    def show(self, state: PowerState, velocity_si: float = 0.0) -> None:
        for axis in self.core.axes:
            axis.feedback = replace(FEEDBACK, node_id=axis.node_id, power_state=state)
            axis.joint = AT_REST._replace(velocity_si=velocity_si)

    def turn(self, *verdicts: Verdict, command_inputs: CommandInputs = NO_INPUTS) -> None:
        self.cycle += 1
        self.core.gateway_state_cycle = self.cycle
        supervisor.supervise(self.core, verdicts, command_inputs, self.cycle, 0)

    def ask(self, kind: RequestKind) -> Outcome:
        self._request_id += 1
        self.turn(command_inputs=CommandInputs(request=Request(self._request_id, kind, self.cycle)))
        return self.core.result.outcome

    def until_stopped(self) -> Mode:
        for _ in range(MANY_CYCLES):
            if self.core.mode != Mode.STOPPING:
                break
            self.turn()
        return self.core.mode

    def steps(self) -> list[Step]:
        return [axis.stop.step for axis in self.core.axes if axis.stop is not None]


@pytest.fixture
def bench() -> Bench:
    return Bench()


# --- verdicts while the drives are let go on request ----------------------------------------------


def test_a_disable_ends_in_ready_and_latches_nothing(bench):
    bench.ask(RequestKind.DISABLE)

    assert bench.until_stopped() == Mode.READY
    assert bench.core.persistent.latched is None
    assert bench.steps() == []


def test_a_verdict_while_disabling_is_latched_and_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.turn(OPENED)
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT
    assert bench.core.verdict == OPENED
    assert bench.core.persistent.latched.cause == Cause.HAND_SWITCH_OPEN.name


def test_a_stop_after_an_earlier_disable_is_latched_and_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.until_stopped()
    bench.show(PowerState.SWITCH_ON_DISABLED)
    bench.turn()
    bench.ask(RequestKind.ENABLE)
    assert bench.core.mode == Mode.HOLD
    bench.turn(OPENED)
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT


def test_a_disable_that_is_not_obeyed_ends_in_fault(bench):
    bench.ask(RequestKind.DISABLE)
    bench.show(PowerState.OPERATION_ENABLED, velocity_si=1.0)
    for _ in range(MANY_CYCLES):
        if Step.HOLD not in bench.steps():
            break
        bench.turn()
    bench.show(PowerState.QUICK_STOP_ACTIVE)

    assert bench.until_stopped() == Mode.FAULT
    assert bench.core.verdict.cause == Cause.STOP_NOT_OBEYED


# --- after a stop ---------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [Step.HOLD, Step.QUICK_STOP])
def test_a_stop_that_holds_under_power_is_judged_and_taken_further(bench, step):
    category = StopCategory.S2 if step is Step.HOLD else StopCategory.S1
    bench.turn(Verdict(category, Cause.STOP_REQUESTED))
    if step is Step.QUICK_STOP:
        bench.show(PowerState.QUICK_STOP_ACTIVE)
    assert bench.until_stopped() == Mode.FAULT
    assert bench.steps() == [step, step]

    bench.turn(JUMPED)

    assert wanted.is_driving(bench.core)
    assert bench.core.verdict == JUMPED
    assert bench.steps() == [Step.DISABLE, Step.QUICK_STOP]


def test_power_off_is_one_step_and_never_a_milder_one(bench):
    hip, slide = bench.core.axes
    bench.turn(OPENED)
    slide.stop = slide.stop._replace(step=Step.NMT_STOP)

    supervisor.power_off(bench.core, 200)
    first = hip.stop, slide.stop
    supervisor.power_off(bench.core, 201)

    assert (hip.stop, slide.stop) == first
    assert (hip.stop.step, hip.stop.since_cycle) == (Step.DISABLE, 200)
    assert slide.stop.step == Step.NMT_STOP


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_a_quick_stop_without_torque(bench, number):
    for axis in bench.core.axes:
        axis.effort_sent_si, axis.position_sent_si = 10.0, 0.2
    bench.turn()
    leg = bench.core.legs[0]
    leg.reference = leg.reference._replace(feedforward=(number, 0.0))

    commands = impedance.command(bench.core, bench.cycle)

    assert bench.core.verdict.cause == Cause.COMMAND_NOT_FINITE
    assert [one.power for one in commands] == [PowerRequest.QUICK_STOP] * 2
    assert [one.target_torque_permille for one in commands] == [0, 0]
    assert [axis.effort_sent_si for axis in bench.core.axes] == [0.0, 0.0]
    assert [axis.position_sent_si for axis in bench.core.axes] == [0.2, 0.2]


# --- assist ---------------------------------------------------------------------------------------


def test_assist_in_force_is_not_taken_over_by_the_next_holder_of_the_lease(bench):
    core, leg = bench.core, bench.core.legs[0]
    core.mode = Mode.TORQUE
    leg.assist = replace(leg.assist, lease=FIRST_LEASE, effort_si=(5.0, 0.0))
    core.lease = NEXT_LEASE
    core.setpoints = (Setpoint(lease=NEXT_LEASE, seq=1, for_cycle=99, leg="right"),)

    controllers.receive(core, 100)

    assert leg.assist.accepted is None
    assert core.setpoint_accepted_count == 0

    leg.assist = replace(leg.assist, effort_si=(0.0, 0.0))
    controllers.receive(core, 101)

    assert leg.assist.accepted == core.setpoints[0]


def test_where_nothing_is_in_force_the_next_holder_is_heard_at_once(bench):
    core, leg = bench.core, bench.core.legs[0]
    core.mode, core.lease = Mode.TORQUE, NEXT_LEASE
    leg.assist = replace(leg.assist, lease=FIRST_LEASE)
    core.setpoints = (Setpoint(lease=NEXT_LEASE, seq=1, for_cycle=99, leg="right"),)

    controllers.receive(core, 100)

    assert leg.assist.accepted == core.setpoints[0]
