"""The asserts of the tests are rewritten once, before the workers of pytest-xdist start.

All workers collect all tests, at the same time. From a fresh clone each of them would rewrite each
assert; here the process that starts them does it, and they load what it has kept in `__pycache__`.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from _pytest.assertion.rewrite import (
    PYC_TAIL,
    _read_pyc,
    _rewrite_test,
    _write_pyc,
    assertstate_key,
    get_cache_dir,
)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before pytest-xdist's own hook, which starts the workers."""
    if session.config.getoption("tx", None) and not sys.dont_write_bytecode:
        rewrite(session.config, modules(session.config))


def modules(config: pytest.Config) -> Iterable[Path]:
    """Modules of tests below what pytest is asked to run."""
    for argument in config.args:
        place = Path(argument.partition("::")[0])
        yield from place.rglob("test_*.py") if place.is_dir() else [place]


def rewrite(config: pytest.Config, files: Iterable[Path]) -> None:
    """Keep the code of these files as pytest's import hook does, where it is not yet there."""
    for file in files:
        kept = get_cache_dir(file) / f"{file.stem}{PYC_TAIL}"
        if _read_pyc(file, kept) is None:
            kept.parent.mkdir(exist_ok=True)
            source_hash, code = _rewrite_test(file, config)
            _write_pyc(config.stash[assertstate_key], code, source_hash, kept)
