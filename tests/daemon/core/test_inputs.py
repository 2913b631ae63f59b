"""Levels as they come: one, several, none, again, late, out of order, and for another core."""

from dataclasses import dataclass, field

import msgspec
import pytest
from gaitd_names import EventCode, RefusalCode, RequestKind, Role
from safety_inputs import ALL_WELL

from daemon.core import inputs
from daemon.core.modes.roles import refusal
from daemon.core.slices import Inputs
from daemon.ipc.record import AxisSetpoint, GatewayState, Request, Setpoint
from daemon.ipc.report import Event, Refusal

CYCLE = 1000
ENABLE = Request(8, RequestKind.ENABLE, CYCLE - 1)
SETPOINT = Setpoint(5, 1, CYCLE - 1, AxisSetpoint(3.0), AxisSetpoint(20.0), "right")


KNOWN = Inputs(stop_count=2, gateway_state_seq=50, gateway_state_cycle=CYCLE - 1)
"""After level 50, with two stops."""


@dataclass
class Heard:
    """What is known from cycle to cycle, with request 7 answered."""

    inputs: Inputs = KNOWN
    request_id: int = 7
    events: list[Event] = field(default_factory=list)


@pytest.fixture
def core():
    return Heard()


def receive(core, states, cycle):
    before = core.inputs
    core.inputs = inputs.receive(before, states, "ours", core.request_id, cycle)
    core.events += inputs.news(before, core.inputs)
    return core.inputs


def asked(inputs):
    return inputs.stop, inputs.request


def level(seq, **changes):
    told = {"core_boot_id": "ours", "for_cycle": CYCLE - 1, "stop_count": 2, **changes}
    told = {"lease_role": Role.CONTROLLER, **told}
    return GatewayState(seq=seq, **told)


def test_a_stop_in_any_datagram_of_a_burst_is_heard(core):
    for place in range(3):
        counts = [2 + (number >= place) for number in range(3)]
        core.inputs = msgspec.structs.replace(core.inputs, stop_count=2)
        burst = [
            level(core.inputs.gateway_state_seq + 1 + n, stop_count=count)
            for n, count in enumerate(counts)
        ]

        assert receive(core, burst, CYCLE).stop
        assert core.inputs.stop_count == 3
        assert not receive(
            core, [level(core.inputs.gateway_state_seq + 1, stop_count=3)], CYCLE
        ).stop


def test_a_stop_in_an_earlier_datagram_is_heard_though_a_later_one_counts_lower(core):
    assert receive(core, [level(51, stop_count=3), level(52, stop_count=2)], CYCLE).stop


def test_the_first_level_of_all_only_tells_where_the_count_is(core):
    core.inputs = Inputs()

    assert not receive(core, [level(51, stop_count=9)], CYCLE).stop
    assert core.inputs.stop_count == 9


def test_the_age_of_a_level_counts_from_the_cycle_that_it_answers(core):
    receive(core, [level(51, for_cycle=CYCLE - 1)], CYCLE + 40)
    assert core.inputs.gateway_state_cycle == CYCLE - 1

    receive(core, [level(52, for_cycle=CYCLE - 9)], CYCLE + 41)
    assert core.inputs.gateway_state_cycle == CYCLE - 1


def test_a_level_for_a_cycle_that_has_not_been_counts_for_nothing_but_a_stop(core):
    ahead = level(51, for_cycle=CYCLE + 1, request=ENABLE, setpoints=(SETPOINT,), lease=5)

    heard = receive(core, [ahead], CYCLE)

    assert asked(heard) == (False, None)
    assert (core.inputs.gateway_state_cycle, core.inputs.setpoints, core.inputs.lease) == (
        CYCLE - 1,
        (),
        0,
    )
    assert receive(core, [level(52, for_cycle=CYCLE + 1, stop_count=3)], CYCLE).stop
    assert receive(core, [level(51, request=ENABLE)], CYCLE).request == ENABLE


def test_the_newest_of_a_burst_counts_and_not_the_last(core):
    older, newest = level(51, lease=4), level(52, request=ENABLE, setpoints=(SETPOINT,), lease=5)

    heard = receive(core, [newest, older], CYCLE)

    assert heard.request == ENABLE
    assert (core.inputs.setpoints, core.inputs.lease) == ((SETPOINT,), 5)


def test_a_level_that_comes_again_asks_for_nothing_again(core):
    sent = level(51, request=ENABLE, setpoints=(SETPOINT,), lease=5)
    assert receive(core, [sent, sent], CYCLE).request == ENABLE
    core.request_id = ENABLE.id
    receive(core, [level(52, request=Request(9, RequestKind.DISABLE))], CYCLE)
    core.request_id = 9

    heard = receive(core, [sent], CYCLE + 10)

    assert asked(heard) == (False, None)
    assert (core.inputs.setpoints, core.inputs.lease) == ((), 0)


