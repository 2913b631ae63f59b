"""What a drive is commanded when guidance, mode display or limits are not as they should be."""

import math
from unittest import mock

import numpy as np
import pytest
from gaitd_names import Cause, Mode, Outcome, RequestKind, StopCategory
from records import both
from wire import (
    ENABLED_WORD,
    NODES,
    QUICK_STOP_WORD,
    change_what_drives_say,
    rpdo1,
    target_torques,
    without_bit_12,
    words_by_cycle,
)

from daemon.core.safety.checks import ENABLE_CYCLES
from daemon.core.steps import exercises

INT16_MAX = 0x7FFF


def guided_to(session, **change):
    """From now on every reference says this."""
    honest = exercises.reference_of

    def reference_of(leg, sample):
        return honest(leg, sample)._replace(**change)

    return mock.patch.object(exercises, "reference_of", reference_of)


def test_a_torque_beyond_every_limit_is_clipped_and_never_wraps_into_its_opposite(warm_hold):
    """M34: far more than 16 bits hold."""
    wild_nm = -1e300
    sent = len(warm_hold.bus.sent)

    with guided_to(warm_hold, feedforward=(wild_nm, 0.0)):
        warm_hold.run(0.1)

    axis = warm_hold.core.axes[0]
    asked = np.array(target_torques(warm_hold.bus.sent[sent:], 5))
    while_driving = asked[:5] * math.copysign(1, wild_nm)
    most = axis.limits.effort_max_si * axis.scaling.permille_per_effort_si
    assert np.all(np.diff(while_driving) >= 0)
    assert while_driving[-1] > 0.9 * most
    assert np.abs(asked).max() <= round(most) < INT16_MAX


@pytest.mark.parametrize(
    ("field", "number"),
    [("position", math.nan), ("velocity", math.inf), ("feedforward", -math.inf)],
)
def test_a_number_that_is_not_finite_is_a_quick_stop_in_the_same_cycle(
    warm_guided_hold, field, number
):
    sent = len(warm_guided_hold.bus.sent)

    with guided_to(warm_guided_hold, **{field: (number, 0.0)}):
        warm_guided_hold.loop.turn()

    record = warm_guided_hold.record
    frames = warm_guided_hold.bus.sent[sent:]
    assert record.verdict.cause == Cause.COMMAND_NOT_FINITE
    assert [rpdo1(frames, node)[-1].controlword for node in NODES] == [QUICK_STOP_WORD] * 2
    warm_guided_hold.until(Mode.FAULT, within_s=1)


def test_a_number_that_is_not_finite_leaves_the_target_where_it_was_and_takes_the_torque_away(
    warm_guided_gait,
):
    session = warm_guided_gait
    before = [rpdo1(session.bus.sent, node)[-1].target_counts for node in NODES]
    sent = len(session.bus.sent)

    with guided_to(session, velocity=(math.nan, 0.0)):
        session.loop.turn()

    frames = session.bus.sent[sent:]
    assert [rpdo1(frames, node)[-1].target_counts for node in NODES] == before
    assert [target_torques(frames, node)[-1] for node in NODES] == [0, 0]


def targets_while_enabled(session, since):
    """Target positions of the hip drive in counts, as long as it is told to be enabled."""
    told = rpdo1(session.bus.sent[since:], 5)
    return [one.target_counts for one in told if one.controlword == ENABLED_WORD]


def test_a_target_that_runs_away_is_no_faster_than_the_axis_may_be_and_stops(warm_position_hold):
    wild_rad = 1.0
    sent = len(warm_position_hold.bus.sent)
    axis = warm_position_hold.core.axes[0]
    begun_rad, slide_m = both(warm_position_hold.record.legs[0], "measured_position")

    with guided_to(warm_position_hold, position=(begun_rad + wild_rad, slide_m)):
        warm_position_hold.run(0.5)

    counts = targets_while_enabled(warm_position_hold, sent)
    step = axis.limits.velocity_max_si * 0.01 * axis.scaling.counts_per_si
    assert np.abs(np.diff(counts)).max() <= step + 1
    assert warm_position_hold.record.verdict.category != StopCategory.NONE


def test_a_target_beyond_the_range_stops_before_the_drive_faults(warm_position_hold):
    """M35: outside 607Dh this drive faults (8A82h), so no target may come near it."""
    sent = len(warm_position_hold.bus.sent)
    axis = warm_position_hold.core.axes[0]
    begun_rad, slide_m = both(warm_position_hold.record.legs[0], "measured_position")

    for cycle in range(240):
        with guided_to(warm_position_hold, position=(begun_rad + 0.003 * cycle, slide_m)):
            warm_position_hold.loop.turn()

    counts = targets_while_enabled(warm_position_hold, sent)
    limits, scaling = axis.limits, axis.scaling
    edge_rad = limits.position_max_si - limits.soft_margin_si
    assert max(counts) == pytest.approx(edge_rad * scaling.counts_per_si, abs=1)
    told = [event for record in warm_position_hold.records for event in record.events]
    assert not any(0x8A82 in event.values for event in told)
    assert warm_position_hold.record.verdict.cause == Cause.TRACKING_LIMIT


def test_a_mode_that_never_shows_is_not_enabled_and_gets_no_torque(warm_ready):
    """M14, at enabling."""
    session = warm_ready

    def show_velocity_mode(frame):
        if frame.can_id != 0x185:
            return frame
        return frame._replace(data=frame.data[:6] + bytes((9,)))

    change_what_drives_say(session, show_velocity_mode)
    sent = len(session.bus.sent)
    cycle = session.record.cycle

    answer = session.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert session.record.verdict.cause == Cause.MODE_NOT_SHOWN
    assert session.record.cycle - cycle <= ENABLE_CYCLES + 4
    scale = session.core.axes[0].scaling.permille_per_effort_si
    enabling = [r for r in session.records if r.cycle > cycle and r.mode.active]
    present = [record.drives[0].effort * scale for record in enabling]
    sent_permille = target_torques(session.bus.sent[sent:], 5)
    start = len(sent_permille) - len(present) - 1
    assert sent_permille[start:-1] == pytest.approx(present, abs=1)


def test_a_drive_that_says_it_does_not_follow_stops_both_and_its_cause_is_named(warm_guided_hold):
    """M15."""
    cycle = warm_guided_hold.record.cycle
    change_what_drives_say(warm_guided_hold, without_bit_12(NODES[1]))

    stopped = warm_guided_hold.run_until(lambda record: not record.mode.active, within_s=1)

    allowed = warm_guided_hold.settings.limits.communication.mode_switch_cycles
    assert stopped.verdict.cause == Cause.NOT_FOLLOWING
    assert stopped.cycle - cycle == allowed + 1
    warm_guided_hold.run(0.1)
    words = words_by_cycle(warm_guided_hold.bus.sent)[-1]
    assert set(words.values()) == {QUICK_STOP_WORD}
