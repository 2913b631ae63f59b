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

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Final, NamedTuple

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
from daemon.ipc.record import Mode, ModeRequest, RequestKind


class Event(Enum):
    """Events that may change the mode."""

    BRING_UP_BEGUN = "bring-up begun"
    BRING_UP_DONE = "bring-up done"
    STILL_LATCHED = "latched before this start"
    DRIVES_LOST = "drives lost"
    """A drive or the bus was lost while no drive was enabled."""
    DRIVE_FAULTY = "drive faulty"
    ENABLE = "enable"
    DISABLE = "disable"
    RESET = "reset"
    TO_HOLD = "mode hold"
    TO_GAIT = "mode gait"
    TO_TORQUE = "mode torque"
    TO_EXCITE = "mode excite"
    TO_HAND_GUIDING = "mode hand_guiding"
    TO_SELF_TEST = "mode self_test"
    TO_REFERENCE = "mode reference"
    TO_COMMISSION = "mode commission"
    BRING_UP_RESTARTED = "other limits for the drives"
    EXERCISE_OVER = "exercise over"
    LEASE_LAPSED = "assist lapsed"
    """The lease of the assist in force has ended, or its setpoints are stale."""
    STOP = "stop"
    AT_REST_WELL = "at rest, as asked"
    AT_REST_STOPPED = "at rest, by a verdict"


TRANSITIONS: Mapping[tuple[Mode, Event], Mode] = {
    (Mode.OFF, Event.BRING_UP_BEGUN): Mode.BRINGING_UP,
    (Mode.BRINGING_UP, Event.BRING_UP_DONE): Mode.READY,
    (Mode.BRINGING_UP, Event.STILL_LATCHED): Mode.FAULT,
    (Mode.BRINGING_UP, Event.DRIVES_LOST): Mode.OFF,
    (Mode.BRINGING_UP, Event.DRIVE_FAULTY): Mode.FAULT,
    (Mode.READY, Event.ENABLE): Mode.HOLD,
    (Mode.READY, Event.RESET): Mode.OFF,
    (Mode.READY, Event.BRING_UP_RESTARTED): Mode.OFF,
    (Mode.READY, Event.TO_REFERENCE): Mode.REFERENCE,
    (Mode.READY, Event.TO_COMMISSION): Mode.COMMISSION,
    (Mode.READY, Event.DRIVES_LOST): Mode.OFF,
    (Mode.READY, Event.DRIVE_FAULTY): Mode.FAULT,
    (Mode.READY, Event.STOP): Mode.STOPPING,
    (Mode.HOLD, Event.TO_GAIT): Mode.GAIT,
    (Mode.HOLD, Event.TO_TORQUE): Mode.TORQUE,
    (Mode.HOLD, Event.TO_EXCITE): Mode.EXCITE,
    (Mode.HOLD, Event.TO_HAND_GUIDING): Mode.HAND_GUIDING,
    (Mode.HOLD, Event.TO_SELF_TEST): Mode.SELF_TEST,
    (Mode.HOLD, Event.DISABLE): Mode.STOPPING,
    (Mode.HOLD, Event.STOP): Mode.STOPPING,
    (Mode.GAIT, Event.TO_HOLD): Mode.HOLD,
    (Mode.GAIT, Event.EXERCISE_OVER): Mode.HOLD,
    (Mode.GAIT, Event.LEASE_LAPSED): Mode.HOLD,
    (Mode.GAIT, Event.DISABLE): Mode.STOPPING,
    (Mode.GAIT, Event.STOP): Mode.STOPPING,
    (Mode.TORQUE, Event.TO_HOLD): Mode.HOLD,
    (Mode.TORQUE, Event.EXERCISE_OVER): Mode.HOLD,
    (Mode.TORQUE, Event.LEASE_LAPSED): Mode.HOLD,
    (Mode.TORQUE, Event.DISABLE): Mode.STOPPING,
    (Mode.TORQUE, Event.STOP): Mode.STOPPING,
    (Mode.EXCITE, Event.TO_HOLD): Mode.HOLD,
    (Mode.EXCITE, Event.EXERCISE_OVER): Mode.HOLD,
    (Mode.EXCITE, Event.DISABLE): Mode.STOPPING,
    (Mode.EXCITE, Event.STOP): Mode.STOPPING,
    (Mode.HAND_GUIDING, Event.TO_HOLD): Mode.HOLD,
    (Mode.HAND_GUIDING, Event.EXERCISE_OVER): Mode.HOLD,
    (Mode.HAND_GUIDING, Event.DISABLE): Mode.STOPPING,
    (Mode.HAND_GUIDING, Event.STOP): Mode.STOPPING,
    (Mode.SELF_TEST, Event.TO_HOLD): Mode.HOLD,
    (Mode.SELF_TEST, Event.EXERCISE_OVER): Mode.HOLD,
    (Mode.SELF_TEST, Event.DISABLE): Mode.STOPPING,
    (Mode.SELF_TEST, Event.STOP): Mode.STOPPING,
    (Mode.REFERENCE, Event.EXERCISE_OVER): Mode.STOPPING,
    (Mode.REFERENCE, Event.DISABLE): Mode.STOPPING,
    (Mode.REFERENCE, Event.STOP): Mode.STOPPING,
    (Mode.COMMISSION, Event.EXERCISE_OVER): Mode.STOPPING,
    (Mode.COMMISSION, Event.DISABLE): Mode.STOPPING,
    (Mode.COMMISSION, Event.STOP): Mode.STOPPING,
    (Mode.STOPPING, Event.AT_REST_WELL): Mode.READY,
    (Mode.STOPPING, Event.AT_REST_STOPPED): Mode.FAULT,
    (Mode.FAULT, Event.RESET): Mode.OFF,
}

