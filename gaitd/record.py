"""`gaitd record`: recordings of a running service as MCAP and Parquet, by `clients/record`.

A client of role `display`. It waits for a service that does not run yet. It ends by Ctrl-C or
SIGTERM, and then finishes what it records. Exit codes: 0; 2 usage, configuration, a folder without
room; 4 no answer from the service.
"""

import signal
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_client import ClientError, NoServiceError, Target, Trainer
from gaitd_client.signals import ENDS
from gaitd_names import ExitCode
from gaitd_record import (
    Begun,
    Deleted,
    Event,
    Finished,
    FullError,
    Ignored,
    Listening,
    Options,
    Purpose,
    RecordError,
    Room,
    Unfinished,
    WhenFull,
    finish_leftovers,
    record,
)

from gaitd.command_line import CommandError, JsonLinesOption, json_text
from gaitd.remote import (
    ConfigOption,
    CredentialsOption,
    EndpointOption,
    TrainerOption,
    client_of,
    find_target,
    report_silence,
)

RETRY_S: Final = 1.0
"""Time between two attempts to find the service."""
LIMIT_MB: Final = 20_000
"""About a hundred hours of one leg."""


def command(
    output: Annotated[Path, typer.Option(help="folder of the recordings", file_okay=False)] = Path(
        "recordings"
    ),
    purpose: Annotated[
        Purpose,
        typer.Option(
            "--for",
            help="what is recorded: training: while the drives are enabled; calibration: each run"
            " of excite and each gait",
        ),
    ] = Purpose.ALL,
    limit_mb: Annotated[
        int, typer.Option(min=1, help="of all recordings in the folder together")
    ] = LIMIT_MB,
    when_full: Annotated[
        WhenFull, typer.Option(help="at the limit, or on a full disk: end, or delete the oldest")
    ] = WhenFull.END,
    only_finish: Annotated[
        bool, typer.Option("--finish", help="only finish what a kill has left in the folder")
    ] = False,
    config: ConfigOption = None,
    endpoint: EndpointOption = None,
    trainer: TrainerOption = None,
    credentials: CredentialsOption = None,
    as_json: JsonLinesOption = False,
) -> None:
    """Record what a running service publishes, until Ctrl-C."""

    def report(event: Event) -> None:
        print(json_text(_fields(event)) if as_json else _line(event), flush=True)

    room = Room(output, limit_mb, when_full)
    try:
        if only_finish:
            if not output.is_dir():
                raise CommandError(f"{output}: no such folder", ExitCode.USAGE, blame=str(output))
            finish_leftovers(output, report)
            return
        target = find_target(config, endpoint, trainer, credentials)
        with _end_requested() as over, ExitStack() as open_until_the_end:
            service = _service(target, over, open_until_the_end)
            if service is not None:
                service.status()  # a wrong trainer has no messages, without end
                record(service, Options(purpose, room), report, over)
    except ClientError as error:
        raise typer.Exit(report_silence("record", str(error), as_json=as_json)) from error
    except RecordError as error:
        raise CommandError(str(error), ExitCode.USAGE, following=_next(error, output)) from error
    except OSError as error:
        file = str(error.filename or output)
        raise CommandError(f"{file}: {error.strerror}", ExitCode.USAGE, blame=file) from error


def _service(target: Target, over: threading.Event, ending: ExitStack) -> Trainer | None:
    """Connect to the service, and wait for one that does not run yet; None: ended before."""
    is_reported = False
    while not over.is_set():
        try:
            return ending.enter_context(client_of(target, "record"))
        except NoServiceError as error:
            if not is_reported:
                is_reported = True
                print(f"waiting: {error}", file=sys.stderr, flush=True)
            over.wait(RETRY_S)
    return None


@contextmanager
def _end_requested() -> Generator[threading.Event]:
    """Yield what the first signal sets; those after it change nothing: the end takes seconds."""
    over = threading.Event()
    before = {one: signal.signal(one, lambda _signal, _frame: over.set()) for one in ENDS}
    try:
        yield over
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _next(error: RecordError, folder: Path) -> str:
    """Return the command to give next."""
    if isinstance(error, FullError):
        return "gaitd record --when-full delete-oldest, or another --output or --limit-mb"
    return f"gaitd record --finish --output {folder}"


def _fields(event: Event) -> dict[str, object]:
    return {"event": type(event).__name__.lower(), **event._asdict()}


def _line(event: Event) -> str:
    match event:
        case Listening():
            return f"listening    {event.service}"
        case Begun():
            return f"begun        {event.path}"
        case Deleted():
            return f"deleted      {event.path}"
        case Ignored():
            return f"ignored      {event.key}: is no message of gaitd: {event.reason}"
        case Unfinished():
            return f"unfinished   {event.reason}"
        case Finished():
            duration_s = (event.end_utc_ns - event.begun_utc_ns) / 1e9
            lost = sum(event.lost.values())
            ended = "" if event.ended == "in order" else f"; {event.ended}"
            return (
                f"finished     {event.path}: {duration_s:.1f} s, {event.message_count} messages,"
                f" {lost} lost, {event.size_bytes / 1e6:.1f} MB{ended}"
            )
