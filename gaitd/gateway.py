"""`gaitd gateway`: the process of the service that serves the network."""

import os
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final

from gaitd_names import ExitCode

from gaitd.command_line import CommandError, ConfigFile, JsonLinesOption

if TYPE_CHECKING:
    from daemon.config.trainer import TrainerFile

RETRY_S: Final = 1.0


def command(
    config: ConfigFile,
    as_json: JsonLinesOption = False,
) -> None:
    """Run Zenoh, events and requests of the service until SIGTERM; exit code 0."""
    from contextlib import closing

    import zenoh
    from gaitd_toml import ConfigError

    from daemon.config.trainer import SIMULATED, load_trainer
    from daemon.gateway import log
    from daemon.gateway.process import serve, share_one_heap
    from daemon.gateway.reload import Reload
    from daemon.ipc.state_file import NAME
    from daemon.keys.folder import read_keys
    from daemon.recorder.state_file_sync import StateFileSync
    from daemon.system.bus_choice import simulation
    from daemon.system.clock import MonotonicClock
    from daemon.system.journal import SOCKET, Journal, is_journal, to_stderr
    from daemon.system.lock import hold
    from daemon.system.sd_notify import Notifier
    from daemon.zenoh_io import endpoints

    def read(path: Path) -> "TrainerFile":
        return endpoints.check(load_trainer(path))

    share_one_heap()
    file = read(config)
    settings = file.trainer.zenoh
    is_simulated = file.trainer.bus.interface == SIMULATED
    clock = simulation(config).page_clock(Path(file.channel)) if is_simulated else MonotonicClock()
    in_journal = is_journal(os.environ.get("JOURNAL_STREAM"), sys.stderr.fileno())
    journal = Journal("gaitd-gateway", SOCKET if in_journal else None)
    log.begin(journal, file.trainer.log.level, sys.stdout if as_json else None)
    zenoh.init_log_from_env_or("error")
    ending, reload = _Ending(), Reload(file, read)
    signal.signal(signal.SIGHUP, reload.request)
    with (
        closing(journal),
        hold(config, "paths.runtime", file.runtime, "gateway"),
        closing(StateFileSync(file.state / NAME)),
    ):
        restarts = False
        while True:
            try:
                restarts = serve(
                    settings.trainer,
                    settings.listen,
                    file.runtime,
                    file.state,
                    clock,
                    ending.is_requested,
                    file.trainer.lease,
                    os.environ.get("NOTIFY_SOCKET"),
                    reload,
                    lambda: None if file.keys is None else read_keys(file.keys),
                )
            except (zenoh.ZError, ConfigError) as error:
                listen = ", ".join(settings.listen)
                what = (
                    f"cannot listen on {listen}: {error}"
                    if isinstance(error, zenoh.ZError)
                    else error
                )
                if not restarts:
                    text, blame = f"gaitd gateway: {what}", f"{config}: zenoh.listen"
                    raise CommandError(text, ExitCode.USAGE, blame=blame) from error
                # It ran before: an end now would take the clients' STOP away for good.
                to_stderr(f"gaitd gateway: {what}; it tries again")
                with closing(Notifier(os.environ.get("NOTIFY_SOCKET"))) as supervisor:
                    supervisor.send("WATCHDOG=1", "STATUS=cannot listen; tries again")
                time.sleep(RETRY_S)
            if ending.is_requested() or not restarts:
                return


class _Ending:
    """Flag that SIGTERM or SIGINT sets."""

    def __init__(self) -> None:
        self._is_requested = False
        signal.signal(signal.SIGTERM, self._request)
        signal.signal(signal.SIGINT, self._request)

    def is_requested(self) -> bool:
        return self._is_requested

    def _request(self, _signal: int, _frame: FrameType | None) -> None:
        self._is_requested = True
