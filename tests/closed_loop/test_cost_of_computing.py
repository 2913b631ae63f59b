"""What arrives while the core computes: races, played on purpose and again."""

import msgspec
from gaitd_names import Mode
from sessions import elsewhere, new_session

from daemon.ipc.record import CycleRecord
from sim_drives.time.conductor import computing_cost

WALK_S = 0.5


def costly(session, seed):
    """Every answer of its core takes 0.3 to 3 ms from now on."""
    session.bus.seat.cost = computing_cost(seed, "core") if seed else None
    return session


def records(session, begun=0):
    return msgspec.msgpack.encode(session.records[begun:])


def walked(session, seed):
    begun = len(session.records)
    costly(session, seed).run(WALK_S)
    return records(session, begun)


def test_a_walk_is_the_same_whenever_in_its_cycle_the_core_answers(warm_gait):
    """Commands act at SYNC, so the instant of an answer between two of them is no matter."""
    walks = [elsewhere(warm_gait, lambda one, seed=seed: walked(one, seed)) for seed in (None, 1)]

    assert walks[0] == walks[1]
    modes = {record.mode for record in msgspec.msgpack.decode(walks[1], type=list[CycleRecord])}
    assert modes == {Mode.GAIT}


def test_a_race_is_played_again_by_its_seed_and_another_one_by_another():
    first, again, other = (records(costly(new_session(), seed).until_ready()) for seed in (1, 1, 2))

    assert first == again
    assert first != other
