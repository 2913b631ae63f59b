"""Enums whose members are values of events, refusals and progress, by the name of the value."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from gaitd_names import (
    AxisStep,
    Cause,
    CyclePart,
    Doubt,
    Failure,
    Finding,
    Mode,
    MotionPhase,
    RefusalCode,
    RequestKind,
    Role,
    SelfTestDue,
    Stage,
    StopCategory,
    Trigger,
    Untested,
)

ENUMS: Final[Mapping[str, type[StrEnum]]] = {
    "category": StopCategory,
    "cause": Cause,
    "doubt": Doubt,
    "failure": Failure,
    "finding": Finding,
    "mode": Mode,
    "mode_before": Mode,
    "mode_now": Mode,
    "open_request": RequestKind,
    "part": CyclePart,
    "phase": MotionPhase,
    "refusal": RefusalCode,
    "request": RequestKind,
    "role": Role,
    "self_test_due": SelfTestDue,
    "stage": Stage,
    "step": AxisStep,
    "trigger": Trigger,
    "untested": Untested,
}
