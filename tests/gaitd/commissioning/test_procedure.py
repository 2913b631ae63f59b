"""The procedure by itself: what comes out of a state and an observation."""

import math

import msgspec
import pytest
from gaitd_client import Mode, wire
from gaitd_names import Cause, RefusalCode, StopCategory, Untested
from records import record as cycle_record

from analysis.acceptance.record import (
    Finding,
    FindingCode,
    Judgement,
    Reason,
    ReasonCode,
    Section,
    Service,
    StopTrace,
)
from daemon.ipc.record import Verdict
from daemon.ipc.report import Refusal
from daemon.report_messages import judgement, refusal_message
from gaitd.commissioning import stages
from gaitd.commissioning.measures import position_findings
from gaitd.commissioning.messages import (
    Answer,
    Instruction,
    InstructionCode,
    Observation,
    Request,
)
from gaitd.commissioning.objects import unread
from gaitd.commissioning.procedure import BEGIN, STEP_MAX_S, Task, interrupted, is_over, step
from gaitd.commissioning.run import Run
from gaitd.commissioning.stops import STOPS, StopRules, judge

HIP = "right/hip"
MISSING = Finding(HIP, Section.SIGN, FindingCode.STEP, Judgement.NOT_MEASURED)
GAIT = {"mode": Mode.GAIT}
OPEN = Refusal(RefusalCode.HAND_SWITCH_OPEN)
PRESS = Refusal(RefusalCode.INPUT_UNTESTED, HIP, (Untested.STO_ACTIVE,))
FAULT = Verdict(StopCategory.S1, Cause.DRIVE_FAULT, HIP)
REQUESTED = Verdict(StopCategory.S2, Cause.STOP_REQUESTED)


def reply(refusal=None, name="mode"):
    return wire.Reply(
        **{"seq": 1, "core_boot_id": None, "cycle": None, "sample_time_ns": None, "mode": None},
        request=name,
        outcome="refused" if refusal else "done",
        refusal=refusal and refusal_message(refusal),
    )


def at(now_s=0.0, mode=Mode.READY, verdict=REQUESTED, **more):
    told = judgement(verdict if mode == Mode.FAULT else Verdict())
    return Observation(now_s, Service(mode, told), **more)


def record(seq, mode=Mode.READY, *, sto_released=True):
    made = cycle_record(seq)
    drives = tuple(
        msgspec.structs.replace(drive, sto_released=sto_released) for drive in made.drives
    )
    verdict = FAULT if mode is Mode.FAULT else Verdict()
    return msgspec.structs.replace(made, mode=mode, drives=drives, verdict=verdict)


def task(*some, **more):
    return Task(some, Section.SIGN, axes=(HIP,), **more)


def played(one, *observations, state=BEGIN):
    """State and all outputs after a task's stages have had these observations."""
    outputs = ()
    for seen in observations:
        state, new = step((one,), state, seen)
        outputs += new
    return state, outputs


def findings(outputs):
    return [one for one in outputs if isinstance(one, Finding)]


@pytest.mark.parametrize(
    ("stage", "seen", "why", "blocks"),
    [
        (stages.READY, at(31, Mode.OFF), ReasonCode.NO_MODE, True),
        (stages.AGREED, at(answer=Answer(False)), ReasonCode.NOT_CONFIRMED, False),
        (stages.REQUESTED, at(reply=reply(OPEN)), ReasonCode.REFUSED, False),
        (stages.ENTERED, at(mode=Mode.FAULT), ReasonCode.NO_MODE, True),
        (stages.ENTERED, at(31), ReasonCode.NO_MODE, False),
        (stages.ENTERED, at(is_silent=True), ReasonCode.NO_MODE, False),
        (stages.RUN, at(STEP_MAX_S, Mode.GAIT), ReasonCode.NOT_IN_TIME, False),
        (stages.HELD, at(mode=Mode.FAULT), ReasonCode.NO_MODE, True),
        (stages.STEADY, at(1), ReasonCode.NO_MODE, True),
        (stages.SETTLED, at(mode=Mode.FAULT), ReasonCode.NO_MODE, True),
        (stages.LATCHED, at(mode=Mode.FAULT), ReasonCode.STOPPED, True),
        (stages.LATCHED, at(mode=Mode.GAIT), ReasonCode.NO_MODE, True),
        (stages.ENABLED, at(mode=Mode.FAULT), ReasonCode.STOPPED, True),
        (stages.ENABLED, at(mode=Mode.OFF), ReasonCode.NO_MODE, True),
        (stages.MARK, at(answer=Answer(None)), ReasonCode.NOT_CONFIRMED, False),
        (stages.SAMPLED, at(0.1), ReasonCode.NO_SAMPLE, False),
        (stages.DISTANCE, at(answer=Answer(0.0)), ReasonCode.NOT_CONFIRMED, False),
        (stages.DISTANCE, at(answer=Answer(math.nan)), ReasonCode.NOT_CONFIRMED, False),
        (stages.WALKING, at(mode=Mode.HOLD), ReasonCode.NO_MODE, True),
        (stages.WALKING, at(60, Mode.GAIT), ReasonCode.NO_MODE, True),
        (stages.FAST, at(mode=Mode.STOPPING), ReasonCode.NO_MODE, True),
        (stages.STOPPED, at(reply=reply(OPEN, "stop")), ReasonCode.REFUSED, True),
        (stages.STOPPED, at(STEP_MAX_S, Mode.GAIT), ReasonCode.NO_STOP, True),
    ],
)
def test_a_step_that_cannot_be_done_is_a_finding_and_one_that_has_failed_blocks(
    stage, seen, why, blocks
):
    asked = Instruction(InstructionCode.HOME_AXIS)
    one = task(stage, announced=asked, request=Request("mode", GAIT))

    state, outputs = played(one, at(), seen)

    assert is_over((one,), state)
    (finding,) = findings(outputs)
    assert finding.judgement is (Judgement.FAILED if blocks else Judgement.NOT_MEASURED)
    assert finding.reason.code is why
    assert state.blocked == (finding.reason if blocks else None)


