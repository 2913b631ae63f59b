"""The bus load that we compute is the one that can-utils measures on a SocketCAN interface."""

import pytest

from drives.bringup.bus_load import frame_bits_exact


@pytest.mark.rig_vcan
@pytest.mark.timeout(3000)
def test_the_bits_of_a_walking_session_are_those_that_canbusload_counts(vcan_world):
    rows = [line.split() for line in vcan_world.text("load").splitlines() if "vcan0@" in line]
    played = vcan_world.wire.lines

    assert sum(int(row[1]) for row in rows) == len(played)
    assert sum(int(row[2]) for row in rows) == sum(
        frame_bits_exact(line.frame.can_id, line.frame.data) for line in played
    )
