"""Commands of the documents, run as they are printed: requests, drives and recordings of a session.

What is not run here is accepted by the programs (`tests/test_documents.py`), and has its reason in
ELSEWHERE. A new command that is in neither table fails.
"""

import collections
import contextlib
import re
import shutil
from typing import Final, NamedTuple

import numpy as np
import pytest
from command_line import gaitd
from documents import PAGES, PROJECT, commands
from gaitd_names import Mode

from gaitd_lab.testing.trainer import STANDSTILL, speeds_by_leg


class Run(NamedTuple):
    """How a command is run in the shared session."""

    begins_in: Mode | None
    """Mode of the service before it."""
    codes: tuple[int, ...] = (0,)
    """Exit codes that are right."""
    takes_time: bool = True
    """False: asks neither service nor drives, so simulated time can stand."""


RUN: Final = {
    r"gaitd scan --config .*": Run(None),
    r"gaitd drive \S+ compare .*": Run(Mode.READY),
    r"gaitd status( --config .*)?": Run(None),
    r"gaitd enable( --config trainer.toml)?": Run(Mode.READY),
    r"gaitd mode (hand_guiding|gait .*|excite .*)": Run(Mode.HOLD),
    r"gaitd disable( --config trainer.toml)?": Run(Mode.HOLD),
    r"gaitd stop": Run(Mode.HOLD),
    r"gaitd reset": Run(Mode.FAULT),
    r"gaitd blackbox( requests)? --config .*": Run(None, takes_time=False),
    r"gaitd (schema|explain) .*": Run(None, takes_time=False),
    r"gaitd watch .* (--count 1|--once) .*": Run(None),
    r"gaitd wait hold .*": Run(Mode.HOLD),
}
"""Commands that are run, by what they look like."""

ELSEWHERE: Final = {
    r"make .*|pip .*|(\S+/)?python.*|pytest .*|\. .venv.*": "changes the environment, or is a test",
    r"(sudo|ip|systemctl|systemd-sysusers|journalctl|install|candump|cd) .*": (
        "root, hardware or systemd: tests/rigs"
    ),
    r"sha256sum .*|gaitd/bin/gaitd demo": "tests/rigs/test_release_in_a_container.py",
    r"apt-get .*": "tests/rigs/test_package_under_systemd.py",
    r"dask .*|gaitd fleet .*": "tests/gaitd/test_fleet.py, test_fleet_friction.py",
    r"gaitd import-candump .*": "tests/gaitd/test_import_candump.py",
    r"gaitd replay walk.csv .*": "tests/gaitd/test_replay_command.py",
    r"gaitd (run|sim) .*": "a service: the sessions of tests/service are these two",
    r"gaitd doctor.*": "tests/gaitd/test_doctor.py",
    r"gaitd self-test .*": "tests/gaitd/test_self_test_command.py",
    r"gaitd check .*": "tests/gaitd/test_main.py, tests/daemon/config/test_all_errors.py",
    r"gaitd scan --interface .*": "hardware: tests/gaitd/test_scan.py",
    r"gaitd drive \S+ (dump|store|restore|compare .*--(eds|with)).*": (
        "tests/gaitd/test_drive_command.py"
    ),
    r"gaitd blackbox show .*": "tests/gaitd/test_blackbox_command.py",
    r"gaitd drive profile .*": "tests/gaitd/test_drive_profile.py",
    r"gaitd drive (verify|evidence) .*": "tests/gaitd/test_drive_verify.py",
    r"gaitd (commission|reference) .*": "tests/service/test_one_axis.py, tests/closed_loop",
    r"gaitd .* --config configs/hil.toml": "tests/closed_loop/test_real_beside_virtual.py",
    r"gaitd .* --config configs/two_legs.toml": "tests/service/test_two_legs.py",
    r"gaitd (keys|plan) .*|gaitd .*--credentials .*": "tests/service/test_keys.py",
    r"gaitd replay .*--publish.*": "tests/daemon/gateway/test_playback.py",
    r"gaitd replay STOP.ring": "tests/service/test_black_box.py",
    r"gaitd replay RECORDING .*": "tests/gaitd/test_replay_command.py",
    r"gaitd baseline .*": "tests/gaitd/test_baseline_command.py",
    r"gaitd record .*": "tests/service/test_record.py",
    r"gaitd replay recordings/.*": "tests/clients/record",
    r"gaitd calibrate .*": "minutes: tests/gaitd/test_calibrate_command.py",
    r"gaitd delay .*": "tests/analysis",
    r"gaitd (experiment|consistency|ablation|strides) .*": "minutes: tests/gaitd_lab/studies",
    r"gaitd matrix .*": "minutes: tests/faults",
    r"gaitd patients": "a night: tests/gaitd_lab/studies/test_working_patients.py",
    r"gaitd real-data .*": "recordings that are not part of the project: tests/analysis",
    r"gaitd rig .*": "tests/gaitd_lab/test_rig.py",
    r"(curl|node) .*": "tests/clients/display/test_examples.py",
    r"gaitd-session .*": "tests/clients/session/test_program.py",
    r"gaitd-assist .*": "tests/clients/assist/test_program.py",
    r"gaitd-display .*": "tests/clients/display",
}
"""Commands that are not run here, and why or where else."""

PLAYED: Final = PROJECT / "docs" / "day_one.md"
"""Its commands are played whole, in their order, by test_day_one.py."""
ALL: Final = list(
    dict.fromkeys(" ".join(one.words) for page in PAGES if page != PLAYED for one in commands(page))
)
NAMES: Final = re.compile("FILE|/etc/gaitd/trainer.toml|configs/demo.toml")
"""Names of the trainer file in the documents; here it is trainer.toml."""


def row(table, text):
    """The first row whose pattern is the whole command."""
    return next((table[pattern] for pattern in table if re.fullmatch(pattern, text)), None)


def test_every_command_is_run_or_has_a_reason():
    assert [text for text in ALL if row(ELSEWHERE, text) is None and row(RUN, text) is None] == []
    for reason in ELSEWHERE.values():
        for path in re.findall(r"tests/\S+\w", reason):
            assert (PROJECT / path).exists()


@pytest.fixture(scope="module")
def files(long_service):
    """The name that the documents use, in the folder of the service's configuration."""
    shutil.copy(long_service.config, long_service.config.with_name("trainer.toml"))


def wait_for_rest(service):
    """After a stop the leg sinks into its springs; `enable` is refused while it moves."""
    speeds = collections.deque(maxlen=50)

    def rests(record):
        speeds.append(np.max(speeds_by_leg(record), axis=0))
        return len(speeds) == speeds.maxlen and np.all(np.max(speeds, axis=0) < STANDSTILL)

    service.until(rests)


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(
    "text",
    dict.fromkeys(NAMES.sub("trainer.toml", text) for text in ALL if not row(ELSEWHERE, text)),
)
def test_a_command_does_what_it_is_for(long_service, text, monkeypatch):
    how = row(RUN, text)
    monkeypatch.setenv("GAITD_CONFIG", "trainer.toml")
    service = long_service.bring(Mode.READY if how.begins_in is Mode.READY else Mode.HOLD)
    if how.begins_in is Mode.FAULT:
        service.stop()
    if how.begins_in is Mode.READY:
        wait_for_rest(service)

    with contextlib.nullcontext() if how.takes_time else service.held():
        ended = gaitd(*text.split()[1:], folder=service.config.parent)

    if service.mode in {Mode.HAND_GUIDING, Mode.EXCITE}:  # these have no end of their own
        service.request("disable")
    assert ended.code in how.codes, ended.out + ended.err