def test_what_follows_a_failure_is_not_tried_and_the_machine_is_stopped():
    last = Task((stages.LEFT,), is_always_done=True)
    tasks = (task(stages.HELD), task(stages.REQUESTED), last)
    state, _ = step(tasks, BEGIN, at())

    state, outputs = step(tasks, state, at(mode=Mode.FAULT))
    assert findings(outputs)[1] == msgspec.structs.replace(MISSING, reason=state.blocked)
    assert Request("stop") not in outputs
    state, outputs = step(tasks, state, at(mode=Mode.FAULT))

    assert [one.code for one in outputs] == [InstructionCode.LEFT_STOPPED]
    assert is_over(tasks, state)


@pytest.mark.parametrize(
    ("seen", "told"),
    [
        ((at(1, Mode.FAULT),), [InstructionCode.LEFT_STOPPED]),
        ((at(1, Mode.STOPPING), at(2, Mode.OFF)), []),
        ((at(11, Mode.GAIT),), [InstructionCode.MAY_NOT_HAVE_STOPPED]),
    ],
)
def test_a_procedure_that_ends_in_motion_asks_for_a_stop(seen, told):
    last = Task((stages.LEFT,), is_always_done=True)

    state, outputs = played(last, at(mode=Mode.GAIT), *seen)

    assert outputs[0] == Request("stop")
    assert [one.code for one in outputs[1:]] == told
    assert is_over((last,), state)


def test_a_machine_that_moves_without_a_service_to_ask_is_told():
    last = Task((stages.LEFT,), is_always_done=True)
    alone = BEGIN._replace(blocked=Reason(ReasonCode.NO_SERVICE))

    _, outputs = played(last, at(mode=Mode.HOLD), at(11, Mode.HOLD), state=alone)

    assert [one.code for one in outputs] == [InstructionCode.MAY_NOT_HAVE_STOPPED]


@pytest.mark.parametrize(
    ("value", "judged", "why"),
    [(None, Judgement.NOT_MEASURED, None), (False, Judgement.FAILED, ReasonCode.MOVED_OPPOSITE)],
)
def test_a_sign_that_was_not_seen_is_not_proven_and_one_seen_to_be_wrong_blocks(value, judged, why):
    one = task(stages.SEEN, stages.CONFIRMED)

    state, outputs = played(one, at(), at(answer=Answer(value)))

    (finding,) = findings(outputs)
    assert (finding.code, finding.judgement) == (FindingCode.DIRECTION, judged)
    assert (state.blocked and state.blocked.code) is why


def test_a_motion_that_was_seen_is_confirmed_to_the_service():
    asked = {"mode": Mode.COMMISSION, "axis": HIP}
    one = task(stages.SEEN, stages.CONFIRMED, request=Request("mode", asked))

    _, outputs = played(one, at(), at(answer=Answer(True)), at(reply=reply()))

    assert outputs[0] == Instruction(InstructionCode.WAS_SEEN, HIP)
    assert outputs[1] == Request("mode", {**asked, "witnessed": True})
    assert outputs[2].judgement is Judgement.PASSED


