"""The acceptance of each drive as files: a record, JSON, and the page that is made from it."""

import os
from contextlib import ExitStack
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from signal import SIGHUP, SIGTERM, default_int_handler, signal
from tempfile import TemporaryFile
from typing import Final

from gaitd_client import NoServiceError, Target
from gaitd_toml import COMMAND_LINE, ConfigError

from analysis.acceptance import page, record
from analysis.acceptance.record import AcceptanceRecord, Reason, ReasonCode
from daemon.config.bundle import Settings
from gaitd.commissioning.local_service import LocalService
from gaitd.commissioning.messages import Instruction, InstructionCode
from gaitd.commissioning.plans import Gait, acceptance
from gaitd.commissioning.procedure import State
from gaitd.commissioning.run import Operator, Run
from gaitd.language import texts
from gaitd.remote import client_of

ROOM_BYTES: Final = 2_000_000
"""Much more than what the files of one drive take."""


def accept(
    target: Target, settings: Settings, operator: Operator, gait: Gait, folder: Path
) -> Reason | None:
    """Do the whole procedure, and write a record and a page for each drive.

    They are written whatever ends the procedure.

    Returns: why not all steps were done; None if they were.

    Raises:
        ClientError: the service does not answer, or its core was started anew.
        ConfigError: the folder has records already.
        OSError: a file cannot be written.
    """
    prepare(folder, settings)
    for ending in (SIGTERM, SIGHUP):  # so that the machine is stopped if the terminal is gone, too
        signal(ending, default_int_handler)
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    with ExitStack() as connection:
        trainer, blocked = None, None
        try:
            trainer = connection.enter_context(client_of(target, "commission"))
        except NoServiceError as error:  # its bring-up may have refused a drive: that can be read
            blocked = Reason(ReasonCode.NO_SERVICE, values={"said": str(error)})
        service = LocalService(trainer, settings)
        if blocked is None and (foreign := service.foreign_files()):
            blocked = Reason(ReasonCode.OTHER_FILES, values={"files": foreign})
        run = Run(acceptance(settings, gait), service, operator, State(blocked=blocked))
        try:
            run.play_to_rest()
        finally:
            boot_id = "" if trainer is None else service.boot_id
            for path in write(run, settings, utc, boot_id, folder):
                operator.follow(Instruction(InstructionCode.WRITTEN, values={"file": str(path)}))
    return run.state.blocked


def prepare(folder: Path, settings: Settings) -> None:
    """Make the folder, and refuse one that cannot take the records, before anything moves.

    Raises:
        ConfigError: it has records already, which are kept.
        OSError: it cannot be written, or has no room.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for drive in settings.drives:
        path = record_path(folder, drive.name)
        if path.exists():
            allowed = f"another folder: {path.name} is in this one, and is not replaced"
            raise ConfigError(COMMAND_LINE, "--report", folder, allowed)
    try:
        with TemporaryFile(dir=folder, buffering=0) as probe:
            os.posix_fallocate(probe.fileno(), 0, ROOM_BYTES * len(settings.drives))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from error


def record_path(folder: Path, drive: str) -> Path:
    """The file of a drive's record; its page is beside it."""
    return folder / f"{drive.replace('/', '_')}.json"


def write(run: Run, settings: Settings, utc: str, boot_id: str, folder: Path) -> list[Path]:
    """Write `LEG_AXIS.json` and `LEG_AXIS.html` of each drive; the page is made from the file.

    Returns: the pages.
    """
    pages: list[Path] = []
    hashes = {Path(name).name: digest for name, digest in settings.hashes.items()}
    for drive in settings.drives:
        made = AcceptanceRecord(
            drive=drive.name,
            node_id=drive.node_id,
            utc=utc,
            gaitd_version=version("gaitd"),
            core_boot_id=boot_id,
            profile=Path(drive.axis.profile).name,
            profile_verified_on_hardware=drive.profile.verified_on_hardware,
            sha256=hashes,
            findings=tuple(one for one in run.findings if one.drive == drive.name),
            stops=tuple(one for one in run.stops if one.drive == drive.name),
        )
        path = record_path(folder, drive.name)
        record.write(made, path)
        pages.append(path.with_suffix(".html"))
        page.write(record.read(path), texts(), pages[-1])
    return pages
