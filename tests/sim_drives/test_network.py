"""NMT, heartbeats and what silence does: S01 to S03 and S07 of canopen.md 6.2."""

import pytest
from drive_bench import Bench

SAVE = int.from_bytes(b"save", "little")


def watch_master(bench, timeout_ms=100, node_id=5):
    assert bench.write(0x1016, 1, 1 << 16 | timeout_ms, 4, node_id) == 0


def beat(bench, count=1, period_ms=20.0):
    for _ in range(count):
        bench.send(0x701, b"\x05")
        bench.run_ms(period_ms)


def test_power_on_gives_one_boot_up_message_and_then_the_state_of_pre_operational():
    bench = Bench()

    bench.run_ms(100)
    assert bench.frames(0x705) == [b"\x00"]

    assert bench.write(0x1017, 0, 50, 2) == 0
    bench.run_ms(200)
    assert bench.frames(0x705) == [b"\x00"] + [b"\x7f"] * 4
    assert bench.times_ms(0x705)[1:] == [150, 200, 250, 300]


def test_a_saved_heartbeat_begins_with_the_one_boot_up_message(bench):
    bench.write(0x1017, 0, 30, 2)
    bench.write(0x1010, 1, SAVE, 4)
    for command in (0x81, 0x82):
        bench.forget()
        bench.nmt(command)
        bench.run_ms(250)

        assert bench.frames(0x705)[0] == b"\x00"
        assert set(bench.frames(0x705)[1:]) == {b"\x7f"}


def test_a_drive_reaches_switch_on_disabled_within_half_a_second(bench):
    assert bench.statusword() & 0x0F7F == 0x0240


def test_stopping_an_enabled_node_makes_a_quick_stop_and_starting_it_again_does_not_enable(bench):
    bench.go_operational()
    bench.enable(torque=300)
    bench.cycles(30, 0x0F, 10, 0, 300)
    assert bench.plant.velocity[0] > 0.5

    bench.nmt(0x02)
    bench.run_ms(1000)
    bench.nmt(0x01)
    bench.cycles(3)

    assert bench.plant.velocity[0] == 0
    assert bench.state() == 0x07


def test_an_nmt_command_for_another_node_or_of_another_length_is_ignored(bench):
    for data in (b"\x01\x07", b"\x01", b"\x01\x05\x00", b"\x33\x05"):
        bench.ask(0x000, data)
    bench.write(0x1017, 0, 10, 2)
    bench.run_ms(10)

    assert bench.frames(0x705)[-1] == b"\x7f"


def test_node_zero_means_every_node(bench):
    for node_id in (5, 6):
        bench.write(0x1017, 0, 10, 2, node_id)
    bench.nmt(0x01, 0)
    bench.run_ms(10)

    assert bench.frames(0x705)[-1] == bench.frames(0x706)[-1] == b"\x05"


def test_a_mode_and_targets_are_never_saved(bench):
    bench.write(0x6060, 0, 10, 1)
    bench.write(0x6071, 0, 100, 2)
    bench.write(0x60B0, 0, 100, 4)
    bench.run_ms(10)
    bench.write(0x1010, 1, SAVE, 4)

    bench.nmt(0x81)
    bench.run_ms(400)

    delivered = {0x6060: 1, 0x6061: 1, 0x6071: 0, 0x60B0: 0}  # an EPOS4 begins in profile position
    assert {index: bench.read(index) for index in delivered} == delivered


def test_two_watches_of_the_same_node_are_refused(bench):
    watch_master(bench)

    assert bench.write(0x1016, 2, 1 << 16 | 50, 4) == 0x06040043
    assert bench.write(0x1016, 2, 2 << 16 | 50, 4) == 0
    assert bench.write(0x1016, 1, 1 << 16 | 50, 4) == 0


def test_a_master_that_was_never_heard_is_not_missed(bench):
    watch_master(bench)

    bench.run_ms(1000)

    assert bench.frames(0x085) == []


def test_the_boot_up_message_of_a_master_is_no_heartbeat(bench):
    watch_master(bench)
    bench.send(0x701, b"\x00")
    bench.run_ms(1000)
    assert bench.frames(0x085) == []

    beat(bench)
    bench.run_ms(60)
    bench.send(0x701, b"\x00")
    bench.run_ms(60)
    assert len(bench.frames(0x085)) == 1


def test_one_watch_that_is_changed_leaves_the_other_as_it_is(bench):
    watch_master(bench)
    beat(bench)
    assert bench.write(0x1016, 2, 2 << 16 | 500, 4) == 0
    bench.run_ms(150)

    assert bench.frames(0x085) == [bytes.fromhex("3081100000000000")]


def test_a_plain_drive_forgets_a_loss_when_its_watch_is_written_anew(generic):
    generic.write(0x6007, 0, 3, 2)
    watch_master(generic)
    beat(generic)
    generic.run_ms(150)
    assert generic.read(0x1001) == 0x11

    watch_master(generic, timeout_ms=0)
    assert generic.read(0x1001) == 0
    generic.run_ms(1000)
    assert generic.frames(0x085) == [bytes.fromhex("3081110000000000"), bytes(8)]


def test_a_master_that_falls_silent_is_missed_after_its_time_and_once(bench):
    watch_master(bench)
    beat(bench, 10)
    last_ms = bench.now_ms - 20

    bench.run_ms(1000)

    assert bench.frames(0x085) == [bytes.fromhex("3081100000000000")]
    assert 100 <= bench.times_ms(0x085)[0] - last_ms <= 110


@pytest.mark.parametrize(("behaviour", "state"), [(0, 0x7F), (1, 0x05), (2, 0x04)])
def test_object_1029_says_what_becomes_of_the_nmt_state(bench, behaviour, state):
    bench.go_operational()
    bench.write(0x1029, 1, behaviour, 1)
    bench.write(0x1017, 0, 20, 2)
    watch_master(bench)

    beat(bench, 3)
    bench.run_ms(200)

    assert bench.frames(0x705)[-1] == bytes((state,))


def test_an_epos4_is_reset_after_a_lost_master_only_after_reset_communication(bench):
    watch_master(bench)
    beat(bench)
    bench.run_ms(200)
    beat(bench, 3)

    bench.write(0x6040, 0, 0x00, 2)
    bench.write(0x6040, 0, 0x80, 2)
    assert bench.state() == 0x08

    bench.nmt(0x82)
    bench.run_ms(100)
    bench.write(0x6040, 0, 0x00, 2)
    bench.write(0x6040, 0, 0x80, 2)
    assert bench.state() == 0x40
    assert bench.frames(0x085)[-1] == bytes(8)


def test_a_plain_drive_obeys_6007h_and_is_well_again_when_its_master_is_back(generic):
    generic.go_operational(torque=0x6077_0010)
    generic.write(0x6007, 0, 3, 2)
    generic.write(0x605A, 0, 6, 2)
    watch_master(generic)
    generic.send(0x701, b"\x05")
    generic.enable(torque=300)
    generic.run_ms(200)

    assert generic.state() == 0x07
    assert generic.read(0x1001) == 0x11

    beat(generic)
    assert generic.frames(0x085) == [bytes.fromhex("3081110000000000"), bytes(8)]
    assert generic.state() == 0x07
