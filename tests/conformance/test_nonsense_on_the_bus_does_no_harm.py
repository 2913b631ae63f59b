"""CAN fuzz of the running service, in lock-step: a station that talks nonsense from a seed.

Whatever it says: no exception, no motion out of ready, no torque command beyond the limits, and a
stop stays until somebody resets. Afterwards the service is brought back by the ordinary requests.
`pytest --fuzz-minutes=N` runs it for N simulated minutes, with other seeds each time.
"""

import struct

import pytest
from babbler import Babbler, heartbeat, network, process_data
from sessions import Session

from daemon.config.axes import drive_limits
from daemon.record import Mode, Outcome, RequestKind
from drives.bus import Frame
from drives.errors import BringUpRefused
from drives.units import axis_scaling, expected_base, permille_to_effort
from sim_drives.frame import Frame as WorldFrame

ENABLING = 0x0F
PAUSE_S = 1.0


class Fuzz:
    """A session with a babbler on its bus, and what must hold whatever it says."""

    def __init__(self, seed):
        self.seed = seed
        self.session = Session()
        lockstep = self.session.lockstep
        self.lockstep, self.bus = lockstep, lockstep.bus
        self.babbler = Babbler(self.session.machine.world, lockstep.bus, seed)
        settings = self.session.settings
        limits = drive_limits(settings.limits)
        self.bounds = {
            0x300 + drive.node_id: (axis_scaling(drive, expected_base(drive)), limit.effort_max_si)
            for drive, limit in zip(settings.drives, limits, strict=True)
        }
        self.seen = 0
        self.stopped_at = None

    def run(self, duration_s):
        end_ns = self.bus.now_ns + int(duration_s * 1e9)
        while self.bus.now_ns < end_ns:
            self.lockstep.loop.turn()
            self.judge()

    def judge(self):
        """Commands since the last look, and the latch."""
        for frame in self.bus.sent[self.seen :]:
            if frame.can_id in self.bounds:
                scaling, most_si = self.bounds[frame.can_id]
                effort_si = permille_to_effort(*struct.unpack("<h", frame.data), scaling)
                assert abs(effort_si) <= most_si * 1.001, self.story()
        self.seen = len(self.bus.sent)
        mode = self.lockstep.record.mode
        if self.stopped_at is not None:
            assert not mode.active, self.story()
        elif not mode.active and mode != Mode.READY:
            self.stopped_at = self.lockstep.record.cycle

    def story(self):
        said = "\n".join(
            f"({said.time_ns / 1e9:.6f}) {said.frame.can_id:03X}#{said.frame.data.hex()}"
            f"{' error' if said.frame.is_error else ''}"
            for said in self.babbler.said[-20:]
        )
        record = self.lockstep.record
        return f"seed {self.seed}, {record.mode.name}, {record.verdict}, last said:\n{said}"

    def commands(self, begun):
        """Controlwords sent since."""
        return [
            int.from_bytes(frame.data[:2], "little")
            for frame in self.bus.sent[begun:]
            if frame.can_id in (0x205, 0x206)
        ]

    def to_ready(self):
        """By what an operator would ask for: a reset, as often as the drives need."""
        self.babbler.stop()
        self.lockstep.run(PAUSE_S)
        for _ in range(5):
            if self.lockstep.record.mode == Mode.READY:
                break
            self.lockstep.request(RequestKind.RESET)
            self.lockstep.run(3.0)
        self.lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=15)
        self.lockstep.run(0.3)
        self.seen, self.stopped_at = len(self.bus.sent), None

    def to_enabled(self):
        self.to_ready()
        answer = self.lockstep.request(RequestKind.ENABLE)
        assert answer.outcome == Outcome.DONE, (answer.reason, self.story())


def truth_of(session):
    row = session.truth.rows[-1]
    return row.hip_angle_rad, row.slide_position_m


RATES_HZ = (20, 200, 2000)


@pytest.fixture
def episodes(request):
    """How many episodes of each kind, and where their seeds begin."""
    minutes = request.config.option.fuzz_minutes
    return (3 * len(RATES_HZ), 0) if minutes is None else (int(minutes * 60 / 4), 1000)


