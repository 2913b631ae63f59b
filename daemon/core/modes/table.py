"""The modes of the service as a table of transitions, and the guards of requests.

Rules:
1. A transition is a row of `TRANSITIONS`; without a row it is impossible, and a request for it is
   refused with the mode's name.
2. Drives are enabled only by the request ENABLE in READY, and one axis at a time by the requests
   REFERENCE and COMMISSION in READY, which need the empty machine. Enabling, resetting a fault and
   enabling again are three requests. A restart, a drive's reboot or a cause that has disappeared
   never enables a drive.
3. A stop has no guard: every mode has a row for it, except where no drive is enabled or a stop is
   already under way.
4. A stop with a verdict ends in FAULT and stays there until RESET, also across a restart; DISABLE
   ends in READY.
5. TORQUE needs a lease that is held, and drives in torque mode. A lease that lapses, or setpoints
   that become stale, end it in HOLD; they end a gait only while assist or a stiffness scale is in
   force. This latches no verdict, because the drives are healthy.
6. Standstill of a leg is known from a sample of the cycle of the request. ENABLE needs a sample of
   every axis, RESET one of every axis whose drive is not lost: the next bring-up checks that drive.
7. Where a daily test is required, ENABLE is refused until hand switch and STO have been seen in
   both states, and only HAND_GUIDING and SELF_TEST may move a leg before a self-test has passed.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gaitd_names import Mode, RefusalCode, RequestKind, SelfTestDue, Trigger

from daemon.core.exercises.excite import Excite
from daemon.core.exercises.exercise import Exercise
from daemon.core.exercises.gait import Gait
from daemon.core.exercises.guards import GuardInputs
from daemon.core.exercises.hand_guiding import HandGuiding
from daemon.core.exercises.hold import Hold
from daemon.core.exercises.homing import Homing
from daemon.core.exercises.self_test import SelfTest
from daemon.core.exercises.sign_test import SignTest
from daemon.core.exercises.single_axis import SingleAxis
from daemon.core.exercises.torque import Torque
from daemon.ipc.record import ModeRequest
from daemon.ipc.report import Refusal

TRANSITIONS: Mapping[tuple[Mode, Trigger], Mode] = {
    (Mode.OFF, Trigger.BRING_UP_BEGUN): Mode.BRINGING_UP,
    (Mode.BRINGING_UP, Trigger.BRING_UP_DONE): Mode.READY,
    (Mode.BRINGING_UP, Trigger.STILL_LATCHED): Mode.FAULT,
    (Mode.BRINGING_UP, Trigger.DRIVES_LOST): Mode.OFF,
    (Mode.BRINGING_UP, Trigger.DRIVE_FAULTY): Mode.FAULT,
    (Mode.READY, Trigger.ENABLE): Mode.HOLD,
    (Mode.READY, Trigger.RESET): Mode.OFF,
    (Mode.READY, Trigger.BRING_UP_RESTARTED): Mode.OFF,
    (Mode.READY, Trigger.TO_REFERENCE): Mode.REFERENCE,
    (Mode.READY, Trigger.TO_COMMISSION): Mode.COMMISSION,
    (Mode.READY, Trigger.DRIVES_LOST): Mode.OFF,
    (Mode.READY, Trigger.DRIVE_FAULTY): Mode.FAULT,
    (Mode.READY, Trigger.STOP): Mode.STOPPING,
    (Mode.HOLD, Trigger.TO_GAIT): Mode.GAIT,
    (Mode.HOLD, Trigger.TO_TORQUE): Mode.TORQUE,
    (Mode.HOLD, Trigger.TO_EXCITE): Mode.EXCITE,
    (Mode.HOLD, Trigger.TO_HAND_GUIDING): Mode.HAND_GUIDING,
    (Mode.HOLD, Trigger.TO_SELF_TEST): Mode.SELF_TEST,
    (Mode.HOLD, Trigger.DISABLE): Mode.STOPPING,
    (Mode.HOLD, Trigger.STOP): Mode.STOPPING,
    (Mode.GAIT, Trigger.TO_HOLD): Mode.HOLD,
    (Mode.GAIT, Trigger.EXERCISE_OVER): Mode.HOLD,
    (Mode.GAIT, Trigger.LEASE_LAPSED): Mode.HOLD,
    (Mode.GAIT, Trigger.DISABLE): Mode.STOPPING,
    (Mode.GAIT, Trigger.STOP): Mode.STOPPING,
    (Mode.TORQUE, Trigger.TO_HOLD): Mode.HOLD,
    (Mode.TORQUE, Trigger.EXERCISE_OVER): Mode.HOLD,
    (Mode.TORQUE, Trigger.LEASE_LAPSED): Mode.HOLD,
    (Mode.TORQUE, Trigger.DISABLE): Mode.STOPPING,
    (Mode.TORQUE, Trigger.STOP): Mode.STOPPING,
    (Mode.EXCITE, Trigger.TO_HOLD): Mode.HOLD,
    (Mode.EXCITE, Trigger.EXERCISE_OVER): Mode.HOLD,
    (Mode.EXCITE, Trigger.DISABLE): Mode.STOPPING,
    (Mode.EXCITE, Trigger.STOP): Mode.STOPPING,
    (Mode.HAND_GUIDING, Trigger.TO_HOLD): Mode.HOLD,
    (Mode.HAND_GUIDING, Trigger.EXERCISE_OVER): Mode.HOLD,
    (Mode.HAND_GUIDING, Trigger.DISABLE): Mode.STOPPING,
    (Mode.HAND_GUIDING, Trigger.STOP): Mode.STOPPING,
    (Mode.SELF_TEST, Trigger.TO_HOLD): Mode.HOLD,
    (Mode.SELF_TEST, Trigger.EXERCISE_OVER): Mode.HOLD,
    (Mode.SELF_TEST, Trigger.DISABLE): Mode.STOPPING,
    (Mode.SELF_TEST, Trigger.STOP): Mode.STOPPING,
    (Mode.REFERENCE, Trigger.EXERCISE_OVER): Mode.STOPPING,
    (Mode.REFERENCE, Trigger.DISABLE): Mode.STOPPING,
    (Mode.REFERENCE, Trigger.STOP): Mode.STOPPING,
    (Mode.COMMISSION, Trigger.EXERCISE_OVER): Mode.STOPPING,
    (Mode.COMMISSION, Trigger.DISABLE): Mode.STOPPING,
    (Mode.COMMISSION, Trigger.STOP): Mode.STOPPING,
    (Mode.STOPPING, Trigger.AT_REST_WELL): Mode.READY,
    (Mode.STOPPING, Trigger.AT_REST_STOPPED): Mode.FAULT,
    (Mode.FAULT, Trigger.RESET): Mode.OFF,
}

_TRIGGER_OF_KIND = {
    RequestKind.ENABLE: Trigger.ENABLE,
    RequestKind.DISABLE: Trigger.DISABLE,
    RequestKind.RESET: Trigger.RESET,
}


class ModeRules(NamedTuple):
    """What is particular to a mode that a client can request."""

    trigger: Trigger
    exercise: type[Exercise] | None = None
    """What each leg does; None in the modes of a single axis."""
    single_axis: type[SingleAxis] | None = None
    by_torque: bool = False
    """The drives are in torque mode, also where the drives' position loops follow a gait."""
    needs_impedance: bool = False
    """It is refused with guidance by position."""
    takes_assist: bool = False
    """A controller may add torque and reduce the stiffness of guidance."""
    is_guided_motion: bool = False
    """A reference moves the leg: effort against it may be a spasm."""
    needs_self_test: bool = False
    """It is refused while a self-test is due, because it moves a leg.

    HAND_GUIDING does not need one: the patient may have to get out.
    """


