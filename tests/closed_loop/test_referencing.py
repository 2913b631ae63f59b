"""Where an axis is after a start: homed, or where it was left."""

import math
from itertools import pairwise

import pytest
from gaitd_names import Cause, Doubt, EventCode, Mode, Outcome, RefusalCode, RequestKind
from records import both
from sessions import changed_configs, new_session, reported, single_axis_run

from daemon.core.cycle import POSE_CYCLES
from daemon.core.modes.persistent_state import PersistentState, StoredAxis
from daemon.core.steps.single_axis import seeks_home
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Event, Refusal
from drives.canopen.frame import Frame
from drives.signals import OperationMode, PowerState
from observer.filter.status import Validity

HIP, SLIDE = "right/hip", "right/slide"
EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
    # A search three times as fast, which finds its switch sooner.
    ("drives/hip_epos4.toml", "search_speed_si_per_s = 0.1", "search_speed_si_per_s = 0.3"),
    ("drives/slide_epos4.toml", "search_speed_si_per_s = 0.05", "search_speed_si_per_s = 0.15"),
)
MOVE = "Home offset move distance"
HOME_SHIFT = "\nObjectType=0x7\nDataType=0x0004\nAccessType=rw\nDefaultValue="
INCREMENTAL = (
    ("drives/hip_epos4.toml", "absolute = true", "absolute = false"),
    ("drives/slide_epos4.toml", "absolute = true", "absolute = false"),
    ("plant.toml", 'encoder = "absolute"', 'encoder = "incremental"'),
    (
        "plant.toml",
        "slide.position_m = 0.5905",
        "slide.position_m = 0.2",
    ),  # not far from where it is homed
    # What an earlier commissioning of these drives has stored: 10 degrees at the hip.
    ("drives/epos4.eds", MOVE + HOME_SHIFT + "0", MOVE + HOME_SHIFT + "3000"),
)
STRICT = (
    ("demo.toml", "hip.pose_tolerance_deg = 180.0", "hip.pose_tolerance_deg = 1.5"),
    ("demo.toml", "slide.pose_tolerance_m = 2.0", "slide.pose_tolerance_m = 0.01"),
    ("demo.toml", 'without_stored_pose = "believe"', 'without_stored_pose = "home"'),
)


@pytest.fixture(scope="module")
def incremental_configs(tmp_path_factory):
    return changed_configs(tmp_path_factory.mktemp("incremental"), *EMPTY, *INCREMENTAL)


@pytest.fixture(scope="module")
def warm_incremental(incremental_configs):
    return new_session(incremental_configs).until_ready()


@pytest.fixture
def incremental(warm_incremental):
    return warm_incremental


@pytest.fixture(scope="module")
def warm_homed(incremental_configs):
    """Both axes are homed, the hip first; with the records of its homing."""
    session = new_session(incremental_configs).until_ready()
    records = home(session, HIP)
    assert referenced(session) == [True, False]
    home(session, SLIDE)
    return session, records


def asked(session, axis):
    return session.request(RequestKind.MODE, ModeRequest(Mode.REFERENCE, axis=axis))


def home(session, axis):
    return single_axis_run(session, Mode.REFERENCE, axis)


def referenced(session):
    return [drive.referenced for drive in session.record.drives]


def test_an_incremental_encoder_is_not_referenced_and_cannot_be_enabled(incremental):
    answer = incremental.request(RequestKind.ENABLE)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.NOT_REFERENCED, HIP, (Doubt.NOT_HOMED,))
    assert referenced(incremental) == [False, False]
    assert incremental.record.legs[0].status & (1 << 10)  # UNREFERENCED


def test_homing_finds_the_joint_where_it_is_within_an_encoder_count_or_two(warm_homed):
    incremental, _ = warm_homed
    assert referenced(incremental) == [True, True]

    truth, drives = incremental.truth.rows[-1], incremental.record.drives
    assert drives[0].position == pytest.approx(truth.hip_angle_rad, abs=3e-4)
    assert drives[1].position == pytest.approx(truth.slide_position_m, abs=2e-4)
    assert incremental.request(RequestKind.ENABLE).outcome == Outcome.DONE


def test_homing_is_the_drive_s_own_mode_of_one_axis_with_limited_torque(warm_homed):
    _, records = warm_homed

    moving = [record for record in records if record.mode == Mode.REFERENCE]
    assert {record.drives[0].mode_display for record in moving[20:]} == {OperationMode.HOMING}
    assert max(abs(record.drives[0].effort or 0.0) for record in moving) < 1.02 * 50.0
    assert all(record.drives[0].target_effort == 0.0 for record in moving)
    assert PowerState.OPERATION_ENABLED not in {record.drives[1].power_state for record in records}


