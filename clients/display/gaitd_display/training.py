"""The training session on the patient's page: what it is, and the buttons START, PAUSE, END.

`gaitd_session` decides; this file passes its view on, and its buttons back. It exists only if the
file of the server has a table `session`. After a stop the page offers START alone, and only where
no drive has power: START then requests RESET. Every other way out is decided in `way_out.py`.
"""

import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec
from gaitd_client import Clock, Mode, Trainer
from gaitd_session import (
    Advice,
    Band,
    Button,
    Phase,
    Session,
    Step,
    StoreError,
    View,
    Why,
    blocks_of,
    open_history,
    read_profile,
)
from gaitd_session.machine import ACTIVE
from gaitd_toml import ConfigError

from gaitd_display.settings import SessionFiles
from gaitd_display.words import Spoken, spoken

ANNOUNCING: Final = frozenset({Phase.ENABLING, Phase.ANNOUNCED, Phase.STARTING})
"""Phases of a session in which motion is about to begin."""
PAST_SHOWN: Final = 7
"""Sessions before this one."""


class Summary(msgspec.Struct, frozen=True):
    """What a session has been."""

    walked_s: float
    valid_count: int
    """Strides of all legs whose share is known."""
    in_band_count: int
    """Steps in the target."""
    best_row_count: int
    """The longest row of them."""
    share_ratio: float | None
    """Mean share of the session; None: there is none."""
    past_share_ratios: tuple[float, ...] | None
    """Those of the sessions before, oldest first; None: the history cannot be read."""
    best_share_ratio: float | None
    """The highest of all sessions before; None: there is none."""


class TrainingView(msgspec.Struct, frozen=True, kw_only=True):
    """What the page shows of the session."""

    phase: Phase
    advice: Advice
    buttons: tuple[Button, ...]
    reason: Spoken | None
    """Why the last START was refused; None: it was not."""
    why: Why | None
    """What has ended the last START early; None: nothing, or `reason` or a stop says it."""
    is_kept: bool
    """The history is written."""
    number: int
    """Number of the present or next block, from 1."""
    count: int
    """Blocks of the plan."""
    plan_s: float
    """Time of all blocks."""
    block_left_s: float
    """In REST: the rest that is left."""
    block_s: float
    """Whole time of the block, or of the rest."""
    announce_left_s: float
    """Time before which nothing moves, while motion is announced."""
    bands: Mapping[str, Band]
    """Target of each leg."""
    steps: tuple[Step, ...]
    """The newest steps of the block, oldest first."""
    valid_count: int
    """Strides of the block whose share is known."""
    in_band_count: int
    """Steps of the block in the target."""
    session_valid_count: int
    """Strides of the session whose share is known."""
    session_in_band_count: int
    row_count: int
    """Steps in the target now, one after the other."""
    summary: Summary | None
    """None: the session is not finished."""

    @property
    def has_walked(self) -> bool:
        """A part of the plan was walked."""
        return self.number > 1 or self.block_left_s < self.block_s

    @property
    def announces(self) -> bool:
        """Motion is about to begin."""
        return self.phase in ANNOUNCING

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
            ConfigError: the profile cannot be used.
        """
        self._file, self._trainer, self._clock = files.profile, trainer, clock
        self._profile = read_profile(self._file)
        self._history = open_history(files.history)
        self._changing = threading.Lock()
        self._is_over = False
        self._session = self._make()
        self._past = self._past_shares()

    def _make(self) -> Session:
        """Return a session of the profile as it is now; one that cannot be read changes nothing."""
        self._read_at = _stamp(self._file)
        try:
            self._profile = read_profile(self._file)
        except ConfigError as error:
            print(f"{error.lines}\nthe profile of before stays in force", file=sys.stderr)
        self._plan = blocks_of(self._profile)
        return Session(self._trainer, self._profile, self._history, self._clock)

    def refresh(self) -> None:
        """Take a profile that was changed, as long as nothing has begun; call it in a thread."""
        with self._changing:
            is_due = self._read_at != _stamp(self._file)
            if is_due and not self._is_over and self._session.view().phase is Phase.WAITING:
                self._replace()

    def _replace(self) -> None:
        try:
            self._leave()
        finally:
            self._session = self._make()  # reads what the one before has written at its end
            self._past = self._past_shares()
            self._session.__enter__()

    def _past_shares(self) -> tuple[float, ...] | None:
        """Return the mean shares of the sessions before, oldest first; None: not known."""
        store = self._history.store
        if store is None:
            return None
        try:
            summaries = store.summaries(self._profile.id)
        except StoreError:
            return None  # the session itself says that the history cannot be read
        shares = (one.mean_share_ratio for one in summaries)
        return tuple(share for share in shares if share is not None)

    def begin(self) -> None:
        """Follow the trainer; nothing is requested before START."""
        self._session.__enter__()

    def end(self) -> None:
        """End the session: it switches the drives off if it has switched them on."""
        try:
            with self._changing:
                self._is_over = True
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
        block, refusal = view.block, view.refusal
        return TrainingView(
            phase=view.phase,
            advice=view.advice,
            buttons=buttons,
            reason=None if refusal is None else spoken(lambda texts: texts.refusal(refusal)),
            why=view.why,
            is_kept=view.is_kept,
            number=len(self._plan) if block is None else block.number,
            count=len(self._plan),
            plan_s=sum(one.walk.duration_s for one in self._plan),
            block_left_s=view.block_left_s,
            block_s=view.block_s,
            announce_left_s=view.announce_left_s,
            bands={leg.leg: Band(leg.band_low_ratio, leg.band_high_ratio) for leg in view.legs},
            steps=view.steps,
            valid_count=sum(leg.valid_count for leg in view.legs),
            in_band_count=sum(leg.in_band_count for leg in view.legs),
            session_valid_count=sum(leg.session_valid_count for leg in view.legs),
            session_in_band_count=sum(leg.session_in_band_count for leg in view.legs),
            row_count=view.row_count,
            summary=self._summary(view) if view.phase is Phase.FINISHED else None,
        )

    def _summary(self, view: View) -> Summary:
        return Summary(
            walked_s=view.session_walked_s,
            valid_count=sum(leg.session_valid_count for leg in view.legs),
            in_band_count=sum(leg.session_in_band_count for leg in view.legs),
            best_row_count=view.best_row_count,
            share_ratio=view.session_share_ratio,
            past_share_ratios=None if self._past is None else self._past[-PAST_SHOWN:],
            best_share_ratio=max(self._past or (), default=None),
        )

    def press(self, button: str) -> None:
        """Press a button of the view; waits if another session begins, so call it in a thread."""
        if button != Button.START:
            self._session.press(Button(button))  # what ends a motion waits for nothing
            return
        with self._changing:
            if self._session.view().may_be_replaced:
                self._replace()
            else:
                self._session.press(Button.START)


def _stamp(file: Path) -> tuple[int, int, int] | None:
    """Return what differs where a file is another one; None: it is not there."""
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns, found.st_size
