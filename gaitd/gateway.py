"""`gaitd gateway`: the half of the service that a network can reach."""

import json
import logging
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated, Final

import typer

EXIT_CONFIGURATION: Final = 2


def command(
    config: Annotated[Path, typer.Option("--config", help="Trainer file.", dir_okay=False)],
) -> None:
    """Zenoh, events and requests of the service; ends with SIGTERM, exit code 0."""
    from contextlib import closing

    import zenoh

    from daemon.clock import MonotonicClock
    from daemon.config.strict import ConfigError
    from daemon.config.trainer import load_trainer
    from daemon.gateway import endpoints
    from daemon.gateway.notes_disk import NotesDisk
    from daemon.gateway.process import serve
    from daemon.holding import hold
    from daemon.notes_file import NAME

    file = load_trainer(config)
    settings = file.trainer.zenoh
    bad = endpoints.refused(settings.listen, beyond_loopback=settings.listen_beyond_loopback)
    if bad:
        raise ConfigError(config, f"zenoh.listen[{bad[0]}]", bad[1], endpoints.ALLOWED)
    _log_to_stderr()
    zenoh.init_log_from_env_or("error")
    ending = _Ending()
    with (
        hold(config, "paths.runtime", file.runtime, "gateway"),
        closing(NotesDisk(file.state / NAME)),
    ):
        try:
            serve(
                settings.trainer,
                settings.listen,
                file.runtime,
                file.state,
                MonotonicClock(),
                ending.asked,
                file.trainer.lease,
                os.environ.get("NOTIFY_SOCKET"),
            )
        except zenoh.ZError as error:
            listen = ", ".join(settings.listen)
            print(f"gaitd gateway: cannot listen on {listen}: {error}", file=sys.stderr)
            raise typer.Exit(EXIT_CONFIGURATION) from error


class _Ending:
    """Whether SIGTERM or SIGINT has come."""

    def __init__(self) -> None:
        self._asked = False
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)

    def asked(self) -> bool:
        return self._asked

    def _ask(self, _signal: int, _frame: FrameType | None) -> None:
        self._asked = True


class _Line(logging.Formatter):
    """One event per line: level, text, and what is known of it as key=value."""

    def format(self, record: logging.LogRecord) -> str:
        fields = {"level": record.levelname.lower(), "text": record.getMessage()}
        event = getattr(record, "event", None)
        if event is not None:
            fields |= {"kind": event.kind, "priority": event.priority, "id": event.id}
            fields |= {"cause": event.cause} if event.cause else {}
        return " ".join(
            f"{key}={json.dumps(str(value), ensure_ascii=False)}" for key, value in fields.items()
        )


def _log_to_stderr() -> None:
    handler = logging.StreamHandler()
    handler.setFormatter(_Line())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
