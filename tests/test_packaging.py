"""What is installed is ours, whole, and nothing else's."""

import contextlib
import importlib
import importlib.metadata
import os
import re
import subprocess
import sys
import time
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from config_files import Change, changed, copied
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from gaitd_lab.processes import free_port

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
LABORATORY = PROJECT / "gaitd_lab"
LABORATORY_PYPROJECT = tomllib.loads((LABORATORY / "pyproject.toml").read_text(encoding="utf-8"))
CLIENT_NAME = "gaitd-client"
PACKAGES = PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
OF_THE_LABORATORY = ["gaitd_lab", "sim_drives", "simtime"]


@pytest.mark.parametrize("package", [*PACKAGES, *OF_THE_LABORATORY])
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
        LABORATORY_PYPROJECT,
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


def test_the_laboratory_needs_gaitd_with_its_tools_and_what_is_pinned_for_it():
    wanted = LABORATORY_PYPROJECT["project"]["dependencies"]
    lock = (PROJECT / "requirements" / "lab.txt").read_text(encoding="utf-8")

    assert wanted[0] == f"gaitd[tools]=={PYPROJECT['project']['version']}"
    for requirement in map(Requirement, wanted[1:]):
        pinned = re.search(rf"(?m)^{requirement.name}==(\S+)", lock)
        assert pinned and pinned[1] in requirement.specifier
    assert LABORATORY_PYPROJECT["build-system"] == PYPROJECT["build-system"]


@pytest.mark.parametrize("folder", [CLIENT, DISPLAY, SESSION, ASSIST, RECORD, LABORATORY])
def test_a_source_distribution_has_the_licence_itself(folder):
    licence = folder / "LICENSE"

    assert not licence.is_symlink()
    assert licence.read_bytes() == (PROJECT / "LICENSE").read_bytes()


@pytest.mark.parametrize("own", [SESSION_PYPROJECT, ASSIST_PYPROJECT])
def test_a_client_needs_nothing_that_gaitd_does_not_pin(own):
    assert set(own["project"]["dependencies"]) <= {*PYPROJECT["project"]["dependencies"]}
    assert own["build-system"] == PYPROJECT["build-system"]


def test_a_release_has_every_distribution():
    script = (PROJECT / "scripts" / "release.sh").read_text(encoding="utf-8")
    (named,) = re.findall(r"^DISTRIBUTIONS=\((.*)\)$", script, re.MULTILINE)
    projects = [
        one
        for pattern in ("pyproject.toml", "*/pyproject.toml", "clients/*/pyproject.toml")
        for one in PROJECT.glob(pattern)
        if not one.parent.name.startswith(".")
    ]

    assert {(PROJECT / one).resolve() for one in named.split()} == {
        one.parent.resolve() for one in projects
    }


def build(project: Path, target: str, folder: Path) -> Path:
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)],
        cwd=project,
        check=True,
        capture_output=True,
    )
    (made,) = folder.glob({"wheel": "*.whl", "sdist": "*.tar.gz"}[target])
    return made


def built(project: Path, folder: Path) -> zipfile.ZipFile:
    return zipfile.ZipFile(build(project, "wheel", folder))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    return built(PROJECT, tmp_path_factory.mktemp("wheel"))


def test_the_clients_wheel_holds_its_packages_with_types_and_licence(tmp_path):
    wheel = built(CLIENT, tmp_path)
    names = set(wheel.namelist())
    files = {
        file.relative_to(CLIENT).as_posix()
        for package in ("gaitd_client", "gaitd_names", "gaitd_program", "gaitd_texts", "gaitd_toml")
        for file in (CLIENT / package).rglob("*")
        if file.is_file() and file.suffix != ".pyc"
    }

    assert "gaitd_client/py.typed" in files
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


def test_the_wheel_brings_the_command_and_the_licence_and_nothing_of_the_laboratory(wheel):
    papers = {name.split(".dist-info/")[-1]: name for name in wheel.namelist()}

    points = wheel.read(papers["entry_points.txt"]).decode()
    assert points.split("\n") == ["[console_scripts]", "gaitd = gaitd.__main__:main", ""]
    assert b"Apache License" in wheel.read(papers["licenses/LICENSE"])