def test_an_older_level_may_stop_and_do_nothing_else(core):
    older = level(49, stop_count=3, request=ENABLE, setpoints=(SETPOINT,), lease=5)

    heard = receive(core, [older], CYCLE)

    assert asked(heard) == (True, None)
    assert (core.inputs.setpoints, core.inputs.lease) == ((), 0)


def test_an_older_level_does_not_make_the_next_one_a_stop(core):
    assert not receive(core, [level(49, stop_count=1)], CYCLE).stop
    assert not receive(core, [level(51, stop_count=2)], CYCLE).stop


def test_a_gateway_that_counts_lower_than_is_known_stops_with_its_next_stop(core):
    assert not receive(core, [level(51, stop_count=0)], CYCLE).stop
    assert receive(core, [level(52, stop_count=1)], CYCLE).stop


@pytest.mark.parametrize("number", [0, 5, 7])
def test_a_request_that_was_there_before_is_no_new_one(core, number):
    request = Request(number, RequestKind.ENABLE, CYCLE - 1)

    assert receive(core, [level(51, request=request)], CYCLE).request is None


def test_of_another_core_only_a_stop_counts_and_its_numbers_hide_nothing_of_ours(core):
    foreign = level(10**9, core_boot_id="theirs", request=ENABLE, setpoints=(SETPOINT,), lease=5)

    assert asked(receive(core, [foreign], CYCLE)) == (False, None)
    assert (core.inputs.setpoints, core.inputs.lease) == ((), 0)
    assert receive(core, [level(51, request=ENABLE)], CYCLE).request == ENABLE
    assert receive(core, [level(10**9, core_boot_id="theirs", stop_count=3)], CYCLE).stop


def test_without_a_gateway_state_nothing_is_asked_and_nothing_changes(core):
    assert receive(core, [], CYCLE) == KNOWN
    assert not core.events


def test_a_stop_and_a_request_are_of_one_cycle_only(core):
    assert asked(receive(core, [level(51, stop_count=3, request=ENABLE)], CYCLE)) == (True, ENABLE)
    assert asked(receive(core, [], CYCLE + 1)) == (False, None)


def test_a_level_for_this_very_cycle_counts(core):
    receive(core, [level(51, for_cycle=CYCLE, lease=5)], CYCLE)

    assert (core.inputs.gateway_state_cycle, core.inputs.lease) == (CYCLE, 5)


def test_a_level_with_the_number_of_the_last_one_is_no_newer(core):
    receive(core, [level(50, lease=5, stop_count=1)], CYCLE)

    assert (core.inputs.lease, core.inputs.stop_count) == (0, 2)


@pytest.mark.parametrize("boot_id", ["", "our", "ourt", "zzz"])
def test_any_other_name_of_a_core_is_another_core(core, boot_id):
    receive(core, [level(51, core_boot_id=boot_id, lease=5)], CYCLE)

    assert core.inputs.lease == 0


def older(state):
    """The same state from a gateway that knows no roles: its arrays end before them."""
    *fields, request, setpoints, lease, _lease_role = msgspec.msgpack.decode(
        msgspec.msgpack.encode(state)
    )
    data = msgspec.msgpack.encode([*fields, request[:4], setpoints, lease])
    return msgspec.msgpack.decode(data, type=GatewayState)


def test_a_gateway_that_knows_no_roles_has_the_least_right_and_may_stop(core):
    held = {"request": ENABLE, "setpoints": (SETPOINT,), "lease": 5}
    told = receive(core, [older(level(51, **held))], CYCLE)

    assert (core.inputs.lease, told.stop) == (0, False)
    may_not = Refusal(RefusalCode.ROLE_MAY_NOT, values=(Role.DISPLAY, RequestKind.ENABLE))
    assert refusal(told.request, ALL_WELL) == may_not
    (event,) = core.events
    assert event == Event(EventCode.LEASE_DROPPED, values=(Role.DISPLAY,))
    receive(core, [older(level(52, **held))], CYCLE)
    assert receive(core, [older(level(53, **held, stop_count=3))], CYCLE).stop
    assert core.events == [event]
    receive(core, [older(level(54, **(held | {"lease": 4})))], CYCLE)
    assert core.events == [event, event]

    receive(core, [level(55, lease=5)], CYCLE)
    assert (core.inputs.lease, core.events) == (5, [event, event])


@pytest.mark.parametrize("role", Role)
def test_only_a_role_that_may_hold_the_lease_holds_it_in_the_core(core, role):
    receive(core, [level(51, lease=5, lease_role=role)], CYCLE)

    assert core.inputs.lease == (5 if role in {Role.UNRESTRICTED, Role.CONTROLLER} else 0)
    assert bool(core.events) == (core.inputs.lease == 0)
