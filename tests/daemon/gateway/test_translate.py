"""What may be shown of a record, and what is null instead."""

import json
import math

import msgspec
import numpy as np
import pytest
from gaitd_names import Cause, StopCategory
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon.gateway import translate
from daemon.gateway.translate import Stamp
from daemon.gateway.tremor import Tremor
from daemon.ipc.record import AxisRecord, Verdict
from observer.filter.status import Status, Validity

STAMP = Stamp("boot-a", 7, 1_760_000_000_070_000_000)
OK, SPLIT, BAD = Validity.OK, Validity.SPLIT_UNOBSERVABLE, Validity.BAD


def as_json(message: msgspec.Struct) -> dict:
    return json.loads(msgspec.json.encode(message))


def messages(leg, record) -> list[dict]:
    makers = (translate.estimate, translate.activity, translate.friction)
    view = translate.view_of(leg, record, STAMP, TREMORS)
    return [as_json(make(view, 1)) for make in makers]


GIVEN_ANYWAY = {
    *("validity", "measured_position", "effort", "artificial", "reference_position"),
    *("innovation", "assist", "drift_correlation", "friction_error"),
    "needed",
}
"""What is measured, commanded or known over a long time; every other field is an estimate."""
TREMORS = {"hip": Tremor(5.0, 2.5), "slide": Tremor(6.0, 12.0)}


def estimates_of(axis: dict) -> dict:
    return {name: value for name, value in axis.items() if name not in GIVEN_ANYWAY}


def test_everything_of_a_good_axis_is_given(make_leg, make_record):
    for message in messages(make_leg(), make_record()):
        assert None not in estimates_of(message["hip"]).values()
        assert None not in estimates_of(message["slide"]).values()


def test_at_rest_patient_and_friction_are_null_and_the_net_value_is_given(make_leg, make_record):
    leg = make_leg(hip={"validity": SPLIT})
    estimate, activity, friction = (message["hip"] for message in messages(leg, make_record()))
    both = messages(leg, make_record())[1]

    assert estimate["position"] == 0.25
    assert estimate["patient"] is estimate["friction_std"] is None
    assert friction["friction"] is None
    assert activity["patient"] is activity["patient_power_w"] is None
    assert (activity["net"], activity["net_std"]) == (6.0, 0.4)
    assert estimate["tremor_frequency_hz"] is activity["tremor_amplitude"] is None
    assert (both["slide"]["tremor_frequency_hz"], both["slide"]["tremor_amplitude"]) == (6.0, 12.0)
    assert activity["validity"] == "split_unobservable"
    assert both["patient_power_w"] is None
    assert both["slide"]["patient"] == 40.0


def test_nothing_of_a_bad_axis_is_given_and_the_other_one_stays(make_leg, make_record):
    for message in messages(make_leg(slide={"validity": BAD}), make_record()):
        assert set(estimates_of(message["slide"]).values()) == {None}
        assert None not in estimates_of(message["hip"]).values()
        assert message.get("covariance") is None


def test_friction_says_how_far_it_has_drifted_and_null_while_it_is_unknown(make_leg, make_record):
    known = make_leg(hip={"drift_correlation": -0.97, "friction_error": 0.6})
    _, _, friction = messages(known, make_record())

    assert (friction["hip"]["drift_correlation"], friction["hip"]["friction_error"]) == (-0.97, 0.6)
    assert friction["slide"]["drift_correlation"] is friction["slide"]["friction_error"] is None


def test_an_axis_at_rest_costs_one_observable_state(make_leg, make_record):
    def rank(status):
        return messages(make_leg(status=status), make_record())[0]["observable_rank"]

    resting = Status.STANDSTILL_HIP | Status.STANDSTILL_SLIDE
    assert rank(Status.VALID) == 8
    assert rank(Status.VALID | Status.STANDSTILL_SLIDE) == 7
    assert rank(Status.VALID | resting) == 6


@pytest.mark.parametrize("bit", list(translate.NEVER_PUBLISHED))
def test_some_status_bits_make_both_axes_bad_whatever_the_record_says(bit, make_leg, make_record):
    for message in messages(make_leg(status=Status[bit.name] | Status.VALID), make_record()):
        assert set(estimates_of(message["hip"]).values()) == {None}
        assert message["hip"]["validity"] == message["slide"]["validity"] == "bad"
        assert bit in message["status"]


def test_a_missing_sample_is_null_and_not_nan(make_leg, make_record):
    missing = {"measured_position": math.nan, "innovation": math.nan}

    estimate = messages(make_leg(hip=missing, nis=math.nan), make_record())[0]

    assert estimate["hip"]["measured_position"] is estimate["hip"]["innovation"] is None
    assert estimate["nis"] is None
    assert estimate["slide"]["measured_position"] == 0.4998


any_number = st.one_of(st.floats(), st.sampled_from([math.nan, math.inf, -math.inf]))
any_axis = st.fixed_dictionaries(
    {
        name: st.integers(0, 2) if name == "validity" else any_number
        for name in AxisRecord.__struct_fields__
    }
)
huge = dict.fromkeys(AxisRecord.__struct_fields__, 1e200) | {"validity": 0}


