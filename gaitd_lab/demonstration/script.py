"""The acts of the demonstration, each a generator that reads like a play.

An act is sent a `Situation` several times a second and yields what is to be done now, or None to
wait. It knows no clock, no socket and no process, so a test plays it in no time. What must not
happen (a stop, a refusal, silence) ends it with `ActError`.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Final, NamedTuple

READY_WITHIN_S: Final = 900.0
"""From start; the very first start compiles the observer's kernels: 40 s of an idle processor, and
many times that beside other programs."""
ENABLE_WITHIN_S: Final = 20.0
MOTION_WITHIN_S: Final = 40.0
"""From the request to the first stride: announcement and approach."""
END_MARGIN_S: Final = 30.0
"""For the end of an exercise, beyond its duration: the last stride and the way to rest."""
DISABLE_WITHIN_S: Final = 20.0
ENABLE_AT_S: Final = 5.0
MOVE_AT_S: Final = 8.0
"""Of the act's time. Requests are made at fixed instants, seconds after what they wait for, so that
each run in simulated time plays the same frames and ends with the same errors."""
SILENCE_MAX_S: Final = 5.0
STOPPED: Final = frozenset({"stopping", "fault"})
UNPOWERED: Final = frozenset({"off", "bringing_up"})


class ActError(Exception):
    """The demonstration cannot go on; the text says why, in words for a person."""

    folder: Path | None = None
    """Where logs, truth and black box of the act are, once it has ended."""


class Situation(NamedTuple):
    """What the audience knows at one moment."""

    now_s: float
    """Since the act began."""
    heard_s: float | None
    """When the newest word of the service came; None before the first."""
    mode: str | None
    verdict: str
    """Category, cause and place of the latched verdict; empty if there is none."""
    phase_ratio: float | None
    """0..1 of the stride; None while no gait plays."""
    artificial: bool
    """The artificial scenario plays: the excitation itself, not the way to it."""
    outcome: str | None = None
    """Of the request asked last, `refused` for example; None while it is outstanding."""
    reason: str = ""


class Ask(NamedTuple):
    """Ask the service for something over Zenoh."""

    name: str
    payload: dict[str, Any]


class Patient(NamedTuple):
    """Start one of the scripted patient's programmes in the virtual drives."""

    programme: str


class Kind(Enum):
    """What a span of time is judged as."""

    INTERLUDE = "interlude"
    PASSIVE = "passive"
    """Moved with a patient who does nothing: all activity is false."""
    ACTIVE = "active"
    """Moved with a patient who takes part."""
    OPEN_LOOP = "open loop"
    """The paper's experiment with its artificial disturbance."""


class Scene(NamedTuple):
    """From now on this is what can be seen, for about so long."""

    title: str
    kind: Kind
    lasting_s: float = 0.0


Action = Ask | Patient | Scene | None
Act = Generator[Action, Situation, None]
Playing = Generator[Action, Situation, Situation]


@dataclass(frozen=True, slots=True)
class Plan:
    """How long what is played."""

    passive_s: float
    active_s: float
    paper_s: float
    """0: the paper's scenario is left out."""
    cadence_hz: float = 0.25
    amplitude_ratio: float = 1.0
    scenario: str = "paper"
    programmes: tuple[str, str] = field(default=("passive", "active"))

    @property
    def total_s(self) -> float:
        """Seconds of movement."""
        return self.passive_s + self.active_s + self.paper_s


PAPER_S: Final = 25.0
SHORTEST_GAIT_S: Final = 15.0


def plan_of(seconds: float) -> Plan:
    """Share the seconds of movement: the paper's scenario plays whole or not at all.

    What it leaves is gait, a third of it with a patient who does nothing.
    """
    paper_s = PAPER_S if seconds >= PAPER_S + SHORTEST_GAIT_S else 0.0
    gait_s = seconds - paper_s
    return Plan(passive_s=gait_s / 3, active_s=gait_s * 2 / 3, paper_s=paper_s)


