"""What is installed is ours, whole, and nothing else's."""

import importlib
import importlib.metadata
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
CLIENT = PROJECT / "clients" / "python"
CLIENT_PYPROJECT = tomllib.loads((CLIENT / "pyproject.toml").read_text(encoding="utf-8"))
DISPLAY = PROJECT / "clients" / "display"
SESSION = PROJECT / "clients" / "session"
SESSION_PYPROJECT = tomllib.loads((SESSION / "pyproject.toml").read_text(encoding="utf-8"))
ASSIST = PROJECT / "clients" / "assist"
ASSIST_PYPROJECT = tomllib.loads((ASSIST / "pyproject.toml").read_text(encoding="utf-8"))
RECORD = PROJECT / "clients" / "record"
RECORD_PYPROJECT = tomllib.loads((RECORD / "pyproject.toml").read_text(encoding="utf-8"))
DISPLAY_PYPROJECT = tomllib.loads((DISPLAY / "pyproject.toml").read_text(encoding="utf-8"))
CLIENT_NAME = "gaitd-client"
PACKAGES = PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]


@pytest.mark.parametrize("package", PACKAGES)
def test_the_package_we_import_is_ours(package):
    module = importlib.import_module(package)

    assert Path(str(module.__file__)).parent == PROJECT / package


@pytest.mark.parametrize("rival", ["python-daemon", "daemon", "observer", "drives", "analysis"])
def test_no_installed_distribution_claims_a_name_of_ours(rival):
    with pytest.raises(importlib.metadata.PackageNotFoundError):
        importlib.metadata.distribution(rival)


@pytest.mark.parametrize(
    "project",
    [
        PYPROJECT,
        CLIENT_PYPROJECT,
        DISPLAY_PYPROJECT,
        SESSION_PYPROJECT,
        ASSIST_PYPROJECT,
        RECORD_PYPROJECT,
    ],
)
def test_the_installed_version_is_the_one_of_the_project_file(project):
    assert importlib.metadata.version(project["project"]["name"]) == project["project"]["version"]


def test_gaitd_needs_the_client_of_this_repository_with_its_dependencies():
    wanted = PYPROJECT["project"]["dependencies"]

    assert f"{CLIENT_NAME}=={CLIENT_PYPROJECT['project']['version']}" in wanted
    assert set(CLIENT_PYPROJECT["project"]["dependencies"]) <= set(wanted)
    assert CLIENT_PYPROJECT["build-system"] == PYPROJECT["build-system"]


@pytest.mark.parametrize(
    ("extra", "project"), [("display", DISPLAY_PYPROJECT), ("record", RECORD_PYPROJECT)]
)
def test_display_and_recorder_need_the_versions_that_are_pinned_for_them(extra, project):
    own = {*PYPROJECT["project"]["dependencies"], "gaitd-session==0.1.0"}
    own |= {*PYPROJECT["project"]["optional-dependencies"][extra]}

    assert set(project["project"]["dependencies"]) <= own
    assert project["build-system"] == PYPROJECT["build-system"]


@pytest.mark.parametrize("folder", [CLIENT, DISPLAY, SESSION, ASSIST, RECORD])
def test_a_source_distribution_has_the_licence_itself(folder):
    licence = folder / "LICENSE"

    assert not licence.is_symlink()
    assert licence.read_bytes() == (PROJECT / "LICENSE").read_bytes()


@pytest.mark.parametrize("own", [SESSION_PYPROJECT, ASSIST_PYPROJECT])
def test_a_client_needs_nothing_that_gaitd_does_not_pin(own):
    assert set(own["project"]["dependencies"]) <= {*PYPROJECT["project"]["dependencies"]}
    assert own["build-system"] == PYPROJECT["build-system"]


def built(project: Path, folder: Path) -> zipfile.ZipFile:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=project,
        check=True,
        capture_output=True,
    )
    return zipfile.ZipFile(next(folder.glob("*.whl")))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    return built(PROJECT, tmp_path_factory.mktemp("wheel"))


def test_the_clients_wheel_holds_its_package_with_types_schemas_and_licence(tmp_path):
    wheel = built(CLIENT, tmp_path)
    names = set(wheel.namelist())
    files = {
        file.relative_to(CLIENT).as_posix()
        for file in (CLIENT / "gaitd_client").rglob("*")
        if file.is_file() and file.suffix != ".pyc"
    }

    assert {"gaitd_client/py.typed", "gaitd_client/wire/schemas/gaitd.estimate.v2.json"} <= files
    assert {name for name in names if ".dist-info/" not in name} == files
    licence = next(name for name in names if name.endswith("licenses/LICENSE"))
    assert b"Apache License" in wheel.read(licence)


