"""Modes, their stages and steps, and what changes a mode."""

from enum import StrEnum, auto
from typing import Final


class Mode(StrEnum):
    """Modes of the service. From HOLD on the drives move or hold the legs."""

    OFF = auto()
    BRINGING_UP = auto()
    READY = auto()
    STOPPING = auto()
    FAULT = auto()
    HOLD = auto()
    GAIT = auto()
    TORQUE = auto()
    EXCITE = auto()
    REFERENCE = auto()
    """One axis homes; the others have no power."""
    COMMISSION = auto()
    """The sign of one axis is being proven; the others have no power."""
    HAND_GUIDING = auto()
    """Hand guiding: no stiffness; the drives carry the load and damp the motion."""
    SELF_TEST = auto()
    """Each axis in turn moves a little and back: checks signs, load and friction for the day."""

    @property
    def active(self) -> bool:
        """True if the drives are enabled on purpose in this mode."""
        return self not in _INACTIVE


_INACTIVE: Final = (Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.STOPPING, Mode.FAULT)


class Stage(StrEnum):
    """Progress of an exercise, the same for all: gait, excitation, self-test, homing, ...

    A stage may be left out; the order never reverses.
    """

    PREPARING = auto()
    """Nothing moves: drives are brought up, enabled, or change their mode of operation."""
    ANNOUNCING = auto()
    """Nothing moves yet; the person in the machine is warned."""
    APPROACHING = auto()
    """The leg is moved to the pose in which the exercise begins."""
    PLAYING = auto()
    """The requested exercise runs: strides, a scenario, hand guiding, a test, homing."""
    ENDING = auto()
    """The leg comes to the pose, or to rest, in which the exercise ends."""
    OVER = auto()


class Trigger(StrEnum):
    """What may change the mode; `daemon/core/modes/table.py` has the transitions."""

    BRING_UP_BEGUN = auto()
    BRING_UP_DONE = auto()
    STILL_LATCHED = auto()
    """A stop is latched since an earlier start."""
    DRIVES_LOST = auto()
    """A drive or the bus was lost while no drive was enabled."""
    DRIVE_FAULTY = auto()
    ENABLE = auto()
    DISABLE = auto()
    RESET = auto()
    TO_HOLD = auto()
    TO_GAIT = auto()
    TO_TORQUE = auto()
    TO_EXCITE = auto()
    TO_HAND_GUIDING = auto()
    TO_SELF_TEST = auto()
    TO_REFERENCE = auto()
    TO_COMMISSION = auto()
    BRING_UP_RESTARTED = auto()
    """The drives need other limits."""
    EXERCISE_OVER = auto()
    LEASE_LAPSED = auto()
    """The lease of the assist in force has ended, or its setpoints are stale."""
    STOP = auto()
    AT_REST_WELL = auto()
    """At rest, as requested."""
    AT_REST_STOPPED = auto()
    """At rest, by a verdict."""


class ProgressCode(StrEnum):
    """What the machine does now, within its mode and stage."""

    SETTING_UP = auto()
    """A bring-up; the subject is the drive."""
    COMPARING_LOAD = auto()
    EXERCISING = auto()
    GUIDED_BY_HAND = auto()
    TESTING = auto()
    """A self-test; the subject is the axis."""
    ONE_AXIS = auto()
    """Homing or a sign test; the subject is the axis."""
    # of the gateway
    CORE_STARTING = auto()


class MotionPhase(StrEnum):
    """Phase of the motion of one axis in a self-test."""

    REST = auto()
    FORTH = auto()
    TURN = auto()
    BACK = auto()
    DONE = auto()


class AxisStep(StrEnum):
    """Step of a homing or sign test."""

    WAITING = auto()
    """The drives get their limits for it."""
    ENABLING = auto()
    SEARCHING = auto()
    FORTH = auto()
    RESTING = auto()
    BACK = auto()
    ENDING = auto()
    """At rest again."""
    DONE = auto()
    FAILED = auto()


class Failure(StrEnum):
    """Why an exercise, a homing or a sign test has ended without its result."""

    NONE = auto()
    NO_REST = auto()
    """No rest came, which a change to torque mode needs."""
    NOT_READY = auto()
    """Drives and leg were not ready in time."""
    STOP_REQUESTED = auto()
    DISABLE_REQUESTED = auto()
    HOMING_ERROR = auto()
    HOME_NOT_FOUND = auto()
    DOES_NOT_HOME = auto()
    MOVES_AGAINST_TORQUE = auto()
    DOES_NOT_MOVE = auto()
    KEEPS_MOVING = auto()
