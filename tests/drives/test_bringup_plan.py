"""Plans and objects of bring-up that the drives of the demonstration do not have."""

import copy
import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import pytest
from bringup_bench import Bench
from drive_files import CYCLE, HIP_LIMITS, axis_for, drive, join, table

from drives.bringup.bringup import bring_up
from drives.bringup.objects import SdoTarget, examine, read, write, write_range
from drives.bringup.plan import homing_plan, plan
from drives.bringup.steps import ALL_BITS, NO_RTR, Step, StepKind
from drives.canopen.bus import Frame
from drives.cia402.units import raw_homing, raw_limits
from drives.errors import BringUpRefused, SdoAborted

# --- homing ---------------------------------------------------------------------------------------


def with_homing(**changes):
    """The hip's drive, with other settings of its homing."""
    axis = copy.deepcopy(table("hip_epos4.toml"))
    axis["homing"] |= changes
    return join(axis, table(axis["profile"]), "hip_epos4")


def written_by(steps):
    return {(one.index, one.sub): one.value for one in steps if one.kind is StepKind.WRITE}


def test_a_homing_is_planned_with_its_own_settings_before_the_targets_are_seeded():
    description = with_homing()
    raw = raw_homing(description.axis.homing, 1, description)
    usual = plan(description, HIP_LIMITS, CYCLE).steps

    steps = homing_plan(description, HIP_LIMITS, CYCLE).steps

    added = [step for step in steps if step.place not in {one.place for one in usual}]
    assert written_by(added) == {
        (0x6098, 0): 17,
        (0x6099, 1): raw.search_speed_raw,
        (0x6099, 2): raw.zero_speed_raw,
        (0x609A, 0): raw.acceleration_raw,
        (0x30B0, 0): raw.home_raw,
    }
    cleared = [step.index for step in added if step.kind is StepKind.CLEAR]
    assert cleared == [0x30B1, 0x607C]  # would shift the home further
    kinds = [step.kind for step in steps]
    last = max(steps.index(step) for step in added)
    assert last < kinds.index(StepKind.SEED_POSITION)
    supports = next(step for step in steps if step.value == step.mask == 1 << 5)
    assert (supports.kind, supports.place) == (StepKind.CHECK, "6502h:00")


def test_a_homing_has_its_own_torque_limit_and_no_position_limits():
    description = with_homing()
    alone = HIP_LIMITS._replace(
        position_min_si=-math.inf, position_max_si=math.inf, effort_max_si=50.0
    )

    values = written_by(homing_plan(description, HIP_LIMITS, CYCLE).steps)

    raw = raw_limits(alone, description)
    limit = description.profile.torque_limit
    assert values[limit.index, limit.sub] == raw.torque_raw
    assert raw.torque_raw < raw_limits(HIP_LIMITS, description).torque_raw
    (range_,) = [
        one for one in homing_plan(description, HIP_LIMITS, CYCLE).steps if one.index == 0x607D
    ]
    assert (range_.value, range_.second) == (-0x7FFFFFFF, 0x7FFFFFFF)


def test_the_current_that_means_a_stop_is_written_where_it_is_given():
    description = with_homing(method=-4, stop_current_a=4.5)

    values = written_by(homing_plan(description, HIP_LIMITS, CYCLE).steps)

    assert values[0x30B2, 0] == 4500


def test_an_axis_without_homing_has_no_plan_for_it():
    description = drive("hip_epos4")
    axis = copy.deepcopy(table("hip_epos4.toml"))
    del axis["homing"]

    with pytest.raises(ValueError, match="right/hip has no homing"):
        homing_plan(join(axis, table(axis["profile"]), "hip"), HIP_LIMITS, CYCLE)
    assert homing_plan(description, HIP_LIMITS, CYCLE)


# --- heartbeat ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entries", "written"),
    [(0, {}), (1, {1: 0x10064}), (2, {1: 0x10064, 2: 0}), (3, {1: 0x10064, 2: 0, 3: 0})],
)
def test_a_drive_monitors_the_master_s_heartbeat_alone_or_none(entries, written):
    profile = copy.deepcopy(table("profiles/generic.toml"))
    profile["heartbeat"]["consumer_entries"] = entries
    profile["pdo"]["rpdo_timeout"] = True
    description = join(axis_for(profile), profile, "hip")

    values = written_by(plan(description, HIP_LIMITS, CYCLE).steps)

    assert {sub: value for (index, sub), value in values.items() if index == 0x1016} == written
    assert values[0x1017, 0] == CYCLE.drive_heartbeat_ms


# --- objects of another size ----------------------------------------------------------------------

WORD = Step(StepKind.ASK, "a word", 0x2000, 1, bits=16)


def answering(answer):
    """A target whose reads end with these bytes, or with this error."""

    def port_read(node_id, index, sub):
        assert (node_id, index, sub) == (5, 0x2000, 1)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return SdoTarget(SimpleNamespace(read=port_read), "right/hip", 5)


@pytest.mark.parametrize("answer", [b"", b"\x34"])
@pytest.mark.parametrize("kind", [StepKind.ASK, StepKind.REPORT])
def test_fewer_bytes_than_the_object_has_are_refused_and_never_padded(kind, answer):
    with pytest.raises(BringUpRefused) as caught:
        examine(replace(WORD, kind=kind), answering(answer))

    assert (caught.value.place, caught.value.value) == ("2000h:01", answer.hex())
    assert f"{len(answer)} bytes instead of 2 (a word)" in str(caught.value)


