"""All that the patient's page shows, computed from the newest messages; the page only paints it."""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import msgspec
from gaitd_client import (
    Activity,
    Cause,
    Configuration,
    DriveState,
    Event,
    Kind,
    Mode,
    NotValid,
    Safety,
    Stage,
    Stride,
)
from gaitd_session import Advice, Band, Phase, Step
from gaitd_texts import situation_of

from gaitd_display.alarm import Alarm, cause_of
from gaitd_display.drives import together
from gaitd_display.geometry import Geometry, geometry_of
from gaitd_display.scenes import REFUSALS, Now, Scene, scene_of
from gaitd_display.settings import PatientSettings
from gaitd_display.training import TrainingView
from gaitd_display.walk import OwnSteps, StepView, step_view, word_of
from gaitd_display.way_out import (
    ACTION,
    STOPPED_MODES,
    UNPOWERED_MODES,
    Action,
    Pose,
    Release,
    Stop,
    Unstrap,
    WayOut,
    WhyNot,
    unstrap_of,
)
from gaitd_display.way_out import Step as WayStep
from gaitd_display.words import Word

RESTING_MODES: Final = frozenset({Mode.READY, Mode.HOLD})
STAGE_WORDS: Final[Mapping[str | None, Word]] = {
    Stage.PREPARING: Word.WAIT,
    Stage.ANNOUNCING: Word.SOON,
    Stage.APPROACHING: Word.TO_START,
    Stage.ENDING: Word.ENDING,
    Stage.OVER: Word.ENDING,
}
MODE_WORDS: Final[Mapping[str, Word]] = {
    Mode.OFF: Word.WAIT,
    Mode.BRINGING_UP: Word.WAIT,
    Mode.READY: Word.READY,
    Mode.HOLD: Word.HELD,
    Mode.STOPPING: Word.STOPPING,
    Mode.FAULT: Word.STOPPED,
    Mode.GAIT: Word.GO_ON,
    Mode.TORQUE: Word.GO_ON,
    Mode.HAND_GUIDING: Word.GUIDE,
    Mode.SELF_TEST: Word.SELF_TEST,
}
PHASE_WORDS: Final[Mapping[Phase, Word]] = {
    Phase.WAITING: Word.START,
    Phase.PAUSED: Word.PAUSED,
    Phase.FINISHED: Word.FINISHED,
}
"""A session at rest; a rest has two words, because it ends."""
OVER: Final = frozenset({Phase.REST, Phase.PAUSED, Phase.FINISHED})
"""Phases behind a motion, in which the session switches the drives off."""
TRAINING: Final = frozenset({Mode.GAIT, Mode.TORQUE})


class LegView(msgspec.Struct, frozen=True):
    """One leg now; None: not known, or there is none."""

    leg: str
    hip_angle_rad: float | None
    slide_position_m: float | None
    glow_ratio: float
    """Power of the patient with the motion; 0 also where it is not known."""
    share_low_ratio: float | None
    """Its target."""
    share_high_ratio: float | None


class PatientView(msgspec.Struct, frozen=True, kw_only=True):
    """One frame of the patient's page."""

    word: Word
    mode: str | None
    active: bool
    """The drives are enabled, or were when the trainer fell silent."""
    scene: Scene
    legs: tuple[LegView, ...]
    steps: tuple[StepView, ...]
    """The newest ones, oldest first."""
    geometry: Geometry | None
    """None: the service has not said."""
    cause: str | None
    """Cause of the latched stop."""
    step: WayStep
    action: Action | None
    unstrap: Unstrap
    alarm: str | None
    """Sounds until it is acknowledged; another text is another alarm. None: none."""
    sample_time_ms: float | None
    """UTC of the newest sample, ms since 1970: its age when painted is measured by the page."""
    training: TrainingView | None = None
    """None: this server runs no session."""


class _LastStop(NamedTuple):
    """The newest stop of the trainer's events."""

    boot_id: str | None = None
    cause: str = Cause.NONE
    is_reset: bool = False


