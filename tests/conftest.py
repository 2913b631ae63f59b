"""What all tests share: the plugin that gaitd ships, and options of our own.

The rigs (SocketCAN, systemd) are the plugin's. `--rigs=required` makes the lack of one a failure;
it is `--gaitd-rigs` of the plugin by a shorter name.
"""

import gc
import importlib.util
import shutil
import signal
from pathlib import Path

import pytest
from cpu_seconds import CpuSeconds
from hypothesis import settings

# pytest finds it by itself once gaitd is installed; a tree that is newer than its installation
# names it here.
pytest_plugins = [
    *("gaitd_lab.testing.plugin", "forked", "forked_parts", "kept_together", "rewritten"),
]

# How long an example takes says something about the machine, and nothing about the project.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# A shell that runs `make test` in the background has it and all that it starts ignore SIGINT.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection():
    """What is imported and collected stays: a garbage collector would look at it in vain."""
    gc.disable()


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """Nor need it look at it again and again afterwards."""
    gc.freeze()
    gc.enable()


def pytest_addoption(parser):
    parser.addoption(
        "--rigs",
        dest="gaitd_rigs",
        choices=["present", "required", "none"],
        default="present",
        help="use the rigs that are there (default), fail where one is missing, or use none",
    )
    parser.addoption(
        "--write-traces",
        action="store_true",
        help="write the golden traces and plans anew (`make golden`)",
    )
    parser.addoption(
        "--write-process-faults",
        action="store_true",
        help="write docs/evidence/process_faults.md anew from what tests/service measure",
    )
    parser.addoption(
        "--write-assist",
        action="store_true",
        help="write the figure of docs/assist.md anew from simulated patients",
    )
    parser.addoption(
        "--write-pages",
        action="store_true",
        help="write the pictures of the pages in docs/ anew from a browser",
    )
    parser.addoption(
        "--fuzz-minutes",
        type=float,
        help="let the CAN fuzz run for so many minutes each, instead of some seconds",
    )
    parser.addoption(
        "--recordings",
        type=Path,
        metavar="FOLDER",
        help="run the tests on recordings of real machines; docs/evidence/real_data.md has them",
    )
    parser.addoption(
        "--cpu-seconds",
        type=Path,
        metavar="FILE",
        help="print CPU-seconds by group, with those of earlier steps in FILE (`make test`)",
    )


def pytest_runtest_setup(item):
    """A test in a browser is skipped where there is none, or fails where rigs are required."""
    if item.get_closest_marker("rig_browser"):
        lack = "left out" if item.config.option.gaitd_rigs == "none" else browser_lacks()
        if lack and item.config.option.gaitd_rigs == "required":
            pytest.fail(f"required, but rig_browser: {lack}", pytrace=False)
        if lack:
            pytest.skip(f"rig_browser: {lack}; `make rigs` installs it")


def browser_lacks():
    """What this machine lacks for a test in a browser; None if nothing."""
    if importlib.util.find_spec("playwright") is None:
        return "no playwright"
    return None if shutil.which("chromium") else "no chromium"


def pytest_configure(config):
    """Processor time by group, where it is asked for."""
    if config.option.cpu_seconds or hasattr(config, "workerinput"):
        config.pluginmanager.register(CpuSeconds(config.option.cpu_seconds))
