"""A drive that is lost in operation, seen from the wire: what the master sends and what not.

Node 5 is the hip, node 6 the slide. The drives are real enough to go on turning when they are lost,
so only what their frames say may count.
"""

import numpy as np
import pytest
from gaitd_names import Cause, EventCode, Mode, RequestKind
from records import both
from sessions import elsewhere, reported

from drives.canopen.frame import Frame
from drives.signals import PowerState
from observer.filter.status import Validity

MS = 1_000_000
ENABLING = 0b1000
QUICK_STOP = 0x02
TPDO1, TPDO2 = 0x185, 0x285
HEARTBEAT = 0x705


def altered(session, change):
    """Everything that the drives send goes through `change`: frames in, frames out."""
    world = session.machine.world
    advance = world.advance_to

    def advance_to(time_ns):
        return [frame for sent in advance(time_ns) for frame in change(sent)]

    world.advance_to = advance_to


def without(*can_ids):
    return lambda frame: [] if frame.can_id in can_ids else [frame]


def controlwords(session, node_id, since):
    sent = session.bus.sent[since:]
    return [
        int.from_bytes(frame.data[:2], "little")
        for frame in sent
        if frame.can_id == 0x200 + node_id
    ]


def nmt(session, since):
    return [f.data.hex() for f in session.bus.sent[since:] if f.can_id == 0]


def stops_told(session):
    return reported(session.records, EventCode.STOPPED)


# --- what was seen before the loss ----------------------------------------------------------------


WITHOUT_DRIVES = {Mode.OFF, Mode.BRINGING_UP, Mode.FAULT}


def lose_the_bus_as_a_stride_ends(session):
    session.run_until(lambda record: record.legs[0].stride is not None, within_s=8.0)
    session.bus.trouble.is_gone = True


def unplug_a_drive(session):
    session.command("unplugged right/slide 60")


STATES = ("position", "velocity", "friction", "patient")


@pytest.mark.parametrize(
    ("walking", "lose"),
    [
        (True, lose_the_bus_as_a_stride_ends),
        (False, unplug_a_drive),
    ],
)
def test_without_drives_no_record_repeats_what_they_had_shown(
    warm_fast_gait, warm_ready, walking, lose
):
    session = warm_fast_gait if walking else warm_ready
    lose(session)
    session.run(1.0)

    lost = [record for record in session.records[-100:] if record.mode in WITHOUT_DRIVES]
    assert len(lost) > 20
    for record in lost[1:]:  # the first may be that of the cycle in which they were lost
        (leg,) = record.legs
        assert [drive.power_state for drive in record.drives] == [PowerState.UNKNOWN] * 2
        assert not any(drive.fresh or drive.hand_switch_closed for drive in record.drives)
        assert both(leg, "validity") == (Validity.BAD, Validity.BAD)
        unknown = ("measured_position", "reference_position", "net", *STATES)
        assert np.isnan([both(leg, name) for name in unknown]).all()
        assert (leg.stride, leg.gait_phase) == (None, -1.0)


# --- heartbeat ------------------------------------------------------------------------------------


def test_a_heartbeat_that_stays_away_is_a_loss_at_the_consumer_time_within_one_cycle(session):
    timeout_ms = session.settings.limits.communication.heartbeat_timeout_ms
    last_ns = []
    altered(
        session,
        lambda frame: (
            [frame]
            if frame.can_id != HEARTBEAT
            else (last_ns.append(frame.time_ns), [frame])[1]
            if not last_ns
            else []
        ),
    )

    lost = session.run_until(lambda record: not record.mode.active, within_s=1)

    assert lost.verdict.cause == Cause.HEARTBEAT_LOST
    assert lost.verdict.drive == "right/hip"
    passed_ms = (lost.sync_mono_ns - last_ns[0]) / MS
    assert timeout_ms < passed_ms <= timeout_ms + 20


