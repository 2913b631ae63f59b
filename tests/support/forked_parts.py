"""Core and virtual drives forked from the test's process, where their imports and kernels are.

To start one of them as a program costs more than a CPU-second before it does anything. From the
fork on it is what it always is: a process with its signals, descriptors and memory. The gateway,
which has threads of Zenoh, every other program, and all that tests with a rig and thorough tests
start are executed, as people start them: a fork has the memory of its parent, too. A plugin of
pytest; see `tests/conftest.py`.
"""

import ctypes
import gc
import os
import runpy
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pytest
from as_program import exit_code_of

from gaitd_lab import processes

FORKED: Final = ("core", "sim")
ALTERED_CORE: Final = str(Path(__file__).with_name("altered_core.py"))
"""A program that is the core, but for what it replaces in it."""
AS_PEOPLE_START_THEM: Final = ("rig_vcan", "rig_systemd", "rig_browser", "thorough")
"""Marks of tests whose processes are executed."""
EXECUTED: Final = processes.ManagedProcess
PR_SET_PDEATHSIG: Final = 1
DEFAULTS: Final = (signal.SIGTERM, signal.SIGHUP, signal.SIGALRM, signal.SIGPIPE)
LIBC: Final = ctypes.CDLL(None)
_IS_WARM: list[bool] = []


class ForkedPart(processes.ManagedProcess):
    """A process `gaitd core ...` or `gaitd sim ...`, or of the altered core."""

    def __init__(self, name: str, words: Sequence[str], *more: Any, **others: Any) -> None:
        self._words = words
        _warm_up()
        super().__init__(name, words, *more, **others)

    def _execute_child(self, *given: Any) -> None:
        """As `subprocess.Popen` does it, with a fork of this process in place of a program."""
        folder, environment, pipes = given[5], given[6], given[10:16]
        parent = os.getpid()
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            code = 1
            try:
                _become(parent, (pipes[0], pipes[3], pipes[5]), folder, environment)
                code = _run(self._words)
            finally:
                os._exit(code)
        self._child_created = True
        self._close_pipe_fds(*pipes)


def _become(parent: int, streams: Sequence[int], folder: Path, environment: Any) -> None:
    """Leave all behind that a program would not have from the test."""
    os.setsid()
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    os.closerange(len(streams), os.sysconf("SC_OPEN_MAX"))
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number in DEFAULTS:
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.stdin, sys.stdout, sys.stderr = (
        open(number, mode, encoding="utf-8", buffering=1)  # noqa: PTH123, SIM115
        for number, mode in enumerate("rww")
    )
    gc.freeze()


def _run(words: Sequence[str]) -> int:
    from gaitd.__main__ import main

    if words[0] == ALTERED_CORE:
        sys.argv = [*words]
        return exit_code_of(lambda: runpy.run_path(ALTERED_CORE, run_name="__main__"))
    sys.argv = ["gaitd", *words[len(processes.GAITD) :]]
    return exit_code_of(main)


def _warm_up() -> None:
    """Load once what each fork would load: modules, and the kernels of drives and core."""
    if _IS_WARM:
        return
    _IS_WARM.append(True)
    from command_line import gaitd
    from sessions import CONFIGS, new_session

    import daemon.core.runtime.process  # noqa: F401
    import gaitd_lab.commands.sim  # noqa: F401
    from daemon.core.modes.persistent_state import PersistentState
    from daemon.core.runtime.build import build
    from daemon.core.runtime.warm_up import warm_up

    assert gaitd("check", "--config", CONFIGS / "demo.toml").code == 0  # loads the command line
    session = new_session().until_ready()
    warm_up(build(session.settings, "", PersistentState()))


def start_part(
    name: str, words: Sequence[str], *more: Any, **others: Any
) -> processes.ManagedProcess:
    """Start a part; in place of `ManagedProcess`."""
    is_part = tuple(words[:2]) == processes.GAITD and words[2] in FORKED
    made = ForkedPart if is_part or words[0] == ALTERED_CORE else EXECUTED
    return made(name, words, *more, **others)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Fork the parts that this test starts, or execute them."""
    is_forked = not any(item.get_closest_marker(name) for name in AS_PEOPLE_START_THEM)
    processes.ManagedProcess = start_part if is_forked else EXECUTED
