"""The persistent state: poses, proofs of signs, and what they are worth."""

import msgspec
import pytest
from gaitd_names import Doubt

from daemon.core.modes.persistent_state import (
    POSE_STEP_SI,
    TORN,
    UNREADABLE,
    PersistentState,
    PoseRules,
    SignProof,
    StoredAxis,
    StoredAxisTest,
    StoredInputs,
    StoredSelfTest,
    StoredVerdict,
    Wiring,
    disagreement,
    prove,
    proven,
    trusted,
    with_doubt,
    with_pose,
    with_proof,
    without_tests,
)

RULES = PoseRules(tolerance_si=0.01, believed_without_pose=False)
WIRING = Wiring(node_id=5, sign=-1, gear_ratio=100.0, lead_m=None, counts_per_rev=1024)
PROOF = prove(WIRING, 305, (0.036, -0.035), 7)


def at(position_si):
    return with_pose(PersistentState(), "right/hip", position_si, 1)


# --- the file -------------------------------------------------------------------------------------

NO_INPUTS = {
    "hand_switch_open_utc_ns": 0,
    "hand_switch_closed_utc_ns": 0,
    "sto_active_utc_ns": 0,
    "sto_released_utc_ns": 0,
    "serial_number": 0,
}
AXIS_TEST = {"friction_si": 1.0, "friction_ratio": 1.0, "load_error_si": 0.0, "moved_si": 0.1}
NO_DETAIL = {"finding": "none", "drive": "", "value": None, "limit": None, "said": "", "utc_ns": 0}
EMPTY = {
    "axes": {},
    "format": "gaitd.axes.v1",
    "damaged": False,
    "latched": None,
    "inputs": {},
    "self_test": None,
    "utc_newest_ns": 0,
}


@pytest.mark.parametrize(
    ("stored", "content"),
    [
        (StoredAxis(), {"position_si": None, "noted_utc_ns": 0, "proof": None}),
        (StoredInputs(), NO_INPUTS),
        (StoredAxisTest(1.0, 1.0, 0.0, 0.1), AXIS_TEST | {"serial_number": 0}),
        (
            StoredSelfTest(7, passed=True, leg_digest="leg"),
            {"utc_ns": 7, "passed": True, "leg_digest": "leg", "axes": {}},
        ),
        (StoredVerdict("S1", "SHUTDOWN"), {"category": "S1", "cause": "SHUTDOWN"} | NO_DETAIL),
        (PersistentState(), EMPTY),
        (
            PROOF,
            WIRING._asdict()
            | {
                "serial_number": 305,
                "moved_forth_si": 0.036,
                "moved_back_si": -0.035,
                "utc_ns": 7,
                "doubted": False,
            },
        ),
    ],
)
def test_what_is_stored_is_read_again_and_a_key_of_another_version_is_refused(stored, content):
    assert msgspec.to_builtins(stored) == content
    assert msgspec.convert(content, type(stored)) == stored
    with pytest.raises(msgspec.ValidationError, match="unknown field"):
        msgspec.convert({**content, "later": 0}, type(stored))


def test_an_unreadable_file_is_damaged_and_latches_a_stop():
    latched = StoredVerdict("S1", "last_end_unknown", finding="notes_unreadable")
    assert PersistentState(damaged=True, latched=latched) == UNREADABLE
    assert StoredVerdict("S1", "last_end_unknown", finding="notes_torn") == TORN


# --- poses ----------------------------------------------------------------------------------------


def test_a_pose_that_has_not_changed_is_no_news():
    persistent = with_pose(PersistentState(), "right/hip", 0.25, 1)

    assert with_pose(persistent, "right/hip", 0.25 + 0.99 * POSE_STEP_SI, 2) is persistent
    assert with_pose(at(0.0), "right/hip", 1e-4, 2) == at(0.0)
    assert (
        with_pose(persistent, "right/hip", 0.25 - 1.01 * POSE_STEP_SI, 2)
        .axis("right/hip")
        .noted_utc_ns
        == 2
    )


def test_a_pose_and_a_proof_do_not_disturb_each_other_or_another_axis():
    persistent = with_proof(with_pose(PersistentState(), "right/hip", 0.25, 1), "right/hip", PROOF)
    persistent = with_pose(persistent, "right/slide", 0.5, 1)
    persistent = with_pose(persistent, "right/hip", 0.3, 2)

    assert persistent.axis("right/hip") == StoredAxis(0.3, 2, PROOF)
    assert persistent.axis("right/slide").position_si == 0.5


@pytest.mark.parametrize(("encoder_si", "accepted"), [(0.255, True), (0.245, True), (0.261, False)])
def test_an_encoder_is_accepted_where_the_axis_was_left(encoder_si, accepted):
    doubt = disagreement(at(0.25), "right/hip", encoder_si, RULES)

    assert doubt is (Doubt.NONE if accepted else Doubt.LEFT_ELSEWHERE)


