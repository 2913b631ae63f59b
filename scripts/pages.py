"""Pages of docs/ that a command writes in minutes or hours, and whether their sources are older.

docs/sources.json has, for each such page, digests of the code and configuration that its last run
used; a page with other digests now is reported as older than its sources, which says nothing of how
much its numbers would change.
`scripts/pages.py --write PAGE` runs the page's command and then stores the digests; `--made PAGE`
only stores them, after its command was run by hand on the sources as they are.
"""

import argparse
import ast
import functools
import hashlib
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from safety_gates import UNIT_TESTS

PROJECT: Final = Path(__file__).resolve().parent.parent
DOCS: Final = PROJECT / "docs"
STORED: Final = DOCS / "sources.json"
ROOTS: Final = (PROJECT, *sorted((PROJECT / "clients").iterdir()))
"""Folders of our packages."""


class Made(NamedTuple):
    """How a page or a picture of docs/ is made that takes long."""

    command: str
    modules: tuple[str, ...]
    """Modules that the command starts with; with all that they import they are its sources."""
    files: tuple[str, ...] = ("configs",)


READ: Final = (".py", ".toml", ".eds", ".html", ".css", ".js")
SERVICE: Final = ("gaitd.core", "gaitd.gateway", "gaitd_lab.commands.sim")
LONG: Final = {
    "assist.png": Made(
        "pytest -n0 tests/clients/assist/test_page.py -m thorough --write-assist",
        ("gaitd_assist.program", "gaitd_lab.lockstep"),
        ("configs", "clients/assist/configs", "tests/clients/assist"),
    ),
    "engineer.png": Made(
        "pytest -n0 tests/rigs/test_engineer_page_in_a_browser.py -m rig_browser -k demo"
        " --write-pages",
        ("gaitd_display.__main__", *SERVICE),
        ("configs", "clients/display/gaitd_display/static"),
    ),
    "evidence/ablation.md": Made(
        "gaitd ablation --seeds 5 --output docs/evidence", ("gaitd_lab.commands.ablation",)
    ),
    "evidence/calibration.md": Made(
        "python -m gaitd_lab.studies.calibration docs/evidence", ("gaitd_lab.studies.calibration",)
    ),
    "evidence/consistency.md": Made(
        "gaitd consistency --output docs/evidence", ("gaitd_lab.commands.consistency",)
    ),
    "evidence/experiment.md": Made(
        "gaitd experiment --seeds 10 --every-law --output docs/evidence",
        ("gaitd_lab.commands.experiment",),
    ),
    "evidence/patients.md": Made(
        "gaitd patients --seeds 1 --seconds 20 --output docs/evidence",
        ("gaitd_lab.commands.patients",),
    ),
    "evidence/real_data.md": Made(
        "gaitd real-data RECORDINGS --output docs/evidence", ("gaitd_lab.commands.real_data",)
    ),
    "evidence/strides.md": Made(
        "gaitd strides --output docs/evidence", ("gaitd_lab.commands.strides",)
    ),
    "evidence/two_legs/experiment.md": Made(
        "gaitd experiment --seeds 1 --config configs/two_legs.toml --output docs/evidence/two_legs",
        ("gaitd_lab.commands.experiment",),
    ),
    "evidence/two_legs/fault_matrix_cells.md": Made(
        "gaitd matrix --fault silent --fault unplugged --fault emcy_2xxx_fault --fault hand_switch"
        " --fault sto --fault encoder_jump --fault limit_switch --fault our_bus_off"
        " --mode gait_impedance --mode hold --config configs/two_legs.toml"
        " --output docs/evidence/two_legs",
        ("gaitd_lab.commands.matrix",),
    ),
    "evidence/two_legs/patients.md": Made(
        "gaitd patients --seeds 1 --seconds 20 --patient half --patient all --patient 1.4"
        " --patient spasm --cadence 0.35 --config configs/two_legs.toml"
        " --output docs/evidence/two_legs",
        ("gaitd_lab.commands.patients",),
    ),
    "evidence/two_legs/strides.md": Made(
        "gaitd strides --seeds 1 --config configs/two_legs.toml --output docs/evidence/two_legs",
        ("gaitd_lab.commands.strides",),
    ),
    "evidence/fault_matrix.md": Made(
        "gaitd matrix --output docs/evidence", ("gaitd_lab.commands.matrix",)
    ),
    "patient.png": Made(
        "pytest -n0 tests/rigs/test_session_in_a_browser.py -m rig_browser --write-pages",
        ("gaitd_display.__main__",),
        ("clients/display/gaitd_display/static",),
    ),
    "pictures": Made(
        "pytest -n0 tests/rigs -m rig_browser -k pictures --write-pages",
        ("gaitd_display.__main__", "gaitd_session.report"),
        ("clients/display/gaitd_display/static",),
    ),
    "evidence/process_faults.md": Made(
        "pytest tests/service -m '' --write-process-faults",
        SERVICE,
        ("configs", "tests/service", "tests/support"),
    ),
}
"""Each page or picture by its name."""
RECORDINGS: Final = "RECORDINGS"
"""In a command: the folder of recordings of real machines, which are not part of the project."""
TARGET_MISSED: Final = 1
"""Exit code of a command that has written its page, and found a target missed or a law broken."""


