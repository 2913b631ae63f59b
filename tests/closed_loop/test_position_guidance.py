"""guidance = "position": the drives' own loops play the gait (CSP), from enable to every stop."""

from itertools import pairwise

import numpy as np
import pytest
from gaitd_names import Cause, EventCode, Finding, Mode, RequestKind, Stage
from records import both
from reports import verdict_of
from sessions import (
    AXES,
    empty_machine,
    new_session,
    reported,
    scores,
)
from wire import (
    change_what_drives_hear,
    change_what_drives_say,
    deaf_to_mode,
    rpdo1,
    target_torques,
)

from daemon.ipc.record import ModeRequest
from drives.cia402.units import position_si
from drives.signals import OperationMode, PowerState

CSP = OperationMode.CYCLIC_SYNC_POSITION
CST = OperationMode.CYCLIC_SYNC_TORQUE
NODES = (5, 6)
HOLD = ModeRequest(Mode.HOLD)
EXCITE = ModeRequest(Mode.EXCITE, duration_s=25.0, scenario="open_loop")
CYCLES_BEHIND = 2
"""A target acts from the next SYNC and is reached at the one after."""


@pytest.fixture(scope="module")
def warm_fast_position_gait(position_configs):
    """A gait at 0.5 Hz by the drives' own loops."""
    return new_session(position_configs).walk(cadence_hz=0.5, duration_s=6.0)


def targets_si(session, since=0):
    """Target positions of both axes in the order in which they were sent: one row per cycle."""
    sent = session.bus.sent[since:]
    columns = [
        [position_si(told.target_counts, axis.scaling) for told in rpdo1(sent, node)]
        for axis, node in zip(session.core.axes, NODES, strict=True)
    ]
    return np.array(columns).T


def measured(records):
    return np.array([both(record.legs[0], "measured_position") for record in records])


def test_a_gait_is_played_by_the_drives_loops_and_the_estimate_says_how_sure_it_is(
    warm_fast_position_gait,
):
    session = warm_fast_position_gait
    session.command("patient active")
    session.run(1)
    begun = len(session.records)

    found = scores(session, 2)

    records = session.records[begun:]
    assert {drive.mode_display for record in records for drive in record.drives} == {CSP}
    assert all(record.verdict.cause == Cause.NONE for record in records)
    wanted = np.array([both(record.legs[0], "reference_position") for record in records])
    behind = np.abs(wanted[:-CYCLES_BEHIND] - measured(records)[CYCLES_BEHIND:]).max(axis=0)
    assert behind[0] < 0.01
    assert behind[1] < 0.01
    assert found["hip"].rms < 2.5
    assert found["slide"].rms < 20.0
    truth = {row.sync_mono_ns: row for row in session.truth.rows}
    for axis, column in enumerate(("hip_patient_nm", "slide_patient_n")):
        errors = [
            (leg.axes[axis].patient - getattr(truth[record.sync_mono_ns], column))
            / leg.axes[axis].patient_std
            for record in records
            for leg in record.legs
            if leg.axes[axis].validity == 0
        ]
        assert len(errors) > 0.95 * len(records)
        assert np.mean(np.abs(errors) < 3) > 0.97


def test_a_whole_gait_moves_its_targets_without_a_step_and_ends_in_hold(warm_position_hold):
    session = warm_position_hold
    begun = len(session.bus.sent)
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=1.0, duration_s=5.0)

    session.request(RequestKind.MODE, gait)
    session.run_until(lambda record: record.mode == Mode.HOLD, within_s=30)
    session.run(0.1)

    speed = np.abs(np.diff(targets_si(session, begun), axis=0)).max(axis=0) / 0.01
    change = np.abs(np.diff(targets_si(session, begun), n=2, axis=0)).max(axis=0) / 0.01**2
    assert session.record.verdict.cause == Cause.NONE
    # The gait itself asks 2.45 rad/s and 2.38 m/s, 13.7 rad/s^2 and 19.5 m/s^2; two counts of
    # rounding on top.
    assert 1.0 < speed[0] < 2.45 * 1.05
    assert 1.0 < speed[1] < 2.38 * 1.05
    assert change[0] < 13.7 * 1.1 + 2 * 6.1e-5 / 0.01**2
    assert change[1] < 19.5 * 1.1 + 2 * 4.9e-5 / 0.01**2


def test_enabling_finds_no_distance_to_go(position_configs):
    session = new_session(position_configs).until_ready()
    begun = len(session.bus.sent)
    before = both(session.record.legs[0], "measured_position")

    session.request(RequestKind.ENABLE)
    session.run(0.5)

    assert np.abs(targets_si(session, begun) - before).max() < 5e-4
    assert both(session.record.legs[0], "measured_position") == pytest.approx(before, abs=5e-4)


# --- stops ----------------------------------------------------------------------------------