class PatientState:
    """The newest messages, and what follows from them."""

    def __init__(self, settings: PatientSettings, run_id: str) -> None:
        """Start without a message.

        Args:
            settings: of this server.
            run_id: differs with each start of the server, so that an alarm is never one of before.

        Raises:
            ConfigError: the check of the way out cannot be used.
        """
        self._glow_full_w: dict[str, float] = {leg.name: leg.glow_full_w for leg in settings.leg}
        target = settings.target
        self._own = OwnSteps(
            None if target is None else Band(target.share_low_ratio, target.share_high_ratio)
        )
        self._release = Release(settings.way_out)
        self._may_request = settings.web.is_loopback
        self._activities: dict[str, Activity] = {}
        self._safety: Safety | None = None
        self._drives: dict[str, DriveState] = {}
        self._together = together(())
        self._training: TrainingView | None = None
        self._alarm = Alarm(run_id)
        self._last_stop = _LastStop()
        self._geometry: Geometry | None = None
        self.configuration: Configuration | None = None
        self.way_out = WayOut()

    def use(self, configuration: Configuration | None) -> None:
        """Take the configuration of the running core; None: it has not answered."""
        self.configuration = configuration
        if configuration is not None:
            self._geometry = geometry_of(configuration.robot, configuration.limits)

    def take_stride(self, stride: Stride) -> None:
        """Take a stride that has ended."""
        self._own.take(stride)

    def take_event(self, event: Event) -> None:
        """Take an event: those of the past say which stop was reset before this server's start."""
        if event.kind != Kind.STOP:
            return
        if event.cause is None:
            self._last_stop = self._last_stop._replace(is_reset=True)
        else:
            self._last_stop = _LastStop(event.core_boot_id, event.cause)

    def take(
        self,
        activities: Iterable[tuple[str, Activity | NotValid]],
        safety: Safety | NotValid,
        drives: Iterable[DriveState | NotValid],
        training: TrainingView | None = None,
    ) -> PatientView:
        """Take the newest messages, and what the session says; return the frame."""
        drives = tuple(drives)
        self._activities = {leg: one for leg, one in activities if isinstance(one, Activity)}
        self._safety = safety if isinstance(safety, Safety) and safety.valid else None
        self._drives = {drive.name: drive for drive in drives if isinstance(drive, DriveState)}
        self._together = together(drives)
        self._training = training
        is_silent = self._safety is None or not self._activities
        mode = None if self._safety is None or is_silent else self._safety.mode
        if mode not in TRAINING:
            self._own.forget()
        alarm = self._alarm.take(
            None if is_silent else self._safety,
            self._drives.values(),
            has_session=training is not None,
        )
        step = WayStep.NONE if is_silent else self._step(mode)
        word = Word.NO_SIGNAL if is_silent else self._word(step)
        cause = None if is_silent else self._cause()
        unstrap = unstrap_of(step, mode, has_power=self._together.may_have_power)
        return PatientView(
            word=word,
            mode=mode,
            active=self._alarm.was_active,
            scene=scene_of(self._now(word, mode, cause, step, unstrap)),
            legs=tuple(map(self._leg, self._glow_full_w)),
            steps=tuple(step_view(one, self._band(one.leg)) for one in self._steps()),
            geometry=self._geometry,
            cause=cause,
            step=step,
            action=ACTION.get(step),
            unstrap=unstrap,
            alarm=alarm,
            sample_time_ms=max(
                (one.sample_time_ns / 1e6 for one in self._activities.values()), default=None
            ),
            training=training,
        )

    def _now(
        self, word: Word, mode: str | None, cause: str | None, step: WayStep, unstrap: Unstrap
    ) -> Now:
        return Now(
            word,
            mode,
            cause,
            None if cause is None else situation_of(cause, are_holding=self._together.are_holding),
            step,
            unstrap,
            self._together.is_switch_held,
            any(drive.sto_released is False for drive in self._drives.values()),
            self._training,
        )

    @property
    def boot_id(self) -> str | None:
        """Boot id of the running core; None: unknown."""
        return None if self._safety is None else self._safety.core_boot_id

    # --- legs and steps -------------------------------------------------------------------------

    def _steps(self) -> tuple[Step, ...]:
        return self._own.steps if self._training is None else self._training.steps

    def _band(self, leg: str) -> Band | None:
        return self._own.band if self._training is None else self._training.bands.get(leg)

    def _leg(self, leg: str) -> LegView:
        pose, activity, band = self._pose(leg), self._activities.get(leg), self._band(leg)
        power_w = None if activity is None else activity.patient_power_w
        glow = 0.0 if power_w is None else power_w / self._glow_full_w[leg]
        return LegView(
            leg,
            None if pose is None else round(pose.hip_angle_rad, 4),
            None if pose is None else round(pose.slide_position_m, 4),
            round(min(max(glow, 0.0), 1.0), 2),
            None if band is None else band.low_ratio,
            None if band is None else band.high_ratio,
        )

    # --- the word -------------------------------------------------------------------------------

    def _word(self, step: WayStep) -> Word:
        assert self._safety is not None  # noqa: S101 - invariant: it is not silent
        mode, stage = self._safety.mode, self._safety.stage
        if mode in UNPOWERED_MODES and cause_of(self._safety) != Cause.NONE:
            return Word.STOPPED
        if step is not WayStep.NONE and mode not in STOPPED_MODES:
            return Word.WAY_OUT if step is not WayStep.HELP else Word.STOPPED
        training = self._training
        announces = training is not None and training.announces and mode in RESTING_MODES
        if announces or (mode == Mode.SELF_TEST and stage == Stage.PREPARING):
            return Word.SOON
        if training is not None and mode in RESTING_MODES and not training.is_going:
            return self._word_at_rest(training, mode)
        if mode in TRAINING and stage == Stage.PLAYING:
            if training is not None and training.advice is Advice.RELAX:
                return Word.RELAX
            return word_of(self._steps())
        if stage in STAGE_WORDS and mode not in STOPPED_MODES:
            return STAGE_WORDS[stage]
        return self._word_of_mode(mode)

    def _is_held(self) -> bool:
        """True in HOLD once each drive can hold the leg, and its load was compared."""
        is_ready = self._safety is not None and self._safety.stage != Stage.PREPARING
        return is_ready and self._together.are_holding

    def _word_of_mode(self, mode: str | None) -> Word:
        if mode == Mode.HOLD and not self._is_held():
            return Word.WAIT
        return MODE_WORDS.get(mode or "", Word.SERVICE)

    def _word_at_rest(self, training: TrainingView, mode: str | None) -> Word:
        if training.advice is Advice.TRAINER_IS_USED:
            return Word.USED
        if mode != Mode.READY and training.phase in OVER:
            return Word.ENDING  # letting go would be a stop until the drives are off
        if training.phase is Phase.REST and training.block_left_s > 0:
            return Word.REST
        if mode == Mode.READY and training.advice in REFUSALS:
            return REFUSALS[training.advice]
        if training.phase is Phase.REST:
            return Word.NEXT
        if training.phase is Phase.PAUSED and not training.has_walked:
            return Word.START
        return PHASE_WORDS.get(training.phase, self._word_of_mode(mode))

    # --- a stop ---------------------------------------------------------------------------------

    def _cause(self) -> str | None:
        """Return the cause of the latched stop, or the emergency stop that is behind it."""
        cause = cause_of(self._safety)
        if cause == Cause.NONE:
            return None
        return Cause.STO_ACTIVE if self._alarm.is_by_emergency_stop(cause) else cause

    def _step(self, mode: str | None) -> WayStep:
        cause = cause_of(self._safety)
        is_latched = cause != Cause.NONE
        if self._training is not None and self._training.is_going:
            self.way_out.leave()
        may_start = self._training is not None and self._training.resets
        poses = self._poses()
        why_not = self._release.why_not(cause, self.configuration, poses)
        if not self._may_request:
            at_rest = UNPOWERED_MODES | {Mode.READY}
            is_at_rest = mode == Mode.FAULT or (is_latched and mode in at_rest)
            return WayStep.HELP if is_at_rest else WayStep.NONE
        # Where the leg has been led by hand since then does not count.
        was_reset = self._last_stop.is_reset and self._last_stop.boot_id == self.boot_id
        was_reset &= self._release.why_not(self._last_stop.cause, self.configuration, poses) in {
            None,
            WhyNot.POSE,
        }
        return self.way_out.step(
            Stop(
                mode,
                is_latched,
                why_not,
                self._together.is_switch_held,
                self._is_held(),
                may_start,
                was_reset,
            )
        )

    def _poses(self) -> tuple[Pose | None, ...]:
        return tuple(map(self._pose, self._glow_full_w))

    def _pose(self, leg: str) -> Pose | None:
        hip, slide = self._position(f"{leg}/hip"), self._position(f"{leg}/slide")
        return None if hip is None or slide is None else Pose(hip, slide)

    def _position(self, name: str) -> float | None:
        drive = self._drives.get(name)
        return drive.position if drive is not None and drive.fresh else None
