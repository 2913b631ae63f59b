"""The screen of `gaitd status` says that a leg is held only where each drive says that it can."""

import display_bench as bench
import pytest
from gaitd_client import DriveState, wire
from gaitd_names import Cause, Mode, StopCategory
from gaitd_texts import Reader, catalogue

from gaitd.status import lines

TEXTS = catalogue(Reader.OPERATOR, "en")


def drive(power="operation_enabled", *, fresh=True):
    return bench.filled(DriveState, name="right/hip", fresh=fresh, power_state=power)


@pytest.mark.parametrize(
    ("drives", "situation"),
    [
        ((drive(), drive("quick_stop_active")), "held"),
        ((drive(), drive("fault")), "loose"),
        ((drive(), drive(fresh=False)), "loose"),
        ((), "loose"),
    ],
)
def test_a_leg_is_held_only_where_each_drive_says_so(drives, situation):
    verdict = bench.filled(wire.Judgement, category=StopCategory.S1, cause=Cause.SPASM)
    safety = bench.filled(wire.Safety, valid=True, mode=Mode.FAULT, verdict=verdict)
    status = bench.filled(wire.Status, safety=safety, drives=drives, legs=(), events=())

    assert TEXTS.text(f"first.{situation}") in "\n".join(lines(status, TEXTS))
