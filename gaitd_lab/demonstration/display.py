"""The pages beside a demonstration: servers of `clients/display` as processes.

They are clients like any other, and the demonstration does not depend on them. Of the patient's
page, which is asked for, the start is checked. The engineer's page is there if it can be: where its
package is missing or no port is free the demonstration says so, and goes on.
"""

import contextlib
import importlib.util
import json
import socket
from collections.abc import Generator
from pathlib import Path
from typing import Final, NamedTuple

from gaitd_client.connection import Target

from gaitd_lab.processes import ManagedProcess, ServiceError, ServiceProcesses

PACKAGE: Final = "gaitd_display"
HOST: Final = "127.0.0.1"
PORTS_TRIED: Final = 20
ENGINEER_SETTINGS: Final = """\
truth = {truth}

[web]
host = "127.0.0.1"
port = {port}

[trainer]
endpoint = "{endpoint}"
trainer = "{trainer}"
"""
SETTINGS: Final = """\
[web]
host = "127.0.0.1"
port = {port}

[trainer]
endpoint = "{endpoint}"
trainer = "{trainer}"

[page]
language = "en"
help = {{ en = "This is a demonstration.", de = "Dies ist eine Vorführung." }}
unstrap = {{ en = "There are no straps.", de = "Es gibt keine Gurte." }}

[[bar]]
leg = "{leg}"
target_low_w = 30.0
target_high_w = 100.0
full_w = 120.0
"""
"""The scripted patient is below the band while passive, at 5 W, and in it while active, at 55 W."""


@contextlib.contextmanager
def display(target: Target, leg: str, folder: Path, port: int | None) -> Generator[int | None]:
    """Serve the page inside the context; yields the process id, None without a page.

    Args:
        target: address of the service.
        leg: the leg that is shown.
        folder: for its file and its log.
        port: of the page on loopback; None: there is no page.

    Raises:
        ServiceError: the package is not installed.
    """
    if port is None:
        yield None
        return
    if importlib.util.find_spec(PACKAGE) is None:
        raise ServiceError("the page needs `pip install ./clients/display`, or `make demo-display`")
    file = folder / "display.toml"
    file.write_text(
        SETTINGS.format(port=port, endpoint=target.endpoints[0], trainer=target.trainer, leg=leg),
        encoding="utf-8",
    )
    words = ("-m", PACKAGE, "patient", "--config", str(file))
    process = ManagedProcess("gaitd-display", words, folder / "display.log")
    try:
        yield process.pid
    finally:
        process.end()


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
        ENGINEER_SETTINGS.format(
            port=port,
            endpoint=where.target.endpoints[0],
            trainer=where.target.trainer,
            truth=json.dumps(str(where.truth_path)),
        ),
        encoding="utf-8",
    )
    words = ("-m", PACKAGE, "engineer", "--config", str(file))
    process = ManagedProcess("gaitd-display engineer", words, where.folder / "engineer.log")
    try:
        yield process.pid
    finally:
        process.end()
