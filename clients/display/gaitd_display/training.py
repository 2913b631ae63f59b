"""The training session on the patient's page: time left, and the buttons START, PAUSE, END.

`gaitd_session` decides; this file passes its view on, and its buttons back. It exists only if the
file of the server has a table `session`. After a stop the page offers none of these buttons: the
way out is decided in `way_out.py` alone.
"""

import sys
from collections.abc import Callable
from typing import Final

import msgspec
from gaitd_client import Clock, Mode, Trainer
from gaitd_session import Button, Phase, Session, open_history, read_profile

from gaitd_display.settings import SessionFiles

STOPPED_MODES: Final = frozenset({Mode.STOPPING, Mode.FAULT})


class TrainingView(msgspec.Struct, frozen=True):
    """What the page shows of the session."""

    phase: str
    advice: str
    buttons: tuple[str, ...]
    block_number: int | None
    block_count: int | None
    left_s: float
    """All blocks and rests that are left."""
    rest_left_s: float | None
    """None: no rest."""
    reason: str
    """Text of the service for a stop or a refusal; empty without one."""
    is_kept: bool
    """The history is written."""


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
        self._session.__exit__(None, None, None)
        if self._session.left_on:
            print(f"the drives may be on: {self._session.left_on}", file=sys.stderr)
        if self._history.store is not None:
            self._history.store.close()

    def view(self, mode: str | None) -> TrainingView:
        """Return what the page shows.

        Args:
            mode: of the service; None: unknown, then there is no button.

        Raises:
            SessionError: the session has ended by an error, printed to stderr.
        """
        view = self._session.view()
        buttons = tuple(map(str, view.buttons))
        if view.may_be_replaced:
            buttons = (str(Button.START), *buttons)
        if mode is None or mode in STOPPED_MODES:
            buttons = ()
        return TrainingView(
            phase=str(view.phase),
            advice=str(view.advice),
            buttons=buttons,
            block_number=None if view.block is None else view.block.number,
            block_count=None if view.block is None else view.block.count,
            left_s=view.session_left_s,
            rest_left_s=view.block_left_s if view.phase is Phase.REST else None,
            reason=view.reason,
            is_kept=view.is_kept,
        )

    def press(self, button: str) -> None:
        """Press a button of the view; waits if another session begins, so call it in a thread."""
        if button == Button.START and self._session.view().may_be_replaced:
            before, self._session = self._session, self._make()
            before.__exit__(None, None, None)
            self._session.__enter__()
        else:
            self._session.press(Button(button))
