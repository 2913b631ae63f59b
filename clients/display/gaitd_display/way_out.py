"""The way out of a latched stop, for a patient who is alone.

RESET takes the drives' hold from the leg; until ENABLE it has no power and drifts. `gaitd check`
computes how far and how fast, for the worst pose of the gait. So RESET is offered only if

1. the cause needs no look at the machine first (`ALONE`). After all others a drive, a sensor, the
   program or the configured leg is in doubt, and hand guiding relies on each of them;
2. the check is of the configuration that the service runs, by the hashes of all files;
3. every axis has a brake, or both drift less than the file of the server allows, and reach no
   position limit;
4. the leg is inside the area of the gait, for which the drift was computed;
5. the hand switch is held. The core checks that again for a client of role `session`.

Each of RESET, ENABLE and HAND_GUIDING is a button of its own: no request includes the next one.
Otherwise the page says how to call for help, and how to get out of the straps.
"""

import math
from enum import StrEnum, auto
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from gaitd_client import Cause, Configuration, Mode
from gaitd_toml import ConfigError

from gaitd_display.settings import WayOutRules

WRITTEN_BY: Final = "`gaitd check --json` writes it"
ALONE: Final = frozenset(
    {
        Cause.STOP_REQUESTED,
        Cause.HAND_SWITCH_OPEN,
        Cause.GATEWAY_SILENT,
        Cause.VELOCITY_LIMIT,
        Cause.POWER_LIMIT,
        Cause.ENERGY_LIMIT,
        Cause.TRACKING_LIMIT,
        Cause.STOPPING_PATH,
        Cause.SPASM,
        Cause.MOVED_AGAINST_DRIVE,
        Cause.CLONUS,
        Cause.TEMPERATURE_LIMIT,
    }
)
"""Causes of the person or of the motion, after which drives, sensors and model are not in doubt."""


class WhyNot(StrEnum):
    """Why the page does not offer RESET."""

    NOT_CONFIGURED = auto()
    """The file of the server has no table `way_out`."""
    CAUSE = auto()
    OTHER_CONFIGURATION = auto()
    """The check is of other files than the service runs, or the service has not said which."""
    DRIFT = auto()
    POSE = auto()
    """The leg is outside the area of the gait, or its pose is unknown."""


class Step(StrEnum):
    """Where the patient is on the way out."""

    NONE = auto()
    HELP = auto()
    """Not alone: call for help."""
    START = auto()
    """No drive has power: START of the session requests RESET, which takes nothing from the leg."""
    SWITCH = auto()
    """The hand switch must be held before anything is offered."""
    RESET = auto()
    WAIT = auto()
    ENABLE = auto()
    GUIDE = auto()
    """The leg is held, and hand guiding can begin."""
    GUIDING = auto()
    """The leg moves by hand; it can be held where it is."""


class Unstrap(StrEnum):
    """How the page tells to get out of the straps."""

    NOT_NOW = auto()
    """Not at all: the drives brake, or the person is led through other steps first."""
    BEHIND_EMERGENCY_STOP = auto()
    """A drive may have power, and is stronger than a person: the emergency stop comes first."""
    NO_POWER = auto()
    """No drive has power."""


class Action(StrEnum):
    """Request of a button."""

    RESET = auto()
    ENABLE = auto()
    HAND_GUIDING = auto()
    HOLD = auto()


ACTION: Final = {
    Step.RESET: Action.RESET,
    Step.ENABLE: Action.ENABLE,
    Step.GUIDE: Action.HAND_GUIDING,
    Step.GUIDING: Action.HOLD,
}
"""The one request that a step offers; the server refuses every other."""


class Drift(msgspec.Struct, frozen=True):
    """The part of `gaitd check --json` on a leg without power: the worst over the gait's poses."""

    hip_moved_deg: float
    slide_moved_m: float
    reaches_limit: bool


class Area(msgspec.Struct, frozen=True):
    """Extent of the leg's motion in one kind of stop."""

    hip_deg: tuple[float, float]
    slide_m: tuple[float, float]


class Check(msgspec.Struct, frozen=True):
    """What is read of the output of `gaitd check --json`."""

    drift: Drift
    sweeps: tuple[Area, ...]
    """First: the gait, with both axes on their ramps."""
    sha256: dict[str, str]


class Pose(msgspec.Struct, frozen=True):
    """Measured pose of one leg."""

    hip_angle_rad: float
    slide_position_m: float


def read_check(path: Path) -> Check:
    """Read the output of `gaitd check --json`.

    Raises:
        ConfigError: it cannot be read, or is none.
    """
    try:
        check = msgspec.json.decode(path.read_bytes(), type=Check)
    except OSError as error:
        reason = (error.strerror or "cannot be read").lower()
        raise ConfigError(path, "", "", f"{reason}; {WRITTEN_BY}") from error
    except ValueError as error:
        raise ConfigError(path, "", "", f"{error}; {WRITTEN_BY}") from error
    if not check.sweeps:
        raise ConfigError(path, "sweeps", [], f"at least one; {WRITTEN_BY}")
    return check


