"""The pytest plugin: `virtual_trainer`, `virtual_trainers`, `vcan`, and the rigs.

pytest finds it automatically where gaitd is installed. It imports nothing of the project, and
starts nothing, until a test uses one of its fixtures. docs/integrating.md shows their use.
"""

import contextlib
import sys
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

import pytest

if TYPE_CHECKING:
    from daemon.config.edits import Edits
    from gaitd_lab.testing.rigs import Rig
    from gaitd_lab.testing.trainer import VirtualTrainer

RIG_MARKERS: Final[Mapping[str, str]] = {"rig_vcan": "vcan", "rig_systemd": "systemd"}
"""Marker of a test, and the rig that the marker requires."""
REQUIRED: Final = "required"
NONE: Final = "none"
MISSED: Final = (*(f"{marker}: " for marker in RIG_MARKERS), "vcan: ")
INSTALLS_THEM: Final = "`make rigs` in a clone of gaitd installs rigs, as root on Debian"
MARKERS: Final = (
    "virtual_trainer(edits=None, configs=None, trainer_file='demo.toml', pace=1): "
    "what configuration the fixture of that name runs",
    "rig_vcan: needs SocketCAN, natively or in the virtual machine of `make rigs`",
    "rig_systemd: needs the systemd container of `make rigs`",
)

LACKS: Final = pytest.StashKey[dict[str, str | None]]()


# --- a virtual trainer ------------------------------------------------------------------------


class VirtualTrainers:
    """Starts virtual trainers for one test; each lives until the test is over."""

    def __init__(self, ending: contextlib.ExitStack) -> None:
        """Use the exit stack that ends the trainers."""
        self._ending = ending

    def __call__(
        self,
        edits: "Edits | None" = None,
        *,
        configs: Path | None = None,
        trainer_file: str = "demo.toml",
        pace: float | str = 1,
    ) -> "VirtualTrainer":
        """Start one and wait until it is ready; see `gaitd_lab.testing.trainer.virtual_trainer`."""
        from gaitd_lab.testing.trainer import virtual_trainer

        made = virtual_trainer(edits, configs=configs, trainer_file=trainer_file, pace=pace)
        return self._ending.enter_context(made)


@pytest.fixture
def virtual_trainers() -> Generator[VirtualTrainers]:
    """Provide a function that starts virtual trainers, each with its own configuration."""
    with contextlib.ExitStack() as ending:
        yield VirtualTrainers(ending)


@pytest.fixture
def virtual_trainer(
    request: pytest.FixtureRequest, virtual_trainers: VirtualTrainers
) -> "VirtualTrainer":
    """Provide a virtual trainer that is ready to be enabled; its marker configures it."""
    marker = request.node.get_closest_marker("virtual_trainer")
    return virtual_trainers(*marker.args, **marker.kwargs) if marker else virtual_trainers()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the output of a virtual trainer's processes to the report of a failure."""
    del item, call
    report = yield
    trainer = sys.modules.get("gaitd_lab.testing.trainer")
    if report.failed and trainer is not None:
        for running in trainer.RUNNING:
            report.sections += [
                (f"gaitd {part} (virtual trainer)", output) for part, output in running.said()
            ]
    return report


# --- SocketCAN and other rigs -----------------------------------------------------------------


@pytest.fixture
def vcan(request: pytest.FixtureRequest) -> Generator[str]:
    """Provide the name of a fresh vcan interface; skips where there can be none."""
    from gaitd_lab.testing.vcan import VcanError, fresh_vcan

    with contextlib.ExitStack() as ending:
        try:
            name = ending.enter_context(fresh_vcan())
        except VcanError as error:
            instead = f"`gaitd rig vcan -- pytest {request.node.path.name}` has one"
            _do_without(request.config, f"vcan: {error}; {instead}")
        yield name


@pytest.fixture(scope="session")
def vcan_rig() -> "Rig":
    """Provide an environment with SocketCAN."""
    return _rig("vcan")


@pytest.fixture(scope="session")
def systemd_rig() -> "Rig":
    """Provide an environment with systemd as PID 1."""
    return _rig("systemd")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add gaitd's option; its name has the prefix gaitd, because it is in every run of pytest."""
    parser.getgroup("gaitd").addoption(
        "--gaitd-rigs",
        dest="gaitd_rigs",
        choices=["present", REQUIRED, NONE],
        default="present",
        help="use the rigs that are there (default), fail where one is missing, or use none",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Register the markers."""
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)
    config.stash[LACKS] = {}


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose rig is not available, or fail it where rigs are required."""
    for marker in RIG_MARKERS:
        if item.get_closest_marker(marker) and (lack := _lack(item.config, marker)):
            _do_without(item.config, f"{marker}: {lack}")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print one line for all missing rigs, whatever tests needed them."""
    reasons = [
        report.longrepr[2].removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", [])
        if isinstance(report.longrepr, tuple)
    ]
    missed = {reason for reason in reasons if reason.startswith(MISSED)}
    if missed:
        terminalreporter.write_line(f"not used: {'; '.join(sorted(missed))} ({INSTALLS_THEM})")


def _lack(config: pytest.Config, marker: str) -> str | None:
    lacks = config.stash[LACKS]
    if marker not in lacks:
        left_out = config.option.gaitd_rigs == NONE
        lacks[marker] = (
            "left out by --gaitd-rigs=none" if left_out else _rig(RIG_MARKERS[marker]).lacks()
        )
    return lacks[marker]


def _do_without(config: pytest.Config, why: str) -> NoReturn:
    if config.option.gaitd_rigs == REQUIRED:
        pytest.fail(f"required, but {why}", pytrace=False)
    pytest.skip(why)


def _rig(name: str) -> "Rig":
    from gaitd_lab.testing.rigs import RIGS

    return RIGS[name]
