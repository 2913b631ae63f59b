"""Each rig is what its marker says, seen from inside: what is built on them may rely on it."""

import sys

import pytest

EXCHANGE = """
import can
with can.Bus(interface="socketcan", channel="vcan0") as drive, can.Bus(
    interface="socketcan", channel="vcan0"
) as master:
    master.send(can.Message(arbitration_id=0x080, is_extended_id=False))
    print(drive.recv(timeout=5))
"""


@pytest.mark.rig_vcan
@pytest.mark.timeout(600)
def test_a_frame_crosses_a_real_socketcan_interface(vcan_rig, tmp_path):
    (tmp_path / "exchange.py").write_text(EXCHANGE)

    finished = vcan_rig.run(
        "modprobe vcan; modprobe can-raw\n"
        "ip link add dev vcan0 type vcan; ip link set vcan0 up\n"
        f"{sys.executable} exchange.py",
        tmp_path,
    )

    assert finished.exit_code == 0, finished.output
    assert "ID:      080" in finished.output


@pytest.mark.rig_systemd
@pytest.mark.timeout(300)
def test_systemd_is_the_first_process_and_runs_our_python(systemd_rig, tmp_path):
    finished = systemd_rig.run(
        f"cat /proc/1/comm; systemctl --version; {sys.executable} -c 'import daemon.record'",
        tmp_path,
    )

    assert finished.exit_code == 0, finished.output
    assert finished.output.startswith("systemd\nsystemd 25")
