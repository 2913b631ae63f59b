"""Conformance, CiA 402: from power-on to motion as a master would do it that we did not write.

python-canopen 2.4.1 drives the virtual drives over its own `BaseNode402`. Each look at a TPDO sends
its own SYNC, so what is read is never older than what was commanded, on however busy a computer.
What is wrong in canopen, and what these tests do instead:

1. Its controlword setter sends nothing if the RPDO is synchronous (types 0 to 240): RPDO1, which
   holds controlword and mode, is of type 255 here, and the targets' RPDO2 of type 1.
2. Its target state QUICK STOP ACTIVE enables a drive that is not: it is asked for in operation
   enabled only.
3. `reset_from_fault` ends in operation enabled: the edge of bit 7 is written here by hand.
4. Before the first TPDO it takes the state for not ready: the first TPDO is waited for.
5. It writes the new COB-ID to switch a PDO off: identifiers stay those of the predefined set.
"""

import time

import pytest
from outside_master import TIMEOUT_S, boot_up, eventually

SYNC_S = 0.01
"""At least, from one to the next."""
FOLLOWS = 0x1000
REFERENCED = 0x8000


def mapped(node):
    """The PDOs of an outside master: commands at once, targets and answers by SYNC; operational."""
    node.pdo.read()
    for pdo in [*node.tpdo.values(), *node.rpdo.values()]:
        pdo.enabled = False
        pdo.save()
    shapes = (
        (node.tpdo[1], 1, (0x6041, 0x6061, 0x6064)),
        (node.tpdo[2], 1, (0x6077, 0x606C)),
        (node.rpdo[1], 255, (0x6040, 0x6060)),
        (node.rpdo[2], 1, (0x607A, 0x6071)),
    )
    for pdo, kind, objects in shapes:
        pdo.clear()
        for index in objects:
            pdo.add_variable(index)
        pdo.trans_type = kind
        pdo.enabled = True
        pdo.save()
    for pdo in node.tpdo.values():
        pdo.wait_for_reception = asking(node.network.sync, pdo)
    node.nmt.state = "OPERATIONAL"
    node.setup_402_state_machine(read_pdos=False)
    node.check_statusword()
    return node


def asking(sync, pdo):
    """In place of canopen's wait for whatever comes next: what a SYNC of now brings."""

    def wait_for_reception(timeout):
        time.sleep(SYNC_S)
        with pdo.receive_condition:
            pdo.is_received = False
            sync.transmit()
            pdo.receive_condition.wait(timeout)
        return pdo.timestamp if pdo.is_received else None

    return wait_for_reception


@pytest.fixture
def encoder():
    return "incremental"  # one that there is something to home for


def pytest_generate_tests(metafunc):
    if "drive" in metafunc.fixturenames:
        metafunc.parametrize("make", ["epos4", "generic", "elmo_gold"], indirect=True)


@pytest.fixture
def drive(request, make):
    return mapped(request.getfixturevalue("hip" if make == "epos4" else "slide"))


def target(node, *, position=None, torque=0):
    """One RPDO2, all of its bytes at once."""
    if position is not None:
        node.rpdo[2][0x607A].raw = position
    node.rpdo[2][0x6071].raw = torque
    node.rpdo[2].transmit()


def position_of(node):
    node.check_statusword()
    return node.tpdo[1][0x6064].raw


def test_every_state_is_reached_and_left_as_canopen_expects(drive):
    assert drive.state == "SWITCH ON DISABLED"

    for state in (
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "READY TO SWITCH ON",
        "SWITCH ON DISABLED",
        "OPERATION ENABLED",
        "SWITCH ON DISABLED",
    ):
        drive.state = state

        assert drive.state == state


def test_a_quick_stop_ends_where_605a_says(drive):
    stays = drive.sdo[0x605A].raw in (5, 6, 7, 8)
    drive.state = "OPERATION ENABLED"

    drive.controlword = 0x0002

    ended = "QUICK STOP ACTIVE" if stays else "SWITCH ON DISABLED"
    assert eventually(lambda: drive.check_statusword() and drive.state == ended)


def test_homing_on_the_present_position_is_done_by_canopen_s_own_helper(drive, make):
    epos4 = make == "epos4"
    drive.sdo[0x6098].raw = 37 if epos4 else 35
    drive.sdo[0x30B0 if epos4 else 0x607C].raw = 4321
    assert not drive.check_statusword() & REFERENCED

    assert drive.homing(timeout=TIMEOUT_S)

    assert abs(position_of(drive) - 4321) < 10
    assert drive.is_homed()
    assert drive.op_mode == "HOMING"


def test_a_mode_that_6502h_does_not_name_is_not_entered(drive, make):
    with pytest.raises(TypeError, match="not suppported"):  # canopen's spelling
        drive.op_mode = "INTERPOLATED POSITION"

    drive.rpdo[1][0x6060].raw = 7
    drive.rpdo[1].transmit()
    drive.check_statusword()
    drive.check_statusword()

    assert drive.op_mode == ("PROFILED POSITION" if make == "epos4" else "NO MODE")


def test_cyclic_position_follows_a_ramp_by_rpdo_at_canopen_s_sync(drive):
    drive.sdo[0x6065].raw = 2000
    start = position_of(drive)
    drive.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    target(drive, position=start)
    drive.state = "OPERATION ENABLED"
    assert eventually(lambda: drive.check_statusword() & FOLLOWS)

    for step in range(1, 21):
        target(drive, position=start + 5 * step)
        drive.check_statusword()

    assert eventually(lambda: abs(position_of(drive) - start - 100) <= 2)
    assert drive.state == "OPERATION ENABLED"


