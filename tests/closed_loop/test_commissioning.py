"""Proving the sign of each axis: in lock-step, with the virtual drives of the empty machine."""

import struct
from itertools import groupby

import pytest
from gaitd_names import Cause, EventCode, Failure, Mode, Outcome, RefusalCode, RequestKind, Stage
from sessions import CONFIGS, changed_configs, elsewhere, new_session, reported, single_axis_run

from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal
from drives.signals import PowerState

HIP, SLIDE = "right/hip", "right/slide"
EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
)
PROVEN = ("demo.toml", 'signs = "assumed"', 'signs = "proven"')


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    return changed_configs(tmp_path_factory.mktemp("proven"), *EMPTY, PROVEN)


@pytest.fixture(scope="module")
def warm_untested(configs):
    return new_session(configs).until_ready()


@pytest.fixture
def session(warm_untested):
    return warm_untested


@pytest.fixture(scope="module")
def warm_tested(configs):
    """After a sign test of the hip, with its records."""
    session = new_session(configs).until_ready()
    return session, sign_test(session, HIP)


@pytest.fixture(scope="module")
def proven(warm_untested, warm_tested):
    """Why nothing was enabled before and after each test, and the notes after both were watched."""

    def refused(session):
        return session.request(RequestKind.ENABLE).refusal

    def witnessed(session):
        refusals = [refused(session)]
        assert asked(session, HIP, witnessed=True).outcome == Outcome.DONE
        refusals.append(refused(session))
        sign_test(session, SLIDE)
        refusals.append(refused(session))
        assert asked(session, SLIDE, witnessed=True).outcome == Outcome.DONE
        session.run(0.1)
        return refusals, session.state_file.persistent

    refusals, persistent = elsewhere(warm_tested[0], witnessed)
    return [elsewhere(warm_untested, refused), *refusals], persistent


@pytest.fixture
def proof(proven):
    """The notes after both axes were tested and watched."""
    return proven[1]


def asked(session, axis, *, witnessed=False):
    wanted = ModeRequest(Mode.COMMISSION, axis=axis, witnessed=witnessed)
    return session.request(RequestKind.MODE, wanted)


def sign_test(session, axis):
    return single_axis_run(session, Mode.COMMISSION, axis)


def failures(records):
    failed = reported(records, EventCode.SINGLE_AXIS_FAILED)
    return [(event.subject, event.values[0]) for event in failed]


def test_nothing_can_be_enabled_before_every_sign_is_proven(proven):
    refusals, _ = proven

    unproven = [Refusal(RefusalCode.SIGN_NOT_PROVEN, axis) for axis in (HIP, SLIDE)]
    assert refusals == [unproven[0], unproven[0], unproven[1], unproven[1]]


def test_a_sign_test_is_prepared_with_its_bring_up_played_and_ended(warm_tested):
    session, _ = warm_tested

    stages = [stage for stage, _ in groupby(one.stage for one in session.records)]

    prepared_and_ready = [Stage.PREPARING, None]
    sign_test = [Stage.PREPARING, Stage.PLAYING, Stage.ENDING, None]
    assert stages[:6] == [*prepared_and_ready, *sign_test]


def test_an_axis_that_moves_with_its_torque_and_was_watched_is_proven_and_says_so(warm_tested):
    session, records = warm_tested
    (tested,) = reported(records, EventCode.SIGN_TESTED)
    effort_forth_nm, moved_forth_rad, effort_back_nm, moved_back_rad = tested.values
    assert tested.subject == HIP
    assert effort_forth_nm > 0.0 > effort_back_nm
    assert not session.record.drives[0].sign_proven

    asked(session, HIP, witnessed=True)
    session.run(0.1)

    assert session.record.drives[0].sign_proven
    proof = session.state_file.persistent.axis(HIP).proof
    assert proof is not None
    assert (proof.moved_forth_si, proof.moved_back_si) == (moved_forth_rad, moved_back_rad)
    assert proof.moved_forth_si > 0.03 > -0.03 > proof.moved_back_si


def test_a_witness_of_nothing_is_not_believed(session):
    answer = asked(session, HIP, witnessed=True)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.NOT_TESTED, HIP)


