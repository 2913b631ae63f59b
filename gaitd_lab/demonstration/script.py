"""The acts of the demonstration as generators.

An act receives a `Situation` several times a second and yields the next action, or None to wait. It
uses no clock, socket or process, so a test can run it without delay. An unexpected stop, a refusal
or missing messages end it with `ServiceError`.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, NamedTuple

import msgspec

from gaitd_lab.processes import ServiceError

READY_WITHIN_S: Final = 900.0
"""Time limit of the start; the first start compiles the observer's kernels: 40 s of an idle
processor, and many times that beside other programs.
"""
ENABLE_WITHIN_S: Final = 20.0
MOTION_WITHIN_S: Final = 40.0
"""Time limit from the request to the first stride: announcement and approach."""
END_MARGIN_S: Final = 30.0
"""Time limit after an exercise's duration: the last stride and the way to rest."""
DISABLE_WITHIN_S: Final = 20.0
HELP_WITHIN_S: Final = 60.0
"""Time limit for the controller's start, which the computer needs, in simulated time."""
ENABLE_AT_S: Final = 5.0
MOVE_AT_S: Final = 8.0
"""Time of the act. Requests are made at fixed instants, seconds after the event they wait for, so
that each run in simulated time has the same frames and the same errors.
"""
SILENCE_MAX_S: Final = 5.0
STOPPED: Final = frozenset({"stopping", "fault"})
UNPOWERED: Final = frozenset({"off", "bringing_up"})


class Training(msgspec.Struct, frozen=True):
    """What a patient's page shows of the session."""

    phase: str
    advice: str
    buttons: tuple[str, ...] = ()
    reason: str = ""


class Seen(msgspec.Struct, frozen=True):
    """What a patient sees."""

    mode: str | None = None
    training: Training | None = None


class Situation(NamedTuple):
    """Present state of the service, input of an act."""

    now_s: float
    """Time since the act began."""
    received_s: float | None
    """Time of the newest message of the service; None before the first."""
    mode: str | None
    verdict: str
    """Category, cause and place of the latched verdict; empty if there is none."""
    phase_ratio: float | None
    """Phase 0..1 of the stride; None while no gait is running."""
    artificial: bool
    """True during the excitation itself, not during the approach to it."""
    lease_holder: str | None = None
    """The controller that holds the lease."""
    outcome: str | None = None
    """Outcome of the last request, for example `refused`; None while it is pending."""
    reason: str = ""
    seen: Seen = Seen()
    """What the patient sees on the page of a training."""


class Ask(NamedTuple):
    """A request to the service over Zenoh."""

    name: str
    payload: dict[str, Any]


class Patient(NamedTuple):
    """Starts one of the scripted patient's programmes in the virtual drives."""

    programme: str


class Help(NamedTuple):
    """Starts the reference controller for assistance as needed."""


class HandSwitch(NamedTuple):
    """The patient holds the hand switch, or lets go of it."""

    is_held: bool


class EmergencyStop(NamedTuple):
    """The patient presses the emergency stop, or releases it."""

    is_pressed: bool


class Press(NamedTuple):
    """The patient presses a button of the page."""

    button: str


class Release(NamedTuple):
    """The therapist logs in on the other page, and releases the plan."""


class Kind(Enum):
    """Evaluation of a span of time."""

    INTERLUDE = "interlude"
    PASSIVE = "passive"
    """Motion with a passive patient: all estimated activity is false."""
    ACTIVE = "active"
    """Motion with an active patient."""
    TIRING = "tiring"
    """Motion with a patient whose effort fades to nothing."""
    OPEN_LOOP = "open loop"
    """The paper's experiment with its artificial disturbance."""


class Scene(NamedTuple):
    """A scene begins; its title and expected duration."""

    title: str
    kind: Kind
    lasting_s: float = 0.0


Action = Ask | Patient | Help | HandSwitch | EmergencyStop | Press | Release | Scene | None
Act = Generator[Action, Situation, None]
Playing = Generator[Action, Situation, Situation]


@dataclass(frozen=True, slots=True)
class Plan:
    """Durations of the parts."""

    passive_s: float
    active_s: float
    paper_s: float
    """0: the paper's scenario is left out."""
    cadence_hz: float = 0.25
    amplitude_ratio: float = 1.0
    scenario: str = "paper"
    programmes: tuple[str, str] = field(default=("passive", "active"))
    tiring_s: float = 0.0
    """Gait of a patient who tires, played without help and with it; 0: the other parts."""

    @property
    def total_s(self) -> float:
        """Total seconds of movement."""
        return self.passive_s + self.active_s + self.paper_s + 2 * self.tiring_s


PAPER_S: Final = 25.0
SHORTEST_GAIT_S: Final = 15.0


def plan_of(seconds: float) -> Plan:
    """Divide the seconds of movement: the paper's scenario runs completely or not at all.

    The rest is gait, a third of it with a passive patient.
    """
    paper_s = PAPER_S if seconds >= PAPER_S + SHORTEST_GAIT_S else 0.0
    gait_s = seconds - paper_s
    return Plan(passive_s=gait_s / 3, active_s=gait_s * 2 / 3, paper_s=paper_s)


def tiring_plan(seconds: float) -> Plan:
    """Divide the seconds of movement: half without help, half with it."""
    return Plan(passive_s=0.0, active_s=0.0, paper_s=0.0, tiring_s=seconds / 2, cadence_hz=0.3)


