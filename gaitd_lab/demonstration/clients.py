"""Clients beside a demonstration as processes: pages of `clients/display`, and the assist.

They are clients like any other. In simulated time each is a `client_process.py`; by the computer's
clock it is its own command.
"""

import importlib.util
import json
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from daemon.config.edits import Value, edited
from gaitd_lab.processes import ManagedProcess, ServiceError, ServiceProcesses, free_port

IN_STEP: Final = "gaitd_lab.demonstration.client_process"
DISPLAY, ASSIST = "gaitd_display", "gaitd_assist"
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
    """Return a free port, the first one from `first_port` on, if the page can be served.

    Args:
        kind: whose page it is.
        first_port: the port that is tried first.
    """
    if _shipped(kind) is None:
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


def _shipped(kind: str) -> Path | None:
    """Return the settings of a client that is installed from a clone."""
    found = importlib.util.find_spec(ASSIST if kind == "assist" else DISPLAY)
    if found is None or found.origin is None:
        return None
    file = Path(found.origin).parents[1] / "configs" / f"{kind}.toml"
    return file if file.exists() else None


def shipped_settings(
    kind: str,
    where: ServiceProcesses,
    edits: Mapping[str, Value],
    credentials: Path | None = None,
) -> str:
    """Return the settings that are shipped for a client, with other values of some keys.

    Args:
        kind: `patient`, `therapist`, `engineer` or `assist`.
        where: the service.
        edits: further keys.
        credentials: folder of the client; None: the service has no keys.

    Raises:
        ServiceError: the client is not installed from a clone.
    """
    file = _shipped(kind)
    if file is None:
        raise ServiceError("clients/display and clients/assist must be installed: `make demo`")
    text = file.read_text(encoding="utf-8")
    for key, value in {"trainer.endpoint": where.target.endpoints[0], **edits}.items():
        text = edited(file.name, text, key, value)
    own = {"trainer": where.target.trainer}
    if credentials is not None:
        own["credentials"] = str(credentials)
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in own.items())
    return text.replace("[trainer]\n", f"[trainer]\n{lines}")


def patient_settings(where: ServiceProcesses, port: int, credentials: Path | None = None) -> str:
    """Return the settings of a patient's page without a session, for each leg of the service."""
    settings = shipped_settings("patient", where, {"web.port": port, **PATIENT}, credentials)
    names = [leg["name"] for leg in where.table["leg"]]
    return settings + "".join(OTHER_LEG.format(name=name) for name in names[1:])


def engineer_settings(
    where: ServiceProcesses, port: int, credentials: Path | None, pages: Path | None = None
) -> str:
    """Return the settings of the engineer's page, which shows the truth of the virtual drives.

    Args:
        where: the service.
        port: of the page.
        credentials: folder of the client; None: the service has no keys.
        pages: folder of own pages beside it; None: there are none.
    """
    settings = shipped_settings("engineer", where, {"web.port": port}, credentials)
    own = "" if pages is None else f"pages = {json.dumps(str(pages.absolute()))}\n"
    return f"truth = {json.dumps(str(where.truth_path))}\n{own}{settings}"


def start_client(kind: str, where: ServiceProcesses, settings: str) -> ManagedProcess:
    """Start a client, which must be ended by `ManagedProcess.end`.

    Args:
        kind: as of `shipped_settings`.
        where: the service.
        settings: content of the client's file.
    """
    file = where.folder / f"{kind}.toml"
    file.write_text(settings, encoding="utf-8")
    if not where.tempo.wall_clock:
        words = ("-m", IN_STEP, kind, str(file), str(where.channel), where.leg)
    elif kind == "assist":
        words = ("-m", f"{ASSIST}.program", "run", "--config", str(file))
    else:
        words = ("-m", DISPLAY, kind, "--config", str(file))
    return ManagedProcess(f"the client {kind}", words, where.folder / f"{kind}.log")
