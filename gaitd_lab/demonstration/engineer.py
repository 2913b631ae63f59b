"""The engineer's page beside a demonstration: a server of `clients/display` as a process.

It is a client like any other, and is there if it can be: where its package is missing or no port is
free the demonstration says so, and goes on, as it does if the server ends. `gaitd-display engineer`
has the computer's clock. Here it has one that is as slow as the act's, too, so that neither a busy
computer nor a fast act makes its messages old.
"""

import contextlib
import importlib.util
import json
import socket
import sys
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_client import Clock, MonotonicClock, Trainer

from gaitd_lab.processes import ManagedProcess, ServiceProcesses
from simtime.clock import PageClock

PACKAGE: Final = "gaitd_display"
HOST: Final = "127.0.0.1"
PORTS_TRIED: Final = 20
SETTINGS: Final = """\
truth = {truth}

[web]
host = "127.0.0.1"
port = {port}

[trainer]
endpoint = "{endpoint}"
trainer = "{trainer}"
"""


class EngineerPage(NamedTuple):
    """Where the engineer's page is, or why it is not."""

    port: int | None
    said: str
    """One line for a person."""

    @property
    def address(self) -> str:
        """Address of the page; empty without one."""
        return "" if self.port is None else address_of(self.port)


def address_of(port: int) -> str:
    """Return the address of a page on loopback."""
    return f"http://{HOST}:{port}/"


def find_engineer_page(first_port: int) -> EngineerPage:
    """Return the first free port from `first_port` on, if the package is installed."""
    if importlib.util.find_spec(PACKAGE) is None:
        return EngineerPage(None, "the engineer's page needs clients/display: `make demo`")
    for port in range(first_port, min(first_port + PORTS_TRIED, 65536)):
        if _is_free(port):
            return EngineerPage(port, f"the engineer's page: {address_of(port)}")
    last_port = first_port + PORTS_TRIED - 1
    return EngineerPage(None, f"no engineer's page: ports {first_port} to {last_port} are in use")


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        # As the server binds: connections of an earlier page that are closing are no obstacle.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


@contextlib.contextmanager
def engineer_page(where: ServiceProcesses, port: int | None) -> Generator[int | None]:
    """Serve the engineer's page inside the context; yields the process id, None without a page.

    Args:
        where: the running service, and the file of its virtual drives' truth.
        port: of the page on loopback; None: there is no page.
    """
    if port is None:
        yield None
        return
    file = where.folder / "engineer.toml"
    file.write_text(
        SETTINGS.format(
            port=port,
            endpoint=where.target.endpoints[0],
            trainer=where.target.trainer,
            truth=json.dumps(str(where.truth_path)),
        ),
        encoding="utf-8",
    )
    words = ("-m", __name__, str(file), str(where.channel))
    process = ManagedProcess("gaitd-display engineer", words, where.folder / "engineer.log")
    try:
        yield process.pid
    finally:
        process.end()


class SlowerClock:
    """Passes as slowly as the slower of two clocks."""

    def __init__(self, one: Clock, other: Clock) -> None:
        """Begin at 0."""
        self._clocks, self._lock = (one, other), threading.Lock()
        self._read_ns = [clock.now_ns() for clock in self._clocks]
        self._now_ns = 0

    def now_ns(self) -> int:
        """Time since it was made, in ns."""
        with self._lock:
            read_ns = [clock.now_ns() for clock in self._clocks]
            passed_ns = (now - then for now, then in zip(read_ns, self._read_ns, strict=True))
            self._read_ns, self._now_ns = read_ns, self._now_ns + min(passed_ns)
            return self._now_ns


def main(file: Path, channel: Path) -> None:
    """Serve until SIGTERM."""
    from gaitd_display.engineer import EngineerServer
    from gaitd_display.settings import EngineerSettings, read_settings
    from gaitd_display.web import serve

    settings = read_settings(file, EngineerSettings)
    act, link = PageClock(channel), settings.trainer
    clock = SlowerClock(act, MonotonicClock())
    trainer = Trainer(link.endpoint, trainer=link.trainer, clock=clock, keep_trying=True)
    serve(EngineerServer(settings, trainer, act.utc_ahead_ns).app, settings.web)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
