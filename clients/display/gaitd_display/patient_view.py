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
from gaitd_session.session import WITHOUT_POWER

from gaitd_display.alarm import Alarm, cause_of
from gaitd_display.cause_texts import INSTRUCTIONS, Situation, patient_text
from gaitd_display.feedback import BarView, LegFeedback, Result
from gaitd_display.settings import PatientSettings
from gaitd_display.texts import Text, Word
from gaitd_display.training import TrainingView
from gaitd_display.way_out import (
    ACTION,
    STOPPED_MODES,
    UNPOWERED_MODES,
    Action,
    Pose,
    Release,
    Step,
    Stop,
    Unstrap,
    WayOut,
    WhyNot,
    unstrap_of,
)

RESTING_MODES: Final = frozenset({Mode.READY, Mode.HOLD})
HOLDING: Final = frozenset({"operation_enabled", "quick_stop_active"})
"""CiA 402 power states in which a drive can hold a leg."""
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
    Mode.HOLD: Word.REST,
    Mode.STOPPING: Word.STOPPING,
    Mode.FAULT: Word.STOPPED,
    Mode.GAIT: Word.GO_ON,
    Mode.TORQUE: Word.GO_ON,
    Mode.HAND_GUIDING: Word.GUIDE,
    Mode.SELF_TEST: Word.SELF_TEST,
}
TRAINING: Final = frozenset({Mode.GAIT, Mode.TORQUE})
RESULT_WORDS: Final = {
    Result.BELOW: Word.STRONGER,
    Result.ABOVE: Word.GENTLY,
    Result.WITHIN: Word.GOOD,
    Result.UNKNOWN: Word.GO_ON,
}
WORST_FIRST: Final = (Result.BELOW, Result.ABOVE, Result.WITHIN, Result.UNKNOWN)
"""With two legs the first of these that a leg has gives the word."""


class Said(msgspec.Struct, frozen=True):
    """A text in both languages, as the page gets it."""

    en: str
    de: str


class StopView(msgspec.Struct, frozen=True):
    """The latched stop, in plain words."""

    cause: str
    happened: Said
    instructions: tuple[Said, ...]


class Dot(msgspec.Struct, frozen=True, tag="dot", tag_field="kind"):
    """One stride: sent once, as it ends."""

    leg: str
    number: int
    boot: str
    """A stride with the same leg, number and boot is the same."""
    share_ratio: float | None
    work_j: float | None


class PatientView(msgspec.Struct, frozen=True):
    """One frame of the patient's page."""

    word: Word
    mode: str | None
    active: bool
    """The drives are enabled, or were when the trainer fell silent."""
    bars: tuple[BarView, ...]
    stop: StopView | None
    step: Step
    """With a stop, or a step on the way out of one, the page shows these alone."""
    action: Action | None
    unstrap: Unstrap
    alarm: str | None
    """Sounds until it is acknowledged; another text is another alarm. None: none."""
    training: TrainingView | None = None
    """None: this server runs no session."""


def dot(stride: Stride) -> Dot:
    """Return what the page shows of a stride."""
    return Dot(
        stride.leg,
        stride.number,
        stride.core_boot_id,
        stride.share_ratio,
        stride.work_positive_j,
    )


