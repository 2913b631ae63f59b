"""Requests and stops: what the level says, and that every query gets exactly one answer."""

import pytest
from gaitd_client import wire
from gaitd_names import Mode, Outcome, RequestKind
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.gateway.requests import STOP_TIMEOUT_NS, TIMEOUT_NS, RequestQueue
from daemon.ipc.record import AxisSetpoint, RequestResult, Setpoint

SECOND = 1_000_000_000
ASK = wire.Ask()


@pytest.fixture
def desk(make_record):
    made = RequestQueue()
    assert made.receive("boot-a", make_record(100)) == []
    return made


def test_a_request_is_answered_when_a_record_shows_its_outcome(desk, make_record):
    assert desk.submit(1, "enable", ASK, 0) is None
    request = desk.gateway_state().request

    assert desk.receive("boot-a", make_record(101, request=RequestResult(request.id))) == []
    done = desk.receive("boot-a", make_record(102, request=RequestResult(request.id, Outcome.DONE)))

    assert (request.kind, request.for_cycle) == (RequestKind.ENABLE, 100)
    assert [(answer.ticket, answer.outcome) for answer in done] == [(1, Outcome.DONE)]
    assert desk.gateway_state().request.kind is RequestKind.NONE


def test_a_second_request_is_refused_as_busy(desk):
    desk.submit(1, "enable", ASK, 0)

    answer = desk.submit(2, "reset", ASK, 0)

    assert answer.outcome is Outcome.REFUSED
    assert (answer.refusal.code, answer.refusal.values) == ("busy", {"open_request": "enable"})


def test_a_request_without_an_outcome_leaves_the_level_when_its_time_is_over(desk):
    desk.submit(1, "enable", ASK, 0)

    assert desk.tick(TIMEOUT_NS[RequestKind.ENABLE] - 1) == []
    answers = desk.tick(TIMEOUT_NS[RequestKind.ENABLE])

    assert [answer.outcome for answer in answers] == [Outcome.PENDING]
    assert desk.gateway_state().request.kind is RequestKind.NONE


def test_another_core_is_never_asked_what_the_one_before_was_asked(desk, make_record):
    desk.submit(1, "enable", ASK, 0)

    answers = desk.receive("boot-b", make_record(1))

    assert [answer.outcome for answer in answers] == [Outcome.REFUSED]
    assert answers[0].refusal.code == "core_restarted"
    assert desk.gateway_state().core_boot_id == "boot-b"
    assert desk.gateway_state().request.kind is RequestKind.NONE


def test_nothing_is_asked_of_a_core_that_fell_silent(desk):
    desk.submit(1, "enable", ASK, 0)

    assert [answer.outcome for answer in desk.lose_core()] == [Outcome.PENDING]
    assert desk.gateway_state().request.kind is RequestKind.NONE
    assert desk.submit(2, "enable", ASK, 0).outcome is Outcome.REFUSED


def test_request_ids_go_on_from_those_the_core_has_seen(make_record):
    desk = RequestQueue()
    desk.receive("boot-a", make_record(100, request=RequestResult(41, Outcome.DONE)))

    desk.submit(1, "reset", ASK, 0)

    assert desk.gateway_state().request.id == 42


def test_a_stop_is_in_the_next_level_and_is_answered_when_the_core_has_seen_it(desk, make_record):
    desk.submit(1, "enable", ASK, 0)
    before = desk.gateway_state().stop_count

    desk.stop(2, 0)

    level = desk.gateway_state()
    assert level.stop_count == before + 1
    assert level.request.kind is RequestKind.ENABLE
    seen = desk.receive("boot-a", make_record(101, stop_count=level.stop_count))
    assert [(answer.ticket, answer.outcome) for answer in seen] == [(2, Outcome.DONE)]


