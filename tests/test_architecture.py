"""The import contracts of pyproject.toml hold, and each would notice if it did not."""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACTS = PYPROJECT["tool"]["importlinter"]["contracts"]
PACKAGES = PYPROJECT["tool"]["importlinter"]["root_packages"]


def lint_imports(project: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"],
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
    )


def test_all_import_contracts_are_kept():
    linted = lint_imports(PROJECT)

    assert linted.returncode == 0, linted.stdout
    assert f"{len(CONTRACTS)} kept, 0 broken" in linted.stdout


FORBIDDEN = [
    ("drives/planted.py", "import daemon.record"),
    ("observer/planted.py", "import drives.signals"),
    ("daemon/core/planted.py", "import sim_drives.actuation"),
    ("sim_drives/planted.py", "import observer.cdkf"),
    ("sim_drives/planted.py", "import drives.signals"),
    ("daemon/gateway/planted.py", "import daemon.core.safety"),
    ("daemon/core/planted.py", "import zenoh"),
    ("observer/planted.py", "import time"),
    ("analysis/planted.py", "import drives.signals"),
    ("daemon/planted.py", "import pytest"),
    ("gaitd/planted.py", "import pytest"),
    ("gaitd/planted.py", "import gaitd.testing.service"),
]


@pytest.mark.parametrize(("file", "line"), FORBIDDEN, ids=[" ".join(plant) for plant in FORBIDDEN])
def test_a_planted_import_breaks_a_contract(tmp_path, file, line):
    for package in PACKAGES:
        shutil.copytree(PROJECT / package, tmp_path / package)
    shutil.copy(PROJECT / "pyproject.toml", tmp_path)
    (tmp_path / file).write_text(f'"""Planted."""\n\n{line}\n')

    linted = lint_imports(tmp_path)

    assert linted.returncode == 1, linted.stdout
    assert "BROKEN" in linted.stdout
    assert file.removesuffix(".py").replace("/", ".") in linted.stdout
