"""A session in a terminal: the view as text, three keys as buttons."""

import os
import select
import sys
import termios
import tty
from collections.abc import Generator
from contextlib import contextmanager
from typing import Final

from rich.console import Group
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from gaitd_session.machine import Button, Phase
from gaitd_session.plan import BlockKind
from gaitd_session.session import Session
from gaitd_session.texts import WHY
from gaitd_session.view import LegView, View

KEYS: Final = {"s": Button.START, "p": Button.PAUSE, "e": Button.END}
NAMES: Final = {Button.START: "[s] START", Button.PAUSE: "[p] PAUSE", Button.END: "[e] END"}
KINDS: Final = {BlockKind.WARM_UP: "warm-up", BlockKind.WALKING: "walking"}
POLL_S: Final = 0.1
KEYS_MAX: Final = 64
"""Read at once."""
SECONDS_PER_MINUTE: Final = 60


class NoTerminalError(Exception):
    """The input is no terminal, so nothing could be pressed."""


def run(session: Session) -> View:
    """Show a session, and press its buttons, until it is finished; return its last view.

    Raises:
        KeyboardInterrupt: a person ends the program.
        NoTerminalError: the input is no terminal.
        SessionError: the session has ended by an error.
    """
    with _single_keys(), Live(auto_refresh=False, screen=False) as live:
        while True:
            view = session.view()
            live.update(render(view), refresh=True)
            if view.phase is Phase.FINISHED and not view.buttons:
                return view
            for key in _pressed(POLL_S):
                if key in KEYS:
                    session.press(KEYS[key])


def render(view: View) -> Panel:
    """Return the view as text."""
    lines = [
        Text(view.word.upper(), style="bold", justify="center"),
        Text(view.text, justify="center"),
    ]
    if view.reason:
        lines.append(Text(view.reason, justify="center"))
    if view.why is not None:
        lines.append(Text(WHY[view.why].en, justify="center"))
    if view.block is not None:
        kind = KINDS[view.block.kind]
        lines.append(
            Text(
                f"block {view.block.number} of {view.block.count} ({kind}):"
                f" {_minutes(view.block_left_s)} left, session {_minutes(view.session_left_s)}"
            )
        )
    lines += [Text(_leg(leg)) for leg in view.legs]
    if view.history_trouble:
        lines.append(Text(f"history: {view.history_trouble}", style="italic"))
    lines.append(Text("   ".join(NAMES[button] for button in view.buttons)))
    return Panel(Group(*lines), subtitle="to stop, let go of the hand switch")


def _leg(leg: LegView) -> str:
    share = "–" if leg.share_ratio is None else f"{leg.share_ratio:.0%}"
    return (
        f"{leg.leg}: your share {share}, target {leg.band_low_ratio:.0%} to"
        f" {leg.band_high_ratio:.0%}, reached in {leg.in_band_count} of {leg.stride_count} strides"
    )


def _minutes(duration_s: float) -> str:
    minutes, seconds = divmod(round(duration_s), SECONDS_PER_MINUTE)
    return f"{minutes}:{seconds:02d}"


def _pressed(within_s: float) -> str:
    """Return what was typed; empty if nothing was within the time."""
    readable, _, _ = select.select([sys.stdin], [], [], within_s)
    # Not by `sys.stdin.read`, whose buffer `select` does not see.
    return os.read(sys.stdin.fileno(), KEYS_MAX).decode(errors="replace") if readable else ""


@contextmanager
def _single_keys() -> Generator[None]:
    """Read keys without Enter."""
    if not sys.stdin.isatty():
        raise NoTerminalError("the input is no terminal, and keys are the buttons; run it in one")
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin, termios.TCSANOW)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