def test_a_stop_in_the_middle_brakes_and_holds_by_the_drives_loops(warm_fast_position_gait):
    session = warm_fast_position_gait
    session.run(0.9)
    begun, told = len(session.records), len(session.bus.sent)

    session.gateway.stop()
    session.run(1.5)

    record = session.record
    records = session.records[begun:]
    assert (record.mode, record.verdict.cause) == (Mode.FAULT, Cause.STOP_REQUESTED)
    assert {drive.power_state for drive in record.drives} == {PowerState.OPERATION_ENABLED}
    assert {drive.mode_display for one in records for drive in one.drives} == {CSP}
    stood = measured(records[-50:])
    assert np.ptp(stood, axis=0).max() < 5e-4
    # No kick: the brakes' deceleration, and what it takes to come back to where the leg was.
    change = np.abs(np.diff(targets_si(session, told), n=2, axis=0)).max(axis=0) / 0.01**2
    assert change[0] < 2.5 * session.settings.limits.hip.quick_stop_deceleration_rad_per_s2
    assert change[1] < 2.5 * session.settings.limits.slide.quick_stop_deceleration_m_per_s2


def test_a_stop_lets_go_of_what_holds_the_leg_back(warm_position_gait):
    """A blocked joint lags behind its target; a stop does not go on pulling it there."""
    warm_position_gait.command("blocked_rotor right/hip")
    warm_position_gait.run(0.05)
    pushed_nm = abs(warm_position_gait.record.drives[0].effort)

    warm_position_gait.gateway.stop()
    warm_position_gait.run(1.5)

    axis = warm_position_gait.core.axes[0]
    assert warm_position_gait.record.verdict.cause == Cause.STOP_REQUESTED
    assert pushed_nm > 20
    assert abs(axis.sent.position_si - axis.sensed.joint.position_si) < 1e-3


# --- mode switches --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def warm_empty_hold(tmp_path_factory):
    """The empty machine, held by the drives' loops."""
    configs = empty_machine(tmp_path_factory.mktemp("empty"))
    file = configs / "demo.toml"
    file.write_text(file.read_text().replace('"impedance"', '"position"'))
    return new_session(configs).enable()


def test_a_switch_to_torque_and_back_makes_no_step_in_torque_or_position(warm_empty_hold):
    """Hold in position mode, an excitation in torque mode, hold in position mode again."""
    session = warm_empty_hold.excite("open_loop", 25.0)
    session.run(2)
    session.request(RequestKind.MODE, HOLD)
    session.run_until(
        lambda record: {drive.mode_display for drive in record.drives} == {CSP}, within_s=5
    )
    session.run(1)
    active = [record for record in session.records if record.mode.active][5:]

    shown = np.array([[drive.mode_display for drive in record.drives] for record in active])
    effort = np.array([[drive.effort for drive in record.drives] for record in active])
    where = measured(active)
    assert {(CSP, CST), (CST, CSP)} <= {
        (int(a), int(b)) for column in shown.T for a, b in pairwise(column)
    }
    breakaway = [axis.limits.breakaway_si for axis in session.core.axes]
    still = [axis.limits.standstill_si_per_s * 0.01 for axis in session.core.axes]
    for axis in range(len(AXES)):
        switched = np.flatnonzero(np.diff(shown[:, axis]))
        for row in switched:
            # Friction hides what is less than breakaway; three cycles on each side.
            near = slice(max(row - 3, 0), row + 5)
            assert np.abs(np.diff(effort[near, axis])).max() < breakaway[axis]
            assert np.abs(np.diff(where[near, axis])).max() < still[axis]
    assert session.record.verdict.cause == Cause.NONE

    # And a drive that moves stays in its mode until it stands.
    records = session.records
    switched = 0
    for drive, node in enumerate(NODES):
        told = rpdo1(session.bus.sent, node)
        limit = session.core.axes[drive].limits.standstill_si_per_s
        for (before, now), record in zip(pairwise(told), records[1 - len(told) :], strict=True):
            if now.mode != before.mode and record.mode.active:
                switched += 1
                assert abs(record.drives[drive].velocity) < limit
    assert switched == 2 * len(NODES)


def test_a_mode_that_never_shows_stops_after_five_cycles_and_commands_no_torque(warm_empty_hold):
    """M14: 6060h says 10, 6061h stays 8."""
    change_what_drives_hear(warm_empty_hold, deaf_to_mode(5, CSP))
    held = both(warm_empty_hold.record.legs[0], "measured_position")
    told = len(warm_empty_hold.bus.sent)
    cycle = warm_empty_hold.record.cycle

    warm_empty_hold.request(RequestKind.MODE, EXCITE)
    stopped = warm_empty_hold.run_until(lambda record: not record.mode.active, within_s=1)

    assert stopped.verdict.cause == Cause.MODE_NOT_SHOWN
    assert (stopped.verdict.value, stopped.verdict.limit) == (CSP, CST)
    assert stopped.cycle - cycle <= 1 + 1 + 5 + 1
    sent = warm_empty_hold.bus.sent[told:]
    permille_per_nm = warm_empty_hold.core.axes[0].scaling.permille_per_effort_si
    # The present torque with its noise, and nothing of the scenario.
    assert np.ptp(target_torques(sent, 5)) < 1.0 * permille_per_nm
    assert len({one.target_counts for one in rpdo1(sent, 5)}) == 1
    warm_empty_hold.run(1)
    assert warm_empty_hold.record.legs[0].hip.measured_position == pytest.approx(held[0], abs=1e-3)


