"""The wire contract: schemas that explain everything, words that agree, and how messages look."""

import json

import msgspec
import pytest
from gaitd_client import wire
from gaitd_names import NMT_STATES, POWER_STATES, EventCode, StatusBit, Validity

from daemon.gateway.translate import COVARIANCE_COUNT
from daemon.ipc.record import STATE_COUNT
from daemon.ipc.report import Event
from daemon.wire.report_fields import values_of
from drives.signals import NmtState, PowerState
from observer.filter import status

HEAD = {"seq": 7, "core_boot_id": "b", "cycle": 41, "sample_time_ns": 1_760_000_000_410_000_000}


@pytest.mark.parametrize("name", wire.MESSAGES)
def test_the_schema_of_a_message_has_its_object_at_the_root_and_explains_every_field(name):
    schema = wire.schema(wire.MESSAGES[name])

    assert schema["$id"] == f"gaitd.{name}.v1"
    assert schema["type"] == "object"
    assert schema["description"]
    assert all(field.get("description") for field in schema["properties"].values())
    for definition in schema.get("$defs", {}).values():
        assert all(field.get("description") for field in definition["properties"].values())


REQUESTS = {"ask", "mode", "acquire", "release", "report", "plan", "mark", "setpoint"}


@pytest.mark.parametrize("name", wire.MESSAGES)
def test_what_a_service_sends_may_get_fields_and_what_it_is_sent_is_read_strictly(name):
    schema = wire.schema(wire.MESSAGES[name])
    objects = [schema, *schema.get("$defs", {}).values()]

    assert {one.get("additionalProperties") is False for one in objects} == {name in REQUESTS}


@pytest.mark.parametrize("name", wire.MESSAGES)
def test_every_reference_in_a_schema_leads_somewhere(name):
    schema = wire.schema(wire.MESSAGES[name])
    text = json.dumps(schema)

    for definition in text.split('"#/$defs/')[1:]:
        assert definition.partition('"')[0] in schema["$defs"]


@pytest.mark.parametrize(
    "name", ["estimate", "activity", "friction", "drives", "safety", "events", "health"]
)
def test_every_message_out_says_where_it_comes_from(name):
    assert set(HEAD) <= set(wire.schema(wire.MESSAGES[name])["required"])


@pytest.mark.parametrize("name", ["estimate", "activity", "friction"])
def test_every_estimated_number_has_its_standard_deviation_and_may_be_null(name):
    schema = wire.schema(wire.MESSAGES[name])
    (axis,) = schema["$defs"].values()
    estimated = [key.removesuffix("_std") for key in axis["properties"] if key.endswith("_std")]

    assert estimated
    for key in estimated:
        assert {"type": "null"} in axis["properties"][key]["anyOf"]
    assert "validity" in axis["properties"]
    assert "status" in schema["properties"]


def test_the_words_of_the_observer_are_the_observers():
    assert {bit.name: 1 << number for number, bit in enumerate(StatusBit)} == {
        bit.name: bit.value for bit in status.Status
    }
    assert {v.name: number for number, v in enumerate(Validity)} == {
        v.name: v.value for v in status.Validity
    }
    assert STATE_COUNT * (STATE_COUNT + 1) // 2 == COVARIANCE_COUNT


def test_the_states_of_the_drives_are_the_masters():
    assert [state.name.lower() for state in PowerState] == list(POWER_STATES)
    assert [int(state) for state in PowerState] == list(range(len(POWER_STATES)))
    assert {int(state): state.name.lower() for state in NmtState} == NMT_STATES


def test_a_refusal_of_another_version_keeps_its_code_and_loses_values_without_names():
    values = ("mode", "gait", "of_a_later_version", 1.0)

    named = values_of(Event(EventCode.REQUEST_REFUSED, values=values))

    assert named == {"request": "mode", "mode": "gait", "refusal": "of_a_later_version"}