def test_an_unconfirmed_stop_is_answered_in_half_a_second_and_stays_in_the_level(desk):
    desk.stop(1, 0)

    answers = desk.tick(STOP_TIMEOUT_NS)

    assert [answer.outcome for answer in answers] == [Outcome.PENDING]
    assert answers[0].refusal.code == "stop_unconfirmed"
    assert desk.gateway_state().stop_count == 1


def test_a_new_gateway_says_nothing_before_it_knows_the_count_of_the_core(make_record):
    desk = RequestQueue()
    assert desk.gateway_state() is None

    desk.receive("boot-a", make_record(100, stop_count=5))

    assert desk.gateway_state().stop_count == 5


def test_a_stop_asked_of_a_new_gateway_is_an_increase_for_the_core(make_record):
    desk = RequestQueue()
    desk.stop(1, 0)
    assert desk.gateway_state().stop_count == 1

    assert desk.receive("boot-a", make_record(100, stop_count=5)) == []

    assert desk.gateway_state().stop_count == 6
    assert desk.receive("boot-a", make_record(101, stop_count=6))[0].outcome is Outcome.DONE


def test_mode_arguments_reach_the_request(desk):
    ask = wire.ModeAsk(mode="excite", duration_s=25.0, scenario="paper", for_cycle=90)

    desk.submit(1, "mode", ask, 0)

    request = desk.gateway_state().request
    assert (request.for_cycle, request.mode.mode) == (90, Mode.EXCITE)
    assert (request.mode.duration_s, request.mode.scenario) == (25.0, "paper")


def test_the_level_carries_the_lease_and_the_newest_setpoint_of_each_leg(desk):
    setpoints = (
        Setpoint(7, 1, 90, AxisSetpoint(3.0), AxisSetpoint(20.0), "right"),
        Setpoint(7, 4, 90, leg="left"),
    )

    level = desk.gateway_state(setpoints, 7)

    assert (level.setpoints, level.lease) == (setpoints, 7)
    assert (desk.gateway_state().setpoints, desk.gateway_state().lease) == ((), 0)


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("ask"), st.sampled_from(("disable", "enable", "reset"))),
        st.tuples(st.just("stop"), st.none()),
        st.tuples(st.just("wait"), st.integers(1, 9 * SECOND)),
        st.tuples(st.just("lose"), st.none()),
        st.tuples(st.just("restart"), st.integers(0, 3)),
        st.tuples(st.just("hear"), st.sampled_from(list(Outcome))),
        st.tuples(st.just("hear deaf"), st.none()),
    ),
    max_size=40,
)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(steps=STEPS)
def test_every_query_gets_one_answer_and_the_stop_count_never_falls(make_record, steps):
    desk, now_ns, boot = RequestQueue(), 0, 0
    asked: list[int] = []
    answered: list[int] = []
    counts: list[int] = []
    seen = 0

    def note(answers):
        answered.extend(answer.ticket for answer in answers if answer)

    for cycle, (step, value) in enumerate(steps):
        ticket = len(asked) + 1
        match step:
            case "ask":
                asked.append(ticket)
                note([desk.submit(ticket, value, ASK, now_ns)])
            case "stop":
                asked.append(ticket)
                desk.stop(ticket, now_ns)
            case "wait":
                now_ns += value
                note(desk.tick(now_ns))
            case "lose":
                note(desk.lose_core())
            case "restart":
                boot, seen = boot + 1, value
                note(desk.receive(f"boot-{boot}", make_record(cycle, stop_count=seen)))
            case "hear" | "hear deaf":
                level = desk.gateway_state()
                if level and step == "hear":
                    seen = level.stop_count
                result = RequestResult(level.request.id, value) if level and value else None
                changes = {"request": result} if result else {}
                note(desk.receive(f"boot-{boot}", make_record(cycle, stop_count=seen, **changes)))
        level = desk.gateway_state()
        counts += [level.stop_count] if level else []
    note(desk.tick(now_ns + 100 * SECOND))

    assert sorted(answered) == asked
    assert counts == sorted(counts)