def test_the_torque_of_a_sign_test_is_bounded_in_the_drive_and_by_the_core(warm_tested):
    session, records = warm_tested
    pushed = [abs(record.drives[0].target_effort) for record in records]

    assert 7.0 < max(pushed) <= 12.0
    full_ma, gentle_ma, again_ma = torque_limits_ma(session)
    assert gentle_ma == int(12.0 / 100 / 0.055736 * 1e3)
    assert again_ma == full_ma > gentle_ma
    # The other axis has no power.
    assert PowerState.OPERATION_ENABLED in {record.drives[0].power_state for record in records}
    assert PowerState.OPERATION_ENABLED not in {record.drives[1].power_state for record in records}


def test_a_motor_or_an_encoder_the_wrong_way_round_is_found_after_a_little_motion(session):
    session.command("wrong_sign right/hip")
    before = session.truth.rows[-1].hip_angle_rad

    records = sign_test(session, HIP)

    assert failures(records) == [(HIP, Failure.MOVES_AGAINST_TORQUE)]
    assert max(abs(row.hip_angle_rad - before) for row in session.truth.rows) < 0.15
    assert asked(session, HIP, witnessed=True).outcome == Outcome.REFUSED
    assert session.request(RequestKind.ENABLE).outcome == Outcome.REFUSED


def test_a_sign_test_stops_like_everything_else_and_proves_nothing(session):
    fault = "hand_switch_open right/hip"
    asked(session, HIP)
    session.run_until(lambda record: record.mode == Mode.COMMISSION, within_s=10)
    session.run(0.6)

    session.command(fault)
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)

    assert session.record.verdict.cause == Cause.HAND_SWITCH_OPEN
    session.command(f"clear {fault}")
    assert session.request(RequestKind.RESET).outcome == Outcome.DONE
    assert asked(session, HIP, witnessed=True).outcome == Outcome.REFUSED


def test_a_sign_test_can_be_stopped_and_disabled_and_leaves_the_usual_limits(session):
    for kind in (None, RequestKind.DISABLE):
        asked(session, HIP)
        session.run_until(lambda record: record.mode == Mode.COMMISSION, within_s=10)
        session.run(0.3)
        if kind is None:
            session.gateway.stop()
            session.run_until(lambda record: record.mode == Mode.FAULT, within_s=5)
            assert session.request(RequestKind.RESET).outcome == Outcome.DONE
        else:
            assert session.request(kind).outcome == Outcome.DONE
            session.run_until(lambda record: record.mode == Mode.READY, within_s=10)
            full_ma, *_, gentle_ma, again_ma = torque_limits_ma(session)
            assert full_ma == again_ma > gentle_ma


def test_with_a_patient_no_axis_is_moved_alone(tmp_path):
    session = new_session(changed_configs(tmp_path, PROVEN)).until_ready()

    answer = asked(session, HIP)

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal == Refusal(RefusalCode.PATIENT_CONFIGURED)


def test_an_axis_that_does_not_exist_is_named_with_those_that_do(session):
    answer = asked(session, "left/hip")

    assert answer.outcome == Outcome.REFUSED
    assert answer.refusal.code is RefusalCode.NO_SUCH_AXIS
    assert answer.refusal.said.split(", ") == [HIP, SLIDE]


def test_a_proof_outlives_a_restart(configs, proof):
    again = new_session(configs, proof).until_ready()

    assert again.request(RequestKind.ENABLE).outcome == Outcome.DONE


def test_a_proof_is_of_one_drive_and_one_transmission(proof, tmp_path):
    change = ("drives/hip_epos4.toml", "gear_ratio = 100.0", "gear_ratio = 100.5")
    changed = changed_configs(tmp_path, *EMPTY, PROVEN, change)
    again = new_session(changed, proof).until_ready()

    refused = again.request(RequestKind.ENABLE)
    assert refused.outcome == Outcome.REFUSED
    assert refused.refusal == Refusal(RefusalCode.SIGN_NOT_PROVEN, HIP)


NAMELESS = tuple(
    ("plant.toml", f"serial_number = 305_000_00{node}", "serial_number = 0") for node in (5, 6)
)