def test_a_lost_heartbeat_quick_stops_both_axes_and_is_told_once(session):
    altered(session, without(HEARTBEAT))
    session.run_until(lambda record: not record.mode.active, within_s=1)
    since = len(session.bus.sent)

    session.run(1)

    assert set(controlwords(session, 6, since)) == {QUICK_STOP}
    assert not any(word & ENABLING for word in controlwords(session, 5, since))
    assert len(stops_told(session)) == 1
    assert session.record.mode == Mode.FAULT


def test_a_heartbeat_that_comes_back_enables_nothing(session):
    gone = [True]
    altered(session, lambda frame: [] if frame.can_id == HEARTBEAT and gone[0] else [frame])
    session.run_until(lambda record: not record.mode.active, within_s=1)
    since = len(session.bus.sent)

    gone[0] = False
    session.run(1)

    assert session.record.mode == Mode.FAULT
    assert not any(
        word & ENABLING for node in (5, 6) for word in controlwords(session, node, since)
    )


def test_a_drive_that_leaves_operational_by_itself_stops_both_axes(session):
    altered(session, without(0x085))

    session.machine.world.receive(Frame(0x000, b"\x80\x05"))
    lost = session.run_until(lambda record: not record.mode.active, within_s=0.1)
    since = len(session.bus.sent)
    session.run(1)

    record = session.record
    assert lost.verdict.cause == Cause.DRIVE_NOT_OPERATIONAL
    assert lost.verdict.drive == "right/hip"
    assert record.mode == Mode.FAULT
    assert record.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE
    assert "0105" not in nmt(session, since)


# --- a reboot -------------------------------------------------------------------------------------


def test_a_drive_that_reboots_in_operation_is_lost_at_once_and_the_other_axis_is_stopped(session):
    since = len(session.bus.sent)

    session.bus.seat.waiting.append(session.bus.sent[0]._replace(can_id=HEARTBEAT, data=b"\x00"))
    session.run(0.02)

    record = session.record
    assert record.verdict.cause == Cause.DRIVE_REBOOTED
    assert record.verdict.drive == "right/hip"
    assert not record.drives[0].referenced
    assert not any(
        word & ENABLING for node in (5, 6) for word in controlwords(session, node, since)
    )


# --- TPDOs that are not as they should be ---------------------------------------------------------


def test_tpdos_of_another_length_are_never_used_and_stop_both_axes_when_they_go_on(session):
    altered(session, lambda f: [f._replace(data=f.data[:6])] if f.can_id == TPDO1 else [f])
    session.run_until(lambda record: not record.mode.active, within_s=0.1)
    session.run(0.5)

    record = session.record
    assert record.verdict.cause == Cause.DRIVE_SILENT
    assert record.drives[0].protocol_error_count >= 3
    assert record.drives[1].power_state == PowerState.QUICK_STOP_ACTIVE


def test_one_short_tpdo_is_a_missing_sample_and_no_stop(session):
    once = [True]

    def cut(frame):
        if frame.can_id == TPDO1 and once[0]:
            once[0] = False
            return [frame._replace(data=frame.data[:3])]
        return [frame]

    altered(session, cut)
    session.run(0.5)

    record = session.record
    assert record.mode == Mode.GAIT
    assert record.drives[0].protocol_error_count == 1
    missed = [r for r in session.records[-60:] if not r.drives[0].fresh]
    assert len(missed) == 1


def test_every_tpdo_twice_changes_nothing_but_a_counter(session):
    def half_a_second_later(one):
        one.run(0.5)
        return one.record

    plain = elsewhere(session, half_a_second_later)
    altered(session, lambda f: [f, f] if f.can_id in (TPDO1, TPDO2) else [f])
    doubled = half_a_second_later(session)

    assert doubled.mode == Mode.GAIT
    assert doubled.drives[0].late_count > plain.drives[0].late_count
    assert both(doubled.legs[0], "measured_position") == both(plain.legs[0], "measured_position")