def test_the_laboratorys_wheel_holds_its_three_packages_commands_plugin_and_bus(tmp_path):
    wheel = built(LABORATORY, tmp_path)
    names = set(wheel.namelist())
    modules = {
        file.relative_to(PROJECT).as_posix()
        for package in OF_THE_LABORATORY
        for file in (PROJECT / package).rglob("*.py")
    }
    data = {"gaitd_lab/fault_matrix/reversals.csv", "gaitd_lab/peers/anchor.c"}

    assert {name for name in names if ".dist-info/" not in name} == {
        *(modules - {"gaitd_lab/hatch_build.py"}),
        *data,
    }
    papers = {name.split(".dist-info/")[-1]: name for name in names}
    points = wheel.read(papers["entry_points.txt"]).decode()
    assert "[gaitd.commands]\ngaitd_lab = gaitd_lab.commands.table:COMMANDS" in points
    assert "[pytest11]\ngaitd_lab.testing.plugin = gaitd_lab.testing.plugin" in points
    assert "[can.interface]\ngaitd = simtime.can_bus:SimulatedCanBus" in points
    assert b"Apache License" in wheel.read(papers["licenses/LICENSE"])


@pytest.mark.parametrize("project", [PROJECT, LABORATORY], ids=["gaitd", "gaitd-lab"])
def test_a_source_distribution_makes_the_same_wheel_as_the_clone(project, tmp_path):
    # Not tarfile: the Python of Debian 12 has no `filter=`, later ones warn without it.
    subprocess.run(["tar", "-xf", build(project, "sdist", tmp_path), "-C", tmp_path], check=True)
    (unpacked,) = tmp_path.glob("*/pyproject.toml")

    again = build(unpacked.parent, "wheel", tmp_path)

    of_the_clone = build(project, "wheel", tmp_path / "clone")
    assert again.read_bytes() == of_the_clone.read_bytes()


# --- the wheel of gaitd in an empty environment -------------------------------------------------


def needed(name: str) -> dict[str, importlib.metadata.Distribution]:
    """The distributions that one needs, without extras."""
    found: dict[str, importlib.metadata.Distribution] = {}
    left = [name]
    while left:
        name = left.pop()
        if name not in found:
            found[name] = importlib.metadata.distribution(name)
            wanted = map(Requirement, found[name].requires or ())
            left += [
                one.name for one in wanted if not one.marker or one.marker.evaluate({"extra": ""})
            ]
    return found


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    """`bin` of an environment with gaitd and its client from their wheels, and what they need.

    In a clone every package can be imported; here only what is installed can.
    """
    folder = tmp_path_factory.mktemp("alone")
    venv.create(folder / "environment", symlinks=True)
    (packages,) = (folder / "environment").glob("lib/python3*/site-packages")
    for name, one in needed("gaitd").items():
        if name in ("gaitd", CLIENT_NAME):
            continue
        for top in {file.parts[0] for file in one.files or () if file.parts[0] != ".."}:
            with contextlib.suppress(FileExistsError):
                (packages / top).symlink_to(one.locate_file(top))
    wheels = [build(project, "wheel", folder / project.name) for project in (CLIENT, PROJECT)]
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "environment"), "install"]
    subprocess.run([*pip, "--quiet", "--no-index", *map(str, wheels)], check=True)
    return folder / "environment" / "bin"


def ran(alone: Path, *words: object) -> subprocess.CompletedProcess[str]:
    program = [alone / words[0], *map(str, words[1:])]
    return subprocess.run(program, cwd=alone, capture_output=True, text=True, check=False)


def test_without_the_laboratory_none_of_its_modules_can_be_imported(alone):
    found = ran(
        alone,
        "python",
        "-c",
        f"from importlib.util import find_spec; import gaitd; print(gaitd.__file__)\n"
        f"for name in {OF_THE_LABORATORY}: print(find_spec(name))",
    )

    file, *specs = found.stdout.splitlines()
    assert file.startswith(str(alone.parent))
    assert specs == ["None"] * 3