def shows_its_mode_late(node, cycles):
    """TPDO1 of the node with the mode display of so many cycles ago."""
    shown = []

    def change(frame):
        if frame.can_id != 0x180 + node:
            return frame
        shown.append(frame.data[6:7])
        return frame._replace(data=frame.data[:6] + shown[-cycles - 1 :][0] + frame.data[7:])

    return change


def test_a_drive_that_has_left_torque_mode_and_shows_it_late_need_not_give_the_last_torque(
    warm_position_hold,
):
    """Its own loop holds against a person who leans on the leg in these cycles."""
    session = warm_position_hold
    change_what_drives_say(session, shows_its_mode_late(5, cycles=4))
    session.execute(RequestKind.MODE, ModeRequest(Mode.HAND_GUIDING))
    session.run(1)
    session.execute(RequestKind.MODE, HOLD)
    session.run_until(lambda _: rpdo1(session.bus.sent, 5)[-1].mode == CSP, within_s=3)
    asked = session.record
    begun = len(session.records)

    session.machine.trainers["right"].exert(40.0, 0.0)
    session.run(1)

    shown = [record.drives[0] for record in session.records[begun:]]
    late = [abs(drive.effort) for drive in shown if drive.mode_display == CST]
    assert asked.drives[0].mode_display == CST
    gap_max_nm = session.settings.limits.hip.torque_deviation_max_nm
    assert sum(effort_nm > gap_max_nm for effort_nm in late) >= 3
    assert (session.record.mode, session.record.verdict.cause) == (Mode.HOLD, Cause.NONE)


def left_in_torque_mode(session):
    """Mode hold just after an excitation: the moving drives are not yet asked to change."""
    session.excite("open_loop", 25.0)
    session.run(0.7)
    session.execute(RequestKind.MODE, HOLD)
    return session


def test_a_gait_is_announced_for_its_time_after_the_drives_have_changed_their_mode(
    warm_empty_hold,
):
    session = left_in_torque_mode(warm_empty_hold)
    gait = ModeRequest(Mode.GAIT, cadence_hz=0.5, amplitude_ratio=1.0, duration_s=5.0)
    session.execute(RequestKind.MODE, gait)

    def asked(_):
        return {rpdo1(session.bus.sent, node)[-1].mode for node in NODES} == {CSP}

    assert not asked(session.record)
    changed = session.run_until(asked, within_s=2)
    begun = session.run_until(lambda record: record.stage is Stage.APPROACHING, within_s=4)

    announce_s = session.settings.trainer.gait.announce_s
    assert changed.stage is Stage.ANNOUNCING
    assert begun.cycle - changed.cycle >= round(announce_s / 0.01)


def test_a_stop_leaves_the_drives_in_the_mode_in_which_it_finds_them(warm_empty_hold):
    session = warm_empty_hold.excite("open_loop", 25.0)
    session.run(0.7)
    before = len(session.bus.sent)

    session.gateway.stop()
    session.until(Mode.FAULT, within_s=1.5)

    assert session.record.mode == Mode.FAULT
    told = [one for node in NODES for one in rpdo1(session.bus.sent[before:], node)]
    assert {one.mode for one in told} == {CST}


# --- what the drives' loops meet ------------------------------------------------------------


def test_a_following_error_stops_both_axes_once_and_says_so(warm_fast_position_gait):
    """M36: the drive's own window, 8611h, fault reaction, fault."""
    warm_fast_position_gait.run(0.8)
    warm_fast_position_gait.command("blocked_rotor right/hip")

    warm_fast_position_gait.run(0.8)

    record = warm_fast_position_gait.record
    stops = reported(warm_fast_position_gait.records, EventCode.STOPPED, EventCode.FURTHER_CAUSE)
    told = [verdict_of(event) for event in stops]
    assert record.mode == Mode.FAULT
    assert record.drives[0].emergency_code == 0x8611
    assert (Finding.EMCY, 0x8611) in [(one.finding, one.value) for one in told]
    assert record.drives[0].power_state == PowerState.FAULT
    assert record.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    for cause in (Cause.DRIVE_FAULT, Cause.EMERGENCY):
        assert [one.cause for one in told].count(cause) <= 1


def test_a_patient_who_leans_on_a_leg_that_the_drives_hold_is_no_fault(warm_position_hold):
    """A stiff loop holds against 30 N m within a count or two: no encoder is frozen."""
    session = warm_position_hold
    session.machine.trainers["right"].exert(30.0, 0.0)

    session.run(1.5)

    assert session.record.mode == Mode.HOLD
    efforts = [record.drives[0].effort for record in session.records[-150:]]
    assert max(map(abs, efforts)) > 20


def test_an_encoder_that_jumps_to_where_no_leg_can_be_stops_and_ends_no_process(
    warm_position_gait,
):
    warm_position_gait.command("encoder_glitch right/hip - 60000")
    warm_position_gait.run(0.5)

    record = warm_position_gait.record
    assert record.verdict.cause == Cause.ENCODER_JUMP
    assert not record.mode.active
