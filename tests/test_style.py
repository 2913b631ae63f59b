"""The parts of our style that a machine can judge: tripwires, ratcheted, not reasons to shred code.

The exception lists may only shrink: an entry that is no longer needed fails the test too.
"""

import ast
import re
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
THIS = "tests/test_style.py"
PACKAGES = ("drives", "observer", "daemon", "sim_drives", "gaitd", "analysis")

FUNCTION_LINES_MAX = 60
FILE_LINES_MAX = 400

LONG_FILES: dict[str, int] = {}
"""Files that may be longer, with the length they may have."""
LONG_FUNCTIONS: dict[str, int] = {}
"""Functions that may be longer, as `file:name`."""

UNITS = set(
    """
    rad rad_per_s rad_per_s2 deg nm nm_per_s nm_s_per_rad nm_per_rad nm_per_a kg kg_m2 m m_per_s
    m_per_s2 mm n n_per_s n_s_per_m n_per_m n_per_a h s ms us ns hz rpm rpm_per_s a ma v w j degc
    ohm si si_per_s si_per_s2 strides counts counts_per_rev counts_per_s permille ratio bit_per_s
    count index cycles mb mb_per_h
    """.split()  # noqa: SIM905 - thirty quoted words on thirty lines read worse
)
WITHOUT_UNIT = set(
    """
    nis mean_nis gate_nis gait_phase phase fraction speedup correlation position velocity effort
    net state std covariance innovation reference measured artificial value limit value_low
    value_high rms worst bias rms_bound correlation_min strides factor
    """.split()  # noqa: SIM905 - as above
)
"""Names of floats that have no unit, or one for each axis, which their docstring says."""


def python_files() -> list[Path]:
    return sorted(file for package in PACKAGES for file in (PROJECT / package).rglob("*.py"))


def tracked_files() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    files = [PROJECT / name for name in listed.split("\0") if name and (PROJECT / name).is_file()]
    return [file for file in files if b"\0" not in file.read_bytes()]