def test_in_ready_nothing_is_energised_and_nothing_moves(episodes):
    count, seed = episodes
    fuzz = Fuzz(seed + 1)
    fuzz.session.until_ready()
    before = truth_of(fuzz.session)
    for number in range(count):
        begun = len(fuzz.bus.sent)
        fuzz.babbler.start(RATES_HZ[number % len(RATES_HZ)])
        fuzz.run(3.0)
        assert ENABLING not in {word & ENABLING for word in fuzz.commands(begun)}, fuzz.story()
        hip, slide = truth_of(fuzz.session)
        assert abs(hip - before[0]) < 0.01, fuzz.story()
        assert abs(slide - before[1]) < 0.01, fuzz.story()
        fuzz.to_ready()


def test_while_holding_a_stop_is_latched_and_no_torque_exceeds_its_limit(episodes):
    count, seed = episodes
    fuzz = Fuzz(seed + 2)
    fuzz.session.until_ready()
    for number in range(count):
        fuzz.to_enabled()
        fuzz.babbler.start(RATES_HZ[number % len(RATES_HZ)])
        fuzz.run(3.0)
        assert fuzz.stopped_at is not None or fuzz.lockstep.record.mode.active
    fuzz.to_ready()


def test_while_walking_a_stop_is_latched_and_both_axes_come_to_rest(episodes):
    count, seed = episodes
    for number in range(count):
        fuzz = Fuzz(seed + 3 + number)
        fuzz.session.walking(warm_s=1.0)
        fuzz.seen = len(fuzz.bus.sent)
        fuzz.babbler.start(RATES_HZ[number % len(RATES_HZ)])
        fuzz.run(3.0)
        fuzz.babbler.stop()
        fuzz.run(2.0)
        if fuzz.stopped_at is None:
            continue
        row = fuzz.session.truth.rows[-1]
        assert abs(row.hip_velocity_rad_per_s) < 0.1, fuzz.story()
        assert abs(row.slide_velocity_m_per_s) < 0.1, fuzz.story()


@pytest.mark.parametrize("kind", [network, process_data, heartbeat], ids=lambda kind: kind.__name__)
def test_nonsense_while_the_drives_are_brought_up_ends_in_ready_or_a_named_cause(kind):
    fuzz = Fuzz(7)
    fuzz.babbler.start(100, kind)
    try:
        fuzz.run(5.0)
    except BringUpRefused as refusal:  # exit 3: a TPDO of another length than was mapped
        assert refusal.drive in ("right/hip", "right/slide")
        assert "TPDO" in refusal.reason
    else:
        fuzz.to_ready()
    assert ENABLING not in {word & ENABLING for word in fuzz.commands(0)}


def test_a_drive_that_answers_our_answer_with_an_emcy_is_not_answered_again():
    # After its reset the hip has its own mapping again: each RPDO1 of ours is 8220h to it.
    session = Session().walking(warm_s=1.0)
    world, bus = session.machine.world, session.lockstep.bus
    for data in (b"\x82\x05", b"\x01\x05"):
        world.receive(WorldFrame(0x000, data))
    begun = len(bus.sent)

    session.lockstep.run(0.5)

    commands = [frame for frame in bus.sent[begun:] if frame.can_id == 0x205]
    assert len(commands) <= 50 + 3
    assert session.lockstep.record.mode in (Mode.STOPPING, Mode.FAULT)


def test_frames_that_are_nobody_s_change_nothing():
    fuzz = Fuzz(9)
    fuzz.session.walking(warm_s=1.0)
    ids = [can_id for can_id in range(0x100, 0x780) if can_id & 0x7F not in (0, 1, 5, 6)]

    def stranger(rng):
        return Frame(rng.choice(ids), bytes(rng.randrange(256) for _ in range(rng.randrange(9))))

    fuzz.babbler.start(1000, stranger)
    fuzz.run(3.0)

    assert fuzz.stopped_at is None, fuzz.story()
    assert fuzz.lockstep.record.mode == Mode.GAIT
