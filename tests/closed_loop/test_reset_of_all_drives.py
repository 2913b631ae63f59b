"""A reset lets go of all drives that hold the leg within one cycle of each other."""

import pytest
from gaitd_names import Mode, Outcome, RequestKind
from sessions import restarted
from wire import NODES

MS = 1_000_000
CYCLE_MS = 10
QUICK_STOP_ACTIVE, SWITCH_ON_DISABLED = 0x07, 0x40


def watch_power(session):
    """For each drive the world's times at which it went off."""
    world, off_ns = session.machine.world, {}
    honest = world.advance_to

    def state(name):
        return world.node(name).dictionary.value(0x6041, 0) & 0x6F

    before = {name: state(name) for name in world.drives}

    def advance_to(time_ns):
        frames = []
        while world.now_ns < time_ns:
            frames += honest(min(world.now_ns + MS // 4, time_ns))
            for name in world.drives:
                if before[name] == QUICK_STOP_ACTIVE != state(name):
                    off_ns[name] = world.now_ns
                before[name] = state(name)
        return frames + honest(time_ns)

    world.advance_to = advance_to
    return off_ns


@pytest.mark.parametrize("core_is_new", [False, True], ids=["held", "held, by a core before"])
def test_a_reset_of_a_held_stop_releases_all_axes_in_the_same_cycle(warm_generic_hold, core_is_new):
    session = warm_generic_hold
    session.command("hand_switch_open * 0.3")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    session.run(0.5)
    if core_is_new:
        session = restarted(session)
        session.run_until(lambda record: record.mode == Mode.FAULT, within_s=3)
        session.run(0.5)
    off_ns = watch_power(session)

    answer = session.request(RequestKind.RESET)

    assert answer.outcome == Outcome.DONE, answer.refusal
    assert len(off_ns) == len(NODES)
    assert max(off_ns.values()) - min(off_ns.values()) < CYCLE_MS * MS
