"""The cache of compiled code: it is used, never stale, never another user's, one for all clones."""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from power_cuts import check
from traced_calls import mark

from observer import cache_files, jit

OBSERVER = Path(jit.__file__).parent

CALLER = """
from observer.jit import kernel
from {package}.model import twice

@kernel
def four_times(x):
    return twice(twice(x))
"""
MODEL = """
from observer.jit import kernel

@kernel
def twice(x):
    return {factor} * x
"""
USE = "from {package}.caller import four_times; print(four_times(1.0), four_times.stats)"


class Copy:
    """A copy of observer/ with another package beside it, in a folder and a cache of its own."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.cache = folder.parent / "cache"
        shutil.copytree(OBSERVER, folder / "observer", ignore=shutil.ignore_patterns("__pycache__"))

    def move_to(self, folder: Path) -> None:
        """As a second environment of the same user: other files, the same cache."""
        self.folder.rename(folder)
        self.folder = folder

    def write(self, package: str, factor: float) -> None:
        root = self.folder / package
        root.mkdir(exist_ok=True)
        (root / "__init__.py").touch()
        (root / "caller.py").write_text(CALLER.format(package=package))
        (root / "model.py").write_text(MODEL.format(factor=factor))

    def run(self, code: str) -> str:
        """In a process of its own, which sees the copy and not us."""
        return subprocess.run(
            [sys.executable, "-c", code],
            cwd=self.folder,
            env={
                "PATH": os.environ["PATH"],
                "HOME": str(self.folder),
                "PYTHONPATH": str(self.folder),
                "PYTHONDONTWRITEBYTECODE": "1",
                "TMPDIR": str(self.folder),
                "NUMBA_CACHE_DIR": str(self.cache),
            },
            capture_output=True,
            text=True,
            check=True,
        ).stdout


@pytest.fixture
def copy(tmp_path):
    return Copy(tmp_path / "place")


def test_equal_sources_are_loaded_anywhere_and_a_model_in_another_file_is_new_after_an_edit(
    copy, tmp_path
):
    """Numba's own cache looks at the caller's file only, and at its place."""
    copy.write("elsewhere", 2.0)
    first = copy.run(USE.format(package="elsewhere"))
    copy.move_to(tmp_path / "another place")
    again = copy.run(USE.format(package="elsewhere"))
    copy.write("elsewhere", 3.0)
    edited = copy.run(USE.format(package="elsewhere"))

    assert first.startswith("4.0 ")
    assert "cache_misses=Counter()" in again.replace("collections.", "")
    assert edited.startswith("9.0 ")


def test_an_edit_of_the_observer_is_seen_by_kernels_of_other_packages(copy):
    use = (
        "from observer.mechanism.parameters import GRAVITY\n"
        "import elsewhere.caller\n"
        "from observer.jit import source_key\n"
        "from pathlib import Path\n"
        "print(source_key(Path('elsewhere').resolve()), source_key(Path('observer').resolve()))"
    )
    copy.write("elsewhere", 2.0)
    before = copy.run(use).split()
    parameters = copy.folder / "observer" / "mechanism" / "parameters.py"
    parameters.write_text(
        parameters.read_text().replace("GRAVITY: Final = 9.81", "GRAVITY: Final = 1.62")
    )
    after = copy.run(use).split()

    assert before[0] != after[0]
    assert before[1] != after[1]


@pytest.mark.thorough
def test_an_edit_of_the_observers_own_model_is_used(copy):
    """On the moon a leg weighs less; no cache has to be cleared for it."""
    weigh = (
        "from observer.mechanism.mechanism import gravity\n"
        "import numpy as np\n"
        "from observer.mechanism.parameters import *\n"
        "leg = leg_parameters(Geometry(0.44, 0.44, 0.25, 1.05, 0.61, -0.70, 1.05),"
        " (Link(8.0, 0.4, 0.0, 0.2),) * 3, Slide(4.0, 6.0), 0.3, (Spring(),) * 2, Dampers())\n"
        "print(*gravity(leg, np.array([0.2, 0.5])))"
    )
    earth = [float(x) for x in copy.run(weigh).split()]
    parameters = copy.folder / "observer" / "mechanism" / "parameters.py"
    parameters.write_text(
        parameters.read_text().replace("GRAVITY: Final = 9.81", "GRAVITY: Final = 1.62")
    )
    moon = [float(x) for x in copy.run(weigh).split()]

    assert moon == pytest.approx([x * 1.62 / 9.81 for x in earth], rel=1e-12)


def test_the_key_depends_on_the_compilers_version(monkeypatch):
    before = jit.source_key(OBSERVER)
    monkeypatch.setattr(jit.importlib.metadata, "version", lambda name: "0.0")

    assert jit.source_key(OBSERVER) != before


def test_a_folder_that_cannot_be_written_is_not_asked_twice(copy):
    """A read-only home: kernels still compile, and cache in the temporary folder."""
    copy.write("elsewhere", 2.0)
    copy.cache.write_text("a file where the folder should be")

    assert copy.run(USE.format(package="elsewhere")).startswith("4.0 ")


def test_a_temporary_cache_that_others_could_have_filled_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(jit.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(jit.tempfile, "tempdir", str(tmp_path))
    ours = jit._temporary_base()
    ours.chmod(0o777)
    fresh = jit._temporary_base()

    assert ours.parent == tmp_path
    assert fresh != ours
    assert fresh.stat().st_mode & 0o077 == 0


def test_old_generations_of_the_cache_are_removed(tmp_path):
    for number in range(jit.DIRECTORIES_KEPT + 5):
        folder = tmp_path / f"{number:02}"
        folder.mkdir()
        os.utime(folder, (1000 + number, 1000 + number))

    jit._forget_old_generations(tmp_path)

    left = sorted(path.name for path in tmp_path.iterdir())
    assert len(left) == jit.DIRECTORIES_KEPT - 1
    assert left[-1] == f"{jit.DIRECTORIES_KEPT + 4:02}"


def test_a_package_of_which_nothing_was_compiled_is_not_cached(tmp_path):
    (tmp_path / "model.py").write_text("NEVER_COMPILED = 1\n")

    assert not jit.is_cached(tmp_path)


def test_after_a_power_cut_no_file_of_compiled_kernels_is_torn_and_a_settled_one_is_there(tmp_path):
    folder = tmp_path / "cache" / "key"
    folder.parent.mkdir()
    contents = {
        f"model_{number}/twice.{end}": f"{number}{end}".encode() * 600
        for number in (1, 2)
        for end in ("nbi", "nbc")
    }

    def save(number):
        """As numba does: under another name, renamed, without fsync."""
        for name, content in contents.items():
            if name.startswith(f"model_{number}"):
                path = folder / name
                path.parent.mkdir(exist_ok=True)
                path.with_suffix(".tmp").write_bytes(content)
                path.with_suffix(".tmp").replace(path)

    def scenario():
        folder.mkdir(parents=True)
        cache_files.enter(folder)
        save(1)
        cache_files.settle(folder)
        mark("settled")
        save(2)

    def recover(marks):
        folder.mkdir(parents=True, exist_ok=True)
        for name in cut_off(folder):
            os.utime(folder / name, ns=(0, 0))
        lock = cache_files.enter(folder)
        left = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in folder.rglob("*")
            if path.suffix in cache_files.ENDS
        }
        save(2)
        os.close(cache_files.enter(folder))  # as another process, which removes nothing now
        assert (folder / "model_2" / "twice.nbc").exists()
        os.close(lock)
        assert left.items() <= contents.items()
        assert len(left) == 2 or not (left or marks)

    def cut_off(folder):
        """Times are not modelled: those of files that were noted are restored from the notes."""
        noted = cache_files._notes(folder)
        for name, (_, time_ns) in noted.items():
            os.utime(folder / name, ns=(time_ns, time_ns))
        return [name for name in contents if name not in noted and (folder / name).exists()]

    check(tmp_path / "cache", scenario, recover)


def test_numba_finds_no_linear_algebra_of_scipy():
    """It would import SciPy before the first kernel runs."""
    assert not importlib.import_module("numba.np.arraymath")._HAVE_BLAS