def text_of(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def name_of(file: Path) -> str:
    return file.relative_to(PROJECT).as_posix()


FILES = python_files()
NAMES = [name_of(file) for file in FILES]


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


@pytest.mark.parametrize("file", FILES, ids=NAMES)
def test_no_file_is_longer_than_a_reader_can_hold(file):
    name, length = name_of(file), len(text_of(file).splitlines())
    allowed = LONG_FILES.get(name, FILE_LINES_MAX)

    assert length <= allowed, f"{name} has {length} lines of {allowed}"
    assert name not in LONG_FILES or length > FILE_LINES_MAX, f"{name} needs no exception now"


@pytest.mark.parametrize("file", FILES, ids=NAMES)
def test_no_function_is_longer_than_a_screen(file):
    for function in functions(ast.parse(text_of(file))):
        name = f"{name_of(file)}:{function.name}"
        length = (function.end_lineno or 0) - function.lineno + 1
        allowed = LONG_FUNCTIONS.get(name, FUNCTION_LINES_MAX)

        assert length <= allowed, f"{name} has {length} lines of {allowed}"
        assert name not in LONG_FUNCTIONS or length > FUNCTION_LINES_MAX, f"{name}: no exception"


def test_every_exception_names_something_that_exists():
    known = set(NAMES) | {
        f"{name}:{function.name}"
        for name, file in zip(NAMES, FILES, strict=True)
        for function in functions(ast.parse(text_of(file)))
    }

    assert {*LONG_FILES, *LONG_FUNCTIONS} <= known


def unit_of(name: str) -> str | None:
    """The longest unit that the name ends in."""
    parts = name.lower().split("_")
    for start in range(len(parts)):
        if "_".join(parts[start:]) in UNITS and start > 0:
            return "_".join(parts[start:])
    return None


def says_its_unit(name: str) -> bool:
    name = name.removesuffix("_std")  # in the unit of the figure before it
    return name.lstrip("_") in WITHOUT_UNIT or unit_of(name) is not None


def float_fields(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(text_of(file))):
        if not isinstance(node, ast.ClassDef):
            continue
        for field in node.body:
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                annotation = ast.unparse(field.annotation)
                if re.fullmatch(r"(Annotated\[float, .*\]|float)( \| None)?", annotation):
                    yield f"{node.name}.{field.target.id}"


@pytest.mark.parametrize("file", FILES, ids=NAMES)
def test_every_float_field_says_its_unit(file):
    unnamed = [field for field in float_fields(file) if not says_its_unit(field.split(".")[1])]

    assert not unnamed, f"{name_of(file)}: {unnamed} end in no unit"


def config_files() -> list[Path]:
    return sorted((PROJECT / "configs").rglob("*.toml"))


def float_keys(table: dict[str, object], path: str = "") -> Iterator[tuple[str, str]]:
    for key, value in table.items():
        if isinstance(value, float):
            yield path, key
        elif isinstance(value, dict):
            yield from float_keys(value, f"{path}.{key}")
        elif isinstance(value, list):
            for entry in value:
                if isinstance(entry, dict):
                    yield from float_keys(entry, f"{path}.{key}")


@pytest.mark.parametrize("file", config_files(), ids=name_of)
def test_every_number_of_a_configuration_says_its_unit(file):
    table = tomllib.loads(text_of(file))

    unnamed = [f"{path}.{key}" for path, key in float_keys(table) if not says_its_unit(key)]

    assert not unnamed, f"{name_of(file)}: {unnamed} end in no unit"


@pytest.mark.parametrize("mark", ["TODO", "FIXME", "XXX"])
def test_nothing_is_left_for_later(mark):
    found = {name_of(file) for file in tracked_files() if re.search(rf"\b{mark}\b", text_of(file))}

    assert found <= {THIS}


def test_no_file_names_a_path_of_one_machine():
    places = rf"{re.escape(str(PROJECT.parent))}/|/home/\w|/root/|/Users/|/tmp/\w"
    found = [
        f"{name_of(file)}: {match.group()}"
        for file in tracked_files()
        if name_of(file) != THIS and (match := re.search(places, text_of(file)))
    ]

    assert not found


def test_no_file_names_a_package_registry():
    address = re.compile(r"https?://\S*(pypi|pythonhosted|simple/|registry|mirror)\S*", re.I)
    found = [name_of(file) for file in tracked_files() if address.search(text_of(file))]

    assert not [name for name in found if name != THIS]


SWALLOWED = re.compile(r"except:|except (Base)?Exception\b|suppress\((Base)?Exception\)")


BROAD = {
    # Stops the machine: the process ends with it.
    "daemon/core/loop.py",
    # What one query does to us is not done to who asks next; told, logged and answered.
    "daemon/gateway/service.py",
    # A thread that waits for a disk goes on with its next job; told and logged.
    "daemon/gateway/worker.py",
}


def test_a_broad_catch_is_where_one_failure_has_to_end_and_nowhere_else():
    found = {name_of(file) for file in FILES if SWALLOWED.search(text_of(file))}

    assert found == BROAD


GUIDED = ("daemon", "daemon/config", "daemon/core", "daemon/gateway", "drives", "sim_drives")


@pytest.mark.parametrize("folder", GUIDED)
def test_a_package_tells_where_each_of_its_files_is_read(folder):
    guide = ast.get_docstring(ast.parse(text_of(PROJECT / folder / "__init__.py"))) or ""
    words = set(re.findall(r"\w+", guide))

    untold = {file.stem for file in (PROJECT / folder).glob("*.py")} - words - {"__init__"}

    assert not untold


@pytest.mark.parametrize("package", PACKAGES)
def test_an_init_file_holds_only_its_docstring(package):
    for file in (PROJECT / package).rglob("__init__.py"):
        body = ast.parse(text_of(file)).body

        assert len(body) == 1, name_of(file)
        assert isinstance(body[0], ast.Expr), name_of(file)
        assert ast.get_docstring(ast.parse(text_of(file))), name_of(file)


def test_no_folder_of_tests_is_a_package_that_could_hide_ours():
    assert not list((PROJECT / "tests").rglob("__init__.py"))