def said(text: Text) -> Said:
    """Return a text as it is sent."""
    return Said(text.en, text.de)


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
            SettingsError: the check of the way out cannot be used.
        """
        self._legs = {bar.leg: LegFeedback(bar) for bar in settings.bar}
        self._release = Release(settings.way_out)
        self._may_request = settings.web.is_loopback
        self._silent = dict.fromkeys(self._legs, True)
        self._safety: Safety | None = None
        self._drives: dict[str, DriveState] = {}
        self._are_holding, self._may_have_power = False, True
        self._training: TrainingView | None = None
        self._alarm = Alarm(run_id)
        self._last_stop = _LastStop()
        self.configuration: Configuration | None = None
        self.way_out = WayOut()

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
        for leg, activity in activities:
            self._legs[leg].take(activity)
            self._silent[leg] = isinstance(activity, NotValid)
        self._safety = safety if isinstance(safety, Safety) and safety.valid else None
        self._drives = {drive.name: drive for drive in drives if isinstance(drive, DriveState)}
        self._are_holding = len(self._drives) == len(drives) and all(
            drive.power_state in HOLDING for drive in self._drives.values()
        )
        self._may_have_power = len(self._drives) < len(drives) or any(
            not drive.fresh or drive.power_state not in WITHOUT_POWER
            for drive in self._drives.values()
        )
        self._training = training
        word = self._word()
        is_silent = word is Word.NO_SIGNAL
        mode = None if self._safety is None or is_silent else self._safety.mode
        alarm = self._alarm.take(
            None if is_silent else self._safety,
            self._drives.values(),
            has_session=training is not None,
        )
        step = Step.NONE if is_silent else self._step(mode)
        return PatientView(
            word=word,
            mode=mode,
            active=self._alarm.was_active,
            bars=tuple(leg.view() for leg in self._legs.values()),
            stop=None if is_silent else self._stop(),
            step=step,
            action=ACTION.get(step),
            unstrap=unstrap_of(step, mode, has_power=self._may_have_power),
            alarm=alarm,
            training=training,
        )

    @property
    def boot_id(self) -> str | None:
        """Boot id of the running core; None: unknown."""
        return None if self._safety is None else self._safety.core_boot_id

    def _word(self) -> Word:
        if self._safety is None or all(self._silent.values()):
            return Word.NO_SIGNAL
        mode, stage = self._safety.mode, self._safety.stage
        if mode in UNPOWERED_MODES and cause_of(self._safety) != Cause.NONE:
            return Word.STOPPED
        training = self._training
        announces = training is not None and training.announces and mode in RESTING_MODES
        if announces or (mode == Mode.SELF_TEST and stage == Stage.PREPARING):
            return Word.SOON
        if training is not None and training.rests and mode == Mode.READY:
            return Word.REST
        if mode in TRAINING and stage == Stage.PLAYING:
            return self._result_word()
        if stage in STAGE_WORDS and mode not in STOPPED_MODES:
            return STAGE_WORDS[stage]
        return MODE_WORDS.get(mode or "", Word.SERVICE)

    def _result_word(self) -> Word:
        results = {leg.result for leg in self._legs.values()}
        return RESULT_WORDS[next(result for result in WORST_FIRST if result in results)]

    def _stop(self) -> StopView | None:
        cause = cause_of(self._safety)
        if cause == Cause.NONE:
            return None
        text = patient_text(Cause.STO_ACTIVE if self._alarm.is_by_emergency_stop(cause) else cause)
        advice = () if text.advice is None else (text.advice,)
        is_loose = text.situation is Situation.HELD and not self._are_holding
        situation = Situation.LOOSE if is_loose else text.situation
        instructions = (*INSTRUCTIONS[situation], *advice)
        return StopView(cause, said(text.happened), tuple(map(said, instructions)))

    def _step(self, mode: str | None) -> Step:
        cause = cause_of(self._safety)
        is_latched = cause != Cause.NONE
        if self._training is not None and self._training.is_going:
            self.way_out.leave()
        may_start = self._training is not None and self._training.resets
        poses = self._poses()
        why_not = self._release.why_not(cause, self.configuration, poses)
        if not self._may_request:
            is_at_rest = mode == Mode.FAULT or (is_latched and mode in UNPOWERED_MODES)
            return Step.HELP if is_at_rest else Step.NONE
        held = bool(self._drives) and all(
            drive.hand_switch_closed is True for drive in self._drives.values()
        )
        # Where the leg has been led by hand since then does not count.
        was_reset = self._last_stop.is_reset and self._last_stop.boot_id == self.boot_id
        was_reset &= self._release.why_not(self._last_stop.cause, self.configuration, poses) in {
            None,
            WhyNot.POSE,
        }
        return self.way_out.step(Stop(mode, is_latched, why_not, held, may_start, was_reset))

    def _poses(self) -> tuple[Pose | None, ...]:
        return tuple(map(self._pose, self._legs))

    def _pose(self, leg: str) -> Pose | None:
        hip, slide = self._position(f"{leg}/hip"), self._position(f"{leg}/slide")
        return None if hip is None or slide is None else Pose(hip, slide)

    def _position(self, name: str) -> float | None:
        drive = self._drives.get(name)
        return drive.position_si if drive is not None and drive.fresh else None