def test_the_stroke_of_a_homing_is_asked_for_by_one_edge_of_bit_4(warm_homed):
    incremental, _ = warm_homed
    words = [
        int.from_bytes(frame.data[:2], "little")
        for frame in incremental.bus.sent
        if frame.can_id == 0x205
    ]
    rises = [new for old, new in pairwise(words) if new & ~old & 0x10]
    assert rises == [0x1F]


def test_a_stop_during_homing_ends_in_fault_and_references_nothing(incremental):
    asked(incremental, HIP)
    incremental.run_until(lambda record: record.mode == Mode.REFERENCE, within_s=10)
    incremental.run(1.0)

    incremental.gateway.stop()
    incremental.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)

    assert incremental.record.verdict.cause == Cause.STOP_REQUESTED
    assert referenced(incremental) == [False, False]
    assert incremental.request(RequestKind.RESET).outcome == Outcome.DONE
    assert incremental.request(RequestKind.ENABLE).outcome == Outcome.REFUSED


def test_a_reboot_of_a_drive_loses_its_home(warm_homed):
    incremental, _ = warm_homed
    incremental.command("reboot right/hip 0.3")
    incremental.run(0.5)

    incremental.run_until(lambda record: record.mode == Mode.READY, within_s=10)

    assert referenced(incremental) == [False, True]


def test_with_a_patient_no_axis_is_homed(tmp_path):
    session = new_session(changed_configs(tmp_path, *INCREMENTAL)).until_ready()

    answer = asked(session, HIP)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.PATIENT_CONFIGURED)


# --- absolute encoders ----------------------------------------------------------------------------


def left_at(hip_rad, slide_m):
    return PersistentState(
        axes={HIP: StoredAxis(position_si=hip_rad), SLIDE: StoredAxis(position_si=slide_m)}
    )


def test_an_absolute_encoder_that_disagrees_with_the_stored_pose_is_not_believed(tmp_path):
    persistent = left_at(math.radians(13.98) - 0.0628, 0.5905)

    session = new_session(changed_configs(tmp_path, *STRICT), persistent).until_ready()

    assert referenced(session) == [False, True]
    told = reported(session.records, EventCode.NOT_REFERENCED)
    assert told == [Event(EventCode.NOT_REFERENCED, HIP, (Doubt.LEFT_ELSEWHERE,))]
    assert session.request(RequestKind.ENABLE).outcome == Outcome.REFUSED


def test_an_axis_that_could_not_be_followed_is_not_believed_where_it_was_not_left(tmp_path):
    """Absolute encoders as on a real machine, in a gait that has left the stored pose."""
    configs = changed_configs(tmp_path, *STRICT)
    session = new_session(configs, left_at(math.radians(13.98), 0.5905))
    session.walk(cadence_hz=0.4)
    away_rad = math.radians(13.98 + 10.0)
    session.run_until(lambda record: record.drives[0].position > away_rad, within_s=10.0)
    session.command("silent right/hip 0.3")
    session.until(Mode.FAULT, within_s=5.0)
    session.run(1.0)

    session.execute(RequestKind.RESET)
    session.until(Mode.READY, within_s=10.0)

    assert referenced(session) == [False, True]


def test_the_pose_is_stored_at_an_orderly_stop_and_followed_while_nothing_is_driven(warm_hold):
    before = warm_hold.state_file.persistent.axis(HIP).position_si
    warm_hold.run(1.1)
    assert warm_hold.state_file.persistent.axis(HIP).position_si == before

    warm_hold.request(RequestKind.DISABLE)
    warm_hold.run(3.0)

    stored, there = warm_hold.state_file.persistent, warm_hold.record.drives
    assert stored.axis(HIP).position_si == pytest.approx(there[0].position, abs=2e-4)
    assert stored.axis(SLIDE).position_si == pytest.approx(there[1].position, abs=2e-4)


def test_a_service_that_is_asked_to_end_waits_for_the_leg_to_rest_and_stores_where(session):
    session.shut_down()

    last, persistent = session.truth.rows[-1], session.state_file.persistent
    assert abs(last.hip_velocity_rad_per_s) < 0.1
    assert abs(last.slide_velocity_m_per_s) < 0.06
    assert persistent.axis(HIP).position_si == pytest.approx(last.hip_angle_rad, abs=0.002)
    assert persistent.axis(SLIDE).position_si == pytest.approx(last.slide_position_m, abs=0.002)