def tiring_act(plan: Plan, *, helped: bool) -> Act:
    """Gait of a patient who tires, under full guidance alone or with help as needed."""
    how = "help as needed" if helped else "full guidance"
    yield from _enabled("trainer and patient are brought up")
    if helped:
        yield Help()
        yield from until(lambda now: now.lease_holder is not None, "lease", HELP_WITHIN_S)
    yield from _asked("mode", _gait(plan, plan.tiring_s))
    yield Scene("gait is announced and approached", Kind.INTERLUDE)
    yield from until(lambda now: now.phase_ratio is not None, "first stride", MOTION_WITHIN_S)
    yield Patient("tiring")
    yield Scene(f"the patient tires, {how}", Kind.TIRING, plan.tiring_s)
    yield from until(
        lambda now: now.phase_ratio is None, "end of the gait", plan.tiring_s + END_MARGIN_S
    )
    yield Patient("passive")
    yield from _disabled()


def _gait(plan: Plan, duration_s: float) -> dict[str, Any]:
    return {
        "mode": "gait",
        "cadence_hz": plan.cadence_hz,
        "amplitude_ratio": plan.amplitude_ratio,
        "duration_s": duration_s,
    }


def gait_act(plan: Plan) -> Act:
    """Gait with a passive patient, then with an active one."""
    passive, active = plan.programmes
    yield from _enabled("trainer and patient are brought up")
    yield Patient(passive)
    yield from _asked("mode", _gait(plan, plan.passive_s + plan.active_s))
    yield Scene("gait is announced and approached", Kind.INTERLUDE)
    now = yield from until(lambda now: now.phase_ratio is not None, "first stride", MOTION_WITHIN_S)
    began_s = now.now_s
    yield Scene("gait, the patient does nothing", Kind.PASSIVE, plan.passive_s)
    now = yield from _wait(began_s + plan.passive_s)
    yield Patient(active)
    yield Scene("gait, the patient takes part", Kind.ACTIVE, plan.active_s)
    now = yield from until(
        lambda now: now.phase_ratio is None, "end of the gait", plan.active_s + END_MARGIN_S
    )
    yield Patient(passive)
    yield from _disabled()


def paper_act(plan: Plan) -> Act:
    """The paper's open-loop experiment on the empty machine, with an artificial disturbance."""
    yield from _enabled("the empty trainer is brought up")
    payload = {"mode": "excite", "scenario": plan.scenario, "duration_s": plan.paper_s}
    yield from _asked("mode", payload)
    yield Scene("the experiment's middle pose is approached", Kind.INTERLUDE)
    yield from until(lambda now: now.artificial, "beginning of the experiment", MOTION_WITHIN_S)
    yield Scene("the paper's open-loop experiment", Kind.OPEN_LOOP, plan.paper_s)
    yield from until(
        lambda now: not now.artificial, "end of the experiment", plan.paper_s + END_MARGIN_S
    )
    yield from _disabled()


def _enabled(title: str) -> Playing:
    yield Scene(title, Kind.INTERLUDE)
    yield from until(lambda now: now.mode == "ready", "ready", READY_WITHIN_S, powered=False)
    yield from _wait(ENABLE_AT_S)
    yield Scene("the drives are enabled", Kind.INTERLUDE)
    yield from _asked("enable", {})
    yield from until(lambda now: now.mode == "hold", "hold", ENABLE_WITHIN_S)
    return (yield from _wait(MOVE_AT_S))


def _disabled() -> Playing:
    yield Scene("the drives are switched off", Kind.INTERLUDE)
    yield from until(lambda now: now.mode == "hold", "hold", END_MARGIN_S)
    yield from _asked("disable", {})
    return (
        yield from until(lambda now: now.mode == "ready", "ready", DISABLE_WITHIN_S, powered=False)
    )


def _asked(name: str, payload: dict[str, Any]) -> Playing:
    return (yield from asked(Ask(name, payload), name))


def asked(action: Action, name: str) -> Playing:
    """Send a request, and wait for the outcome; a refusal ends the act with its reason.

    Args:
        action: the request.
        name: of it, for the error.
    """
    now = yield action
    while now.outcome is None:
        now = yield from _look(None)
    if now.outcome != "done":
        raise ServiceError(f"{name} {now.outcome}: {now.reason}")
    return now


def _wait(until_s: float) -> Playing:
    now = yield from _look(None)
    while now.now_s < until_s:
        now = yield from _look(None)
    return now


def until(
    reached: Callable[[Situation], bool], what: str, within_s: float, *, powered: bool = True
) -> Playing:
    """Wait for a condition; a stop, missing messages, or a time-out end the act.

    Args:
        reached: the condition.
        what: its name, for the error.
        within_s: time limit.
        powered: the drives are enabled, so that a lost bus is an error, too.
    """
    now = yield from _look(None)
    since_s = now.now_s
    while not reached(now):
        if powered and now.mode in UNPOWERED:
            raise ServiceError(
                f"no {what}: the drives are {now.mode}, {now.verdict or 'no cause said'}"
            )
        if now.now_s - since_s > within_s:
            raise ServiceError(f"no {what} within {within_s:g} s; the mode is {now.mode}")
        now = yield from _look(None)
    return now


def _look(action: Action) -> Playing:
    now = yield action
    if now.mode in STOPPED and now.verdict:
        raise ServiceError(f"the service stopped: {now.verdict}")
    check_word(now)
    return now


def check_word(now: Situation) -> None:
    """Check that the service is not silent.

    Raises:
        ServiceError: it is.
    """
    if now.received_s is not None and now.now_s - now.received_s > SILENCE_MAX_S:
        raise ServiceError(f"no word from the service for {SILENCE_MAX_S:g} s")
