"""Each virtual make is verified, and a drive that lies in one fact is found by that fact."""

import math
import struct
from types import SimpleNamespace

import pytest
from drive_bench import GENERIC, FakePlant
from drive_bench import Bench as Drives
from drive_files import CYCLE, HIP_LIMITS, drive

from drives.bringup.configurator import Configurator
from drives.bringup.plan import single_axis_plan
from drives.canopen.sniffer import SniffedBus
from drives.verification.bench import BenchLimits, Recorder
from drives.verification.facts import FactCode, Judgement
from drives.verification.stages import Options, verify
from gaitd_lab.lockstep import WorldBus, WorldClock
from sim_drives.plant.actuation import Actuation

NODE = 5
GEAR = 100.0
HAND_CYCLES = 30
EFFORT_NM = 10.0
INERTIA_KG_M2 = FakePlant.inertia[0]
KINDS = {
    "epos4": {},
    "generic": GENERIC,
    "elmo": {"personality": "elmo_gold", "eds": "drives/elmo_gold.eds"},
}


class Motor(FakePlant):
    """The share of a turn by which a hand turns it."""

    hand = 1.0


class Between:
    """A world whose frames can be altered: those of the drive, and those to it."""

    def __init__(self, world):
        self._world = world
        self.from_drive = self.to_drive = lambda frame: frame

    def __getattr__(self, name):
        return getattr(self._world, name)

    def advance_to(self, time_ns):
        frames = (self.from_drive(frame) for frame in self._world.advance_to(time_ns))
        return [frame for frame in frames if frame is not None]

    def receive(self, frame):
        if (frame := self.to_drive(frame)) is not None:
            self._world.receive(frame)


def play(*lies, kind="epos4", plant=None):
    """Verify the hip of two virtual drives; lies are told after they have booted."""
    plant = plant or Motor()
    made = Drives(hip=KINDS[kind], plant=plant)
    made.boot()
    between = Between(made.world)
    bus = WorldBus(between)
    clock = WorldClock(bus)
    recorder = Recorder(clock)
    observed = SniffedBus(bus, clock, recorder)

    asked = iter(range(10**6))

    def turn_by_hand():
        """A hand that takes longer than the drive waits for its master."""
        if next(asked) < HAND_CYCLES:
            return False
        plant.position[0] += math.tau / GEAR * plant.hand
        return True

    told = SimpleNamespace(drives=made, frames=between, later=[])
    for lie in lies:
        lie(told)
    limits = HIP_LIMITS._replace(effort_max_si=EFFORT_NM)
    steps = verify(
        single_axis_plan(drive(f"hip_{kind}"), limits, CYCLE, EFFORT_NM),
        BenchLimits(
            limits.velocity_max_si, EFFORT_NM, 0.2, limits.quick_stop_deceleration_si_per_s2
        ),
        CYCLE,
        Options(INERTIA_KG_M2, turn_by_hand),
        bus=observed,
        clock=clock,
        port=Configurator(observed, clock),
    )
    while True:
        try:
            progress = next(steps)
        except StopIteration as end:
            return end.value, recorder
        if progress.text == "samples":
            for late in told.later:
                late()


def failed(found):
    return {fact.code for fact in found.facts if fact.judgement is Judgement.FAILED}


@pytest.mark.parametrize("kind", KINDS)
def test_each_virtual_make_does_what_its_profile_says(kind):
    found, recorder = play(kind=kind)

    assert found.is_off
    assert found.passed, failed(found)
    unmeasured = {f.code for f in found.facts if f.judgement is Judgement.NOT_MEASURED}
    assert unmeasured <= {FactCode.COMMAND_LOSS_TIME, FactCode.COMMAND_LOSS_STATE}
    assert {fact.code for fact in found.facts} == set(FactCode)
    assert found.rows[-1].power_state == "SWITCH_ON_DISABLED"
    assert recorder.frames[-1][1].data == bytes((0x82, NODE))


# --- lies -----------------------------------------------------------------------------------------


def of_tpdo(told, service, change):
    def altered(frame):
        is_it = frame.can_id == service + NODE
        return frame._replace(data=change(frame.data)) if is_it else frame

    told.frames.from_drive = altered


def holds(index, sub, value):
    """The drive takes what bring-up writes, and then does as if it held something else."""

    def lie(told):
        held = told.drives.world.node("right/hip").dictionary
        told.later.append(lambda: held.put(index, sub, value))

    return lie


def another_status(told):
    of_tpdo(told, 0x180, lambda data: bytes((data[0], data[1] ^ 0x08)) + data[2:])


def another_position(told):
    def shifted(data):
        (counts,) = struct.unpack_from("<i", data, 2)
        return data[:2] + struct.pack("<i", counts + 700) + data[6:]

    of_tpdo(told, 0x180, shifted)


def silent_now_and_then(told):
    count = iter(range(10**6))
    told.frames.from_drive = lambda frame: (
        None if frame.can_id == 0x280 + NODE and next(count) % 10 == 9 else frame
    )


def no_emcy(told):
    told.frames.from_drive = lambda frame: None if frame.can_id == 0x080 + NODE else frame


def ignores_reset(told):
    def altered(frame):
        if frame.can_id != 0x200 + NODE:
            return frame
        return frame._replace(data=bytes((frame.data[0] & 0x7F,)) + frame.data[1:])

    told.frames.to_drive = altered