def test_of_a_leg_that_is_moved_by_hand_only_the_pose_in_which_it_rests_is_stored(warm_ready):
    session = warm_ready
    session.run_until(lambda record: record.cycle % POSE_CYCLES == 30, within_s=2)
    before = session.state_file.persistent

    session.command("patient spasm")  # after half a second, so it moves when a pose is due
    session.run_until(lambda record: record.cycle % POSE_CYCLES == 2, within_s=2)
    moved, then = session.record.drives, session.state_file.persistent
    session.run(3.0)

    for axis, drive, standstill_si in zip((HIP, SLIDE), moved, (0.05, 0.03), strict=True):
        assert abs(drive.velocity) > standstill_si
        assert then.axis(axis).position_si == before.axis(axis).position_si
    at_rest = [drive.position for drive in session.record.drives]
    stored = session.state_file.persistent
    assert [stored.axis(axis).position_si for axis in (HIP, SLIDE)] == pytest.approx(
        at_rest, abs=1e-3
    )


def test_of_a_damaged_file_nothing_is_believed_until_it_is_found_anew(tmp_path):
    lenient = changed_configs(tmp_path, *EMPTY, *STRICT[:2])
    session = new_session(lenient, PersistentState(damaged=True)).until_ready()
    home(session, HIP)
    found_rad, truth = session.record.drives[0].position, session.truth.rows[-1]
    assert found_rad == pytest.approx(truth.hip_angle_rad, abs=3e-4)
    session.run(1.5)

    assert referenced(session) == [True, False]
    persistent = session.state_file.persistent
    assert persistent.axis(HIP).position_si is not None
    assert referenced(new_session(lenient, persistent).until_ready())[1] is False


def off_by(tmp_path, off_rad, *changes):
    """Both encoders are believed, but the origin of the hip's is off."""
    off = ("plant.toml", "offset_rad = 0.0", f"offset_rad = {off_rad}")
    configs = changed_configs(tmp_path, *EMPTY, *STRICT[:2], off, *changes)
    session = new_session(configs).until_ready()
    truth = session.truth.rows[-1]
    assert referenced(session) == [True, True]
    wrong_rad = session.record.drives[0].position - truth.hip_angle_rad
    assert abs(wrong_rad) == pytest.approx(abs(off_rad), abs=2e-3)
    return session


def assert_homed_trusted_and_enabled(session, records):
    assert reported(records, EventCode.HOMED) == [Event(EventCode.HOMED, HIP)]
    assert not reported(records, EventCode.STOPPED, EventCode.FURTHER_CAUSE)
    session.run(0.3)
    truth = session.truth.rows[-1]
    assert referenced(session) == [True, True]
    assert session.record.drives[0].position == pytest.approx(truth.hip_angle_rad, abs=3e-4)
    assert session.record.legs[0].hip.position == pytest.approx(truth.hip_angle_rad, abs=1e-3)
    assert Validity.BAD not in both(session.record.legs[0], "validity")
    assert session.request(RequestKind.ENABLE).outcome == Outcome.DONE


def test_estimate_and_pose_of_a_leg_count_again_from_the_cycle_that_finds_home(tmp_path):
    bent = ("plant.toml", "slide.position_m = 0.5905", "slide.position_m = 0.2")
    session = off_by(tmp_path, 0.1, bent)
    begun = len(session.records)
    hip, slide = session.core.axes
    assert not seeks_home(session.core, hip)
    asked(session, HIP)
    session.run_until(lambda record: record.mode == Mode.REFERENCE, within_s=10)
    assert (seeks_home(session.core, hip), seeks_home(session.core, slide)) == (True, False)

    homed = session.run_until(lambda record: reported([record], EventCode.HOMED), within_s=60)

    assert homed.mode == Mode.STOPPING
    assert not seeks_home(session.core, hip)
    since = len(session.records) - 1
    session.until(Mode.OFF)
    for record in session.records[since:-1]:
        assert Validity.BAD not in both(record.legs[0], "validity")
        assert record.legs[0].hip.position == pytest.approx(record.drives[0].position, abs=2e-3)
    session.until_ready()
    assert_homed_trusted_and_enabled(session, session.records[begun:])


def test_a_homing_faster_than_its_search_has_run_away_and_is_stopped(tmp_path):
    slow = ("drives/hip_epos4.toml", "search_speed_si_per_s = 0.3", "search_speed_si_per_s = 0.01")
    session = new_session(changed_configs(tmp_path, *EMPTY, *INCREMENTAL, slow)).until_ready()
    node = session.machine.world
    asked(session, HIP)
    session.run_until(lambda record: record.mode == Mode.REFERENCE, within_s=10)
    session.run(0.3)
    fast = Frame(0x605, bytes.fromhex("23996001") + (60).to_bytes(4, "little"))
    node.receive(fast)  # another SDO client writes 6099h:01: 60 rpm, 0.06 rad/s
    session.run_until(lambda record: record.mode != Mode.REFERENCE, within_s=60)

    assert session.record.verdict.cause == Cause.VELOCITY_LIMIT