MODES: Mapping[Mode, ModeRules] = {
    Mode.HOLD: ModeRules(Trigger.TO_HOLD, Hold),
    Mode.GAIT: ModeRules(
        Trigger.TO_GAIT, Gait, takes_assist=True, is_guided_motion=True, needs_self_test=True
    ),
    Mode.TORQUE: ModeRules(
        Trigger.TO_TORQUE,
        Torque,
        by_torque=True,
        needs_impedance=True,
        takes_assist=True,
        needs_self_test=True,
    ),
    Mode.EXCITE: ModeRules(Trigger.TO_EXCITE, Excite, by_torque=True, needs_self_test=True),
    Mode.HAND_GUIDING: ModeRules(Trigger.TO_HAND_GUIDING, HandGuiding, by_torque=True),
    Mode.SELF_TEST: ModeRules(
        Trigger.TO_SELF_TEST, SelfTest, by_torque=True, is_guided_motion=True
    ),
    Mode.REFERENCE: ModeRules(Trigger.TO_REFERENCE, single_axis=Homing),
    Mode.COMMISSION: ModeRules(Trigger.TO_COMMISSION, single_axis=SignTest),
}
"""The modes that a client can request; `Mode` has more, which the core enters by itself."""
NO_RULES: Final = ModeRules(Trigger.STOP)
"""For the modes that cannot be requested."""


