"""Each rig is what its marker says, seen from inside: what is built on them may rely on it."""

import sys

import pytest


@pytest.mark.rig_vcan
@pytest.mark.timeout(3000)
def test_a_frame_crosses_a_real_socketcan_interface(vcan_world):
    assert "ID:      080" in vcan_world.text("exchange.log")


@pytest.mark.rig_systemd
@pytest.mark.timeout(300)
def test_systemd_is_the_first_process_and_runs_our_python(systemd_rig, tmp_path):
    finished = systemd_rig.run(
        f"cat /proc/1/comm; systemctl --version; {sys.executable} -c 'import daemon.ipc.record'",
        tmp_path,
    )

    assert finished.exit_code == 0, finished.output
    assert finished.output.startswith("systemd\nsystemd 25")
