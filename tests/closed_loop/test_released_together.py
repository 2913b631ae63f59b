"""A reset lets go of all drives that hold the leg within one cycle of each other."""

import pytest
from sessions import Session, generic_drives
from wire import NODES

from daemon.ipc.record import Mode, Outcome, RequestKind
from gaitd_lab.lockstep import Lockstep

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


@pytest.fixture(scope="module")
def warm_generic_hold(tmp_path_factory):
    """Drives that go on holding when their master is gone."""
    return Session(generic_drives(tmp_path_factory.mktemp("generic"))).enabled()


@pytest.mark.parametrize("restarted", [False, True], ids=["held", "held, by a core before"])
def test_a_reset_of_a_held_stop_releases_all_axes_in_the_same_cycle(warm_generic_hold, restarted):
    session, lockstep = warm_generic_hold, warm_generic_hold.lockstep
    session.machine.command("hand_switch_open * 0.3")
    lockstep.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    lockstep.run(0.5)
    if restarted:
        lockstep = Lockstep(session.settings, session.machine.world, notes=lockstep.notebook.notes)
        lockstep.run_until(lambda record: record.mode == Mode.FAULT, within_s=3)
        lockstep.run(0.5)
    off_ns = watch_power(session)

    answer = lockstep.request(RequestKind.RESET)

    assert answer.outcome == Outcome.DONE, answer.reason
    assert len(off_ns) == len(NODES)
    assert max(off_ns.values()) - min(off_ns.values()) < CYCLE_MS * MS