def test_a_difference_of_just_the_tolerance_is_accepted():
    assert disagreement(at(0.0), "right/hip", -RULES.tolerance_si, RULES) is Doubt.NONE


@pytest.mark.parametrize("damaged", [True, False])
@pytest.mark.parametrize("believed", [True, False])
def test_without_a_pose_the_setting_decides_and_a_damaged_file_is_never_believed(damaged, believed):
    persistent = PersistentState(damaged=damaged)

    doubt = disagreement(
        persistent, "right/hip", 0.2, RULES._replace(believed_without_pose=believed)
    )

    if damaged:
        assert doubt is Doubt.POSE_UNREADABLE
    else:
        assert doubt is (Doubt.NONE if believed else Doubt.NO_POSE_STORED)


def test_a_pose_stored_after_a_damaged_file_is_used():
    persistent = with_pose(PersistentState(damaged=True), "right/hip", 0.2, 1)

    assert disagreement(persistent, "right/hip", 0.2, RULES) is Doubt.NONE


# --- proofs ---------------------------------------------------------------------------------------


def test_a_proof_is_valid_for_its_own_drive_and_wiring():
    persistent = with_proof(PersistentState(), "right/hip", PROOF)

    assert proven(persistent, "right/hip", WIRING, 305)
    assert not proven(persistent, "right/slide", WIRING, 305)
    assert not proven(persistent, "right/hip", WIRING, 306)


@pytest.mark.parametrize(
    "change",
    [{"node_id": 6}, {"sign": 1}, {"gear_ratio": 99.0}, {"lead_m": 0.1}, {"counts_per_rev": 2048}],
)
def test_any_other_wiring_makes_a_proof_void(change):
    persistent = with_proof(PersistentState(), "right/hip", PROOF)

    assert not proven(persistent, "right/hip", WIRING._replace(**change), 305)


def test_a_sign_is_trusted_only_by_a_proof_without_doubt_of_a_drive_with_a_serial_number():
    persistent = with_proof(PersistentState(), "right/hip", PROOF)
    doubted = with_doubt(persistent, "right/hip", doubted=True)
    nameless = with_proof(PersistentState(), "right/hip", prove(WIRING, 0, (0.036, -0.035), 7))

    assert trusted(persistent, "right/hip", WIRING, 305)
    assert not trusted(persistent, "right/hip", WIRING, 306)
    assert not trusted(persistent, "right/slide", WIRING, 305)
    assert not trusted(doubted, "right/hip", WIRING, 305)
    assert proven(doubted, "right/hip", WIRING, 305)
    assert proven(nameless, "right/hip", WIRING, 0)
    assert not trusted(nameless, "right/hip", WIRING, 0)


def test_a_doubt_goes_with_a_test_and_changes_nothing_where_there_is_no_proof():
    persistent = with_proof(PersistentState(), "right/hip", PROOF)
    doubted = with_doubt(persistent, "right/hip", doubted=True)

    assert with_doubt(doubted, "right/hip", doubted=True) is doubted
    assert with_doubt(doubted, "right/hip", doubted=False) == persistent
    assert with_doubt(persistent, "right/slide", doubted=True) is persistent


def test_a_proof_keeps_how_far_the_axis_moved_and_when():
    assert SignProof(5, 305, -1, 100.0, None, 1024, 0.036, -0.035, 7) == PROOF


# --- a drive that is another one ------------------------------------------------------------------

TEST = StoredSelfTest(
    7, passed=True, leg_digest="leg", axes={"right/hip": StoredAxisTest(1, 1, 0, 0.1)}
)
WHOLE = PersistentState(
    axes={"right/hip": StoredAxis(0.2, 5, PROOF), "right/slide": StoredAxis(0.4, 5, PROOF)},
    inputs={"right/hip": StoredInputs(1, 2, 3, 4), "right/slide": StoredInputs(5, 6, 7, 8)},
    self_test=TEST,
)


def test_what_was_tested_of_another_drive_is_forgotten_and_nothing_else():
    kept = without_tests(WHOLE, "right/hip")

    assert kept == PersistentState(
        axes={"right/hip": StoredAxis(0.2, 5, None), "right/slide": StoredAxis(0.4, 5, PROOF)},
        inputs={"right/slide": StoredInputs(5, 6, 7, 8)},
    )
    other = without_tests(WHOLE, "right/slide")
    assert (other.self_test, set(other.inputs)) == (TEST, {"right/hip"})
    assert without_tests(kept, "right/hip") is kept
    assert without_tests(PersistentState(), "right/hip") == PersistentState()
