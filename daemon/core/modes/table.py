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
from dataclasses import dataclass
from enum import Enum

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
    BRING_UP_ANEW = "other limits for the drives"
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
    (Mode.READY, Event.BRING_UP_ANEW): Mode.OFF,
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

_EVENT_OF_MODE = {
    Mode.HOLD: Event.TO_HOLD,
    Mode.GAIT: Event.TO_GAIT,
    Mode.TORQUE: Event.TO_TORQUE,
    Mode.EXCITE: Event.TO_EXCITE,
    Mode.HAND_GUIDING: Event.TO_HAND_GUIDING,
    Mode.SELF_TEST: Event.TO_SELF_TEST,
    Mode.REFERENCE: Event.TO_REFERENCE,
    Mode.COMMISSION: Event.TO_COMMISSION,
}


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
        return _EVENT_OF_MODE.get(wanted.mode)
    return _EVENT_OF_KIND.get(kind)


@dataclass(frozen=True, slots=True)
class GuardInputs:
    """Inputs of the guards, collected in the cycle of the request."""

    mode: Mode
    gateway_alive: bool
    at_rest: bool
    hand_switch_closed: bool
    sto_released: bool
    unreferenced: tuple[str, ...]
    """Names of the axes without a valid position, with the reason."""
    outside: tuple[str, ...]
    """Names of the axes outside their range, and of the legs near their singularity."""
    drives_powered: bool
    """All drives are enabled and their static load has been compared."""
    cadence_max_hz: float
    scenarios: Mapping[str, float]
    """Excite scenarios by name, with their longest duration in s."""
    artificial: frozenset[str]
    """Names of the scenarios with an artificial disturbance."""
    patient_configured: bool
    guidance: str
    unproven: tuple[str, ...] = ()
    """Names of the axes whose sign must be proven and is not."""
    lease_held: bool = False
    """A controller holds the lease, according to the gateway."""
    inputs_unseen: tuple[str, ...] = ()
    """The states of hand switch and STO still to be observed in the daily test, where required."""
    self_test_due: str = ""
    """The reason why a self-test must come before any motion; empty if none is due."""
    unsampled: tuple[str, ...] = ()
    """Names of the axes without a complete sample in this cycle: their standstill is unknown."""
    lost: frozenset[str] = frozenset()
    """Names of the axes whose drive is silent or got NMT stop: the next bring-up checks them."""


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
    if event in {Event.TO_REFERENCE, Event.TO_COMMISSION}:
        return "" if wanted.witnessed else _refuse_preparation(now)
    if event == Event.TO_TORQUE and now.guidance == "position":
        return "assist is refused: with guidance 'position' the drives give the torque"
    if event in _FROM_HOLD and not now.drives_powered:
        return "the drives are not holding yet"
    if event in _TESTED and now.self_test_due:
        return f"{now.self_test_due}: `gaitd self-test`"
    if event == Event.TO_TORQUE:
        return "" if now.lease_held else "mode torque needs a lease, and nobody holds one"
    if event == Event.TO_GAIT:
        return _refuse_gait(wanted, now)
    if event == Event.TO_EXCITE:
        return _refuse_excite(wanted, now)
    return ""


_FROM_HOLD = frozenset(
    {Event.TO_GAIT, Event.TO_TORQUE, Event.TO_EXCITE, Event.TO_HAND_GUIDING, Event.TO_SELF_TEST}
)
_TESTED = frozenset({Event.TO_GAIT, Event.TO_TORQUE, Event.TO_EXCITE})
"""Events that need a passed self-test because they move a leg.

HAND_GUIDING does not need one: the patient may have to get out.
"""


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
    if now.inputs_unseen:
        return f"not seen to act today: {', '.join(now.inputs_unseen)}"
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
    unsampled = [name for name in now.unsampled if name not in now.lost]
    if now.mode == Mode.FAULT and unsampled:
        return _not_sampled(unsampled)
    if now.mode == Mode.FAULT and not now.at_rest:
        return "the leg is moving"
    if now.mode == Mode.FAULT and not now.hand_switch_closed:
        return "the hand switch is open"
    if now.mode == Mode.FAULT and not now.sto_released:
        return "safe torque off is active"
    return ""


def _refuse_gait(wanted: ModeRequest, now: GuardInputs) -> str:
    if not CADENCE_MIN_HZ <= wanted.cadence_hz <= now.cadence_max_hz:
        allowed = f"{CADENCE_MIN_HZ:g} to {now.cadence_max_hz:g}"
        return f"cadence_hz = {wanted.cadence_hz:g}, allowed {allowed}"
    if not 0 < wanted.amplitude_ratio <= 1:
        return f"amplitude_ratio = {wanted.amplitude_ratio:g}, allowed > 0 and <= 1"
    if not 0 < wanted.duration_s <= DURATION_MAX_S:
        return f"duration_s = {wanted.duration_s:g}, allowed > 0 and <= {DURATION_MAX_S:g}"
    return ""


CADENCE_MIN_HZ = 0.02
"""Lowest cadence: a gait ends with a whole stride, which must not take longer than 50 s."""
DURATION_MAX_S = 3600.0
"""Longest gait of one request, s."""


def _refuse_excite(wanted: ModeRequest, now: GuardInputs) -> str:
    longest_s = now.scenarios.get(wanted.scenario)
    if longest_s is None:
        known = ", ".join(sorted(now.scenarios))
        return f"scenario = {wanted.scenario!r}, configured are: {known}"
    if not 0 < wanted.duration_s <= longest_s:
        return f"duration_s = {wanted.duration_s:g}, allowed > 0 and <= {longest_s:g}"
    if wanted.scenario in now.artificial and now.patient_configured:
        return (
            "an artificial disturbance is only for the empty machine, and a patient is configured"
        )
    if wanted.scenario in now.artificial and now.lease_held:
        return "an artificial disturbance would mislead the controller that holds the lease"
    return ""
