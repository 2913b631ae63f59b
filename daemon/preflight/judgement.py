"""The one function that judges a set of files, and the two ways in which its answer is used."""

from pathlib import Path
from typing import NamedTuple

from daemon.config.bundle import Settings
from daemon.config.strict import ConfigError
from daemon.preflight.load import load
from daemon.preflight.report import Report, examine, refuse
from daemon.zenoh_io import endpoints


class Judgement(NamedTuple):
    """A set of files that can be reported on, refused or not."""

    settings: Settings
    report: Report
    refusal: ConfigError | None
    """What the report shows and nothing may start with."""


def judge(path: Path) -> Judgement:
    """Read a trainer file and all that it names, and judge all that needs no bus.

    Raises:
        ConfigError: the first thing that leaves nothing to report on.
    """
    settings = load(path)
    endpoints.check(settings.file)
    report = examine(settings)
    try:
        refuse(settings, report)
    except ConfigError as error:
        return Judgement(settings, report, error)
    return Judgement(settings, report, None)


def accepted(path: Path) -> Settings:
    """The settings of a set of files that `gaitd check` accepts.

    Raises:
        ConfigError: exactly what `gaitd check` refuses, in its words.
    """
    judgement = judge(path)
    if judgement.refusal is not None:
        raise judgement.refusal
    return judgement.settings
