"""Each import contract of pyproject.toml notices what breaks it; `make check` sees that none is."""

import shutil
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import grimp

PROJECT = Path(__file__).resolve().parent.parent
LINTER = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
    "importlinter"
]


FOLDER = {
    "gaitd_client": PROJECT / "clients" / "python",
    "gaitd_names": PROJECT / "clients" / "python",
    "gaitd_program": PROJECT / "clients" / "python",
    "gaitd_texts": PROJECT / "clients" / "python",
    "gaitd_toml": PROJECT / "clients" / "python",
    "gaitd_display": PROJECT / "clients" / "display",
    "gaitd_session": PROJECT / "clients" / "session",
    "gaitd_assist": PROJECT / "clients" / "assist",
    "gaitd_record": PROJECT / "clients" / "record",
}


class Plant(NamedTuple):
    package: str
    imported: str
    contract: str


OFFLINE = "only offline work and the wire contract meet in analysis"
PHYSICS = "the virtual drives share frames, data sheets and physics with the service"
PYTEST = "pytest is not needed to run gaitd: only the plugin that it ships imports it"
SHIPPED = "the service imports neither commands nor laboratory nor simulated time"
JUDGEMENT = "commands ask whether a configuration is good; nothing that they start does"
ALONE = "the client library is complete without gaitd"
EDGE = "texts are for the edge of the core, not for what moves the machine"
NETWORK = "names, texts and files load no network"
MESSAGES = "messages are for gateway and clients, not for what moves the machine"
TOOLS = "the service and the virtual drives need no package of the tools"
COMMAND_LINE = "of the laboratory only its commands know the command line"
TRAINER = "commands of a trainer import nothing of the laboratory"
PLANTS = (
    Plant("observer", "scipy", TOOLS),
    Plant("drives", "daemon.ipc.record", "drives and observer know nothing of ours"),
    Plant("observer", "drives.signals", "drives and observer never see each other"),
    Plant("daemon.core", "sim_drives.plant.actuation", SHIPPED),
    Plant("drives", "simtime.link", SHIPPED),
    Plant("sim_drives", "observer.filter.cdkf", PHYSICS),
    Plant("sim_drives", "drives.signals", PHYSICS),
    Plant(
        "daemon.gateway",
        "daemon.core.safety.checks",
        "the gateway sees neither drives nor observer nor core",
    ),
    Plant("daemon.core", "zenoh", "the core sees no network and no gateway"),
    Plant("observer", "time", "the observer is numerics only"),
    Plant("analysis", "drives.signals", OFFLINE),
    Plant("daemon", "pytest", PYTEST),
    Plant("gaitd", "pytest", PYTEST),
    Plant(
        "gaitd_lab", "gaitd_lab.testing.service", "what tests share is for tests, and `gaitd rig`"
    ),
    Plant("gaitd_lab", "gaitd.remote", COMMAND_LINE),
    Plant("gaitd", "simtime.link", TRAINER),
    Plant("simtime", "sim_drives.settings", "simulated time knows no virtual drive"),
    Plant("daemon.core", "daemon.preflight.acceptance", JUDGEMENT),
    Plant("gaitd_client", "daemon.ipc.record", ALONE),
    Plant("gaitd_toml", "gaitd_client.wire", NETWORK),
    Plant("gaitd_names", "gaitd_client.wire", NETWORK),
    Plant("gaitd_texts", "gaitd_client.wire", NETWORK),
    Plant("daemon.core.steps", "gaitd_texts", EDGE),
    Plant("daemon.core", "gaitd_client.stream", MESSAGES),
    Plant("gaitd_display", "daemon.ipc.record", "the display sees messages alone"),
    Plant("gaitd_record", "daemon.ipc.record", "the recorder sees the client library alone"),
    Plant("daemon.gateway", "pyarrow", "the service needs no package of the recorder"),
    Plant("gaitd_session", "daemon.ipc.record", "a session sees the client library alone"),
    Plant(
        "gaitd_assist",
        "daemon.ipc.record",
        "the reference controller sees the client library alone",
    ),
)


def test_each_planted_import_breaks_its_contract(tmp_path):
    for package in LINTER["root_packages"]:
        shutil.copytree(FOLDER.get(package, PROJECT) / package, tmp_path / package)
    shutil.copy(PROJECT / "pyproject.toml", tmp_path)
    for number, plant in enumerate(PLANTS):
        file = tmp_path / plant.package.replace(".", "/") / f"planted_{number}.py"
        file.write_text(f'"""Planted."""\n\nimport {plant.imported}\n')

    linted = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )

    assert linted.returncode == 1, linted.stdout
    report = linted.stdout.partition("Broken contracts")[2].splitlines()
    said: dict[str, str] = {}
    for line, after in pairwise(report):
        if line and set(after) == {"-"}:
            said[contract := line] = ""
        elif said:
            said[contract] += f"{line}\n"
    assert set(said) == {plant.contract for plant in PLANTS}
    assert set(said) == {contract["name"] for contract in LINTER["contracts"]}
    for number, plant in enumerate(PLANTS):
        chain = f"{plant.package}.planted_{number} -> {plant.imported} (l.3)"
        assert chain in said[plant.contract], plant


def test_no_files_import_each_other_in_a_circle():
    graph = grimp.build_graph(*LINTER["root_packages"], cache_dir=None)
    imported = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}

    assert len(imported) > 500
    TopologicalSorter(imported).prepare()  # raises with the names of a circle
