"""The shipped units as text: systemd reads them without a complaint, and says how open they are."""

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest
from processes import CONFIGS

from daemon.config.trainer import load_trainer
from daemon.ipc.ring_clip import FOLDER

SYSTEMD = Path(__file__).parents[2] / "systemd"
BUSES = {"can0": "drop-ins", "vcan0": "examples", "simulated": "examples"}
"""Folder of the drop-in of each bus."""
TRAINER = CONFIGS / "trainer.toml"
EXPOSURE_MAX = {
    "gaitd-core": 1.5,
    "gaitd-gateway": 2.0,
    "gaitd-patient": 2.0,
    "gaitd-therapist": 2.0,
    "gaitd-assist": 2.0,
    "gaitd-record": 2.0,
}
BINDING = ("Requires", "Requisite", "BindsTo", "PartOf", "Upholds", "PropagatesStopTo", "Conflicts")
FRAMES_OF_A_CYCLE = 2 * (1 + 2 * 2 + 1)
"""Two legs: SYNC, two RPDOs for each of two drives, heartbeat; and as many that a stop adds."""
needs_analyze = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="no systemd-analyze"
)


class _Unit(configparser.RawConfigParser):
    """A unit file: keys keep their case, and those that repeat add up."""

    def __init__(self, path: Path) -> None:
        super().__init__(strict=False, comment_prefixes=("#", ";"), interpolation=None)
        self.optionxform = str
        self.read(path)

    def values(self, section, key):
        return self.get(section, key, fallback="").split()


def unit(name):
    return _Unit(SYSTEMD / name)


def lines_of(name):
    text = (SYSTEMD / name).read_text()
    return [line for line in text.splitlines() if line and not line.startswith("#")]


@pytest.fixture(params=sorted(BUSES))
def placed(request, tmp_path):
    """The units with a program that exists, as systemd wants to see one, and their drop-ins."""
    for folder, drop_in in (
        ("service.d", "drop-ins/no-can"),
        ("gaitd-sim.service.d", "drop-ins/may-can"),
        ("gaitd-core.service.d", "drop-ins/may-can"),
        ("gaitd-core.service.d", f"{BUSES[request.param]}/bus-{request.param}"),
    ):
        (tmp_path / folder).mkdir(exist_ok=True)
        shutil.copy(SYSTEMD / f"{drop_in}.conf", tmp_path / folder)
    program = tmp_path / "gaitd"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    for path in SYSTEMD.rglob("gaitd*.*"):
        if path.suffix in {".service", ".target"}:
            shutil.copy(path, tmp_path)
    for path in tmp_path.rglob("*.*"):
        if path.is_file():
            text = path.read_text()
            for name in ("gaitd-display", "gaitd-assist", "gaitd"):
                text = text.replace(f"/opt/gaitd/bin/{name}", str(program))
            path.write_text(text)
    return tmp_path


@needs_analyze
def test_systemd_reads_every_unit_without_a_complaint(placed):
    names = sorted(str(path) for path in placed.glob("gaitd*.*") if path.is_file())

    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", *names],
        capture_output=True,
        text=True,
        check=False,
    )

    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@needs_analyze
@pytest.mark.parametrize("name", sorted(EXPOSURE_MAX))
def test_a_unit_is_as_closed_as_promised(name):
    threshold = round(EXPOSURE_MAX[name] * 10)

    service = str(SYSTEMD / f"{name}.service")
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", f"--threshold={threshold}", service],
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stdout[-300:] + done.stderr


def test_only_the_core_and_the_virtual_drives_may_open_a_can_socket():
    def families(name):
        return unit(name).values("Service", "RestrictAddressFamilies")

    assert families("gaitd-core.service") == ["AF_CAN", "AF_UNIX"]
    assert "AF_CAN" not in families("gaitd-gateway.service")
    everybody = unit("drop-ins/no-can.conf").values("Service", "RestrictAddressFamilies")
    assert everybody == ["~AF_CAN"]
    assert not unit("drop-ins/may-can.conf").options("Service")


