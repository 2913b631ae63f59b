"""Compilation with numba: one decorator, and a cache that cannot be stale.

numba's own cache checks only the file of the compiled function, so after an edit of `mechanism.py`
a cached filter silently uses the old mechanism. Here the cache directory is named by a hash over
all sources that a kernel can use: those of `observer/`, those of the package that the decorated
function lives in, and the versions of the compilers. numba itself compares the features of the
processor. Another source gives another directory, so no entry needs to be invalidated, and equal
sources share one: a kernel is compiled once for a machine, not once for each environment or clone.
What a power cut may have torn is removed (`cache_files.py`).

`kernel` is for functions that are called from Python or are large. `inline` is for the pieces that
kernels are made of: LLVM puts their bodies into the caller, which lets a loop over sigma points
become vector instructions.

Nothing calls a kernel from C, so none gets numba's wrapper for that: it costs a fifth of the time
of compilation.

Floating point stays as written (no fastmath): the same inputs give the same bits. Division by zero
gives inf instead of an exception; kernels guard their divisors.

No kernel uses linear algebra of SciPy, which the service does not need. numba imports it before the
first kernel runs where it is installed, which takes each process a quarter of a second: numba is
told here that there is none. So a kernel that needs it fails in every environment alike.
"""

import atexit
import contextlib
import hashlib
import importlib.metadata
import inspect
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Generator
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
from numba.core import config as numba_config
from numba.core import event
from numba.core.caching import UserProvidedCacheLocator
from numba.np import linalg
from numba.np.unsafe.ndarray import to_fixed_tuple

from observer import cache_files

F = TypeVar("F", bound=Callable[..., Any])

CONFIG: Final[Any] = numba_config
"""numba's own configuration, whose attributes are created at run time."""
fixed_tuple: Final[Any] = to_fixed_tuple
"""`fixed_tuple(array, count)` in a kernel: the first elements of an array, held in registers."""
COMPILERS: Final = ("numba", "llvmlite", "numpy")
"""Packages that compile the kernels; with Python's version they are part of the key."""
TOLD_EVERY: Final = 20
"""Number of compiled functions from one report of `compiling` to the next."""
DIRECTORIES_KEPT: Final = 32
"""Number of older cache generations to keep; the rest is removed when a new one begins."""


def _no_blas() -> None:
    """As numba's own function where SciPy is not installed."""
    raise ImportError("kernels have no linear algebra of SciPy")


linalg.ensure_blas = _no_blas


def kernel(function: F) -> F:
    """Compile `function` at its first call with each set of types, cached on disk."""
    return _compile(function, forceinline=False)


def inline(function: F) -> F:
    """Like `kernel`, for pieces whose body goes into every caller."""
    return _compile(function, forceinline=True)


def _compile(function: F, *, forceinline: bool) -> F:
    _KNOWN.append(function.__qualname__)
    root = _source_root(Path(inspect.getfile(function)))
    before = CONFIG.CACHE_DIR, CONFIG.CACHE_LOCATOR_CLASSES
    # numba reads both when it decorates, so each package can have its own directory.
    CONFIG.CACHE_DIR = str(_cache_directory(root))
    CONFIG.CACHE_LOCATOR_CLASSES = f"{__name__}.{AnyPlace.__name__}"
    try:
        # The types of numba do not know `no_cfunc_wrapper`.
        compiler: Any = numba.njit
        options = {"error_model": "numpy", "forceinline": forceinline, "no_cfunc_wrapper": True}
        compiled: F = compiler(cache=True, **options)(function)
        return compiled
    finally:
        CONFIG.CACHE_DIR, CONFIG.CACHE_LOCATOR_CLASSES = before


class AnyPlace(UserProvidedCacheLocator):
    """Finds the kernels of a source file below `CONFIG.CACHE_DIR` wherever the file is.

    numba's own locators name the folder of a file's kernels by a hash of the file's place, so a
    second environment of the same machine would compile everything again.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Folder of the file's kernels, relative to the cache directory."""
        path = Path(py_file).resolve()
        root = _source_root(path)
        return "_".join((root.name, *path.relative_to(root).with_suffix("").parts))


