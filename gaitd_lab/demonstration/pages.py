"""Pages beside a demonstration: servers of `clients/display` as processes, on loopback.

They are clients like any other. In simulated time each is a `page_server.py`; by the computer's
clock it is the command `gaitd-display`.
"""

import contextlib
import importlib.util
import json
import socket
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from daemon.config.edits import Value, edited
from gaitd_lab.processes import ManagedProcess, ServiceError, ServiceProcesses, free_port

PACKAGE: Final = "gaitd_display"
SERVER: Final = "gaitd_lab.demonstration.page_server"
HOST: Final = "127.0.0.1"
PORTS_TRIED: Final = 20
"""Then any free port is taken."""
PORT_MAX: Final = 65535
PATIENT: Final = {
    "page.help.en": "This is a demonstration.",
    "page.help.de": "Dies ist eine Vorführung.",
    "page.unstrap.en": "There are no straps.",
    "page.unstrap.de": "Es gibt keine Gurte.",
}
OTHER_LEG: Final = """
[[leg]]
name = "{name}"
glow_full_w = 120.0
"""
ENGINEER: Final = """\
truth = {truth}

[web]
host = "{host}"
port = {port}

[trainer]
endpoint = "{endpoint}"
trainer = "{trainer}"
{credentials}
"""


class PageSpot(NamedTuple):
    """Where a page is, or why it is not."""

    port: int | None
    said: str
    """One line for a person."""

    @property
    def shown(self) -> str:
        """Address for the live view; empty without a page."""
        return "" if self.port is None else f"in a browser: {address_of(self.port)}"


def address_of(port: int) -> str:
    """Return the address of a page on loopback."""
    return f"http://{HOST}:{port}/"


def find_page(kind: str, first_port: int) -> PageSpot:
    """Return a free port, the first one from `first_port` on, if the package is installed.

    Args:
        kind: whose page it is.
        first_port: the port that is tried first.
    """
    if importlib.util.find_spec(PACKAGE) is None:
        return PageSpot(None, f"the {kind}'s page needs clients/display: `make demo`")
    ports = range(first_port, min(first_port + PORTS_TRIED, PORT_MAX + 1))
    port = next((port for port in ports if _is_free(port)), None) or free_port()
    return PageSpot(port, f"the {kind}'s page: {address_of(port)}")


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        # As the server binds: connections of an earlier page that are closing are no obstacle.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def shipped_settings(
    kind: str, where: ServiceProcesses, port: int, edits: Mapping[str, Value]
) -> str:
    """Return the settings that are shipped for a server, with other values of some keys.

    Args:
        kind: `patient` or `therapist`.
        where: the running service.
        port: of the page.
        edits: further keys.

    Raises:
        ServiceError: `clients/display` is not installed from a clone.
    """
    found = importlib.util.find_spec(PACKAGE)
    file = (
        Path(found.origin).parents[1] / "configs" / f"{kind}.toml"
        if found and found.origin
        else None
    )
    if file is None or not file.exists():
        raise ServiceError(f"the {kind}'s page must be installed from a clone: `make demo`")
    text = file.read_text(encoding="utf-8")
    own = {"web.port": port, "trainer.endpoint": where.target.endpoints[0], **edits}
    for key, value in own.items():
        text = edited(file.name, text, key, value)
    return text


def with_credentials(settings: str, folder: Path) -> str:
    """Return settings with the credentials of their client."""
    return settings.replace("[trainer]\n", f"[trainer]\n{_credentials(folder)}\n")


def _credentials(folder: Path | None) -> str:
    return "" if folder is None else f"credentials = {json.dumps(str(folder))}"


@contextlib.contextmanager
def page(kind: str, where: ServiceProcesses, settings: str) -> Generator[ManagedProcess]:
    """Serve a page inside the context.

    Args:
        kind: `patient`, `therapist` or `engineer`.
        where: the running service.
        settings: content of the server's file.
    """
    file = where.folder / f"{kind}.toml"
    file.write_text(settings, encoding="utf-8")
    if where.tempo.wall_clock:
        words = ("-m", PACKAGE, kind, "--config", str(file))
    else:
        words = ("-m", SERVER, kind, str(file), str(where.channel), where.leg)
    process = ManagedProcess(f"gaitd-display {kind}", words, where.folder / f"{kind}.log")
    try:
        yield process
    finally:
        process.end()


@contextlib.contextmanager
def engineer_page(
    where: ServiceProcesses, port: int | None, credentials: Path | None = None
) -> Generator[None]:
    """Serve the engineer's page inside the context, if it can be; a demonstration goes on without.

    Args:
        where: the running service, and the file of its virtual drives' truth.
        port: of the page on loopback; None: there is no page.
        credentials: folder of the server's client; None: the service has no keys.
    """
    if port is None:
        yield
        return
    settings = ENGINEER.format(
        truth=json.dumps(str(where.truth_path)),
        host=HOST,
        port=port,
        endpoint=where.target.endpoints[0],
        trainer=where.target.trainer,
        credentials=_credentials(credentials),
    )
    with page("engineer", where, settings):
        yield


def patient_settings(where: ServiceProcesses, port: int) -> str:
    """Return the settings of a patient's page without a session, for each leg of the service."""
    settings = shipped_settings("patient", where, port, PATIENT)
    names = [leg["name"] for leg in where.table["leg"]]
    return settings + "".join(OTHER_LEG.format(name=name) for name in names[1:])