def test_each_page_has_a_user_of_its_own_loopback_and_no_file_of_the_service():
    pages = [unit(f"gaitd-{who}.service") for who in ("patient", "therapist")]

    assert pages[0].get("Service", "User") != pages[1].get("Service", "User")
    for page in pages:
        assert page.values("Service", "IPAddressAllow") == ["localhost"]
        assert "AF_CAN" not in page.values("Service", "RestrictAddressFamilies")
        assert {"-/var/lib/gaitd", "-/run/gaitd", "-/etc/gaitd"} <= set(
            page.values("Service", "InaccessiblePaths")
        )
        own = page.get("Service", "User")
        assert page.values("Service", "SupplementaryGroups") == [
            own
        ]  # its file; the group is shared
        assert not [key for key in BINDING if page.values("Unit", key)]


def test_no_drop_in_gives_the_core_a_network_or_another_watchdog():
    for bus, folder in BUSES.items():
        drop_in = unit(f"{folder}/bus-{bus}.conf")
        assert not drop_in.values("Service", "RestrictAddressFamilies")
        assert not drop_in.values("Service", "IPAddressAllow")
        assert not drop_in.values("Service", "WatchdogSec")
    assert unit("gaitd-core.service").values("Service", "IPAddressDeny") == ["any"]


def test_neither_half_needs_the_other_and_a_stop_reaches_the_core_first():
    core, gateway = unit("gaitd-core.service"), unit("gaitd-gateway.service")
    target = unit("gaitd.target")

    for half in (core, gateway):
        for key in BINDING:
            assert set(half.values("Unit", key)) <= {"gaitd.target"}
        assert half.values("Unit", "PartOf") == ["gaitd.target"]
    assert not [key for key in BINDING if target.values("Unit", key)]
    assert "gaitd-gateway.service" in core.values("Unit", "After")
    assert set(target.values("Unit", "Wants")) == {"gaitd-core.service", "gaitd-gateway.service"}


def test_the_core_waits_for_its_interface_and_does_not_end_with_it():
    bus = unit("drop-ins/bus-can0.conf")

    device = ["sys-subsystem-net-devices-can0.device"]
    assert bus.values("Unit", "After") == device
    assert bus.values("Unit", "Wants") == [*device, "systemd-networkd.service"]
    assert not [key for key in BINDING if bus.values("Unit", key)]
    assert unit("drop-ins/can0-wait.conf").values("Unit", "JobTimeoutSec") == ["5s"]


def test_the_interface_has_the_bit_rate_of_the_trainer_and_room_for_a_stop():
    network, link = unit("network/80-gaitd-can0.network"), unit("network/80-gaitd-can0.link")

    assert network.values("Match", "Name") == link.values("Match", "OriginalName") == ["can0"]
    assert network.values("CAN", "BitRate") == ["1M"]
    assert load_trainer(TRAINER).trainer.bus.bitrate_bit_per_s == 1_000_000
    assert network.values("CAN", "RestartSec") == ["100ms"]
    assert int(link.get("Link", "TransmitQueueLength")) > FRAMES_OF_A_CYCLE


def test_the_folders_of_the_units_are_those_of_the_trainer_file():
    paths = load_trainer(TRAINER)
    made = {line.split()[1]: line.split()[2:] for line in lines_of("gaitd.tmpfiles")}

    for name in ("gaitd-core.service", "gaitd-gateway.service"):
        writable = set(unit(name).values("Service", "ReadWritePaths"))
        assert {str(paths.runtime), str(paths.state)} <= writable <= set(made)
    assert made[str(paths.state)][0] == "3770"  # sticky: neither takes what the other has made
    assert made[str(paths.state / FOLDER)][1] == "gaitd-gateway"


def test_every_user_of_a_unit_is_made():
    files = SYSTEMD.rglob("*.sysusers")
    made = {line.split()[1] for path in files for line in lines_of(path)}

    for path in SYSTEMD.rglob("*.service"):
        service = unit(path)
        assert {service.get("Service", "User"), service.get("Service", "Group")} <= made


def test_the_core_is_started_again_but_for_what_a_person_must_mend():
    core = unit("gaitd-core.service")

    assert core.values("Service", "Type") == ["notify"]
    assert core.values("Service", "Restart") == ["on-failure"]
    assert core.values("Service", "RestartPreventExitStatus") == ["2", "3"]
    assert core.values("Service", "WatchdogSec")


def test_what_is_not_closed_has_its_reason_beside_it():
    text = (SYSTEMD / "gaitd-core.service").read_text()

    assert "MemoryDenyWriteExecute=" not in text
    assert "MemoryDenyWriteExecute, because numba" in text