@pytest.mark.parametrize(
    ("folder", "name"), [(SESSION, "session"), (ASSIST, "assist"), (RECORD, "record")]
)
def test_a_clients_wheel_holds_its_package_with_types_command_and_licence(folder, name, tmp_path):
    wheel = built(folder, tmp_path)
    names = set(wheel.namelist())
    files = {f"gaitd_{name}/{file.name}" for file in (folder / f"gaitd_{name}").glob("*.*")}

    assert f"gaitd_{name}/py.typed" in files
    assert {name for name in names if ".dist-info/" not in name} == files
    papers = {name.split(".dist-info/")[-1]: name for name in names}
    assert b"Apache License" in wheel.read(papers["licenses/LICENSE"])
    if folder is RECORD:
        return  # its command is `gaitd record`
    command = f"gaitd-{name} = gaitd_{name}.program:main"
    assert command.encode() in wheel.read(papers["entry_points.txt"])


def test_the_displays_wheel_holds_its_pages_and_all_licences(tmp_path):
    wheel = built(DISPLAY, tmp_path)
    names = set(wheel.namelist())
    files = {
        file.relative_to(DISPLAY).as_posix()
        for file in (DISPLAY / "gaitd_display").rglob("*")
        if file.is_file() and file.suffix != ".pyc"
    }

    assert {"gaitd_display/static/patient.html", "gaitd_display/patient.py"} <= files
    assert {name for name in names if ".dist-info/" not in name} == files
    papers = {name.split("licenses/")[-1]: name for name in names if "licenses/" in name}
    assert b"Apache License" in wheel.read(papers["LICENSE"])
    font = papers["gaitd_display/static/fonts/LICENSE.AtkinsonHyperlegibleNext"]
    assert b"SIL Open Font License, Version 1.1" in wheel.read(font)


def test_the_wheel_holds_every_module_and_configuration_and_nothing_but_our_packages(wheel):
    modules = {
        file.relative_to(PROJECT).as_posix()
        for package in PACKAGES
        for file in (PROJECT / package).rglob("*.py")
    }
    configs = {f"gaitd/{file.relative_to(PROJECT)}" for file in (PROJECT / "configs").rglob("*.*")}
    names = set(wheel.namelist())

    assert modules | configs <= names
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(PACKAGES)


def test_the_wheel_brings_the_command_the_pytest_plugin_and_the_licence(wheel):
    papers = {name.split(".dist-info/")[-1]: name for name in wheel.namelist()}
    points = wheel.read(papers["entry_points.txt"])

    assert b"gaitd = gaitd.__main__:main" in points
    assert b"[pytest11]\ngaitd_lab.testing.plugin = gaitd_lab.testing.plugin" in points
    assert b"Apache License" in wheel.read(papers["licenses/LICENSE"])


LOCKS = sorted((PROJECT / "requirements").glob("*.txt"))


@pytest.mark.parametrize("lock", LOCKS, ids=[lock.name for lock in LOCKS])
def test_every_pinned_package_has_a_hash_and_no_address(lock):
    blocks = lock.read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    pins = [line for line in blocks if "==" in line and not line.lstrip().startswith("#")]

    assert pins
    assert all("--hash=sha256:" in pin for pin in pins)
    assert not any("://" in pin for pin in pins)


def test_every_dependency_is_pinned_at_a_version_that_the_project_allows():
    locked = "\n".join(lock.read_text(encoding="utf-8") for lock in LOCKS).lower()
    wanted = [*PYPROJECT["project"]["dependencies"]]
    for extra in PYPROJECT["project"]["optional-dependencies"].values():
        wanted += extra

    for requirement in wanted:
        if requirement.startswith(CLIENT_NAME):
            continue  # of this repository, in no lock file
        name = requirement.split("=")[0].split(">")[0].strip().lower()
        assert f"\n{name}==" in f"\n{locked}", requirement
        if "==" in requirement:
            assert f"\n{requirement.lower()} " in f"\n{locked}", requirement


def test_the_page_of_third_party_software_has_exactly_what_is_pinned_for_the_installed_service():
    page = (PROJECT / "docs" / "third_party.md").read_text(encoding="utf-8")
    told = re.findall(r"(?m)^\| ([a-z0-9-]+) \| (\d[^ ]*) \| [^|]+ \| [^|]+ \|", page)
    locks = [
        (PROJECT / "requirements" / name).read_text()
        for name in ("run.txt", "display.txt", "record.txt")
    ]
    pinned = re.findall(r"(?m)^([a-z0-9-]+)==(\S+)(?!.*win32)", "\n".join(locks))

    assert sorted(told) == sorted(set(pinned))