@pytest.mark.parametrize(("signed", "value"), [(False, 0xFF34), (True, -0xCC)])
def test_of_more_bytes_the_lowest_are_used(signed, value):
    assert read(replace(WORD, signed=signed), answering(b"\x34\xff\x99\x99")) == value


def test_an_object_that_a_drive_need_not_have_is_0_where_it_has_none():
    missing = SdoAborted(0x2000, 1, 0x06020000, "no such object")

    assert examine(WORD, answering(missing)) == 0
    with pytest.raises(BringUpRefused, match="06020000h, no such object"):
        examine(replace(WORD, kind=StepKind.REPORT), answering(missing))


# --- what is compared, written and read back ------------------------------------------------------


def keeping(values, kept=0xFFFF_FFFF):
    """A target that stores what is written, but only these bits of it."""
    written = []

    def port_write(_node_id, index, sub, data):
        written.append((index, sub, data.hex()))
        value = int.from_bytes(data, "little") & kept
        values[index, sub] = value.to_bytes(len(data), "little")

    def port_read(_node_id, index, sub):
        return values[index, sub]

    return SdoTarget(SimpleNamespace(read=port_read, write=port_write), "right/hip", 5), written


BASE = Step(StepKind.COMPARE, "a base", 0x2000, 3, signed=True, value=10_000)


@pytest.mark.parametrize("value", [9_900, 10_100])
def test_a_base_may_be_one_percent_off(value):
    target, _ = keeping({(0x2000, 3): value.to_bytes(4, "little")})

    assert examine(BASE, target) == value


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (0, "the drive has no motor data: expected about 10000 (a base)"),
        *(
            (value, "more than 1 % from the axis file's 10000 (a base)")
            for value in (9_899, 10_101, -10_000)
        ),
    ],
)
def test_a_base_that_is_none_or_another_is_refused_with_both_values(value, reason):
    target, _ = keeping({(0x2000, 3): value.to_bytes(4, "little", signed=True)})

    with pytest.raises(BringUpRefused) as caught:
        examine(BASE, target)

    assert (caught.value.value, caught.value.reason) == (str(value), reason)


@pytest.mark.parametrize(
    ("bits", "value", "kept", "mask"),
    [
        *((16, -2, 0xFFFF, ALL_BITS), (16, -1, 0xFFFF, ALL_BITS), (8, 0, 0xFF, ALL_BITS)),
        (32, 0x4000_0185, 0xBFFF_FFFF, ALL_BITS ^ NO_RTR),
    ],
)
def test_what_reads_back_the_same_under_the_mask_is_written(bits, value, kept, mask):
    target, written = keeping({}, kept)

    write(replace(WORD, kind=StepKind.WRITE, bits=bits, mask=mask), target, value)

    data = value.to_bytes(bits // 8, "little", signed=value < 0)
    assert written == [(0x2000, 1, data.hex())]


@pytest.mark.parametrize("lost", [1, 0x100, 0x8000_0000])
def test_each_bit_that_does_not_read_back_is_refused(lost):
    target, _ = keeping({}, ALL_BITS ^ lost)
    value = 0x8000_0185

    with pytest.raises(BringUpRefused) as caught:
        write(Step(StepKind.WRITE, "a word", 0x2000, mask=ALL_BITS ^ NO_RTR), target, value)

    reason = f"written, but it reads back {value ^ lost} (a word)"
    assert (caught.value.value, caught.value.reason) == (str(value), reason)


def test_the_maximum_of_a_range_is_in_the_next_sub_index():
    target, written = keeping({(0x2000, 4): bytes(4)})

    write_range(Step(StepKind.RANGE, "a range", 0x2000, 3, signed=True, value=-1, second=2), target)

    assert written == [(0x2000, 3, "ffffffff"), (0x2000, 4, "02000000")]


def test_a_read_that_is_refused_is_told_as_one():
    with pytest.raises(BringUpRefused) as caught:
        read(WORD, answering(SdoAborted(0x2000, 1, 0x06010001, "write only")))

    assert (caught.value.value, caught.value.place) == ("(read)", "2000h:01")
    assert caught.value.reason == "refused with 06010001h, write only (a word)"


# --- traffic that is none of ours -----------------------------------------------------------------


def test_replies_and_frames_of_other_nodes_change_nothing():
    quiet, loud = Bench(), Bench()
    for frame in (Frame(0x583, bytes(8)), Frame(0x7E5, b"\0"), Frame(0x685, bytes(8))):
        loud.bus.put(frame, 1)

    assert quiet.run() == loud.run()


def test_what_runs_beside_bring_up_is_called_every_ten_milliseconds_of_waiting():
    bench = Bench(hip={"mute": {(0x1000, 0)}})
    called_ns = []
    bench.port._meanwhile = lambda: called_ns.append(bench.clock.now_ns())

    with pytest.raises(Exception, match="1000h:00"):
        list(bring_up(bench.plans, bench.port, CYCLE))

    waits_ns = {later - before for before, later in pairwise(called_ns)}
    assert len(called_ns) >= 30
    assert max(waits_ns) <= 10_000_000
