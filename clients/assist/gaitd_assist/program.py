"""The command `gaitd-assist run --config FILE`: hold the lease, and answer until it is ended.

It requests no mode: an operator or a session starts the gait.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Final

import typer
from gaitd_client import (
    Assist,
    ClientError,
    CredentialsError,
    Estimate,
    Lease,
    NoAnswerError,
    NotValid,
    Refusal,
    Safety,
    Stream,
    Stride,
    Trainer,
    read_credentials,
)
from gaitd_client.signals import interrupted_once
from gaitd_names import ExitCode
from gaitd_program import CommandError, parser
from gaitd_program import run as run_program

from gaitd_assist.journal import Journal
from gaitd_assist.law import Law, Pair
from gaitd_assist.leg import LegController, StrideLine
from gaitd_assist.settings import Settings, check_caps, read_settings, stiffness_of

CLIENT: Final = "gaitd-assist"
WRITE_S: Final = 0.5
"""Time between two writes of the log."""


MakeLaw = Callable[[], Law]


class Answers:
    """The law that the lease calls with each estimate of each leg."""

    def __init__(
        self,
        settings: Settings,
        stiffness: Pair | None,
        trainer: Trainer,
        journal: Journal,
        more: Sequence[MakeLaw],
    ) -> None:
        """Subscribe to what the laws need besides the estimate."""
        self._journal = journal
        self._safety: Stream[Safety] = trainer.safety()
        self._strides: dict[str, Stream[Stride]] = {}
        self._legs: dict[str, LegController] = {}
        for leg in settings.legs:
            self._strides[leg] = trainer.stride(leg)
            self._legs[leg] = settings.controller(stiffness)
            self._legs[leg].laws += [make_law() for make_law in more]

    def __call__(self, estimate: Estimate) -> Assist:
        """Answer one estimate."""
        safety, leg = self._safety.newest(), self._legs[estimate.leg]
        setpoint = leg.answer(estimate, None if isinstance(safety, NotValid) else safety.stage)
        stride = self._strides[estimate.leg].newest()
        line = None if isinstance(stride, NotValid) else leg.end_stride(stride)
        if line is not None:
            self._journal.add(line)
        return setpoint


def run(
    settings: Settings,
    path: Path,
    trainer: Trainer,
    duration_s: float | None = None,
    more: Sequence[MakeLaw] = (),
) -> None:
    """Answer the estimates of a connected trainer.

    Args:
        settings: of the file `path`.
        path: names the file in errors.
        trainer: connected.
        duration_s: by the trainer's clock; None: until KeyboardInterrupt.
        more: makes further laws for each leg, called after those of this package.

    Raises:
        ConfigError: the file does not fit the service.
        ClientError: the service does not answer, or grants no lease.
        OSError: the log cannot be written; the lease is then released.
    """
    trainer.wait_for_core(lambda why: print(f"{CLIENT}: waits: {why}", flush=True))
    configuration = trainer.configuration()
    if not configuration.leg_names:
        raise NoAnswerError(f"{trainer.target}: the core does not run: start it first")
    check_caps(settings, path, configuration, trainer.status().plan)
    stiffness, clock = stiffness_of(settings, path, configuration), trainer.clock
    end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * 1e9)
    with Journal(settings.log) as journal:
        answers = Answers(settings, stiffness, trainer, journal, more)
        with trainer.lease(CLIENT, answers, legs=settings.legs, on_refusal=_report) as lease:
            print(f"{CLIENT}: holds the lease for {', '.join(settings.legs)}", flush=True)
            was, lost_count = "", 0
            while end_ns is None or clock.now_ns() < end_ns:
                lease.wait(WRITE_S)
                for line in journal.write():
                    _publish(line, lease)
                if journal.lost_count > lost_count:
                    lost_count = journal.lost_count
                    print(f"{CLIENT}: {lost_count} lines of the log were lost", file=sys.stderr)
                if lease.why_not != was:
                    was = lease.why_not
                    print(f"{CLIENT}: {was or 'answers again'}", flush=True)


app: Final = parser(CLIENT, "The reference controller of a gait trainer's assist.")


@app.command("run")
def command(
    config: Annotated[Path, typer.Option("--config", help="its settings", dir_okay=False)],
) -> None:
    """Hold the lease and assist, until Ctrl-C or SIGTERM."""
    try:
        with interrupted_once():
            _connect_and_run(config)
    except KeyboardInterrupt:
        print(f"{CLIENT}: ended; the lease is released", flush=True)
    except OSError as error:
        text = f"{error.filename}: {error.strerror}; the log must be writable"
        raise CommandError(text, ExitCode.USAGE) from error


def main() -> None:
    """Entry point of the script."""
    run_program(app, {ClientError: ExitCode.UNAVAILABLE, CredentialsError: ExitCode.USAGE})


def _connect_and_run(file: Path) -> None:
    settings = read_settings(file)
    link = settings.trainer
    credentials = None if link.credentials is None else read_credentials(link.credentials)
    with Trainer(link.endpoint, credentials, trainer=link.trainer, client=CLIENT) as trainer:
        run(settings, file, trainer)


def _publish(line: StrideLine, lease: Lease) -> None:
    """Publish a stride's state for displays; the gait goes on if that fails."""
    try:
        lease.report(line.leg, line.cycle, line.values, line.hip, line.slide)
    except ClientError as error:
        print(f"{CLIENT}: stride {line.number} is not published: {error}", file=sys.stderr)


def _report(refusal: Refusal) -> None:
    refused = f"{refusal.setpoint_count} setpoints refused: {refusal.meaning}; {refusal.remedy}"
    print(f"{CLIENT}: {refused}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
