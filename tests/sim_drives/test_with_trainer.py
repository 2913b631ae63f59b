"""The drives on the whole plant: what the bus says agrees with what the mechanics do."""

import math
import struct

import pytest
from drive_bench import CONFIGS, Bench

from daemon.config.trainer import load_trainer
from gaitd_lab.virtual_machine import virtual_machine

HIP_SI_PER_COUNT = 2 * math.pi / 102_400
SLIDE_SI_PER_COUNT = 0.025 / 512
HIP_NM_PER_A = 0.055736 * 100


class TrainerBench(Bench):
    """The demonstration's machine under the hand of a master."""

    def __init__(self, seed=5):
        machine = virtual_machine(load_trainer(CONFIGS / "demo.toml"), seed=seed)
        self.world = machine.world
        self.plant = machine.trainers["right"]
        self.trace = []
        self.boot()
        for node_id in (5, 6):
            self.write(0x60C2, 1, 10, 1, node_id)
            self.write(0x6065, 0, 0xFFFFFFFF, 4, node_id)
            self.go_operational(node_id)

    def both(self, controlword, mode, positions, torques=(0, 0)):
        """One cycle of both axes."""
        self.send(0x080)
        sent = self.run_ms(2)
        for node_id, position, torque in zip((5, 6), positions, torques, strict=True):
            self.send(0x200 + node_id, struct.pack("<Hbi", controlword, mode, position))
            self.send(0x300 + node_id, struct.pack("<h", torque))
        return sent + self.run_ms(8)

    def here(self):
        return tuple(
            struct.unpack("<i", self.read(0x6064, 0, node_id).to_bytes(4, "little"))[0]
            for node_id in (5, 6)
        )

    def hold(self):
        """Enabled in cyclic position where the leg is."""
        start = self.here()
        for controlword in (0x06, 0x07, 0x0F):
            for _ in range(2):
                self.both(controlword, 8, start)
        return start

    def sweep(self, start, cycles, hip_counts_per_cycle):
        for number in range(1, cycles + 1):
            self.both(0x0F, 8, (start[0] + round(number * hip_counts_per_cycle), start[1]))
        return start[0] + round(cycles * hip_counts_per_cycle), start[1]


@pytest.fixture
def machine():
    return TrainerBench()


def test_the_counts_on_the_bus_are_where_the_joints_are(machine):
    machine.hold()

    machine.send(0x080)
    truth = machine.plant.truth()
    machine.run_ms(5)

    for node_id, axis, step, sign in ((5, 0, HIP_SI_PER_COUNT, 1), (6, 1, SLIDE_SI_PER_COUNT, -1)):
        counts = struct.unpack("<i", machine.frames(0x180 + node_id)[-1][2:6])[0]
        assert sign * counts * step == pytest.approx(truth.position[axis], abs=2 * step)


def test_the_current_on_the_bus_is_the_torque_on_the_joint(machine):
    start = machine.hold()
    for _ in range(30):
        machine.both(0x0F, 10, start, (150, 0))

    machine.send(0x080)
    effort_nm = machine.plant.truth().effort[0]
    machine.run_ms(5)

    current_ma = struct.unpack("<i", machine.frames(0x285)[-1][:4])[0]
    assert effort_nm == pytest.approx(0.15 * 27.868, rel=0.01)
    assert current_ma * 1e-3 * HIP_NM_PER_A == pytest.approx(effort_nm, abs=0.3)


def codes(machine):
    """EMCY of both axes, as error codes."""
    return [
        [int.from_bytes(data[:2], "little") for data in machine.frames(0x080 + node_id)]
        for node_id in (5, 6)
    ]


def test_both_axes_stop_by_themselves_when_the_master_dies(machine):
    for node_id in (5, 6):
        machine.write(0x1016, 1, 1 << 16 | 100, 4, node_id)
    machine.send(0x701, b"\x05")
    start = machine.hold()
    for number in range(1, 31):
        machine.send(0x701, b"\x05")
        machine.both(0x0F, 8, (start[0] + 80 * number, start[1] - 4 * number))
    assert abs(machine.plant.truth().velocity[0]) > 0.3
    machine.forget()

    machine.run_ms(85)  # the last heartbeat is 10 ms old already
    assert codes(machine) == [[0x8250], [0x8250]]  # no new target
    machine.run_ms(20)
    assert codes(machine) == [[0x8250, 0x8130], [0x8250, 0x8130]]
    machine.run_ms(500)

    assert [machine.state(node_id) for node_id in (5, 6)] == [0x08, 0x08]


def session(seed):
    machine = TrainerBench(seed)
    start = machine.hold()
    machine.plant.patient(machine.plant.programmes[-1])
    machine.sweep(start, 40, 50)
    for _ in range(40):
        machine.both(0x0F, 10, start, (80, -40))
    return machine.trace


def test_the_same_seed_gives_the_same_trace_with_noise_and_jitter_in_it_and_another_one_another():
    once = session(3)

    assert session(3) == once != session(4)
