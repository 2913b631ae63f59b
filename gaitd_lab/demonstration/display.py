"""The patient's page beside a demonstration: a server of `clients/display` as a process.

It is a client like any other, and the demonstration does not depend on it: only its start is
checked.
"""

import contextlib
import importlib.util
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Final

from gaitd_client.connection import Target

from gaitd_lab.processes import ManagedProcess, ServiceError

PACKAGE: Final = "gaitd_display"
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

[target]
share_low_ratio = 0.3
share_high_ratio = 0.7
"""
"""The scripted patient is below the target while passive, and in it while active."""
LEG: Final = """
[[leg]]
name = "{leg}"
glow_full_w = 120.0
"""


@contextlib.contextmanager
def display(
    target: Target, legs: Sequence[str], folder: Path, port: int | None
) -> Generator[int | None]:
    """Serve the page inside the context; yields the process id, None without a page.

    Args:
        target: address of the service.
        legs: the legs that are shown.
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
    text = SETTINGS.format(port=port, endpoint=target.endpoints[0], trainer=target.trainer)
    text += "".join(LEG.format(leg=leg) for leg in legs)
    file.write_text(text, encoding="utf-8")
    words = ("-m", PACKAGE, "patient", "--config", str(file))
    process = ManagedProcess("gaitd-display", words, folder / "display.log")
    try:
        yield process.pid
    finally:
        process.end()
