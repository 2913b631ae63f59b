"""The acts of the demonstration: what is asked of the service, and what the patient does.

An act is a function of a `Player`, which lets time pass and returns the state of the service after
each turn. An act uses no clock, socket or process itself, so a test can play it without delay. An
unexpected stop, a refusal or missing messages end it with `ServiceError`.
"""

from collections.abc import Callable
from enum import Enum
from typing import Any, Final, NamedTuple, Protocol

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
PASSIVE, ACTIVE, TIRING = "patient passive", "patient active", "patient tiring"
"""Commands of the virtual drives for the scripted patient."""
GAIT_HZ: Final = 0.25
TIRING_HZ: Final = 0.3


class Situation(NamedTuple):
    """Present state of the service."""

    now_s: float
    """Time since the act began."""
    received_s: float | None
    """Time at which the service was last heard; None: not yet."""
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
    """A part of an act: its title and expected duration."""

    title: str
    kind: Kind = Kind.INTERLUDE
    lasting_s: float = 0.0


class Player(Protocol):
    """What an act can do."""

    def turn(self) -> Situation:
        """Let a tenth of a second pass; return the state after it."""
        ...

    def begin(self, scene: Scene) -> None:
        """Begin a scene, which ends the one before."""
        ...

    def ask(self, name: str, payload: dict[str, Any]) -> None:
        """Send the service a request; `turn` returns its outcome once it is known."""
        ...

    def drives(self, command: str) -> None:
        """Send the virtual drives a command, for example of the scripted patient."""
        ...

    def start_assist(self) -> None:
        """Start the reference controller for help as needed."""
        ...


class Plan(NamedTuple):
    """Seconds of movement of each part."""

    passive_s: float
    active_s: float
    paper_s: float
    """0: the paper's scenario is left out."""


PAPER_S: Final = 25.0
SHORTEST_GAIT_S: Final = 15.0


def plan_of(seconds: float) -> Plan:
    """Divide the seconds of movement: the paper's scenario runs completely or not at all.

    The rest is gait, a third of it with a passive patient.
    """
    paper_s = PAPER_S if seconds >= PAPER_S + SHORTEST_GAIT_S else 0.0
    gait_s = seconds - paper_s
    return Plan(passive_s=gait_s / 3, active_s=gait_s * 2 / 3, paper_s=paper_s)


def gait_act(player: Player, plan: Plan) -> None:
    """Gait with a passive patient, then with an active one."""
    _enable(player, "trainer and patient are brought up")
    player.drives(PASSIVE)
    began_s = _walk(player, GAIT_HZ, plan.passive_s + plan.active_s)
    player.begin(Scene("gait, the patient does nothing", Kind.PASSIVE, plan.passive_s))
    _wait(player, began_s + plan.passive_s)
    player.drives(ACTIVE)
    player.begin(Scene("gait, the patient takes part", Kind.ACTIVE, plan.active_s))
    _end_walk(player, plan.active_s)


def tiring_act(player: Player, duration_s: float, *, helped: bool) -> None:
    """Gait of a patient who tires, under full guidance alone or with help as needed."""
    how = "help as needed" if helped else "full guidance"
    _enable(player, "trainer and patient are brought up")
    if helped:
        player.start_assist()
        until(player, lambda now: now.lease_holder is not None, "lease", HELP_WITHIN_S)
    _walk(player, TIRING_HZ, duration_s)
    player.drives(TIRING)
    player.begin(Scene(f"the patient tires, {how}", Kind.TIRING, duration_s))
    _end_walk(player, duration_s)


def paper_act(player: Player, duration_s: float) -> None:
    """The paper's open-loop experiment on the empty machine, with an artificial disturbance."""
    _enable(player, "the empty trainer is brought up")
    _request(player, "mode", {"mode": "excite", "scenario": "paper", "duration_s": duration_s})
    player.begin(Scene("the experiment's middle pose is approached"))
    until(player, lambda now: now.artificial, "beginning of the experiment", MOTION_WITHIN_S)
    player.begin(Scene("the paper's open-loop experiment", Kind.OPEN_LOOP, duration_s))
    within_s = duration_s + END_MARGIN_S
    until(player, lambda now: not now.artificial, "end of the experiment", within_s)
    _disable(player)


def _walk(player: Player, cadence_hz: float, duration_s: float) -> float:
    """Begin a gait; return the time of its first stride."""
    payload = {"cadence_hz": cadence_hz, "amplitude_ratio": 1.0, "duration_s": duration_s}
    _request(player, "mode", {"mode": "gait", **payload})
    player.begin(Scene("gait is announced and approached"))
    return until(player, _is_walking, "first stride", MOTION_WITHIN_S).now_s


def _is_walking(now: Situation) -> bool:
    return now.phase_ratio is not None


def _end_walk(player: Player, duration_s: float) -> None:
    """Wait for the end of a gait, and switch the drives off."""
    within_s = duration_s + END_MARGIN_S
    until(player, lambda now: not _is_walking(now), "end of the gait", within_s)
    player.drives(PASSIVE)
    _disable(player)


def _enable(player: Player, title: str) -> None:
    player.begin(Scene(title))
    until(player, lambda now: now.mode == "ready", "ready", READY_WITHIN_S)
    _wait(player, ENABLE_AT_S)
    player.begin(Scene("the drives are enabled"))
    _request(player, "enable", {})
    until(player, lambda now: now.mode == "hold", "hold", ENABLE_WITHIN_S)
    _wait(player, MOVE_AT_S)


def _disable(player: Player) -> None:
    player.begin(Scene("the drives are switched off"))
    until(player, lambda now: now.mode == "hold", "hold", END_MARGIN_S)
    _request(player, "disable", {})
    until(player, lambda now: now.mode == "ready", "ready", DISABLE_WITHIN_S)


def _request(player: Player, name: str, payload: dict[str, Any]) -> None:
    """Send a request, and wait for its outcome; a refusal ends the act with its reason."""
    player.ask(name, payload)
    now = _turn(player)
    while now.outcome is None:
        now = _turn(player)
    if now.outcome != "done":
        raise ServiceError(f"{name} {now.outcome}: {now.reason}")


def _wait(player: Player, until_s: float) -> None:
    while _turn(player).now_s < until_s:
        pass


def until(
    player: Player, reached: Callable[[Situation], bool], what: str, within_s: float
) -> Situation:
    """Wait for a condition; a stop, missing messages, or a time-out end the act.

    Args:
        player: lets time pass.
        reached: the condition.
        what: its name, for the error.
        within_s: time limit.
    """
    now = _turn(player)
    since_s = now.now_s
    while not reached(now):
        if now.now_s - since_s > within_s:
            why = f"; {now.verdict}" if now.verdict else ""
            raise ServiceError(f"no {what} within {within_s:g} s; the mode is {now.mode}{why}")
        now = _turn(player)
    return now


def _turn(player: Player) -> Situation:
    now = heard_turn(player)
    if now.mode in STOPPED and now.verdict:
        raise ServiceError(f"the service stopped: {now.verdict}")
    return now


def heard_turn(player: Player) -> Situation:
    """Let a turn pass.

    Raises:
        ServiceError: the service is silent.
    """
    now = player.turn()
    if now.received_s is not None and now.now_s - now.received_s > SILENCE_MAX_S:
        raise ServiceError(f"no word from the service for {SILENCE_MAX_S:g} s")
    return now