def test_a_failed_finding_ends_a_sign_test_before_the_operator_is_asked():
    bad = msgspec.structs.replace(MISSING, judgement=Judgement.FAILED)
    one = task(stages.JUDGED, stages.SEEN, stages.CONFIRMED, judge=lambda _: (bad,))

    state, outputs = played(one, at(), at(), at())

    assert outputs == (bad,)
    assert state.blocked == Reason(ReasonCode.FAILED_BEFORE, HIP, {"section": "sign"})


def test_a_self_test_that_ends_in_a_stop_blocks_whatever_it_has_found():
    state, _ = played(task(stages.UNSTOPPED), at(), at(mode=Mode.FAULT))

    assert state.blocked.code is ReasonCode.STOPPED


@pytest.mark.parametrize("referenced", [True, False])
def test_an_axis_whose_position_is_valid_is_not_moved(referenced):
    made = record(1)
    drives = tuple(msgspec.structs.replace(one, referenced=referenced) for one in made.drives)
    seen = at(records=(msgspec.structs.replace(made, drives=drives),))
    asked = Instruction(InstructionCode.HOME_AXIS, HIP)
    one = task(*stages.POSITION, announced=asked, judge=position_findings)

    state, outputs = played(one, seen, seen, seen)

    assert is_over((one,), state) == referenced
    if referenced:
        assert [found.judgement for found in outputs] == [Judgement.PASSED]
    else:
        assert outputs == (asked,)


def test_objects_that_cannot_be_read_block():
    one = task(stages.OBJECTS)

    state, outputs = played(one, at(), at(objects=unread(HIP, "no answer")))

    assert findings(outputs)[0].judgement is Judgement.NOT_MEASURED
    assert state.blocked.code is ReasonCode.UNREAD


@pytest.mark.parametrize(
    ("some", "measured", "asks"),
    [
        (stages.STOP_IN_GAIT, "stop_requested", [Request("reset")]),
        (stages.STOP_IN_GAIT, "hand_switch_open", []),
        (stages.DAILY_TEST, "stop_requested", []),
    ],
)
def test_a_latched_stop_is_reset_only_if_it_is_the_one_that_was_measured(some, measured, asks):
    one = task(*some[some.index(stages.LATCHED) :])
    stopped = [at(mode=Mode.FAULT)] * 2

    state, outputs = played(one, *stopped, state=BEGIN._replace(measured=measured))

    assert [one for one in outputs if isinstance(one, Request)] == asks
    assert (state.blocked is None) == bool(asks)


@pytest.mark.parametrize(
    ("records", "resets"),
    [
        ((record(2, sto_released=False), record(3, Mode.FAULT)), True),
        ((record(2), record(3, Mode.FAULT)), False),
        ((record(2, Mode.HOLD, sto_released=False), record(3, Mode.FAULT)), False),
    ],
    ids=["pressed without power", "not pressed", "pressed in motion"],
)
def test_the_fault_of_an_emergency_stop_pressed_without_power_is_reset(records, resets):
    one = task(stages.RESET, stages.CLEARED, stages.ENABLED)
    begun = BEGIN._replace(stage=2, began_s=0.0, began_seq=1)

    state, outputs = played(one, at(mode=Mode.FAULT, verdict=FAULT, records=records), state=begun)

    assert (Request("reset") in outputs) == resets
    assert (state.blocked is None) == resets


def test_a_refused_enable_is_repeated_and_its_reason_is_shown_once_until_time_is_up():
    one, refused = task(stages.ENABLED), reply(OPEN, "enable")
    state, outputs = played(one, at(), at(0.1, reply=refused), at(0.2), at(0.6))
    shown = Instruction(InstructionCode.HOLD_HAND_SWITCH, refusal=refusal_message(OPEN))
    assert outputs == (Request("enable"), shown, Request("enable"))

    again, outputs = played(one, at(0.7, reply=refused), at(1.2), state=state)
    assert outputs == (Request("enable"),)
    late, _ = played(one, at(STEP_MAX_S, reply=refused), state=again)
    done, _ = played(one, at(1.3, reply=reply()), state=again)

    assert late.blocked.code is ReasonCode.REFUSED
    assert is_over((one,), done)
    assert done.blocked is None


@pytest.mark.parametrize("code", [RefusalCode.SIGN_NOT_PROVEN, RefusalCode.NOT_REFERENCED])
def test_a_refusal_that_another_command_ends_is_not_waited_for(code):
    refused = at(0.1, reply=reply(Refusal(code, HIP), "enable"))

    state, _ = played(task(stages.ENABLED), at(), refused)

    assert state.blocked.code is ReasonCode.REFUSED


