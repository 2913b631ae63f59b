"""A client of an act as a process in the act's time: a page of `clients/display`, or the assist.

`gaitd-display` and `gaitd-assist` have the computer's clock. Here silence, rests and blocks are
measured in the act's time, and the client has a seat in step, like the core (`turns.py`). The
programs know nothing of it: they are given a `Clock`, as in their tests. A login is of a person,
and keeps the computer's clock.
"""

import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gaitd_client import NotValid, Stream, Trainer
from gaitd_client.wire import Estimate

from gaitd_lab.demonstration.turns import pass_turn
from simtime.clock import PageClock
from simtime.link import Link, LinkLostError, SocketLink
from simtime.wire import Role

TURN_NS: Final = 30_000_000
"""Time that may pass beyond what was received; with the 100 ms between two messages of a drive less
than the 200 ms after which a client calls a trainer silent."""
RETRY_S: Final = 0.1


def newest_of(estimates: Stream[Estimate], clock: PageClock) -> Callable[[], int | None]:
    """Return a function for `pass_turn`: the time of a leg's newest message."""

    def newest_ns() -> int | None:
        newest = estimates.newest()
        is_silent = isinstance(newest, NotValid)
        return None if is_silent else newest.sample_time_ns - clock.utc_ahead_ns()

    return newest_ns


def take_turns(link: Link, newest_ns: Callable[[], int | None]) -> None:
    """Let time pass until the process ends; the client outlives the virtual drives."""
    while True:
        try:
            pass_turn(link, TURN_NS, newest_ns)
        except LinkLostError:
            time.sleep(RETRY_S)


def main(kind: str, file: Path, channel: Path, leg: str) -> None:
    """Serve or answer until SIGTERM.

    Args:
        kind: of the client: `assist`, or of the page.
        file: its settings.
        channel: socket of the act's simulated bus.
        leg: a leg of the trainer.
    """
    clock = PageClock(channel)

    def sit(trainer: Trainer) -> None:
        link = SocketLink(channel, Role.IN_STEP, kind)
        newest_ns = newest_of(trainer.estimate(leg), clock)
        threading.Thread(target=take_turns, args=(link, newest_ns), daemon=True).start()

    if kind == "assist":
        _assist(file, clock, sit)
    else:
        _serve(kind, file, clock, sit)


def _serve(kind: str, file: Path, clock: PageClock, sit: Callable[[Trainer], None]) -> None:
    from gaitd_display.__main__ import server_of
    from gaitd_display.web import serve
    from gaitd_program import CommandError

    made = server_of(kind, file, clock, clock.utc_ahead_ns)
    sit(made.trainer)
    try:
        serve(made.app, made.web)
    except CommandError as error:
        sys.exit(str(error))


def _assist(file: Path, clock: PageClock, sit: Callable[[Trainer], None]) -> None:
    from gaitd_assist import read_settings
    from gaitd_assist.program import CLIENT, run
    from gaitd_client.signals import interrupted_once

    settings = read_settings(file)
    link = settings.trainer
    trainer = Trainer(link.endpoint, trainer=link.trainer, client=CLIENT, clock=clock)
    try:
        with interrupted_once(), trainer:
            sit(trainer)
            run(settings, file, trainer)
    except KeyboardInterrupt:
        sys.exit(0)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4])