def test_tpdos_that_come_after_the_window_are_late_and_stop_both_axes_when_they_go_on(session):
    window_ms = session.settings.trainer.cycle.window_ms
    held = []

    def late(frame):
        """Delivered with the first frame that comes after the window is over."""
        if frame.can_id in (TPDO1, TPDO2):
            held.append(frame)
            return []
        return [frame]

    altered(session, late)
    bus = session.bus
    wait = bus.link.wait

    def wait_and_deliver(until_ns, *, for_frame):
        wait(until_ns, for_frame=for_frame)
        due = [f for f in held if bus.now_ns - f.time_ns > window_ms * MS]
        for frame in due:
            held.remove(frame)
            bus.seat.waiting.append(bus.sent[0]._replace(can_id=frame.can_id, data=frame.data))

    bus.link.wait = wait_and_deliver
    session.run_until(lambda record: not record.mode.active, within_s=0.2)
    session.run(0.1)

    record = session.record
    assert record.verdict.cause == Cause.DRIVE_SILENT
    assert record.drives[0].late_count > 0


# --- the end --------------------------------------------------------------------------------------


def test_a_shutdown_with_both_axes_enabled_quick_stops_switches_off_and_lets_go(warm_hold):
    session = warm_hold
    since = len(session.bus.sent)
    begun_ns = session.bus.now_ns

    session.shut_down()

    for node in (5, 6):
        words = controlwords(session, node, since)
        assert words[0] == QUICK_STOP
        assert words[-1] == 0x00
        assert not any(word & ENABLING for word in words)
    assert nmt(session, since) == ["8205", "8206"]
    assert session.bus.now_ns - begun_ns < 2000 * MS
    torques = [frame.data for frame in session.bus.sent[since:] if frame.can_id in {0x305, 0x306}]
    assert set(torques) == {b"\0\0"}


@pytest.mark.parametrize(
    ("fault", "reset"), [("silent right/hip", "8206"), ("unplugged right/slide", "8205")]
)
def test_a_shutdown_ends_also_when_a_drive_does_not_answer(warm_hold, fault, reset):
    """The drive that does not answer may have power: it keeps its watch on the heartbeat."""
    warm_hold.command(fault)
    begun_ns = warm_hold.bus.now_ns
    since = len(warm_hold.bus.sent)

    warm_hold.shut_down()

    assert warm_hold.bus.now_ns - begun_ns < 2000 * MS
    assert [sent for sent in nmt(warm_hold, since) if sent.startswith("82")] == [reset]
    words = [w for node in (5, 6) for w in controlwords(warm_hold, node, since)[1:]]
    assert not any(word & ENABLING for word in words)


def power_states(session):
    nodes = (session.machine.world.node(name) for name in ("right/hip", "right/slide"))
    return {node.drive.state.name for node in nodes}


def test_a_reset_that_one_drive_does_not_answer_leaves_no_other_one_with_power(warm_hold):
    warm_hold.command("silent right/hip 30")
    warm_hold.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    assert "QUICK_STOP_ACTIVE" in power_states(warm_hold)

    warm_hold.gateway.request(RequestKind.RESET)
    warm_hold.run(4)

    assert warm_hold.record.mode == Mode.OFF
    assert warm_hold.record.verdict.cause == Cause.DRIVE_SILENT
    # The silent one heard it, too.
    assert power_states(warm_hold) == {"SWITCH_ON_DISABLED"}


def test_a_shutdown_in_the_cycle_of_a_reset_waits_until_the_reset_has_switched_off(warm_hold):
    warm_hold.gateway.stop()
    warm_hold.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
    warm_hold.gateway.request(RequestKind.RESET)
    while warm_hold.record.mode == Mode.FAULT:
        warm_hold.loop.turn()
    assert power_states(warm_hold) == {"QUICK_STOP_ACTIVE"}

    warm_hold.shut_down()

    assert power_states(warm_hold) == {"SWITCH_ON_DISABLED"}