@pytest.mark.parametrize(
    ("refusal", "code"),
    [
        (OPEN, InstructionCode.HOLD_HAND_SWITCH),
        (Refusal(RefusalCode.STO_ACTIVE), InstructionCode.RELEASE_STO),
        (PRESS, InstructionCode.PRESS_STO),
        (Refusal(RefusalCode.NO_PLAN), InstructionCode.WAIT),
    ],
)
def test_a_state_to_be_seen_asks_for_another_thing_than_the_refusal_of_its_name(refusal, code):
    assert stages.instruction_after(reply(refusal)).code is code


@pytest.mark.parametrize(
    ("asked", "sto_released", "cause", "code"),
    [
        (PRESS, False, Cause.DRIVE_FAULT, ReasonCode.STO_ACTED),
        (OPEN, False, Cause.DRIVE_FAULT, ReasonCode.STOPPED),
        (PRESS, True, Cause.DRIVE_FAULT, ReasonCode.STOPPED),
        (PRESS, False, Cause.BUS_DOWN, ReasonCode.STOPPED),
    ],
)
def test_an_emergency_stop_that_was_asked_for_is_told_from_another_fault(
    asked, sto_released, cause, code
):
    records = (record(5, sto_released=sto_released), record(6, Mode.FAULT))
    verdict = Verdict(StopCategory.S1, cause, HIP)
    fault = at(0.2, Mode.FAULT, verdict, records=records)

    state, _ = played(task(stages.ENABLED), at(), at(0.1, reply=reply(asked)), fault)

    assert state.blocked.code is code


class Interrupted:
    """A service in gait, and an operator who ends the procedure."""

    def __init__(self):
        self.asked, self.mode = [], Mode.GAIT

    def newest(self):
        return at(mode=self.mode)

    following = newest

    def request(self, request):
        self.asked.append(request)
        self.mode = Mode.FAULT
        return reply()

    def note(self, progress):
        pass

    def follow(self, instruction):
        if instruction.code is InstructionCode.HOME_AXIS:
            raise KeyboardInterrupt
        return Answer(True)


def test_an_interrupted_run_stops_the_machine_and_keeps_what_was_measured():
    service, found = Interrupted(), msgspec.structs.replace(MISSING, judgement=Judgement.PASSED)
    asked = Instruction(InstructionCode.HOME_AXIS)
    tasks = (
        task(stages.JUDGED, judge=lambda _: (found,)),
        task(stages.AGREED, announced=asked),
        Task((stages.LEFT,), axes=(HIP,), is_always_done=True),
    )
    run = Run(tasks, service, service)

    with pytest.raises(KeyboardInterrupt):
        run.play_to_rest()

    assert service.asked == [Request("stop")]
    first, rest = run.findings
    assert first == found
    assert (rest.section, rest.reason) == (Section.REST, Reason(ReasonCode.INTERRUPTED))
    assert interrupted(tasks, BEGIN, rest.reason)[0].blocked == rest.reason


@pytest.mark.parametrize(
    ("speeds", "judged"),
    [
        # Near a reversal of the gait, 6 rad/s² until the drive acts, then its ramp of 10 rad/s².
        ((0.06, 0.12, 0.18, 0.24, 0.14, 0.04, 0.0), {Judgement.PASSED}),
        ((0.06, 0.12, 0.18, 0.24, 0.24, 0.24, 0.24, 0.24, 0.04), {Judgement.FAILED}),
        ((0.01, 0.02, 0.03, 0.02, 0.01, 0.0, 0.0), {Judgement.NOT_MEASURED}),
    ],
    ids=["brakes", "does not brake", "was at rest"],
)
def test_a_stop_is_judged_by_the_speed_that_the_axis_had_to_brake(speeds, judged):
    rules = StopRules(HIP, 10.0, 0.05, 3, 0.03, 0.3, 1.5, 5.0)
    times = tuple(0.01 * number for number in range(len(speeds)))
    rest_s = next(t for t, speed in zip(times, speeds, strict=True) if speed in {0.01, 0.04})
    stop = StopTrace(
        **{"drive": HIP, "category": "S1", "cause": "hand_switch_open", "is_obeyed": True},
        **{"speed_si_per_s": speeds[0], "reaction_s": rest_s / 2, "time_s": times},
        **{"position_si": speeds, "velocity_si_per_s": speeds, "effort_si": speeds},
        **{"rest_s": rest_s, "distance_si": 0.01 * sum(speeds)},
    )

    found = list(judge(stop, STOPS[1], rules))

    rest = {FindingCode.TIME_TO_REST, FindingCode.WAY_TO_REST, FindingCode.AT_REST}
    assert {one.judgement for one in found if one.code in rest} == judged