@contextlib.contextmanager
def compiling(tell: Callable[[int, int], None]) -> Generator[None]:
    """Report what is compiled within the block, which may take a minute or two.

    Args:
        tell: called with the number of functions that were compiled, and the number of those that
            are known; one that is called with other types is compiled once more.
    """
    with event.install_listener("numba:compile", _Compiled(tell)):
        yield


class _Compiled(event.Listener):
    def __init__(self, tell: Callable[[int, int], None]) -> None:
        self._tell = tell
        self._count = 0

    def on_start(self, event: object) -> None:
        """Nothing is reported yet."""

    def on_end(self, event: object) -> None:  # noqa: ARG002 - as numba calls it
        self._count += 1
        if self._count % TOLD_EVERY == 0:
            self._tell(self._count, max(self._count, len(_KNOWN)))


def is_cached(*packages: Path) -> bool:
    """True if kernels of `observer/`, and of each of these, were compiled from these sources."""
    keys = map(source_key, (_OBSERVER, *packages))
    return all(any((_cache_base() / key).rglob("*.nbi")) for key in keys)


def source_key(root: Path) -> str:
    """Name of the cache of kernels under `root`: a hash over everything that they depend on."""
    digest = hashlib.sha256()
    for name in COMPILERS:
        digest.update(f"{name} {importlib.metadata.version(name)}\n".encode())
    digest.update(f"python {platform.python_version()}\n".encode())
    for folder in dict.fromkeys((_OBSERVER, root)):
        digest.update(f"{folder.name}\n".encode())
        for path in sorted(folder.rglob("*.py")):
            digest.update(f"{path.relative_to(folder)}\n".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:24]


def _source_root(path: Path) -> Path:
    """Top package of the file, or its folder if it is in no package."""
    folder = path.resolve().parent
    while (folder.parent / "__init__.py").exists():
        folder = folder.parent
    return folder


@cache
def _cache_directory(root: Path) -> Path:
    directory = _cache_base() / source_key(root)
    if directory.exists():
        with contextlib.suppress(OSError):  # of another user, who maintains it
            os.utime(directory)  # marks the directory as in use
    else:
        _forget_old_generations(directory.parent)
        directory.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(PermissionError):  # as above: its owner removes and settles
        _USED[directory] = cache_files.enter(directory)
    return directory


def settle() -> None:
    """Bring what this process has compiled to the disk; called at its end, too.

    What a full or broken disk does not take is compiled again by a later process.
    """
    for directory in _USED:
        with contextlib.suppress(OSError):
            cache_files.settle(directory)


@cache
def _cache_base() -> Path:
    """Directory of the caches: NUMBA_CACHE_DIR if set, the user's cache, or /tmp."""
    told = str(CONFIG.CACHE_DIR)
    wanted = Path(told) if told else Path.home() / ".cache" / "gaitd" / "numba"
    try:
        wanted.mkdir(parents=True, exist_ok=True)
    except OSError:
        return _temporary_base()
    return wanted if os.access(wanted, os.W_OK | os.X_OK) else _temporary_base()


def _temporary_base() -> Path:
    """Folder in the system's temporary folder that no other user can write, else a fresh one.

    A cache contains code that will run: one that another user could have filled is not used.
    """
    shared = Path(tempfile.gettempdir()) / f"gaitd-numba-{os.getuid()}"
    shared.mkdir(mode=0o700, exist_ok=True)
    status = shared.lstat()
    is_ours = status.st_uid == os.getuid() and not status.st_mode & 0o022
    return shared if is_ours and not shared.is_symlink() else Path(tempfile.mkdtemp())


def _forget_old_generations(base: Path) -> None:
    # Another process may delete it at the same time; numba recompiles missing entries.
    with contextlib.suppress(FileNotFoundError):
        newest_first = sorted(base.iterdir(), key=lambda path: -path.stat().st_mtime_ns)
        for directory in newest_first[DIRECTORIES_KEPT - 1 :]:
            shutil.rmtree(directory, ignore_errors=True)


_KNOWN: Final[list[str]] = []
"""Functions that this process has decorated."""
_USED: Final[dict[Path, int]] = {}
"""Cache directories of this process, each with its lock, which is held until the process ends."""
atexit.register(settle)
_OBSERVER: Final = Path(__file__).resolve().parent