def gait_act(plan: Plan) -> Act:
    """Gait first with a passive patient, then with one who takes part."""
    passive, active = plan.programmes
    yield from _enabled("trainer and patient are brought up")
    yield Patient(passive)
    duration_s = plan.passive_s + plan.active_s
    yield from _asked(
        "mode",
        {
            "mode": "gait",
            "cadence_hz": plan.cadence_hz,
            "amplitude_ratio": plan.amplitude_ratio,
            "duration_s": duration_s,
        },
    )
    yield Scene("gait is announced and approached", Kind.INTERLUDE)
    now = yield from _until(
        lambda now: now.phase_ratio is not None, "first stride", MOTION_WITHIN_S
    )
    began_s = now.now_s
    yield Scene("gait, the patient does nothing", Kind.PASSIVE, plan.passive_s)
    now = yield from _wait(began_s + plan.passive_s)
    yield Patient(active)
    yield Scene("gait, the patient takes part", Kind.ACTIVE, plan.active_s)
    now = yield from _until(
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
    yield from _until(lambda now: now.artificial, "beginning of the experiment", MOTION_WITHIN_S)
    yield Scene("the paper's open-loop experiment", Kind.OPEN_LOOP, plan.paper_s)
    yield from _until(
        lambda now: not now.artificial, "end of the experiment", plan.paper_s + END_MARGIN_S
    )
    yield from _disabled()


def _enabled(title: str) -> Playing:
    yield Scene(title, Kind.INTERLUDE)
    yield from _until(lambda now: now.mode == "ready", "ready", READY_WITHIN_S, powered=False)
    yield from _wait(ENABLE_AT_S)
    yield Scene("the drives are enabled", Kind.INTERLUDE)
    yield from _asked("enable", {})
    yield from _until(lambda now: now.mode == "hold", "hold", ENABLE_WITHIN_S)
    return (yield from _wait(MOVE_AT_S))


def _disabled() -> Playing:
    yield Scene("the drives are switched off", Kind.INTERLUDE)
    yield from _until(lambda now: now.mode == "hold", "hold", END_MARGIN_S)
    yield from _asked("disable", {})
    return (
        yield from _until(lambda now: now.mode == "ready", "ready", DISABLE_WITHIN_S, powered=False)
    )


def _asked(name: str, payload: dict[str, Any]) -> Playing:
    """Ask, and wait for the outcome; a refusal ends the act with its reason."""
    now = yield Ask(name, payload)
    while now.outcome is None:
        now = yield from _look(None)
    if now.outcome != "done":
        raise ActError(f"{name} {now.outcome}: {now.reason}")
    return now


def _wait(until_s: float) -> Playing:
    now = yield from _look(None)
    while now.now_s < until_s:
        now = yield from _look(None)
    return now


def _until(
    reached: Callable[[Situation], bool], what: str, within_s: float, *, powered: bool = True
) -> Playing:
    """Wait for something to happen; a stop, silence, or too much time ends the act.

    Args:
        reached: whether it has happened.
        what: it is, for the error.
        within_s: it must happen.
        powered: the drives are enabled, so that a bus that went away is an error too.
    """
    now = yield from _look(None)
    since_s = now.now_s
    while not reached(now):
        if powered and now.mode in UNPOWERED:
            raise ActError(
                f"no {what}: the drives are {now.mode}, {now.verdict or 'no cause said'}"
            )
        if now.now_s - since_s > within_s:
            raise ActError(f"no {what} within {within_s:g} s; the mode is {now.mode}")
        now = yield from _look(None)
    return now


def _look(action: Action) -> Playing:
    now = yield action
    if now.mode in STOPPED and now.verdict:
        raise ActError(f"the service stopped: {now.verdict}")
    if now.heard_s is not None and now.now_s - now.heard_s > SILENCE_MAX_S:
        raise ActError(f"no word from the service for {SILENCE_MAX_S:g} s")
    return now
