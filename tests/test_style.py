"""The parts of our style that a machine can judge; each message lists all that offends."""

import ast
import re
import subprocess
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
THIS = "tests/test_style.py"
PACKAGES = ("drives", "observer", "daemon", "sim_drives", "simtime", "gaitd", "analysis", "clients")

UNITS = set(
    """
    rad rad_per_s rad_per_s2 deg nm nm_per_s nm_s_per_rad nm_per_rad nm_per_a kg kg_m2 m in m_per_s
    m_per_s2 mm n n_per_s n_s_per_m n_per_m n_per_a h s ms us ns hz rpm rpm_per_s a ma v w j degc
    ohm si si_per_s si_per_s2 strides counts counts_per_rev counts_per_s permille ratio bit_per_s
    count index cycles mb mb_per_h weeks ratio_per_week
    """.split()  # noqa: SIM905 - thirty quoted words on thirty lines read worse
)
WITHOUT_UNIT = set(
    """
    nis mean_nis gate_nis gait_phase phase fraction speedup correlation position velocity effort
    net state std covariance innovation reference measured artificial value limit value_low
    friction friction_error patient needed assist assist_wanted assist_max assist_mean assist_peak
    measured_position reference_position target_effort drift_correlation tremor_amplitude
    amplitude
    value_high rms worst bias rms_bound correlation_min strides factor nis_mean started event
    """.split()  # noqa: SIM905 - as above
)
"""Names of floats that have no unit, or one for each axis, which their docstring says."""


def python_files() -> list[Path]:
    return sorted(file for package in PACKAGES for file in (PROJECT / package).rglob("*.py"))


@cache
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


def test_every_float_field_says_its_unit():
    unnamed = [
        f"{name_of(file)}: {field}"
        for file in FILES
        for field in float_fields(file)
        if not says_its_unit(field.split(".")[1])
    ]

    assert not unnamed


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


def test_every_number_of_a_configuration_says_its_unit():
    unnamed = [
        f"{name_of(file)}: {path}.{key}"
        for file in sorted((PROJECT / "configs").rglob("*.toml"))
        for path, key in float_keys(tomllib.loads(text_of(file)))
        if not says_its_unit(key)
    ]

    assert not unnamed


def offences(pattern: str, flags: int = 0) -> list[str]:
    """Where a tracked file other than this one says what none may say."""
    return [
        f"{name_of(file)}: {match.group()}"
        for file in tracked_files()
        if name_of(file) != THIS and (match := re.search(pattern, text_of(file), flags))
    ]


def test_a_docstring_can_be_understood_without_the_name_above_it():
    files = (file for file in tracked_files() if file.suffix == ".py" and name_of(file) != THIS)
    begins = re.compile(r'^ *"""Of ', re.MULTILINE)
    found = [name_of(file) for file in files if begins.search(text_of(file))]

    assert not found, "\n".join(['a docstring begins with "Of":', *found])


def test_nothing_is_left_for_later():
    assert not offences(r"\b(TODO|FIXME|XXX)\b")


def test_no_file_names_a_path_of_one_machine():
    assert not offences(rf"{re.escape(str(PROJECT.parent))}/|/home/\w|/root/|/Users/|/tmp/\w")


def test_no_file_names_a_package_registry():
    assert not offences(
        r"https?://\S*(pypi|pythonhosted|simple/|registry|mirror)\S*", re.IGNORECASE
    )


def test_every_text_names_its_subject():
    """Allowed: licences, the Unix user (`User=nobody`, `NOBODY`), a former name in backticks."""
    found = offences(r"(?<!User=)(?<!`)((?i:somebody|anybody)|[Nn]obody)")

    assert not [one for one in found if "LICENSE" not in one]


SWALLOWED = re.compile(r"except:|except (Base)?Exception\b|suppress\((Base)?Exception\)")


BROAD = {
    # Stops the machine: the process ends with it.
    "daemon/core/runtime/loop.py",
    # Latches what the raw checks have found, and raises it again.
    "daemon/core/cycle.py",
    # What one query does to us is not done to who asks next; told, logged and answered.
    "daemon/gateway/control.py",
    # What a controller's law raises, raised again in the program's own thread.
    "clients/python/gaitd_client/lease.py",
    # The same for the function of a stream.
    "clients/python/gaitd_client/stream.py",
    # A thread that waits for a disk goes on with its next job; told and logged.
    "daemon/recorder/worker.py",
}


def test_a_broad_catch_is_where_one_failure_has_to_end_and_nowhere_else():
    found = {name_of(file) for file in FILES if SWALLOWED.search(text_of(file))}

    assert found == BROAD


GUIDED = (
    *("daemon/config", "daemon/gateway", "daemon/ipc", "daemon/preflight", "daemon/recorder"),
    *(
        "daemon/system",
        "daemon/system/machine",
        "daemon/wire",
        "daemon/zenoh_io",
        "daemon/core",
        "daemon/core/modes",
    ),
    *("daemon/core/motion", "daemon/core/runtime", "daemon/core/safety", "daemon/core/steps"),
    *("drives", "drives/bringup", "drives/canopen", "drives/cia402", "drives/service"),
    *("observer", "observer/filter", "observer/mechanism", "observer/offline"),
    *("sim_drives", "sim_drives/canopen", "sim_drives/cia402", "sim_drives/faults"),
    *("sim_drives/plant", "sim_drives/time"),
    *("clients/python/gaitd_client", "clients/python/gaitd_client/wire"),
    "clients/python/gaitd_names",
    "clients/python/gaitd_program",
    "clients/python/gaitd_texts",
    "clients/python/gaitd_toml",
    "clients/display/gaitd_display",
    "clients/session/gaitd_session",
    "clients/assist/gaitd_assist",
    "clients/record/gaitd_record",
)


def test_a_package_tells_where_each_of_its_files_is_read():
    untold = []
    for folder in (PROJECT / package for package in GUIDED):
        guide = ast.get_docstring(ast.parse(text_of(folder / "__init__.py"))) or ""
        words = {"__init__", *re.findall(r"\w+", guide)}
        untold += [name_of(file) for file in folder.glob("*.py") if file.stem not in words]

    assert not untold


LAZY = {"gaitd_lab/testing/__init__.py"}
"""pytest imports it at each start, so it imports what it offers when that is used."""


def test_an_init_file_holds_its_docstring_and_what_the_package_offers():
    allowed = (ast.Expr, ast.ImportFrom, ast.Assign)
    trees = {
        name_of(file): ast.parse(text_of(file))
        for file in FILES
        if file.name == "__init__.py" and name_of(file) not in LAZY
    }

    assert not [
        name
        for name, tree in trees.items()
        if not ast.get_docstring(tree) or not all(isinstance(node, allowed) for node in tree.body)
    ]


def test_no_folder_of_tests_is_a_package_that_could_hide_ours():
    assert not list((PROJECT / "tests").rglob("__init__.py"))