@functools.cache
def code_digest(file: Path) -> str:
    """Digest of what a file does: of Python the syntax tree without docstrings and comments."""
    content = file.read_bytes()
    if file.suffix == ".py":
        tree = ast.parse(content)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                node.body = [one for one in node.body if not _is_text(one)] or [ast.Pass()]
        content = _written(tree).encode()
    return hashlib.sha256(content).hexdigest()[:12]


def _written(node: object) -> str:
    """Write a syntax tree; what is empty is left out, because it differs by Python's version."""
    if isinstance(node, list):
        return f"[{','.join(map(_written, node))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = (
        f"{name}={_written(one)}"
        for name, one in ast.iter_fields(node)
        if one is not None and one != []
    )
    return f"{type(node).__name__}({','.join(fields)})"


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def sources(made: Made) -> set[Path]:
    """Every file of ours that the command may read: imported modules, and the named folders."""
    found: set[Path] = set()
    left = [file for name in made.modules for file in _files_of(name)]
    while left:
        file = left.pop()
        if file not in found:
            found.add(file)
            left += _imported(file)
    for name in made.files:
        found |= {one for one in (PROJECT / name).rglob("*") if one.suffix in READ}
    return found


@functools.cache
def _imported(file: Path) -> tuple[Path, ...]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
    return tuple(one for name in sorted(names) for one in _files_of(name))


@functools.cache
def _files_of(module: str) -> tuple[Path, ...]:
    """Files that the import of a module of ours runs: its packages' and its own."""
    parts = module.split(".")
    root = next((one for one in ROOTS if (one / parts[0] / "__init__.py").is_file()), None)
    if root is None:
        return ()
    packages = (root.joinpath(*parts[:n], "__init__.py") for n in range(1, len(parts) + 1))
    own = root.joinpath(*parts).with_suffix(".py")
    return tuple(one for one in (*packages, own) if one.is_file())


def digests(files: Iterable[Path]) -> dict[str, str]:
    """A digest for each folder, of two levels at most."""
    folders: dict[str, list[str]] = {}
    for file in sorted(files):
        place = file.relative_to(PROJECT)
        line = f"{place} {code_digest(file)}\n"
        folders.setdefault("/".join(place.parent.parts[:2]), []).append(line)
    return {
        folder: hashlib.sha256("".join(lines).encode()).hexdigest()[:12]
        for folder, lines in folders.items()
    }


def older() -> Iterator[str]:
    """Pages whose command takes long, and whose sources have changed since its last run."""
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    for page, made in LONG.items():
        then, now = stored[page]["sources"], digests(sources(made))
        every = then | now
        changed = sorted(one for one in every if then.get(one) != now.get(one))
        if changed:
            some = ", ".join(changed[:6]) + ", ..." * (len(changed) > 6)
            yield (
                f"docs/{page} of {stored[page]['date']} is older than its sources: {len(changed)}"
                f" of {len(every)} folders have changed ({some}): scripts/pages.py --write {page}"
            )
    yield from older_mutants()


MUTATED: Final = re.compile(r"^\| (\S+\.py) \|(?: \d+ \|){3} (\w+) \|\n", re.MULTILINE)
"""A row of mutants.md with the numbers of a file: the file and its digest at that run."""


def older_mutants() -> Iterator[str]:
    """Gated files that have changed since they were mutated, or never were."""
    rows = dict(MUTATED.findall((DOCS / "evidence/mutants.md").read_text(encoding="utf-8")))
    changed = [file for file in UNIT_TESTS if rows.get(file) != code_digest(PROJECT / file)]
    if changed:
        yield (
            f"docs/evidence/mutants.md: {len(changed)} of {len(UNIT_TESTS)} gated files have"
            f" changed since their run, or had none: scripts/mutants.py {' '.join(changed)}"
        )


def write(page: str, recordings: str) -> None:
    """Run the command of a page, and store the digests of what it used."""
    used = digests(sources(LONG[page]))
    words = shlex.split(LONG[page].command)
    program, *arguments = [recordings if word == RECORDINGS else word for word in words]
    ran = subprocess.run(
        [Path(sys.executable).parent / program, *arguments], check=False, cwd=PROJECT
    )
    # pytest ends with 1 for a failed test: nothing was made then.
    good = (0,) if program == "pytest" else (0, TARGET_MISSED)
    if ran.returncode not in good:
        sys.exit(ran.returncode)
    store(page, used)


def store(page: str, used: dict[str, str]) -> None:
    """Store the digests of what the command of a page used, and the date."""
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    stored[page] = {"date": datetime.now(UTC).date().isoformat(), "sources": used}
    STORED.write_text(json.dumps(stored, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def main() -> None:
    """Report, or write a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", metavar="PAGE", choices=LONG, help=", ".join(LONG))
    parser.add_argument(
        "--recordings", metavar="FOLDER", default=RECORDINGS, help="of evidence/real_data.md"
    )
    parser.add_argument("--made", metavar="PAGE", choices=LONG, help="its command has just run")
    given = parser.parse_args()
    if given.write:
        write(given.write, given.recordings)
    if given.made:
        store(given.made, digests(sources(LONG[given.made])))
    if not (given.write or given.made):
        print("\n".join(older()))


if __name__ == "__main__":
    main()
