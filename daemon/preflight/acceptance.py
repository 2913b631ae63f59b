"""The check of a set of files, in one function, and the two ways in which its result is used."""

from pathlib import Path
from typing import NamedTuple

from daemon.config.bundle import Settings
from daemon.config.strict import ConfigError
from daemon.preflight.load import load
from daemon.preflight.report import Report, examine, refuse
from daemon.zenoh_io import endpoints


class CheckResult(NamedTuple):
    """A readable set of files: settings, report, and the refusal if there is one."""

    settings: Settings
    report: Report
    refusal: ConfigError | None
    """Why the service may not start, although a report exists; None if it may."""


def check_files(path: Path) -> CheckResult:
    """Read a trainer file and all that it names, and check all that needs no bus.

    Raises:
        ConfigError: the first fault without which no report can be made.
    """
    settings = load(path)
    endpoints.check(settings.file)
    report = examine(settings)
    try:
        refuse(settings, report)
    except ConfigError as error:
        return CheckResult(settings, report, error)
    return CheckResult(settings, report, None)


def accepted(path: Path) -> Settings:
    """The settings of a set of files that `gaitd check` accepts.

    Raises:
        ConfigError: the same error as that of `gaitd check`.
    """
    result = check_files(path)
    if result.refusal is not None:
        raise result.refusal
    return result.settings