def test_without_the_laboratory_a_configuration_is_checked_and_a_service_is_asked(alone):
    (configs,) = alone.parent.glob("lib/python3*/site-packages/gaitd/configs")

    checked = ran(alone, "gaitd", "check", "--quiet", "--config", configs / "trainer.toml")
    asked = ran(alone, "gaitd", "status", "--endpoint", f"tcp/127.0.0.1:{free_port()}")

    assert (checked.returncode, checked.stderr) == (0, "")
    assert (asked.returncode, asked.stderr.count("\n")) == (4, 1)


def test_without_the_laboratory_its_commands_and_a_simulated_bus_say_what_to_install(alone):
    (configs,) = alone.parent.glob("lib/python3*/site-packages/gaitd/configs")

    demo = ran(alone, "gaitd", "demo")
    core = ran(alone, "gaitd", "core", "--config", configs / "demo.toml")

    for ended in (demo, core):
        assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (2, "", 1)
        assert "gaitd-lab, which is not installed: pip install " in ended.stderr


@pytest.mark.parametrize(
    "shown",
    [
        "the control program starts",
        pytest.param(  # compiles the kernels anew
            "position not known", marks=[pytest.mark.thorough, pytest.mark.timeout(1800)]
        ),
    ],
)
def test_without_laboratory_and_extras_the_service_runs_until_it_is_told_to_end(
    alone, tmp_path, shown
):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = changed(
        copied(tmp_path),
        Change("demo.toml", 'interface = "simulated"', 'interface = "virtual"'),
        Change("demo.toml", '"/dev/shm/gaitd-demo"', f'"{tmp_path}/run"'),
        Change("demo.toml", "tcp/127.0.0.1:7447", endpoint),
    )
    with (tmp_path / "said").open("w+") as said:
        running = subprocess.Popen(
            [alone / "gaitd", "run", "--config", str(config)],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba")},
            stderr=said,
        )
        try:
            while shown not in ran(alone, "gaitd", "status", "--endpoint", endpoint).stdout:
                assert running.poll() is None, (tmp_path / "said").read_text()
                time.sleep(0.5)
        finally:
            running.terminate()
            code = running.wait()
    assert code == 0, (tmp_path / "said").read_text()


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
    wanted += LABORATORY_PYPROJECT["project"]["dependencies"][1:]
    for project in (PYPROJECT, LABORATORY_PYPROJECT):
        for extra in project["project"]["optional-dependencies"].values():
            wanted += extra

    for requirement in wanted:
        if requirement.startswith(CLIENT_NAME):
            continue  # of this repository, in no lock file
        name = requirement.split("=")[0].split(">")[0].strip().lower()
        assert f"\n{name}==" in f"\n{locked}", requirement
        if "==" in requirement:
            assert f"\n{requirement.lower()} " in f"\n{locked}", requirement


def test_what_is_pinned_for_an_installed_service_is_what_it_needs_and_what_builds_it():
    wanted = {canonicalize_name(name) for name in (*needed("gaitd"), *needed("hatchling"))}
    lock = (PROJECT / "requirements" / "run.txt").read_text(encoding="utf-8")

    pinned = re.findall(r"(?m)^([a-z0-9-]+)==(?!.*win32)", lock)

    assert {*pinned} == wanted - {"gaitd", CLIENT_NAME}


@pytest.mark.parametrize("lock", ["run.txt", "display.txt", "record.txt"])
def test_no_package_of_the_tools_is_pinned_for_an_installed_service(lock):
    text = (PROJECT / "requirements" / lock).read_text(encoding="utf-8")

    for tool in map(Requirement, PYPROJECT["project"]["optional-dependencies"]["tools"]):
        assert f"\n{tool.name}==" not in f"\n{text}"


def test_the_page_of_third_party_software_has_exactly_what_is_pinned_for_the_installed_service():
    page = (PROJECT / "docs" / "third_party.md").read_text(encoding="utf-8")
    told = re.findall(r"(?m)^\| ([a-z0-9-]+) \| (\d[^ ]*) \| [^|]+ \| [^|]+ \|", page)
    locks = [
        (PROJECT / "requirements" / name).read_text()
        for name in ("run.txt", "display.txt", "record.txt", "tools.txt")
    ]
    pinned = re.findall(r"(?m)^([a-z0-9-]+)==(\S+)(?!.*win32)", "\n".join(locks))

    assert sorted(told) == sorted(set(pinned))