def rules_of(mode: Mode) -> ModeRules:
    """The rules of a mode; nothing is allowed in one that cannot be requested."""
    return MODES.get(mode, NO_RULES)


class IllegalTransitionError(Exception):
    """The core tried a transition that has no row: a programming error."""


def next_mode(mode: Mode, trigger: Trigger) -> Mode:
    """The mode after a trigger, from the table.

    Raises:
        IllegalTransitionError: the table has no such row.
    """
    try:
        return TRANSITIONS[mode, trigger]
    except KeyError as error:
        raise IllegalTransitionError(f"no transition for {trigger.name} in {mode.name}") from error


def trigger_of(kind: RequestKind, wanted: ModeRequest) -> Trigger | None:
    """The trigger of a request; None if its mode cannot be requested."""
    if kind == RequestKind.MODE:
        rules = MODES.get(wanted.mode)
        return None if rules is None else rules.trigger
    return _TRIGGER_OF_KIND.get(kind)


def refusal(kind: RequestKind, wanted: ModeRequest, now: GuardInputs) -> Refusal | None:
    """The reason why a request is refused; None if it is allowed."""
    trigger = trigger_of(kind, wanted)
    if trigger is None:
        return Refusal(RefusalCode.NO_SUCH_MODE, values=(wanted.mode,))
    if (now.mode, trigger) not in TRANSITIONS:
        return Refusal(RefusalCode.NOT_IN_THIS_MODE, values=(trigger, now.mode))
    if trigger == Trigger.ENABLE:
        return _refuse_enable(now)
    if trigger == Trigger.RESET:
        return _refuse_reset(now)
    if trigger in {Trigger.DISABLE, Trigger.TO_HOLD}:
        return None
    rules = MODES[wanted.mode]
    if rules.exercise is None:
        return None if wanted.witnessed else _refuse_preparation(now)
    if rules.needs_impedance and now.guidance == "position":
        return Refusal(RefusalCode.GUIDANCE_BY_POSITION)
    if not now.drives_powered:
        return Refusal(RefusalCode.NOT_HOLDING_YET)
    if rules.needs_self_test and now.self_test_due is not SelfTestDue.NONE:
        return Refusal(RefusalCode.SELF_TEST_DUE, values=(now.self_test_due,))
    return rules.exercise.refuse(wanted, now)


def _refuse_enable(now: GuardInputs) -> Refusal | None:
    if (unsafe := _refuse_without_inputs(now)) is not None:
        return unsafe
    if now.unproven:
        return Refusal(RefusalCode.SIGN_NOT_PROVEN, now.unproven[0])
    if now.unreferenced:
        axis, doubt = now.unreferenced[0]
        return Refusal(RefusalCode.NOT_REFERENCED, axis, (doubt,))
    if now.inputs_untested:
        axis, state = now.inputs_untested[0]
        return Refusal(RefusalCode.INPUT_UNTESTED, axis, (state,))
    if (moving := _refuse_in_motion(now, now.unsampled)) is not None:
        return moving
    return Refusal(RefusalCode.OUTSIDE_RANGE, now.outside[0]) if now.outside else None


def _refuse_preparation(now: GuardInputs) -> Refusal | None:
    if now.patient_configured:
        return Refusal(RefusalCode.PATIENT_CONFIGURED)
    return _refuse_without_inputs(now) or _refuse_in_motion(now, now.unsampled)


def _refuse_reset(now: GuardInputs) -> Refusal | None:
    if now.mode == Mode.READY:
        return None
    unsampled = [name for name in now.unsampled if name not in now.lost]
    return _refuse_in_motion(now, unsampled) or _refuse_by_person(now)


def _refuse_without_inputs(now: GuardInputs) -> Refusal | None:
    return _refuse_by_person(now) if now.gateway_alive else Refusal(RefusalCode.GATEWAY_SILENT)


def _refuse_by_person(now: GuardInputs) -> Refusal | None:
    if not now.hand_switch_closed:
        return Refusal(RefusalCode.HAND_SWITCH_OPEN)
    return None if now.sto_released else Refusal(RefusalCode.STO_ACTIVE)


def _refuse_in_motion(now: GuardInputs, unsampled: Sequence[str]) -> Refusal | None:
    if unsampled:
        return Refusal(RefusalCode.NO_SAMPLE, unsampled[0])
    return None if now.at_rest else Refusal(RefusalCode.LEG_MOVES)
