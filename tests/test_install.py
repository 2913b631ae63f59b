"""`make install`, staged into a folder: what lies where, what an upgrade keeps, what remains.

The container of `rigs/test_service_under_systemd.py` has the same on a running system.
"""

import os
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import typer
from gaitd_assist import parse_settings
from gaitd_record import Purpose, WhenFull

from gaitd.__main__ import build

PROJECT = Path(__file__).parents[1]
INSTALL = PROJECT / "scripts" / "install.sh"


class Staged:
    """A machine that is only a folder."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def ended(self, what: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", str(INSTALL), what],
            env={**os.environ, "DESTDIR": str(self.root)},
            capture_output=True,
            text=True,
            check=False,
        )

    def run(self, what: str) -> str:
        ended = self.ended(what)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    def refused(self, what: str) -> str:
        ended = self.ended(what)
        assert ended.returncode == 1, ended.stdout + ended.stderr
        return ended.stderr

    def __truediv__(self, name: str) -> Path:
        return self.root / name

    def files(self) -> set[str]:
        paths = (path for path in self.root.rglob("*") if path.is_symlink() or not path.is_dir())
        return {f"/{path.relative_to(self.root)}" for path in paths}


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    staged = Staged(tmp_path_factory.mktemp("installed") / "machine")
    staged.run("files")
    return staged


@pytest.fixture
def machine(installed, tmp_path):
    """One to change."""
    return Staged(shutil.copytree(installed.root, tmp_path / "machine", symlinks=True))


def test_units_configuration_and_documents_are_where_a_debian_machine_looks_for_them(installed):
    units = "/usr/lib/systemd/system"

    assert {
        "/etc/gaitd/trainer.toml",
        "/etc/gaitd/drives/profiles/epos4.toml",
        "/usr/bin/gaitd",
        "/usr/lib/systemd/network/80-gaitd-can0.link",
        "/usr/lib/systemd/network/80-gaitd-can0.network",
        "/usr/lib/sysusers.d/gaitd.conf",
        "/usr/lib/tmpfiles.d/gaitd.conf",
        "/usr/share/doc/gaitd/README.md",
        "/usr/share/doc/gaitd/docs/evidence/README.md",
        "/usr/share/doc/gaitd/docs/pictures/engineer_gait.png",
        "/usr/share/doc/gaitd/docs/wiring_can.svg",
        f"{units}/gaitd-core.service",
        f"{units}/gaitd-core.service.d/20-gaitd-bus.conf",
        f"{units}/gaitd.target",
        f"{units}/service.d/10-gaitd-no-can.conf",
        f"{units}/sys-subsystem-net-devices-can0.device.d/10-gaitd-wait.conf",
    } <= installed.files()
    assert (installed / "usr/bin/gaitd").readlink() == Path("/opt/gaitd/bin/gaitd")


def test_no_unit_is_enabled_and_neither_bus_nor_drives_of_a_desk_are_in_force(installed):
    assert not [name for name in installed.files() if ".wants/" in name]
    assert not [
        name
        for name in installed.files()
        if ("vcan" in name or "gaitd-sim" in name)
        and "/examples/" not in name
        and not name.startswith("/etc/gaitd/")
    ]
    in_force = installed / "usr/lib/systemd/system/gaitd-core.service.d/20-gaitd-bus.conf"
    assert "AF_INET" not in in_force.read_text()


def test_an_upgrade_keeps_what_was_edited_and_offers_its_own_until_it_is_taken(machine):
    trainer = machine / "etc/gaitd/trainer.toml"
    edited = trainer.read_text().replace('channel = "can0"', 'channel = "can1"')
    trainer.write_text(edited)

    said = machine.run("files")

    assert trainer.read_text() == edited
    shipped = (PROJECT / "configs" / "trainer.toml").read_bytes()
    assert (machine / "etc/gaitd/trainer.toml.dist").read_bytes() == shipped
    assert "/etc/gaitd/trainer.toml is kept" in said
    assert [name for name in machine.files() if name.endswith(".dist")] == [
        "/etc/gaitd/trainer.toml.dist"
    ]

    trainer.write_bytes(shipped)
    machine.run("files")

    assert not [name for name in machine.files() if name.endswith(".dist")]


def test_configuration_is_not_for_everybody_to_read(installed):
    for path in (installed / "etc/gaitd").rglob("*"):
        assert path.stat().st_mode & 0o777 == (0o755 if path.is_dir() else 0o640)


def test_an_uninstall_leaves_configuration_and_state_and_what_others_have_put_beside_ours(machine):
    before = {name for name in machine.files() if name.startswith("/etc/gaitd/")}
    added = {"/var/lib/gaitd/axes.json", "/usr/lib/systemd/system/service.d/50-theirs.conf"}
    for name in added:
        file = machine / name[1:]
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()

    machine.run("uninstall")

    assert machine.files() == before | added


def test_a_purge_leaves_nothing(machine):
    machine.run("purge")

    assert machine.files() == set()


def test_the_pages_are_installed_only_when_asked_for_and_keep_their_files(machine):
    units = "/usr/lib/systemd/system"
    pages = {f"{units}/gaitd-patient.service", f"{units}/gaitd-therapist.service"}
    files = {"/etc/gaitd-display/patient.toml", "/etc/gaitd-display/therapist.toml"}
    assert not (pages | files) & machine.files()

    machine.run("display-files")

    assert pages | files <= machine.files()
    for name in files:
        assert (machine / name[1:]).stat().st_mode & 0o777 == 0o640
    (machine / "etc/gaitd-display/patient.toml").write_text("edited")
    machine.run("display-files")
    assert (machine / "etc/gaitd-display/patient.toml").read_text() == "edited"
    history = machine / "var/lib/gaitd-patient/history.sqlite"
    history.parent.mkdir(parents=True)
    history.write_text("of a patient")
    assert "/var/lib/gaitd-patient are kept" in machine.run("uninstall").replace("\ninstall:", "")
    assert not pages & machine.files()
    assert files <= machine.files()
    assert history.exists()
    machine.run("purge")
    assert machine.files() == set()


def test_the_controller_is_installed_only_when_asked_for_and_keeps_its_file(machine):
    unit, file = "/usr/lib/systemd/system/gaitd-assist.service", "/etc/gaitd-assist/assist.toml"
    assert not {unit, file} & machine.files()

    machine.run("assist-files")

    placed = machine / file[1:]
    assert placed.stat().st_mode & 0o777 == 0o640
    settings = parse_settings(placed.read_text(), Path(file))
    assert settings.log == Path("/var/lib/gaitd-assist/assist.jsonl")
    placed.write_text("edited")
    machine.run("assist-files")
    assert placed.read_text() == "edited"
    machine.run("uninstall")
    assert unit not in machine.files()
    assert file in machine.files()
    machine.run("purge")
    assert machine.files() == set()


def test_the_recorder_is_installed_only_when_asked_for_and_keeps_its_file_and_recordings(machine):
    unit, file = "/usr/lib/systemd/system/gaitd-record.service", "/etc/gaitd-record/record.env"
    assert not {unit, file} & machine.files()

    machine.run("record-files")

    placed, recording = machine / file[1:], machine / "var/lib/gaitd-record/20260101/messages.mcap"
    assert placed.stat().st_mode & 0o777 == 0o640
    variable, _, options = placed.read_text().splitlines()[-1].partition("=")
    leaf = typer.main.get_group(build("record")).commands["record"]
    given = leaf.make_context("record", shlex.split(options.strip('"'))).params
    assert variable == "GAITD_RECORD"
    assert (given["purpose"], given["when_full"]) == (Purpose.TRAINING, WhenFull.DELETE_OLDEST)
    placed.write_text("edited")
    machine.run("record-files")
    assert placed.read_text() == "edited"
    recording.parent.mkdir(parents=True)
    recording.touch()
    assert "/var/lib/gaitd-record" in machine.run("uninstall")
    assert unit not in machine.files()
    assert recording.exists()
    machine.run("purge")
    assert machine.files() == set()


def test_the_pages_are_not_added_to_another_version(machine):
    python = machine / "opt/gaitd/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho 0.0.1\n")
    python.chmod(0o755)

    said = machine.refused("display")

    assert "/opt/gaitd has gaitd 0.0.1, this clone is" in said
    assert "`make install` from this clone first" in said


def test_what_it_cannot_do_is_a_matter_of_usage():
    ended = subprocess.run(
        ["bash", str(INSTALL), "dance"],
        capture_output=True,
        text=True,
        check=False,
    )

    assert ended.returncode == 2
    assert "install.sh uninstall" in ended.stdout
