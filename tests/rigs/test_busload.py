"""The bus load that we compute is the one that can-utils measures on a SocketCAN interface."""

import pytest
from candump import candump_line
from sessions import Session
from wiretap import Wiretap

from drives.busload import frame_bits_exact

INTERFACE_UP = (
    "modprobe vcan; modprobe can-raw\nip link add dev vcan0 type vcan; ip link set vcan0 up\n"
)
MEASURE = """
canbusload -e vcan0@1000000 > load < /dev/null & measuring=$!
sleep 1.5
canplayer vcan0=can0 -I session.candump
sleep 2.5
kill $measuring
cat load
"""


@pytest.mark.rig_vcan
@pytest.mark.timeout(600)
def test_the_bits_of_a_walking_session_are_those_that_canbusload_counts(vcan_rig, tmp_path):
    session = Session().walking(warm_s=0.0)
    wire = Wiretap(session.machine.world)
    session.lockstep.run(1.0)
    begun_ns = wire.lines[0].time_ns
    dump = "".join(candump_line(line.time_ns - begun_ns, line.frame) + "\n" for line in wire.lines)
    (tmp_path / "session.candump").write_text(dump)

    finished = vcan_rig.run(INTERFACE_UP + MEASURE, tmp_path)

    assert finished.exit_code == 0, finished.output
    rows = [line.split() for line in finished.output.splitlines() if "vcan0@" in line]
    assert sum(int(row[1]) for row in rows) == len(wire.lines)
    assert sum(int(row[2]) for row in rows) == sum(
        frame_bits_exact(line.frame.can_id, line.frame.data) for line in wire.lines
    )
