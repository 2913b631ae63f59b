"""Help as needed in a demonstration: the reference controller of `clients/assist` as a process.

It is a client like any other; the demonstration requests nothing of it but that it holds the lease.
`gaitd-assist run` has the computer's clock. Here it has the act's, so that a computer on which time
passes more slowly does not make its messages old.
"""

import importlib.util
import signal
import sys
from pathlib import Path
from typing import Final

from gaitd_client import Trainer
from gaitd_client.connection import Target

from gaitd_lab.processes import ManagedProcess, ServiceError
from simtime.clock import PageClock

PACKAGE: Final = "gaitd_assist"
SHIPPED: Final = Path("configs") / "assist.toml"
ENDPOINT: Final = 'endpoint = "tcp/127.0.0.1:7447"'
NEEDED: Final = "help as needed must be installed from a clone: `make demo`"


def helper(target: Target, channel: Path, folder: Path) -> ManagedProcess:
    """Start the controller with the settings that are shipped.

    Args:
        target: address of the service, which must be running.
        channel: socket of the act's simulated bus, which has the time.
        folder: for its file and its logs.

    Raises:
        ServiceError: the package is not installed, or not from a clone.
    """
    found = importlib.util.find_spec(PACKAGE)
    shipped = Path(found.origin).parents[1] / SHIPPED if found and found.origin else None
    if shipped is None or not shipped.exists():
        raise ServiceError(NEEDED)
    address = f'endpoint = "{target.endpoints[0]}"\ntrainer = "{target.trainer}"'
    file = folder / SHIPPED.name
    text = shipped.read_text(encoding="utf-8")
    file.write_text(text.replace(ENDPOINT, address), encoding="utf-8")
    words = ("-m", __name__, str(file), str(channel))
    return ManagedProcess("gaitd-assist", words, folder / "assist.log")


def main(file: Path, channel: Path) -> None:
    """Hold the lease and answer, until SIGTERM."""
    from gaitd_assist import read_settings
    from gaitd_assist.program import CLIENT, run

    settings = read_settings(file)
    link = settings.trainer
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with Trainer(
            link.endpoint, trainer=link.trainer, client=CLIENT, clock=PageClock(channel)
        ) as trainer:
            run(settings, file, trainer)
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
