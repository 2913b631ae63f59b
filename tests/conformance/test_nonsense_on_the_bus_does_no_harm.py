"""CAN fuzz of the running service, in lock-step: a station that talks nonsense from a seed.

Whatever it says: no exception, no motion out of ready, no torque command beyond the limits, and a
stop stays until a reset. Afterwards the ordinary requests bring the service back, unless a
forged answer in bring-up has ended it with a refusal that names drive and object (exit 3).
In each mode other drives and another rate are played by default. `pytest --fuzz-minutes=N`
runs it for N simulated minutes with seeds of its own, which are in the names of the tests.
"""

import random
import struct
from itertools import product

import pytest
from gaitd_names import Mode, RequestKind
from random_frames import Babbler, network, process_data
from sessions import CONFIGS, elmo_drives, generic_drives, new_session

from daemon.config.drive_plan import drive_limits
from drives.canopen.bus import Frame
from drives.cia402.units import axis_scaling, expected_base, permille_to_effort
from drives.errors import BringUpRefused

ENABLE_BIT = 0x08
RATES_HZ = (20, 200, 2000)
MAKES = (lambda _: CONFIGS, generic_drives, elmo_drives)
"""Drives like an EPOS4, plain CiA 402 drives, drives like an Elmo."""
TALK_S = 1.5
PAUSE_S = 2.0
RESET_S = 3.0
STAYS_S = 0.5
"""What is back in ready stays there."""


class Fuzz:
    """A session with a babbler on its bus, and what must hold whatever it says."""

    def __init__(self, seed, session):
        self.seed = seed
        self.session = session
        self.bus = session.bus
        self.babbler = Babbler(session.machine.world, self.bus, seed)
        settings = session.settings
        limits = drive_limits(settings.limits)
        self.bounds = {
            0x300 + drive.node_id: (axis_scaling(drive, expected_base(drive)), limit.effort_max_si)
            for drive, limit in zip(settings.drives, limits, strict=True)
        }
        self.seen = 0
        self.stopped_at = None
        self.refusal = None

    def run(self, duration_s):
        end_ns = self.bus.now_ns + int(duration_s * 1e9)
        while self.bus.now_ns < end_ns and self.refusal is None:
            try:
                self.session.loop.turn()
            except BringUpRefused as refusal:
                assert refusal.drive in ("right/hip", "right/slide")
                assert refusal.reason
                self.refusal = refusal
            self.judge()

    def judge(self):
        """Commands since the last look, and the latch."""
        for frame in self.bus.sent[self.seen :]:
            if frame.can_id in self.bounds:
                scaling, most_si = self.bounds[frame.can_id]
                effort_si = permille_to_effort(*struct.unpack("<h", frame.data), scaling)
                assert abs(effort_si) <= most_si * 1.001, self.story()
        self.seen = len(self.bus.sent)
        mode = self.session.record.mode
        if self.stopped_at is not None:
            assert not mode.active, self.story()  # no mode was requested since
        elif not mode.active and mode != Mode.READY:
            self.stopped_at = self.session.record.cycle

    def story(self):
        said = "\n".join(
            f"({said.time_ns / 1e9:.6f}) {said.frame.can_id:03X}#{said.frame.data.hex()}"
            f"{' error' if said.frame.is_error else ''}"
            for said in self.babbler.said[-20:]
        )
        record = self.session.record
        return f"seed {self.seed}, {record.mode.name}, {record.verdict}, last said:\n{said}"

    def enables(self):
        """Whether an RPDO1 has ever raised bit 3."""
        words = (f.data[0] for f in self.bus.sent if f.can_id in (0x205, 0x206))
        return any(word & ENABLE_BIT for word in words)

    def is_brought_back(self):
        """To ready, by what an operator would ask for, as often as the drives need it."""
        self.babbler.stop()
        self.run(PAUSE_S)
        for _ in range(5):
            if self.is_back():
                break
            self.session.request(RequestKind.RESET)
            end_ns = self.bus.now_ns + int(RESET_S * 1e9)
            while self.bus.now_ns < end_ns and not self.is_back():
                self.run(0.1)
        self.run(STAYS_S)
        return self.is_back()

    def is_back(self):
        return self.refusal is not None or self.session.record.mode == Mode.READY