@pytest.fixture(scope="module")
def warm_nameless(tmp_path_factory):
    """Drives without serial numbers; both signs are proven."""
    configs = changed_configs(tmp_path_factory.mktemp("nameless"), *EMPTY, PROVEN, *NAMELESS)
    session = new_session(configs).until_ready()
    for axis in (HIP, SLIDE):
        sign_test(session, axis)
        asked(session, axis, witnessed=True)
    return session, configs


def test_drives_without_serial_numbers_are_the_same_ones_while_they_are_watched(warm_nameless):
    session, _ = warm_nameless
    session.enable()
    session.gateway.stop()
    session.until(Mode.FAULT)
    session.run(0.5)
    session.execute(RequestKind.RESET)
    session.until_ready()

    assert session.request(RequestKind.ENABLE).outcome == Outcome.DONE


def test_a_drive_without_a_serial_number_is_another_one_after_a_restart(warm_nameless):
    session, configs = warm_nameless
    again = new_session(configs, session.state_file.persistent).until_ready()

    refused = again.request(RequestKind.ENABLE)

    assert refused.outcome == Outcome.REFUSED
    assert refused.refusal == Refusal(RefusalCode.SIGN_NOT_PROVEN, HIP)
    assert not any(drive.sign_proven for drive in again.record.drives)
    assert again.state_file.persistent.axis(HIP).proof is None


def test_a_drive_without_a_serial_number_is_another_one_after_it_was_out_of_sight(warm_nameless):
    session, _ = warm_nameless
    session.run(0.1)
    session.command("reboot right/hip 0.3")
    session.run(1.0)
    session.until_ready()

    refused = session.request(RequestKind.ENABLE)

    assert refused.outcome == Outcome.REFUSED
    assert refused.refusal == Refusal(RefusalCode.SIGN_NOT_PROVEN, HIP)


def test_the_configuration_of_a_real_trainer_asks_for_proven_signs_and_a_stored_pose():
    text = (CONFIGS / "trainer.toml").read_text()

    assert 'signs = "proven"' in text
    assert 'without_stored_pose = "home"' in text


# --- what may come between the request and the motion ---------------------------------------------


def begun_and_not_moving(session):
    """Asked for, and the drives are not up again yet."""
    session.gateway.request(RequestKind.MODE, ModeRequest(Mode.COMMISSION, axis=HIP))
    session.run_until(lambda record: record.mode == Mode.OFF, within_s=5)


def never_enabled(session, since):
    """Until the request is refused and the drives are up again, and for a second then."""
    outcome = session.gateway.outcome
    session.run_until(
        lambda record: record.mode == Mode.READY and outcome().outcome == Outcome.REFUSED,
        within_s=12,
    )
    session.run(1)
    states = {d.power_state for r in session.records[since:] for d in r.drives}
    assert PowerState.OPERATION_ENABLED not in states


def torque_limits_ma(session):
    return [
        struct.unpack_from("<I", frame.data, 4)[0]
        for frame in session.bus.sent
        if frame.can_id == 0x605 and frame.data[:4] == bytes.fromhex("23013002")
    ]


def test_a_stop_between_the_request_and_the_motion_is_not_lost(session):
    since = len(session.records)
    begun_and_not_moving(session)

    session.gateway.stop()
    never_enabled(session, since)

    assert session.record.mode == Mode.READY
    assert torque_limits_ma(session)[-1] == torque_limits_ma(session)[0]


def test_a_stop_together_with_the_request_refuses_it(session):
    since = len(session.records)
    session.gateway.stop()

    session.gateway.request(RequestKind.MODE, ModeRequest(Mode.COMMISSION, axis=HIP))
    never_enabled(session, since)


def test_a_drive_that_is_lost_before_the_motion_ends_the_request_for_good(session):
    since = len(session.records)
    begun_and_not_moving(session)

    session.command("unplugged right/slide 3.0")
    never_enabled(session, since)

    assert session.record.mode == Mode.READY
    assert session.request(RequestKind.RESET).outcome == Outcome.DONE


def test_a_drive_that_is_swapped_after_its_test_is_not_proven_by_it(warm_tested):
    session, _ = warm_tested
    session.command("wrong_identity right/hip")
    session.run(4.0)
    session.run_until(lambda record: record.mode == Mode.READY, within_s=10)

    assert asked(session, HIP, witnessed=True).outcome == Outcome.REFUSED
