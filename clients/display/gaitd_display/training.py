"""The training session on the patient's page: time left, and the buttons START, PAUSE, END.

`gaitd_session` decides; this file passes its view on, and its buttons back. It exists only if the
file of the server has a table `session`. After a stop the page offers START alone, and only where
no drive has power: START then requests RESET. Every other way out is decided in `way_out.py`.
"""

import sys
from collections.abc import Callable
from typing import Final

import msgspec
from gaitd_client import Clock, Mode, Trainer
from gaitd_session import (
    Advice,
    Button,
    Phase,
    Session,
    View,
    Why,
    open_history,
    read_profile,
)
from gaitd_session.machine import ACTIVE

from gaitd_display.settings import SessionFiles

ANNOUNCING: Final = frozenset({Phase.ENABLING, Phase.ANNOUNCED, Phase.STARTING})
"""Phases of a session in which motion is about to begin."""


class Band(msgspec.Struct, frozen=True):
    """Target band of one leg, for its share of a stride's work."""

    leg: str
    low_ratio: float
    high_ratio: float


class Summary(msgspec.Struct, frozen=True):
    """What a session has been."""

    walked_s: float
    valid_count: int
    """Strides of all legs whose share is known."""
    in_band_count: int
    """Those of them that have reached the target."""


class TrainingView(msgspec.Struct, frozen=True):
    """What the page shows of the session."""

    phase: Phase
    advice: Advice
    buttons: tuple[Button, ...]
    left_s: float
    """All blocks and rests that are left."""
    reason: str
    """Text of the service for a stop or a refusal; empty without one."""
    why: Why | None
    """What has ended the last START early; None: nothing, or `reason` or a stop says it."""
    is_kept: bool
    """The history is written."""
    bands: tuple[Band, ...]
    summary: Summary | None
    """None: the session is not finished."""

    @property
    def announces(self) -> bool:
        """Motion is about to begin."""
        return self.phase in ANNOUNCING

    @property
    def rests(self) -> bool:
        """A block is over, and another one comes."""
        return self.phase is Phase.REST

    @property
    def is_going(self) -> bool:
        """A START is in force."""
        return self.phase in ACTIVE

    @property
    def resets(self) -> bool:
        """START requests RESET, because a stop is latched and no drive has power."""
        return self.advice is Advice.PRESS_START_TO_RESET


class Training:
    """The session of this page; after its end START begins another one."""

    def __init__(self, files: SessionFiles, trainer: Trainer, clock: Clock) -> None:
        """Read the profile and open the history.

        Raises:
            ProfileError: the profile cannot be used.
        """
        profile = read_profile(files.profile)
        self._history = open_history(files.history)
        self._make: Callable[[], Session] = lambda: Session(trainer, profile, self._history, clock)
        self._session = self._make()

    def begin(self) -> None:
        """Follow the trainer; nothing is requested before START."""
        self._session.__enter__()

    def end(self) -> None:
        """End the session: it switches the drives off if it has switched them on."""
        try:
            self._leave()
        finally:
            if self._history.store is not None:
                self._history.store.close()

    def _leave(self) -> None:
        """End the session, and tell whether the drives may be on, also if its end raises."""
        try:
            self._session.__exit__(None, None, None)
        finally:
            if self._session.left_on:
                print(f"the drives may be on: {self._session.left_on}", file=sys.stderr)

    def view(self, mode: str | None) -> TrainingView:
        """Return what the page shows.

        Args:
            mode: of the service; None: unknown, then there is no button.

        Raises:
            SessionError: the session has ended by an error, printed to stderr.
        """
        view = self._session.view()
        buttons = view.buttons
        if view.may_be_replaced:
            buttons = (Button.START, *buttons)
        if mode is None or mode == Mode.STOPPING:
            buttons = ()
        elif mode == Mode.FAULT:
            buttons = tuple(button for button in buttons if button is Button.START)
        return TrainingView(
            phase=view.phase,
            advice=view.advice,
            buttons=buttons,
            left_s=view.session_left_s,
            reason=view.reason,
            why=view.why,
            is_kept=view.is_kept,
            bands=tuple(
                Band(leg.leg, leg.band_low_ratio, leg.band_high_ratio) for leg in view.legs
            ),
            summary=_summary(view) if view.phase is Phase.FINISHED else None,
        )

    def press(self, button: str) -> None:
        """Press a button of the view; waits if another session begins, so call it in a thread."""
        if button == Button.START and self._session.view().may_be_replaced:
            try:
                self._leave()
            finally:
                self._session = self._make()  # reads what the one before has written at its end
                self._session.__enter__()
        else:
            self._session.press(Button(button))


def _summary(view: View) -> Summary:
    return Summary(
        walked_s=view.session_walked_s,
        valid_count=sum(leg.session_valid_count for leg in view.legs),
        in_band_count=sum(leg.session_in_band_count for leg in view.legs),
    )
