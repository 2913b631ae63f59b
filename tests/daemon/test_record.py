"""What a struct of the channel says where nothing is given, and which bytes are refused."""

import msgspec
import pytest
from gaitd_names import Cause, EventCode, Finding, ProgressCode, RefusalCode, StopCategory
from hypothesis import given
from hypothesis import strategies as st
from records import drive, leg, record

from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import (
    STATE_COUNT,
    TEXT_BYTES_MAX,
    AssistRecord,
    AxisRecord,
    AxisStrideRecord,
    BusRecord,
    EmergencyRecord,
    GatewayState,
    LegRecord,
    ModeRequest,
    Plan,
    Request,
    RequestResult,
    Setpoint,
    StrideRecord,
    Verdict,
    clipped,
)
from daemon.ipc.report import EVENTS_MAX, SAID_BYTES_MAX, Event, Progress, Refusal

AXIS = AxisRecord(1, 2, 3)
STRIDE_AXIS = AxisStrideRecord(*range(15))
FLAGS = "true,false,true"
NO_VERDICT = '["none","none","",0.0,0.0,"none",""]'
NO_REQUEST = '[0,"none",0,["hold",0.0,0.0,0.0,"","",false,false],"display",null]'
NO_AXIS = "[1,2,3,0.0,0.0,2" + ",null" * 11 + ",0.0,null,null,null]"
NO_BUS = '["active",0,0,0,0,0,0,0,0,0.0]'


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (Verdict(), NO_VERDICT),
        (ModeRequest(), '["hold",0.0,0.0,0.0,"","",false,false]'),
        (Plan(1, 2, 3), "[1,2,3,[null],[null]]"),
        (Request(), NO_REQUEST),
        (Setpoint(), '[0,0,0,[0.0],[0.0],"",1.0]'),
        (GatewayState("b", 1, 2, 3), f'["b",1,2,3,{NO_REQUEST},[],0,"display"]'),
        (RequestResult(), '[0,"pending",null]'),
        (AssistRecord(), '[0,{},0,"none"]'),
        (BusRecord(), NO_BUS),
        (CycleTiming(1, 2, 3, 4), "[1,2,3,4,0,0,{}]"),
        (Event(EventCode.STOPPED), '["stopped","",[],""]'),
        (Refusal(RefusalCode.STOPPED), '["stopped","",[],""]'),
        (Progress(ProgressCode.EXERCISING), '["exercising","",[]]'),
        (AXIS, NO_AXIS),
        (
            EmergencyRecord(1, 2, "ff", "a", "b", *(True, False, True)),
            f'[1,2,"ff","a","b",{FLAGS}]',
        ),
        (
            StrideRecord(*range(1, 6), STRIDE_AXIS, STRIDE_AXIS, *range(6), 1, False),
            "[1,2,3,4,5" + f",{list(range(15))}".replace(" ", "") * 2 + ",0,1,2,3,4,5,1,false]",
        ),
        (
            LegRecord("n", AXIS, AXIS, 1),
            f'["n",{NO_AXIS},{NO_AXIS},1,[],null,null,-1.0,1.0,-1,null]',
        ),
    ],
)
def test_what_is_not_given_reads_as_nothing(made, text):
    assert msgspec.json.encode(made).decode() == text


def test_what_an_older_record_does_not_have_reads_as_nothing():
    assert msgspec.json.encode(drive("a")).endswith(b",0,false,[]]")
    assert (
        msgspec.json.encode(record(1))
        .decode()
        .endswith(f'[10000,500000,300000,0,0,0,{{}}],0.0,0,{NO_BUS},[0,{{}},0,"none"],null,false]')
    )


def test_a_leg_has_its_axes_in_the_order_hip_slide_and_a_verdict_its_values_in_that_of_its_event():
    one = leg("right")
    verdict = Verdict(
        *(StopCategory.S1, Cause.BUS_OFF, "right/hip", 1.0, 2.0, Finding.NO_SAMPLE, "words")
    )

    assert one.axes == (one.hip, one.slide)
    assert verdict.values == (StopCategory.S1, Cause.BUS_OFF, 1.0, 2.0, Finding.NO_SAMPLE)


@pytest.mark.parametrize(
    ("state", "is_valid"),
    [
        (("b" * 64, 2**63 - 1, 0, 0), True),
        (("b" * 65, 0, 0, 0), False),
        (("b", 2**63, 0, 0), False),
        (("b", -1, 0, 0), False),
        (("b", 0, 0, 0, Request(), (Setpoint(),) * 8), True),
        (("b", 0, 0, 0, Request(), (Setpoint(),) * 9), False),
    ],
)
def test_a_gateway_state_beyond_its_bounds_is_refused_and_counted(state, is_valid):
    decoder = Decoder(msgspec.msgpack.Decoder(GatewayState).decode)
    try:
        decoder.decode(msgspec.msgpack.encode(state))
    except RefusedError as error:
        assert isinstance(error.__cause__, msgspec.ValidationError)
        assert str(error) == str(error.__cause__)

    assert decoder.refused_count == (not is_valid)


@pytest.mark.parametrize("error", [UnicodeDecodeError("utf-8", b"", 0, 1, ""), RecursionError()])
def test_what_a_library_raises_besides_its_own_error_is_refused_too_and_has_a_reason(error):
    def decode(_data):
        raise error

    decoder = Decoder(decode)
    for count in (1, 2):
        with pytest.raises(RefusedError, match=r"."):
            decoder.decode(b"")
        assert decoder.refused_count == count


def test_a_bug_of_ours_is_not_invalid_bytes():
    with pytest.raises(TypeError):
        Decoder(len).decode(None)


def test_what_is_said_has_the_size_that_slots_were_made_for():
    assert (TEXT_BYTES_MAX, SAID_BYTES_MAX, EVENTS_MAX, STATE_COUNT) == (400, 160, 8, 8)
    assert (clipped("x" * 401), clipped("\u00e4" * 3, 3)) == ("x" * 400, "\u00e4")


@given(text=st.text(st.characters(), max_size=900), most=st.integers(0, TEXT_BYTES_MAX))
def test_a_clipped_text_is_a_beginning_that_fits(text, most):
    said = clipped(text, most)

    assert len(said.encode()) <= most
    whole = text.encode(errors="replace")
    assert whole.startswith(said.encode())
    assert len(whole) > most or said.encode() == whole


@pytest.mark.parametrize("text", ["\ud83d", "a\udcff"])
def test_what_is_no_text_is_made_one(text):
    assert clipped(text).encode()