_EVENT_OF_KIND = {
    RequestKind.ENABLE: Event.ENABLE,
    RequestKind.DISABLE: Event.DISABLE,
    RequestKind.RESET: Event.RESET,
}


class ModeRules(NamedTuple):
    """What is particular to a mode that a client can request."""

    event: Event
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
    Mode.HOLD: ModeRules(Event.TO_HOLD, Hold),
    Mode.GAIT: ModeRules(
        Event.TO_GAIT, Gait, takes_assist=True, is_guided_motion=True, needs_self_test=True
    ),
    Mode.TORQUE: ModeRules(
        Event.TO_TORQUE,
        Torque,
        by_torque=True,
        needs_impedance=True,
        takes_assist=True,
        needs_self_test=True,
    ),
    Mode.EXCITE: ModeRules(Event.TO_EXCITE, Excite, by_torque=True, needs_self_test=True),
    Mode.HAND_GUIDING: ModeRules(Event.TO_HAND_GUIDING, HandGuiding, by_torque=True),
    Mode.SELF_TEST: ModeRules(Event.TO_SELF_TEST, SelfTest, by_torque=True, is_guided_motion=True),
    Mode.REFERENCE: ModeRules(Event.TO_REFERENCE, single_axis=Homing),
    Mode.COMMISSION: ModeRules(Event.TO_COMMISSION, single_axis=SignTest),
}
"""The modes that a client can request; `Mode` has more, which the core enters by itself."""
NO_RULES: Final = ModeRules(Event.STOP)
"""For the modes that cannot be requested."""


def rules_of(mode: Mode) -> ModeRules:
    """The rules of a mode; nothing is allowed in one that cannot be requested."""
    return MODES.get(mode, NO_RULES)


class IllegalTransitionError(Exception):
    """The core tried a transition that has no row: a programming error."""


def next_mode(mode: Mode, event: Event) -> Mode:
    """The mode after an event, from the table.

    Raises:
        IllegalTransitionError: the table has no such row.
    """
    try:
        return TRANSITIONS[mode, event]
    except KeyError as error:
        raise IllegalTransitionError(f"no transition for {event.value!r} in {mode.name}") from error


def event_of(kind: RequestKind, wanted: ModeRequest) -> Event | None:
    """The event of a request; None if its mode cannot be requested."""
    if kind == RequestKind.MODE:
        rules = MODES.get(wanted.mode)
        return None if rules is None else rules.event
    return _EVENT_OF_KIND.get(kind)


def refusal(kind: RequestKind, wanted: ModeRequest, now: GuardInputs) -> str:
    """The reason why a request is refused; empty if it is allowed."""
    event = event_of(kind, wanted)
    if event is None:
        return f"{wanted.mode.name.lower()} is not a mode that can be asked for"
    if (now.mode, event) not in TRANSITIONS:
        return f"{event.value!r} is not possible in mode {now.mode.name.lower()}"
    if event == Event.ENABLE:
        return _refuse_enable(now)
    if event == Event.RESET:
        return _refuse_reset(now)
    if event in {Event.DISABLE, Event.TO_HOLD}:
        return ""
    rules = MODES[wanted.mode]
    if rules.exercise is None:
        return "" if wanted.witnessed else _refuse_preparation(now)
    if rules.needs_impedance and now.guidance == "position":
        return "assist is refused: with guidance 'position' the drives give the torque"
    if not now.drives_powered:
        return "the drives are not holding yet"
    if rules.needs_self_test and now.self_test_due:
        return f"{now.self_test_due}: `gaitd self-test`"
    return rules.exercise.refuse(wanted, now)


def _refuse_enable(now: GuardInputs) -> str:
    if not now.gateway_alive:
        return "the gateway is not alive"
    if not now.hand_switch_closed:
        return "the hand switch is open"
    if not now.sto_released:
        return "safe torque off is active"
    if now.unproven:
        names = ", ".join(now.unproven)
        return f"the sign is not proven: {names}: run `gaitd commission` for each"
    if now.unreferenced:
        return f"not referenced: {', '.join(now.unreferenced)}"
    if now.inputs_untested:
        return f"not seen to act today: {', '.join(now.inputs_untested)}"
    if now.unsampled:
        return _not_sampled(now.unsampled)
    if not now.at_rest:
        return "the leg is moving"
    if now.outside:
        return f"outside its range: {', '.join(now.outside)}"
    return ""


def _refuse_preparation(now: GuardInputs) -> str:
    if now.patient_configured:
        return "one axis alone is moved in the empty machine, and a patient is configured"
    if not now.gateway_alive:
        return "the gateway is not alive"
    if not now.hand_switch_closed:
        return "the hand switch is open"
    if not now.sto_released:
        return "safe torque off is active"
    if now.unsampled:
        return _not_sampled(now.unsampled)
    return "" if now.at_rest else "the leg is moving"


def _not_sampled(axes: Iterable[str]) -> str:
    return f"no sample of this cycle: {', '.join(axes)}: ask again"


def _refuse_reset(now: GuardInputs) -> str:
    if now.mode == Mode.READY:
        return ""
    unsampled = [name for name in now.unsampled if name not in now.lost]
    if unsampled:
        return _not_sampled(unsampled)
    if not now.at_rest:
        return "the leg is moving"
    if not now.hand_switch_closed:
        return "the hand switch is open"
    return "" if now.sto_released else "safe torque off is active"