def test_cyclic_torque_moves_the_joint_the_way_of_its_sign(drive):
    start = position_of(drive)
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    target(drive, position=start, torque=0)
    drive.state = "OPERATION ENABLED"
    assert eventually(lambda: drive.check_statusword() & FOLLOWS)

    target(drive, torque=40)

    assert eventually(lambda: position_of(drive) > start + 20)
    assert abs(drive.tpdo[2][0x6077].raw - 40) <= 1
    target(drive, torque=0)
    assert eventually(lambda: position_of(drive) and drive.tpdo[2][0x6077].raw == 0)


def test_without_sync_a_synchronous_target_is_not_applied(drive, network):
    drive.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    target(drive, torque=0)
    drive.state = "OPERATION ENABLED"

    target(drive, torque=40)

    assert drive.sdo[0x6071].raw == 0
    network.sync.transmit()
    assert eventually(lambda: drive.sdo[0x6071].raw == 40)
    target(drive, torque=0)
    network.sync.transmit()


def test_a_fault_is_reset_by_one_edge_and_nothing_is_energised(drive, station):
    name = "right/hip" if drive.id == 5 else "right/slide"
    drive.state = "OPERATION ENABLED"
    station.command(f"emcy {name} - 0x3210")
    assert eventually(lambda: drive.check_statusword() and drive.state == "FAULT")
    assert drive.emcy.active[-1].code == 0x3210
    station.command(f"clear emcy {name}")

    for word in (0x0000, 0x0080, 0x0000):
        drive.controlword = word
        drive.check_statusword()

    assert eventually(lambda: drive.check_statusword() and drive.state == "SWITCH ON DISABLED")
    assert drive.emcy.active == []
    for _ in range(5):
        assert drive.check_statusword() & 0x6F == 0x40


def test_a_held_reset_bit_resets_only_once(drive, station):
    name = "right/hip" if drive.id == 5 else "right/slide"
    for fault in (1, 2):
        station.command(f"emcy {name} - 0x3210")
        assert eventually(lambda: drive.check_statusword() and drive.state == "FAULT")
        station.command(f"clear emcy {name}")
        drive.controlword = 0x0080
        if fault == 1:
            assert eventually(
                lambda: drive.check_statusword() and drive.state == "SWITCH ON DISABLED"
            )

    for _ in range(5):
        drive.check_statusword()
        assert drive.state == "FAULT"


def test_both_drives_move_at_the_same_sync(hip, slide):
    nodes = (hip, slide)
    starts = [position_of(mapped(node)) for node in nodes]
    for node, start in zip(nodes, starts, strict=True):
        node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
        target(node, position=start)
        node.state = "OPERATION ENABLED"
        assert eventually(lambda node=node: node.check_statusword() & FOLLOWS)

    for node, start in zip(nodes, starts, strict=True):
        target(node, position=start + 40)

    for node, start in zip(nodes, starts, strict=True):
        assert eventually(lambda node=node, start=start: abs(position_of(node) - start - 40) <= 2)


def test_from_power_on_to_motion_and_back_as_an_outside_master_would_do_it(slide, station):
    # power on: the boot-up message is the first that is heard of a node
    with boot_up(slide):
        station.command("reboot right/slide")
    # who are you?
    assert slide.sdo[0x1000].raw & 0xFFFF == 402
    assert slide.sdo[0x1018][1].raw == slide.object_dictionary[0x1018][1].default
    assert slide.sdo[0x6502].raw & 0x80  # cyclic synchronous position
    # watch each other, and stop by yourself if I fall silent
    beat = slide.network.send_periodic(0x701, b"\x05", 0.02)
    slide.sdo[0x1016][1].raw = 1 << 16 | 60_000
    slide.sdo[0x1017].raw = 50
    slide.sdo[0x6007].raw = 3
    # limits and ramps
    slide.sdo[0x6065].raw = 100_000
    slide.sdo[0x6085].raw = 50_000
    slide.sdo[0x605A].raw = 2
    # PDOs, operational
    mapped(slide)
    assert slide.nmt.wait_for_heartbeat(TIMEOUT_S) in ("OPERATIONAL", "PRE-OPERATIONAL")
    start = position_of(slide)
    slide.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    target(slide, position=start)
    slide.state = "OPERATION ENABLED"
    # motion
    for step in range(1, 31):
        target(slide, position=start + 10 * step)
        slide.check_statusword()
    assert eventually(lambda: abs(position_of(slide) - start - 300) <= 2)
    # stop, off, stopped
    slide.controlword = 0x0002
    assert eventually(lambda: slide.check_statusword() and slide.state == "SWITCH ON DISABLED")
    slide.controlword = 0x0000
    beat.stop()
    slide.nmt.state = "STOPPED"
    assert eventually(lambda: slide.nmt.wait_for_heartbeat(TIMEOUT_S) == "STOPPED")
    assert slide.emcy.active == []


def test_a_master_that_falls_silent_in_motion_is_noticed_and_the_drive_stops_by_itself(slide):
    mapped(slide)
    slide.sdo[0x6007].raw = 3
    slide.sdo[0x605A].raw = 2
    slide.op_mode = "CYCLIC SYNCHRONOUS TORQUE"
    target(slide, torque=0)
    slide.state = "OPERATION ENABLED"

    slide.sdo[0x1016][1].raw = 1 << 16 | 100
    slide.network.send_message(0x701, b"\x05")  # the first heartbeat, and the last

    assert eventually(lambda: [error.code for error in slide.emcy.active] == [0x8130])
    assert eventually(lambda: slide.sdo[0x6041].raw & 0x6F == 0x40)
