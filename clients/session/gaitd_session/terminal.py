"""A session in a terminal: the view as text, three keys as buttons."""

import os
import select
import sys
import termios
import tty
from collections.abc import Generator
from contextlib import contextmanager
from typing import Final

from gaitd_client import Cause
from gaitd_texts import Catalogue, Reader, catalogue, key_of
from rich.console import Group
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from gaitd_session.machine import Button, Phase
from gaitd_session.session import Session
from gaitd_session.view import LegView, View

KEYS: Final = {"s": Button.START, "p": Button.PAUSE, "e": Button.END}
POLL_S: Final = 0.1
KEYS_MAX: Final = 64
"""Read at once."""
SECONDS_PER_MINUTE: Final = 60


class NoTerminalError(Exception):
    """The input is no terminal, so nothing could be pressed."""


def run(session: Session, texts: Catalogue) -> View:
    """Show a session, and press its buttons, until it is finished; return its last view.

    Raises:
        KeyboardInterrupt: a person ends the program.
        NoTerminalError: the input is no terminal.
        SessionError: the session has ended by an error.
    """
    with _single_keys(), Live(auto_refresh=False, screen=False) as live:
        while True:
            view = session.view()
            live.update(render(view, texts), refresh=True)
            if view.phase is Phase.FINISHED and not view.buttons:
                return view
            for key in _pressed(POLL_S):
                if key in KEYS:
                    session.press(KEYS[key])


def render(view: View, texts: Catalogue) -> Panel:
    """Return the view as text, in the patient's words; those for a helper are the operator's."""
    operator = catalogue(Reader.OPERATOR, texts.language)
    lines = [
        Text(texts.text(f"session.{view.phase}").upper(), style="bold", justify="center"),
        Text(texts.text(f"advice.{view.advice}"), justify="center"),
    ]
    if view.refusal is not None:
        lines.append(Text(operator.refusal(view.refusal), justify="center"))
    if view.cause != Cause.NONE:
        lines.append(Text(texts.text(f"happened.{key_of(view.cause)}"), justify="center"))
    if view.why is not None:
        lines.append(Text(texts.text(f"why.{view.why}"), justify="center"))
    if view.block is not None:
        block = texts.text(
            "terminal.block",
            number=view.block.number,
            count=view.block.count,
            kind=operator.text(f"block.{view.block.kind}"),
            left=_minutes(view.block_left_s),
            session_left=_minutes(view.session_left_s),
        )
        lines.append(Text(block))
    lines += [Text(_leg(leg, texts)) for leg in view.legs]
    if view.history_trouble:
        lines.append(Text(f"{texts.text('label.not_kept')}: {view.history_trouble}"))
    lines.append(Text("   ".join(_key(button, texts) for button in view.buttons)))
    return Panel(Group(*lines), subtitle=texts.text("label.to_stop"))


def _key(button: Button, texts: Catalogue) -> str:
    key = next(key for key, one in KEYS.items() if one is button)
    return f"[{key}] {texts.text(f'press.{button}').upper()}"


def _leg(leg: LegView, texts: Catalogue) -> str:
    return texts.text(
        "terminal.leg",
        leg=texts.text(f"label.{leg.leg}"),
        share=leg.share_ratio,
        low=leg.band_low_ratio,
        high=leg.band_high_ratio,
        reached=leg.in_band_count,
        count=leg.stride_count,
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
