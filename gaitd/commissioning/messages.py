"""What goes into the procedure and what comes out of it: codes and numbers, no text.

In: `Observation`. Out: `Instruction` to the operator, `Request` and `ReadObjects` to the service
and its bus, and for the record `Finding` and `StopTrace` (`analysis/acceptance/record.py`).
"""

from collections.abc import Sequence
from enum import StrEnum, auto
from typing import Final, NamedTuple

from gaitd_client import Reply, wire

from analysis.acceptance.record import (
    NO_VALUES,
    Finding,
    Judgement,
    Report,
    Service,
    StopTrace,
    Values,
)
from daemon.ipc.record import CycleRecord

PASSED_OR_FAILED: Final = {True: Judgement.PASSED, False: Judgement.FAILED}

# --- in -------------------------------------------------------------------------------------------


class Answer(NamedTuple):
    """What the operator has answered; None: no answer can be had."""

    value: bool | float | None


class Observation(NamedTuple):
    """What has been received since the last one."""

    now_s: float = 0.0
    """Time of the newest record, or of the message."""
    service: Service = Service()
    records: Sequence[CycleRecord] = ()
    """All that are kept, the newest last; none if the service is on another computer."""
    reports: tuple[Report, ...] = ()
    progress: wire.Progress | None = None
    """What the service does; it is passed on to the operator."""
    is_silent: bool = False
    """Nothing is received any more: what is waited for does not come."""
    reply: Reply | None = None
    answer: Answer | None = None
    objects: tuple[Finding, ...] = ()


# --- out ------------------------------------------------------------------------------------------


class Expects(StrEnum):
    """What an instruction waits for."""

    CONSENT = auto()
    """Before something moves."""
    ACTION = auto()
    """Something that the operator does by hand."""
    SIGHT = auto()
    NUMBER = auto()


class InstructionCode(StrEnum):
    """What the operator is to do or to know."""

    PUSH_AXIS = auto()
    WATCH_AXIS = auto()
    WAS_SEEN = auto()
    MOVE_TO_MARK = auto()
    MOVE_TO_SECOND_MARK = auto()
    DISTANCE = auto()
    HOME_AXIS = auto()
    SELF_TEST = auto()
    SELF_TEST_BEGINS = auto()
    WALK = auto()
    OPEN_HAND_SWITCH_NOW = auto()
    PRESS_STO_NOW = auto()
    HOLD_HAND_SWITCH = auto()
    RELEASE_HAND_SWITCH = auto()
    PRESS_STO = auto()
    RELEASE_STO = auto()
    KEEP_STILL = auto()
    WAIT = auto()
    STO_SEEN = auto()
    LEFT_STOPPED = auto()
    MAY_NOT_HAVE_STOPPED = auto()
    WRITTEN = auto()


EXPECTED: Final = {
    InstructionCode.PUSH_AXIS: Expects.CONSENT,
    InstructionCode.HOME_AXIS: Expects.CONSENT,
    InstructionCode.SELF_TEST: Expects.CONSENT,
    InstructionCode.WALK: Expects.CONSENT,
    InstructionCode.MOVE_TO_MARK: Expects.ACTION,
    InstructionCode.MOVE_TO_SECOND_MARK: Expects.ACTION,
    InstructionCode.WAS_SEEN: Expects.SIGHT,
    InstructionCode.DISTANCE: Expects.NUMBER,
}
"""Instructions that wait for something; the others are only shown."""


class Instruction(NamedTuple):
    """What the operator is to do or to know."""

    code: InstructionCode
    subject: str = ""
    """LEG or LEG/AXIS; empty if it is about none."""
    values: Values = NO_VALUES
    service: Service = Service()
    refusal: wire.Refusal | None = None


class Request(NamedTuple):
    """A request to the service, as `Trainer.request` has it."""

    name: str
    arguments: Values = NO_VALUES


class ReadObjects(NamedTuple):
    """Read the objects of a drive beside the service."""

    drive: str
    is_set_up: bool
    """Bring-up has written its objects; else only what it checks is judged."""


Output = Instruction | Request | ReadObjects | Finding | StopTrace