class Release:
    """Decides whether a person alone may release the leg."""

    def __init__(self, rules: WayOutRules | None) -> None:
        """Read the check once.

        Raises:
            ConfigError: the file of the check cannot be used.
        """
        self._rules = rules
        self._check = None if rules is None else read_check(rules.check)

    def why_not(
        self, cause: str, configuration: Configuration | None, poses: tuple[Pose | None, ...]
    ) -> WhyNot | None:
        """Return the first reason against it; None: RESET may be offered.

        Args:
            cause: of the latched stop.
            configuration: of the running service; None: unknown.
            poses: one for each leg; None: not measured.
        """
        if self._rules is None or self._check is None:
            return WhyNot.NOT_CONFIGURED
        if cause not in ALONE:
            return WhyNot.CAUSE
        if configuration is None or sorted(configuration.config_hashes.values()) != sorted(
            self._check.sha256.values()
        ):
            return WhyNot.OTHER_CONFIGURATION
        if not self._is_harmless(configuration.limits):
            return WhyNot.DRIFT
        return None if poses and all(map(self._is_inside, poses)) else WhyNot.POSE

    def _is_harmless(self, limits: dict[str, Any]) -> bool:
        if all(limits.get(axis, {}).get("brake") is True for axis in ("hip", "slide")):
            return True
        assert self._check is not None  # noqa: S101 - invariant: rules and check come together
        assert self._rules is not None  # noqa: S101 - as above
        drift = self._check.drift
        return (
            drift.hip_moved_deg <= self._rules.hip.drift_max_deg
            and drift.slide_moved_m <= self._rules.slide.drift_max_m
            and not drift.reaches_limit
        )

    def _is_inside(self, pose: Pose | None) -> bool:
        if pose is None or self._check is None:
            return False
        area = self._check.sweeps[0]
        return (
            area.hip_deg[0] <= math.degrees(pose.hip_angle_rad) <= area.hip_deg[1]
            and area.slide_m[0] <= pose.slide_position_m <= area.slide_m[1]
        )


STRAPS_AT: Final = frozenset({Step.HELP, Step.START, Step.GUIDE})
"""Steps at which the page tells how to get out of the straps."""


def unstrap_of(step: Step, mode: str | None, *, has_power: bool) -> Unstrap:
    """Return how the page tells to get out of the straps.

    Args:
        step: of the way out.
        mode: of the service; None: unknown.
        has_power: a drive may exert torque, or has not said.
    """
    if step not in STRAPS_AT or mode == Mode.STOPPING:
        return Unstrap.NOT_NOW
    return Unstrap.BEHIND_EMERGENCY_STOP if has_power else Unstrap.NO_POWER


STOPPED_MODES: Final = frozenset({Mode.STOPPING, Mode.FAULT})
UNPOWERED_MODES: Final = frozenset({Mode.OFF, Mode.BRINGING_UP})
"""Modes without power in the drives, before READY."""


class Stop(NamedTuple):
    """What the service publishes about a stop, and what follows from it."""

    mode: str | None
    """None: unknown."""
    is_latched: bool
    """It has a cause."""
    why_not: WhyNot | None
    """See `Release.why_not`; counts in FAULT."""
    is_switch_held: bool
    """Every drive reads the hand switch as closed."""
    is_held: bool
    """Every drive can hold the leg, and their load was compared; counts in HOLD."""
    may_start: bool
    """START of the session would request RESET; it does so only where no drive has power."""
    was_reset: bool
    """By the trainer's events the last stop was one that a person alone may reset, and was reset.
    """


class WayOut:
    """The step of the way out, from what the service publishes.

    FAULT is left by RESET alone, so the way begins where FAULT is left, whether or not the answer
    to the request arrives. A server that has started behind this takes it from the events.
    """

    def __init__(self) -> None:
        """Start off the way, until the events say more."""
        self._is_asked = self._may_begin = self._is_on_way = False
        self._is_new = True
        """What was before is known by the events alone."""

    def reset_is_asked(self) -> None:
        """Take note that this page requests RESET; until the answer it offers no other."""
        self._is_asked = True

    def reset_is_answered(self) -> None:
        """Take note that the answer has come, or is lost."""
        self._is_asked = False

    def leave(self) -> None:
        """Take note that the session goes on, or another motion."""
        self._may_begin = self._is_on_way = self._is_new = False

    def step(self, stop: Stop) -> Step:
        """Return the present step."""
        if stop.mode == Mode.FAULT:
            self.leave()
            self._may_begin = stop.why_not is None
            return self._step_in_fault(stop)
        self._is_on_way |= self._may_begin or (self._is_new and stop.was_reset)
        self._may_begin = False
        if stop.is_latched and (stop.mode in UNPOWERED_MODES or stop.mode == Mode.READY):
            return Step.HELP
        step = self._step_of_mode(stop)
        if step is Step.NONE:
            self.leave()
        return step if self._is_on_way else Step.NONE

    @staticmethod
    def _step_of_mode(stop: Stop) -> Step:
        """Return the step of someone on the way; `Step.NONE`: a motion, which ends it."""
        if stop.mode in UNPOWERED_MODES:
            return Step.WAIT
        if stop.mode == Mode.READY:
            return Step.ENABLE if stop.is_switch_held else Step.SWITCH
        if stop.mode == Mode.HOLD:
            return Step.GUIDE if stop.is_held else Step.WAIT
        return Step.GUIDING if stop.mode == Mode.HAND_GUIDING else Step.NONE

    def _step_in_fault(self, stop: Stop) -> Step:
        if self._is_asked:
            return Step.WAIT
        if stop.may_start:
            return Step.START
        if stop.why_not is not None:
            return Step.HELP
        return Step.RESET if stop.is_switch_held else Step.SWITCH
