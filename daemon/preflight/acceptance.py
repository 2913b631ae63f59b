"""The check of a set of files, in one function, and the two ways in which its result is used."""

from pathlib import Path
from typing import NamedTuple

from gaitd_toml import ConfigError

from daemon.config.bundle import Settings
from daemon.config.unread import UnreadError
from daemon.preflight.files import check_all
from daemon.preflight.load import read_in_part
from daemon.preflight.report import Report, examine, refusals
from daemon.zenoh_io import endpoints


class CheckResult(NamedTuple):
    """A set of files: settings, report, and all errors."""

    settings: Settings
    """Complete if there is a report; else tables in it may be `UNREAD`."""
    report: Report | None
    """None where an error leaves no numbers to compute it from."""
    errors: list[ConfigError]
    """Why the service may not start; empty if it may."""


def check_files(path: Path) -> CheckResult:
    """Read a trainer file and all that it names, and check all that needs no bus.

    Raises:
        ConfigError: the trainer file cannot be read, or its syntax is wrong.
    """
    settings, errors = read_in_part(path)
    is_complete = not errors
    checked = check_all(settings)
    errors += checked.errors
    try:
        endpoints.check(settings.file)
    except ConfigError as error:
        errors.append(error)
    except UnreadError:
        pass
    report = None
    if is_complete and checked.can_be_swept:
        try:
            report = examine(settings)
            errors += refusals(settings, report)
        except ConfigError as error:  # of an EDS
            errors.append(error)
    return CheckResult(settings, report, errors)


def accepted(path: Path) -> Settings:
    """The settings of a set of files that `gaitd check` accepts.

    Raises:
        ConfigError: the same errors as those of `gaitd check`.
    """
    result = check_files(path)
    if result.errors:
        raise ConfigError.combined(result.errors)
    return result.settings
