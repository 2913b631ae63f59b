"""Stops as the drives get them: from every state, and both axes between the same two SYNCs."""

import pytest
from gaitd_names import Cause, Mode, Outcome, RefusalCode, RequestKind, StopCategory
from sessions import elsewhere, new_session
from wire import (
    DISABLE_VOLTAGE_WORD,
    ENABLE_OPERATION,
    ENABLED_WORD,
    NODES,
    QUICK_STOP_WORD,
    cycles,
    rpdo1,
    words_by_cycle,
)

from daemon.ipc.report import Refusal
from drives.signals import PowerState

QS, OFF = QUICK_STOP_WORD, DISABLE_VOLTAGE_WORD
ENABLED = (ENABLED_WORD, ENABLED_WORD)


# --- both axes between the same two SYNCs -----------------------------------------------------


def told(interval, node):
    """What one drive gets in an interval, stripped of when."""
    ids = {0x200 + node, 0x300 + node}
    return [(frame.can_id, frame.data) for frame in interval if frame.can_id in ids]


def first_change(free, stopped, node):
    """The first interval in which a drive is told something else than without the stop."""
    for number, (one, other) in enumerate(zip(free, stopped, strict=False)):
        if told(one, node) != told(other, node):
            return number
    return None


def test_a_stop_that_holds_begins_for_both_drives_between_the_same_two_syncs(warm_guided_gait):
    """Compared with the very same session without a stop."""
    warm_guided_gait.run_until(
        lambda record: min(abs(drive.velocity or 0.0) for drive in record.drives) > 0.15,
        within_s=8,
    )
    before = len(warm_guided_gait.bus.sent)

    def sent_later(one):
        one.run(0.3)
        return one.bus.sent[before:]

    free = elsewhere(warm_guided_gait, sent_later)
    warm_guided_gait.gateway.stop()
    stopped = sent_later(warm_guided_gait)

    hip, slide = (first_change(list(cycles(free)), list(cycles(stopped)), node) for node in NODES)
    words = words_by_cycle(stopped)
    assert warm_guided_gait.record.verdict.category == StopCategory.S2
    assert hip == slide is not None
    assert all(set(one.values()) == {ENABLED_WORD} for one in words[hip:])


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        ("hand_switch_open right/slide", (QS, QS)),
        ("sto_open right/hip", (OFF, OFF)),
        ("encoder_glitch right/slide - 3000", (QS, OFF)),
    ],
)
def test_a_stop_reaches_both_drives_between_the_same_two_syncs(warm_gait, cause, words):
    """One row for each pair of words; the fault matrix plays all causes."""
    begun = len(list(cycles(warm_gait.bus.sent))) - 1

    warm_gait.command(cause)
    warm_gait.run(0.12)

    told = words_by_cycle(warm_gait.bus.sent)[begun:]
    pairs = [tuple(one[node] for node in NODES) for one in told]
    left = next(number for number, pair in enumerate(pairs) if pair != ENABLED)
    assert pairs[:left] == [ENABLED] * left
    assert 0x0F not in pairs[left]
    # STO is told by an EMCY before it is seen in the inputs: first the one stop, then the other.
    reached = pairs.index(words)
    assert reached - left <= (1 if "sto" in cause else 0)
    assert set(pairs[reached:]) == {words}


def test_an_emcy_between_two_windows_is_answered_to_both_drives_before_the_next_sync(warm_gait):
    running = len(list(cycles(warm_gait.bus.sent))) - 1

    warm_gait.command("emcy right/hip - 0x2310")
    warm_gait.run(0.05)

    words = words_by_cycle(warm_gait.bus.sent)
    assert words[running - 1] == {5: 0x0F, 6: 0x0F}
    assert words[running] == {5: QS, 6: QS}
    assert all(set(one.values()) == {QS} for one in words[running:])


# --- from every state -------------------------------------------------------------------------


def in_flight(word):
    """Enabling, with this controlword on its way to the hip drive."""

    def reach(session):
        session.gateway.request(RequestKind.ENABLE)
        for _ in range(20):
            session.loop.turn()
            if rpdo1(session.bus.sent, 5)[-1].controlword == word:
                return
        raise AssertionError(f"{word:#x} never left")

    return reach


def bringing_up(session):
    """Stopped in the middle already: a whole bring-up is one turn of the loop."""
    gateway = session.gateway
    publish = gateway.publish

    def publish_and_stop(record):
        publish(record)
        if record.mode == Mode.BRINGING_UP:
            gateway.stop()

    gateway.publish = publish_and_stop
    session.until_ready()
    assert session.record.stop_count > 1


def stopping(session):
    session.gateway.stop()
    session.run_until(lambda record: record.mode == Mode.STOPPING, within_s=1)


def fault(session):
    session.command("hand_switch_open right/hip 0.5")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    session.run(0.5)


@pytest.fixture
def powered_on():
    return new_session()


def there_already(session):
    pass


STATES = {
    "bringing up": ("powered_on", bringing_up),
    "ready": ("warm_ready", there_already),
    "transition 2 in flight": ("warm_ready", in_flight(0x06)),
    "transition 3 in flight": ("warm_ready", in_flight(0x07)),
    "transition 4 in flight": ("warm_ready", in_flight(0x0F)),
    "hold": ("warm_hold", there_already),
    "gait": ("warm_gait", there_already),
    "stopping": ("warm_fast_gait", stopping),
    "fault": ("warm_hold", fault),
}
"""What each begins with, and how it is reached from there."""


@pytest.fixture
def warm_begin(request, state):
    return request.getfixturevalue(STATES[state][0])


ALL = (StopCategory.S0, StopCategory.S1, StopCategory.S2)
PLAYED = {"transition 4 in flight": ALL, "gait": ALL, "stopping": ALL[:2], "fault": ALL[2:]}
"""Categories in a state; in the others the one that leaves most power."""


@pytest.mark.parametrize(
    ("state", "category"),
    [(state, category) for state in STATES for category in PLAYED.get(state, ALL[2:])],
)
def test_a_stop_from_every_state_energises_nothing(warm_begin, state, category):
    """M08, on the wire: bit 3 only ever goes on to a drive that shows operation enabled."""
    warm_begin.core.config.categories._by_cause[Cause.STOP_REQUESTED] = category
    STATES[state][1](warm_begin)
    enabled = {
        5 + number
        for number, drive in enumerate(warm_begin.record.drives)
        if drive.power_state == PowerState.OPERATION_ENABLED
    }
    sent = len(warm_begin.bus.sent)

    warm_begin.gateway.stop()
    warm_begin.run(0.4)

    frames = warm_begin.bus.sent[sent:]
    for node in NODES:
        raised = [one for one in rpdo1(frames, node) if one.controlword & ENABLE_OPERATION]
        assert not raised or (node in enabled and category == StopCategory.S2)
    powered = {
        5 + number
        for number, drive in enumerate(warm_begin.record.drives)
        if drive.power_state == PowerState.OPERATION_ENABLED
    }
    assert powered <= (enabled if category == StopCategory.S2 else set())
    quiet = {"bringing up", "ready"}
    assert warm_begin.record.mode == (Mode.READY if state in quiet else Mode.FAULT)


def test_an_enable_that_comes_together_with_a_stop_is_refused(warm_ready):
    warm_ready.gateway.stop()

    answer = warm_ready.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.STOP_REQUESTED)
