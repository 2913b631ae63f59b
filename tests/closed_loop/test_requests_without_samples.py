"""ENABLE and RESET on a leg of which nothing was sampled in that cycle."""

import pytest
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind
from wire import ENABLE_OPERATION, NODES, change_what_drives_say, rpdo1

from daemon.ipc.report import Refusal


def lose_samples(session, axis=None):
    """No TPDO1 of one node, or of any, from now on; True as long as it goes on."""
    on = [True]
    nodes = NODES if axis is None else (NODES[axis],)

    def change(frame):
        return None if on[0] and frame.can_id in {0x180 + node for node in nodes} else frame

    change_what_drives_say(session, change)
    return on


@pytest.mark.parametrize("axis", [None, 1], ids=["both", "slide"])
def test_enable_needs_a_sample_of_every_axis_in_the_cycle_that_grants_it(warm_ready, axis):
    session = warm_ready
    lose_samples(session, axis)
    session.run(0.01)
    since = len(session.bus.sent)

    answer = session.request(RequestKind.ENABLE)
    session.run(0.1)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal.code is RefusalCode.NO_SAMPLE
    for node in NODES:
        told = rpdo1(session.bus.sent[since:], node)
        assert not any(one.controlword & ENABLE_OPERATION for one in told)


def test_reset_needs_a_sample_of_every_axis_that_is_not_lost(warm_hold):
    session = warm_hold
    session.command("hand_switch_open * 0.2")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    session.run(0.3)
    on = lose_samples(session, 1)
    session.run(0.01)

    early = session.request(RequestKind.RESET)
    assert early.outcome == Outcome.REFUSED
    assert early.refusal.code is RefusalCode.NO_SAMPLE
    assert session.record.mode == Mode.FAULT

    on[0] = False
    session.run(0.02)
    assert session.request(RequestKind.RESET).outcome == Outcome.DONE


def test_a_drive_that_was_lost_and_came_back_is_no_obstacle_to_reset(warm_hold):
    session = warm_hold
    session.command("unplugged right/hip 1.5")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    lost = session.record.verdict
    session.run(2.0)

    answer = session.request(RequestKind.RESET)

    assert lost.cause in {Cause.DRIVE_SILENT, Cause.HEARTBEAT_LOST}
    assert answer.outcome == Outcome.DONE, answer.refusal
    assert session.request(RequestKind.ENABLE).outcome == Outcome.DONE


def test_a_drive_that_is_lost_in_a_fault_without_a_stop_delays_a_reset_by_as_long_as_it_may_be_late(
    warm_ready,
):
    session = warm_ready
    session.command("emcy right/slide 0.1 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    session.run(0.3)
    lose_samples(session, 0)
    refused_at = []

    for _ in range(10):
        age_cycles = session.record.drives[0].sample_age_cycles
        session.gateway.request(RequestKind.RESET)
        session.loop.turn()
        if session.record.mode != Mode.FAULT:
            break
        refused_at.append(age_cycles + 1)
        refused = Refusal(RefusalCode.NO_SAMPLE, "right/hip")
        assert session.gateway.outcome().refusal == refused

    longest = session.settings.limits.communication.sample_age_max_cycles
    assert refused_at == list(range(1, longest + 1))