def pytest_generate_tests(metafunc):
    if "seed" not in metafunc.fixturenames:
        return
    minutes = metafunc.config.option.fuzz_minutes
    if minutes is None:
        mode = (
            test_in_ready_nothing_is_energised_and_nothing_moves,
            test_while_holding_a_stop_is_latched_and_no_torque_exceeds_its_limit,
            test_while_walking_a_stop_is_latched_and_both_axes_come_to_rest,
        ).index(metafunc.function)
        thorough = [pytest.mark.thorough]
        seeds = [
            pytest.param(rate + 3 * make, marks=[] if make == mode == (rate + 1) % 3 else thorough)
            for rate, make in product(range(len(RATES_HZ)), range(len(MAKES)))
        ]
    else:
        first = random.SystemRandom().randrange(1_000_000)
        seeds = range(first, first + int(minutes * 60 / (TALK_S + PAUSE_S)))
    metafunc.parametrize("seed", seeds)


@pytest.fixture
def fuzz(seed, tmp_path):
    """Its seed says what the drives are, and how fast the babbler talks."""
    configs = MAKES[seed // len(RATES_HZ) % len(MAKES)](tmp_path)
    return Fuzz(seed, new_session(configs))


@pytest.fixture(scope="module")
def warm_walk():
    return new_session().walk(duration_s=1.0)


def test_in_ready_nothing_is_energised_and_nothing_moves(fuzz):
    fuzz.session.until_ready()
    before = fuzz.session.truth.rows[-1]

    fuzz.babbler.start(RATES_HZ[fuzz.seed % len(RATES_HZ)])
    fuzz.run(TALK_S)

    after = fuzz.session.truth.rows[-1]
    assert not fuzz.enables(), fuzz.story()
    assert abs(after.hip_angle_rad - before.hip_angle_rad) < 0.01, fuzz.story()
    assert abs(after.slide_position_m - before.slide_position_m) < 0.01, fuzz.story()
    assert fuzz.is_brought_back(), fuzz.story()
    assert not fuzz.enables(), fuzz.story()


def test_while_holding_a_stop_is_latched_and_no_torque_exceeds_its_limit(fuzz):
    fuzz.session.enable()

    fuzz.babbler.start(RATES_HZ[fuzz.seed % len(RATES_HZ)])
    fuzz.run(TALK_S)

    assert fuzz.is_brought_back(), fuzz.story()


def test_while_walking_a_stop_is_latched_and_both_axes_come_to_rest(fuzz):
    fuzz.session.walk(duration_s=1.0)

    fuzz.babbler.start(RATES_HZ[fuzz.seed % len(RATES_HZ)])
    fuzz.run(TALK_S)
    fuzz.babbler.stop()
    fuzz.run(PAUSE_S)

    row = fuzz.session.truth.rows[-1]
    if fuzz.stopped_at is not None:
        assert abs(row.hip_velocity_rad_per_s) < 0.1, fuzz.story()
        assert abs(row.slide_velocity_m_per_s) < 0.1, fuzz.story()
        assert fuzz.is_brought_back(), fuzz.story()


@pytest.mark.parametrize("kind", [network, process_data], ids=lambda kind: kind.__name__)
def test_nonsense_while_the_drives_are_brought_up_ends_in_ready_or_a_named_cause(kind):
    fuzz = Fuzz(7, new_session())

    fuzz.babbler.start(100, kind)
    fuzz.run(2.5)

    assert fuzz.is_brought_back(), fuzz.story()
    assert not fuzz.enables()


def test_a_drive_that_answers_our_answer_with_an_emcy_is_not_answered_again(warm_walk):
    # After its reset the hip has its own mapping again: each RPDO1 of ours is 8220h to it.
    world, bus = warm_walk.machine.world, warm_walk.bus
    for data in (b"\x82\x05", b"\x01\x05"):
        world.receive(Frame(0x000, data))
    begun = len(bus.sent)

    warm_walk.run(0.5)

    commands = [frame for frame in bus.sent[begun:] if frame.can_id == 0x205]
    assert len(commands) <= 50 + 3
    assert warm_walk.record.mode in (Mode.STOPPING, Mode.FAULT)


def test_frames_of_other_node_ids_change_nothing(warm_walk):
    fuzz = Fuzz(9, warm_walk)
    ids = [can_id for can_id in range(0x100, 0x780) if can_id & 0x7F not in (0, 1, 5, 6)]

    def stranger(rng):
        return Frame(rng.choice(ids), bytes(rng.randrange(256) for _ in range(rng.randrange(9))))

    fuzz.babbler.start(1000, stranger)
    fuzz.run(1.5)

    assert fuzz.stopped_at is None, fuzz.story()
    assert fuzz.session.record.mode == Mode.GAIT