def test_an_activity_is_this_json():
    hip = wire.AxisActivity(
        validity="ok",
        patient=8.5,
        patient_std=0.5,
        patient_power_w=4.25,
        patient_power_w_std=0.3,
        net=6.0,
        net_std=0.4,
        tremor_frequency_hz=5.0,
        tremor_amplitude=2.5,
    )
    slide = wire.AxisActivity(
        validity="split_unobservable",
        patient=None,
        patient_std=None,
        patient_power_w=None,
        patient_power_w_std=None,
        net=12.0,
        net_std=1.5,
        tremor_frequency_hz=None,
        tremor_amplitude=None,
    )
    message = wire.Activity(
        **HEAD,
        leg="right",
        mode="gait",
        status=("valid",),
        status_bits="0x0001",
        hip=hip,
        slide=slide,
        patient_power_w=None,
        patient_power_w_std=None,
        gait_phase_ratio=0.25,
    )

    assert msgspec.json.encode(message) == (
        b'{"seq":7,"core_boot_id":"b","cycle":41,"sample_time_ns":1760000000410000000,'
        b'"leg":"right","mode":"gait","status":["valid"],"status_bits":"0x0001",'
        b'"hip":{"validity":"ok","patient":8.5,"patient_std":0.5,'
        b'"patient_power_w":4.25,"patient_power_w_std":0.3,"net":6.0,"net_std":0.4,'
        b'"tremor_frequency_hz":5.0,"tremor_amplitude":2.5},'
        b'"slide":{"validity":"split_unobservable","patient":null,"patient_std":null,'
        b'"patient_power_w":null,"patient_power_w_std":null,"net":12.0,"net_std":1.5,'
        b'"tremor_frequency_hz":null,"tremor_amplitude":null},'
        b'"patient_power_w":null,"patient_power_w_std":null,"gait_phase_ratio":0.25}'
    )


def test_a_friction_is_this_json():
    hip = wire.AxisFriction(
        validity="ok", friction=2.5, friction_std=0.5, drift_correlation=-0.5, friction_error=0.25
    )
    slide = wire.AxisFriction(
        validity="ok", friction=-20.0, friction_std=2.0, drift_correlation=None, friction_error=None
    )
    message = wire.Friction(
        **HEAD,
        leg="left",
        mode="hold",
        status=("valid", "near_limit"),
        status_bits="0x2001",
        hip=hip,
        slide=slide,
    )

    assert msgspec.json.encode(message) == (
        b'{"seq":7,"core_boot_id":"b","cycle":41,"sample_time_ns":1760000000410000000,'
        b'"leg":"left","mode":"hold","status":["valid","near_limit"],"status_bits":"0x2001",'
        b'"hip":{"validity":"ok","friction":2.5,"friction_std":0.5,'
        b'"drift_correlation":-0.5,"friction_error":0.25},'
        b'"slide":{"validity":"ok","friction":-20.0,"friction_std":2.0,'
        b'"drift_correlation":null,"friction_error":null}}'
    )


def test_a_reader_ignores_fields_that_it_does_not_know():
    text = b'{"seq":1,"core_boot_id":null,"cycle":null,"sample_time_ns":null,"request":"stop",'
    text += b'"outcome":"done","mode":null,"added_later":[1,2]}'

    assert msgspec.json.decode(text, type=wire.Reply).outcome == "done"


SETPOINT = '{"lease":1,"seq":5,"for_cycle":40,"hip":{"assist":%s},"slide":{"assist":0.0}%s}'


def test_a_setpoint_is_read():
    read = msgspec.json.decode(SETPOINT % ("-3.5", ""), type=wire.SetpointMessage)

    assert (read.hip.assist, read.for_cycle) == (-3.5, 40)


@pytest.mark.parametrize(
    "text",
    [
        SETPOINT % ("NaN", ""),
        SETPOINT % ("1e999", ""),
        SETPOINT % ("1501", ""),
        SETPOINT % ("null", ""),
        SETPOINT % ('"1"', ""),
        SETPOINT % ("1", ',"torque":3'),
        '{"lease":1,"seq":5,"for_cycle":40,"hip":{"assist":1.0}}',
        '{"lease":1,"seq":5,"for_cycle":40,"hip_assist_nm":1.0,"slide_assist_n":0.0}',
    ],
)
def test_a_setpoint_that_is_not_exactly_one_is_refused(text):
    with pytest.raises(msgspec.MsgspecError):
        msgspec.json.decode(text, type=wire.SetpointMessage)


def test_keys_and_encodings_are_those_of_the_design():
    assert wire.key("trainer", "right", "activity") == "gaitd/trainer/right/activity"
    assert wire.encoding(wire.Activity) == "application/json;gaitd.activity.v1"
    assert wire.encoding(wire.DriveState) == "application/json;gaitd.drives.v1"
