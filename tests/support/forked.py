"""Tests that begin with a warm lock-step session, each in a process of its own.

Bringing a session up and into a gait takes most of a closed-loop test. A fixture whose name begins
with `warm_` does it once for a module or a whole run, and each test that uses such a fixture,
directly or through another fixture, is called in a fork of the process that holds it: what the test
does to the session ends with the fork. Set-up and tear-down of fixtures stay in the parent, so a
fixture must not turn a warm session on; only a test may.
"""

import gc
import os
import signal
import sys
import warnings
from typing import Final

import pytest

PREFIX: Final = "warm_"
LOST: Final = "the forked test ended without a result"
SKIPPED: Final = b"S"
FAILED: Final = b"F"
PASSED: Final = b"P"


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Call a test of a warm session in a fork; raise its failure here, with the text of its report.

    With a debugger (`--pdb`) the test runs in the parent, so the terminal reaches it.
    """
    is_warm = any(name.startswith(PREFIX) for name in pyfuncitem.fixturenames)
    if not is_warm or pyfuncitem.config.option.usepdb:
        return None
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        # Python 3.12 warns of threads; those of pytest-xdist do not touch what a test uses.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os.close(reader)
        _call_and_exit(pyfuncitem, writer)
    os.close(writer)
    try:
        with open(reader, "rb") as pipe:  # noqa: PTH123 - a descriptor, not a path
            said = pipe.read()
    except BaseException:
        os.kill(child, signal.SIGKILL)  # a time-out of the parent ends the child as well
        raise
    finally:
        _, status = os.waitpid(child, 0)
    kind, text = said[:1], said[1:].decode(errors="replace")
    if kind == SKIPPED:
        pytest.skip(text)
    if kind != PASSED:
        signal_number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
        pytest.fail(text or f"{LOST}, signal {signal_number}", pytrace=False)
    return True


def _call_and_exit(item: pytest.Function, writer: int) -> None:
    """Whatever happens, say it and end here: a fork must not go on as a copy of its parent."""
    said = FAILED + LOST.encode()
    gc.freeze()  # a look at what the parent made would copy its memory
    try:
        said = _called(item)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        with open(writer, "wb") as pipe:
            pipe.write(said)
        os._exit(0)


def _called(item: pytest.Function) -> bytes:
    wanted = item._fixtureinfo.argnames
    try:
        item.obj(**{name: item.funcargs[name] for name in wanted})
    except pytest.skip.Exception as skipped:
        return SKIPPED + str(skipped).encode()
    except BaseException:  # noqa: BLE001 - handed to the parent, which fails with it
        failure = pytest.ExceptionInfo.from_current()
        return FAILED + str(item.repr_failure(failure)).encode()
    return PASSED