def velocity_in_other_units(told):
    def altered(frame):
        if frame.can_id == 0x580 + NODE and frame.data[1:3] == b"\x6c\x60":
            (value,) = struct.unpack_from("<i", frame.data, 4)
            return frame._replace(data=frame.data[:4] + struct.pack("<i", 10 * value))
        return frame

    told.frames.from_drive = altered


def refuses_a_value(told):
    told.drives.world.node("right/hip").dictionary.put(0x1018, 1, 0x1234)


def silent_under_torque(told):
    """TPDO2 ends once a torque was commanded."""
    commanded = []

    def to_drive(frame):
        if frame.can_id == 0x300 + NODE and any(frame.data):
            commanded.append(frame)
        return frame

    told.frames.to_drive = to_drive
    told.frames.from_drive = lambda frame: (
        None if commanded and frame.can_id == 0x280 + NODE else frame
    )


def test_no_torque_is_given_without_a_view_of_the_motor():
    found, _ = play(silent_under_torque)

    assert "no whole sample" in found.refusal
    assert len([row for row in found.rows if row.torque_permille]) <= 4
    assert found.is_off


def shows_power_by_sdo(told):
    def altered(frame):
        if frame.can_id == 0x580 + NODE and frame.data[1:3] == b"\x41\x60":
            return frame._replace(data=frame.data[:4] + b"\x37\x06\0\0")
        return frame

    def begin():
        told.frames.from_drive = altered

    told.later.append(begin)


def test_a_drive_that_keeps_its_power_keeps_its_watch_too():
    found, recorder = play(shows_power_by_sdo)

    assert not found.is_off
    nmt = [frame.data for _, frame in recorder.frames if frame.can_id == 0]
    assert nmt[-1] == bytes((0x01, NODE))
    disabled = [f.data for _, f in recorder.frames if f.can_id == 0x600 + NODE][-20:]
    assert bytes.fromhex("2b40600000000000") in disabled


class HalfTurn(Motor):
    hand = 0.5


class ReversedMotor(Motor):
    def effort(self, axis):
        return -super().effort(axis)


class PushedMotor(Motor):
    """An offset of the torque: it turns without a command."""

    def effort(self, axis):
        order = self.orders[axis]
        offset_nm = 2.0 if order and order.actuation is Actuation.TORQUE else 0.0
        return super().effort(axis) + offset_nm


class HeavyMotor(Motor):
    """Three times as much inertia as is known: the torque is a third of what is said."""

    inertia = (6.0, 30.0)


class OtherCurrents(Motor):
    effort_per_a = (3.9, 27.08)


class LongRamp(Motor):
    def set_axis(self, axis, actuation):
        super().set_axis(axis, actuation._replace(deceleration_si=actuation.deceleration_si / 8))


LIES = {
    "another maker": ((refuses_a_value,), None, {FactCode.BRING_UP}),
    "a TPDO is left out": ((silent_now_and_then,), None, {FactCode.SAMPLES}),
    "another word in TPDO1": ((another_status,), None, {FactCode.STATUSWORD_MAPPED}),
    "another position in TPDO1": ((another_position,), None, {FactCode.POSITION_MAPPED}),
    "half the counts": ((), HalfTurn, {FactCode.ENCODER}),
    "torque without a command": ((), PushedMotor, {FactCode.STANDSTILL}),
    "a motor that turns the other way": (
        (),
        ReversedMotor,
        {FactCode.SIGN, FactCode.EFFORT_SCALE},
    ),
    "currents in another scale": ((), OtherCurrents, {FactCode.EFFORT_SCALE}),
    "torque in another scale": ((), HeavyMotor, {FactCode.INERTIA}),
    "velocity in other units": ((velocity_in_other_units,), None, {FactCode.VELOCITY_UNIT}),
}


@pytest.mark.parametrize("name", LIES)
def test_a_lie_on_which_motion_would_rely_ends_the_run_with_its_fact(name):
    lies, plant, codes = LIES[name]

    found, _ = play(*lies, plant=plant and plant())

    assert failed(found) - {FactCode.COMPLETED} == codes
    assert found.refusal
    if found.rows:
        assert found.rows[-1].power_state in {"SWITCH_ON_DISABLED", "FAULT"}


LIES_OF_STOPS = {
    "605Ah and 1016h": (
        ("epos4", (holds(0x605A, 0, 2), holds(0x1016, 1, 0)), None),
        {FactCode.QUICK_STOP_STATE, FactCode.HEARTBEAT_LOSS_TIME},
    ),
    "a longer ramp, no EMCY, a fault that stays": (
        ("epos4", (no_emcy, ignores_reset), LongRamp),
        {FactCode.QUICK_STOP_WAY, FactCode.HEARTBEAT_LOSS_EMCY, FactCode.FAULT_RESET},
    ),
    "1400h:05": (("generic", (holds(0x1400, 5, 0),), None), {FactCode.COMMAND_LOSS_TIME}),
    "6007h, coasts": (("generic", (holds(0x6007, 0, 2),), None), {FactCode.COMMAND_LOSS_STATE}),
    "6007h, nothing": (("elmo", (holds(0x6007, 0, 0),), None), {FactCode.HEARTBEAT_LOSS_STATE}),
}


@pytest.mark.parametrize("name", LIES_OF_STOPS)
def test_a_lie_about_a_stop_is_found_by_the_fact_that_it_is_about(name):
    (kind, lies, plant), codes = LIES_OF_STOPS[name]

    found, _ = play(*lies, kind=kind, plant=plant and plant())

    assert codes <= failed(found), [(one.code, one.found) for one in found.facts]
    assert found.rows[-1].power_state in {"SWITCH_ON_DISABLED", "FAULT"}