@settings(derandomize=True, max_examples=50, deadline=None)
@given(
    hip=any_axis,
    slide=any_axis,
    covariance=st.one_of(st.just(()), st.tuples(*[any_number] * 36)),
    pair=st.tuples(any_number, any_number),
    status=st.integers(0, (1 << 15) - 1),
)
@example(hip=huge, slide=huge, covariance=(1e-3,) * 36, pair=(0.0, 0.0), status=0)
def test_no_record_whatever_makes_a_message_with_a_number_that_is_none(
    make_leg, make_record, hip, slide, covariance, pair, status
):
    leg = make_leg(hip, slide, covariance=covariance, status=status, gait_phase=pair[1])
    view = translate.view_of(leg, make_record(dt_s=pair[0]), STAMP)

    for make in (translate.estimate, translate.activity, translate.friction):
        message = make(view, 1)
        for part in (message, message.hip, message.slide):
            for value in msgspec.structs.asdict(part).values():
                assert not isinstance(value, float) or math.isfinite(value)


def test_each_leg_tells_its_own_phase_of_the_stride_and_none_where_no_gait_plays(
    make_leg, make_record
):
    record = make_record(gait_phase=0.1)

    told = [
        [message["gait_phase_ratio"] for message in messages(leg, record)[:2]]
        for leg in (make_leg(gait_phase=0.1), make_leg(gait_phase=0.6), make_leg())
    ]

    assert told == [[0.1, 0.1], [0.6, 0.6], [None, None]]


def test_power_is_torque_times_speed_with_the_deviation_of_its_linearisation(make_leg, make_record):
    generator = np.random.default_rng(5)
    root = generator.normal(size=(8, 8)) * 0.1
    full = root @ root.T
    packed = tuple(float(full[i, j]) for i in range(8) for j in range(i + 1))
    gradient = np.zeros(8)
    gradient[[6, 2, 7, 3]] = 1.0, 8.0, -0.5, 40.0

    activity = messages(make_leg(covariance=packed), make_record())[1]

    assert activity["hip"]["patient_power_w"] == pytest.approx(8.0)
    assert activity["slide"]["patient_power_w"] == pytest.approx(-20.0)
    assert activity["patient_power_w"] == pytest.approx(-12.0)
    expected = math.sqrt(gradient @ full @ gradient)
    assert activity["patient_power_w_std"] == pytest.approx(expected)


def test_a_drive_is_told_with_names_and_hexadecimal_codes(make_drive):
    drive = make_drive(power_state=8, emergency_code=0x8130, emergency_text="heartbeat")

    told = as_json(translate.drive_state(drive, STAMP, 3))

    assert (told["power_state"], told["nmt_state"]) == ("fault", "operational")
    assert (told["statusword"], told["emergency_code"]) == ("0x1637", "0x8130")


def test_the_inputs_of_a_drive_that_was_never_heard_are_null_and_not_open(make_drive):
    drive = make_drive(power_state=0, statusword=0, hand_switch_closed=False, sto_released=False)

    told = as_json(translate.drive_state(drive, STAMP, 3))

    assert told["power_state"] == "unknown"
    for name in ("hand_switch_closed", "sto_released", "statusword", "heartbeat_age_ms"):
        assert told[name] is None


def test_a_verdict_is_told_with_its_value_and_its_limit(make_record):
    verdict = Verdict(StopCategory.S1, Cause.VELOCITY_LIMIT, "right/hip", 2.2, 2.0)

    told = as_json(translate.safety(make_record(verdict=verdict), {}, STAMP, 1))["verdict"]

    assert (told["category"], told["cause"], told["drive"]) == ("S1", "velocity_limit", "right/hip")
    assert (told["value"], told["limit"]) == (2.2, 2.0)


def test_without_the_core_safety_says_nothing_but_that_it_is_not_valid():
    told = as_json(translate.safety(None, {"hip": {}}, STAMP, 1))

    assert told["valid"] is False
    head = {"seq", "core_boot_id", "cycle", "sample_time_ns", "valid"}
    assert {value for key, value in told.items() if key not in head} == {None}


def test_the_estimate_tells_a_controller_what_of_its_assist_is_in_force(make_record, make_leg):
    given = make_leg(
        {"assist": math.nan, "assist_wanted": 9.0},
        {"assist": -3.0},
        stiffness_ratio=0.5,
        setpoint_seq=41,
    )

    none, some = (
        translate.estimate(translate.view_of(leg, make_record(), STAMP), 1)
        for leg in (make_leg(), given)
    )

    assert (none.hip.assist, none.stiffness_ratio, none.setpoint_seq) == (0.0, 1.0, None)
    assert (some.hip.assist, some.slide.assist) == (None, -3.0)
    assert (some.stiffness_ratio, some.setpoint_seq) == (0.5, 41)
