"""Every fault in every mode on both axes, by default a sample of it; a failure names its cell."""

import hashlib
import math
import os
import subprocess
import sys
from collections import defaultdict
from itertools import groupby
from pathlib import Path

import msgspec
import pytest
from gaitd_names import Cause, Mode

from gaitd_lab.fault_matrix import page, pairs, reversals
from gaitd_lab.fault_matrix.cell import Cell, CellResult
from gaitd_lab.fault_matrix.evaluation import broken
from gaitd_lab.fault_matrix.exceptions import EXCEPTIONS
from gaitd_lab.fault_matrix.faults import EMERGENCIES, FAULTS, LAWS
from gaitd_lab.fault_matrix.modes import COLUMNS
from gaitd_lab.fault_matrix.run import cells, parts, play_part, run
from gaitd_lab.fault_matrix.watch import AXES
from sim_drives.settings import FaultKind

PROJECT = Path(__file__).resolve().parents[2]
DEMO = PROJECT / "configs/demo.toml"
SEED = 1
NOT_IN_OPERATION = {
    FaultKind.REFUSES_OBJECT: "of bring-up, tests/closed_loop/test_bring_up*.py",
    FaultKind.WRONG_IDENTITY: "of bring-up, and a loss in operation: tests/closed_loop",
    FaultKind.HOME_SWITCH_STUCK: "of homing by a switch, tests/closed_loop/test_referencing.py",
    FaultKind.SLOW_STATE: "of the power state machine, tests/closed_loop/test_faults.py",
}
"""Faults of the virtual drives without a row, with where they are tested."""
ROTATING = ("daemon", "drives", "observer", "sim_drives", "gaitd_lab", "configs")
"""Folders that decide what a cell does."""
DRIVEN, IDLE = (
    [column.name for column in COLUMNS.values() if column.is_idle == is_idle]
    for is_idle in (False, True)
)
IDLE_TURNS = 9
"""In one turn of so many a fault is played in a mode without power as well."""
ALIKE_COUNT = 3


def alike():
    """Groups of faults of which a turn plays one: up to three of one law, or that stop nothing.

    All emergencies of one law are a group: they differ in the first digit of their code.
    """
    emergencies = [
        [name for name in sorted(FAULTS) if name.endswith(like[6:]) and LAWS[name] == LAWS[like]]
        for like in ("emcy_1xxx_fault", "emcy_1xxx_told")
    ]
    by_law = defaultdict(list)
    for name in sorted(set(FAULTS).difference(*emergencies)):
        by_law[LAWS[name] if LAWS[name].stops else None].append(name)
    others = [
        names[begin : begin + ALIKE_COUNT]
        for names in by_law.values()
        for begin in range(0, len(names), ALIKE_COUNT)
    ]
    return emergencies + [names for names in others if len(names) > 1]


ALIKE = alike()
PAIR_TURNS = 2
"""A turn plays one of so many pairs of the sample."""
CLASS_TURNS = len(DRIVEN) * len(AXES)
TURNS = math.lcm(CLASS_TURNS * math.lcm(*map(len, ALIKE)), len(IDLE) * len(AXES) * IDLE_TURNS)


def turn():
    """The turn of this version of the code: the same on each machine, another after each change."""
    digest = hashlib.sha256()
    for folder in ROTATING:
        for file in sorted((PROJECT / folder).rglob("*")):
            if file.suffix in {".py", ".toml"}:
                digest.update(file.read_bytes())
    return int.from_bytes(digest.digest()[:8]) % TURNS


def sample(turn):
    """Each fault once in a mode with power, and some in one without; of ALIKE ones one each.

    A turn moves each fault to the next mode, and after all modes to the other axis: all turns
    together are all cells.
    """
    found = []
    for number, fault in enumerate(faults_of(turn)):
        place = number + turn
        found.append(cell_at(fault, DRIVEN, place))
        if place % IDLE_TURNS == 0:
            found.append(cell_at(fault, IDLE, place // IDLE_TURNS))
    return found


def faults_of(turn):
    of_alike = [names[turn // CLASS_TURNS % len(names)] for names in ALIKE]
    return [*sorted(set(FAULTS).difference(*ALIKE)), *of_alike]


def cell_at(fault, modes, place):
    on_each_axis = cells((fault,), (modes[place % len(modes)],))
    return on_each_axis[place // len(modes) % len(on_each_axis)]


def pytest_generate_tests(metafunc):
    if "part" in metafunc.fixturenames:
        # Of a mode together, so that its session is prepared once.
        now = turn()
        pairs_now = pairs.sample(SEED)[now % PAIR_TURNS :: PAIR_TURNS]
        a_few = [
            pytest.param(part, id=f"{part[0].mode}_sample")
            for part in parts([*sample(now), *pairs_now])
        ]
        every = [
            pytest.param(part, id=f"{part[0].mode}_{number}", marks=pytest.mark.thorough)
            for number, part in enumerate(parts(cells()))
        ]
        all_pairs = [
            pytest.param(part, id=f"pairs_{part[0].mode}_{number}", marks=pytest.mark.thorough)
            for number, part in enumerate(parts(pairs.every(SEED)))
        ]
        metafunc.parametrize("part", a_few + every + all_pairs)


@pytest.fixture
def warm_process():
    """So a part is played in a fork: `play_part` freezes what the garbage collector knows."""


@pytest.mark.timeout(1800)
def test_a_fault_does_what_is_right_in_this_mode(part, warm_process):
    wrong = [
        f"{page.command(one)}\n    {'; '.join(reasons)}"
        for one in play_part(DEMO, part, SEED)
        if (reasons := broken(one))
    ]
    assert not wrong, "\n".join(["", *wrong])


def test_a_fault_of_one_axis_of_two_legs_stops_all_four_at_the_same_time(warm_process):
    axes = ("right/hip", "right/slide", "left/hip", "left/slide")
    (played,) = play_part(DEMO.with_name("two_legs.toml"), cells(("sto",), ("hold",), axes[3:]), 1)

    assert broken(played) == []
    assert (played.drive, played.together) == ("left/slide", True)
    assert set(played.lost_power) >= set(axes[:3])


QUICK_REVERSALS = ("gait_impedance", 2)
"""Mode and seed of which `make test` plays the reversals."""


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("mode", "seed"),
    [
        pytest.param(
            mode, seed, marks=() if (mode, seed) == QUICK_REVERSALS else pytest.mark.thorough
        )
        for mode in sorted({mode for _, mode, _, _ in reversals.bounds()})
        for seed in range(1, 7)
    ],
)
def test_a_real_reversal_is_found_no_later_and_moves_the_leg_no_farther(mode, seed, warm_process):
    """With each sign proven, so that a person could be the cause."""
    (part,) = parts(cells(reversals.FAULTS, (mode,)))

    played = play_part(DEMO, part, seed)

    keys = {(one.fault, one.mode, one.axis, one.seed) for one in played}
    assert keys == {key for key in reversals.bounds() if (key[1], key[3]) == (mode, seed)}
    wrong = {page.command(one): reasons for one in played if (reasons := broken(one))}
    assert not wrong
    assert not {cause for one in played for cause in one.causes} & {"MOVED_AGAINST_DRIVE"}


def test_the_page_has_the_laws_of_today():
    written = (PROJECT / "docs/evidence/fault_matrix.md").read_text(encoding="utf-8")

    for section in page.laws():
        assert section in written, "stale: `gaitd matrix --output docs/evidence`"


def test_each_sample_has_every_mode_and_a_fault_of_each_law_that_stops_with_power_in_the_drives():
    stopping = {law for law in LAWS.values() if law.stops}

    for number in range(TURNS):
        played = sample(number)

        assert {cell.mode for cell in played} == set(COLUMNS), number
        assert {cell.axis for cell in played} == {"", *AXES}, number
        assert {cell.fault for cell in played if cell.mode in DRIVEN} == set(faults_of(number))
        assert {LAWS[one] for one in faults_of(number)} >= stopping, number


def test_the_samples_of_all_turns_are_all_cells():
    assert {cell for number in range(TURNS) for cell in sample(number)} == set(cells())


def test_the_sample_of_pairs_has_each_two_families_each_offset_and_each_mode_together():
    def families(cell):
        first, second, *_ = pairs.parts_of(cell.fault)
        return [
            next(name for name, faults in pairs.SAMPLE_FAMILIES.items() if fault.name in faults)
            for fault in (first, second)
        ]

    played = pairs.sample(SEED)
    offsets = {cell: pairs.parts_of(cell.fault).offset_cycles for cell in played}
    together = {frozenset(families(cell)) for cell in played}
    kinds = set(pairs.SAMPLE_FAMILIES)

    assert together == {frozenset({one, other}) for one in kinds for other in kinds}
    for values, of in ((pairs.SAMPLE_OFFSETS, offsets.get), (pairs.SAMPLE_MODES, lambda c: c.mode)):
        assert {(kind, of(cell)) for cell in played for kind in families(cell)} == {
            (kind, value) for kind in kinds for value in values
        }
    assert {(offsets[cell], cell.mode) for cell in played} == {
        (offset, mode) for offset in pairs.SAMPLE_OFFSETS for mode in pairs.SAMPLE_MODES
    }


def test_the_sample_of_pairs_is_the_same_in_every_process():
    """The order of a set of texts depends on the process's hash seed."""
    program = f"from gaitd_lab.fault_matrix.pairs import sample; print(sample({SEED}))"
    other = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONHASHSEED": "1"},
        capture_output=True,
        check=True,
        text=True,
    )

    assert other.stdout == f"{pairs.sample(SEED)}\n"


def test_all_pairs_have_each_fault_after_each_other_one_at_each_offset_and_in_each_mode():
    played = pairs.every(SEED)
    parts_of = [pairs.parts_of(cell.fault) for cell in played]
    orders = {(one.first.name, one.second.name) for one in parts_of}

    assert len(orders) == len(played)
    assert {one.offset_cycles for one in parts_of} == set(pairs.OFFSETS)
    for names in zip(*orders, strict=True):
        assert set(names) == set(FAULTS) - {"none"}
    assert {(one.offset_cycles, cell.mode) for one, cell in zip(parts_of, played, strict=True)} == {
        (offset, mode) for offset in pairs.OFFSETS for mode in COLUMNS
    }


def test_a_pair_must_stop_if_one_of_its_faults_must_and_may_end_with_the_code_of_either():
    cell = Cell("tpdo_late_2ms+silent@3", "hold", "right/hip")
    ended = Cell("core_sigterm+silent@0", "hold", "right/hip")

    law = pairs.law_of(cell, None)

    assert law.stops
    assert Cause.DRIVE_SILENT in law.causes
    assert law.within_cycles == LAWS["silent"].within_cycles + 3 + pairs.SLACK_CYCLES
    assert pairs.law_of(ended, None).exit_code == LAWS["core_sigterm"].exit_code
    late = pairs.law_of(Cell("overrun_3+silent@3", "hold", "right/hip"), None)
    assert late.within_cycles == law.within_cycles + 3
    with pytest.raises(KeyError):
        pairs.fault_named("silent+nothing_known@1")


def test_a_jump_during_a_delay_may_look_like_a_motion_and_must_stop_all_the_same():
    delayed, lost = (
        pairs.law_of(Cell(f"{other}+encoder_jump@0", "gait_impedance", "right/slide"), None)
        for other in ("overrun_3", "tpdo_lost_once")
    )

    assert Cause.STOPPING_PATH in delayed.causes
    assert Cause.STOPPING_PATH not in lost.causes
    assert delayed.stops
    assert not delayed.may_go_on


def test_a_jam_hides_a_push_at_the_same_joint_where_it_stands():
    def may_go_on(fault, mode):
        return pairs.law_of(Cell(fault, mode, "right/hip"), None).may_go_on

    assert may_go_on("end_stop+brake_stuck@5", "hold")
    assert not may_go_on("end_stop:brake_stuck@5", "hold")
    assert not may_go_on("end_stop+brake_stuck@5", "gait_impedance")


def test_an_alarm_during_a_delay_of_the_core_is_a_quick_stop_and_not_at_once_one_not_obeyed(
    warm_process,
):
    late = [
        Cell(f"overrun_6{relation}emcy_1xxx_told@2", "hold", axis)
        for relation, axis in zip((pairs.SAME, pairs.OTHER), AXES, strict=True)
    ]

    for one in play_part(DEMO, late, SEED):
        assert one.category == "S1"
        assert "STOP_NOT_OBEYED" not in one.causes


def test_a_drive_that_is_silent_since_bring_up_is_not_called_enabled_by_another_master(
    warm_process,
):
    pair = Cell("tpdo_late_6ms:emcy_5xxx_fault@5", "ready", "right/slide")

    (played,) = play_part(DEMO, [pair], SEED)

    assert played.causes == ("DRIVE_SILENT", "DRIVE_FAULT")


def test_a_cell_alone_is_played_bit_for_bit_as_among_others(warm_process):
    cell = Cell("hand_switch", "commission", "right/hip")

    ((alone,),) = run(DEMO, [cell], SEED, jobs=1)
    among = play_part(DEMO, [cell, *cells(("silent",), ("commission",), AXES[:1])], SEED)

    assert alone in among
    assert alone.stopped


# --- completeness ---------------------------------------------------------------------------------


def test_every_mode_has_its_column_or_is_named_as_left_out():
    assert {column.mode for column in COLUMNS.values()} == set(Mode)


def test_every_fault_of_the_virtual_drives_has_a_row_or_its_test_elsewhere():
    text = "".join(
        (PROJECT / f"gaitd_lab/fault_matrix/{name}.py").read_text() for name in ("faults", "kinds")
    )

    without = {kind for kind in FaultKind if f'"{kind.value} ' not in text}

    assert {kind for kind in without if f"{kind.value} {{" not in text} == set(NOT_IN_OPERATION)


def test_every_error_class_has_a_fault_and_a_message_that_changes_nothing():
    assert set(EMERGENCIES) == {*range(1, 10), 0xF}
    for error_class, (code, _) in EMERGENCIES.items():
        assert code >> 12 == error_class
        assert {f"emcy_{error_class:x}xxx_fault", f"emcy_{error_class:x}xxx_told"} <= set(FAULTS)


def test_every_exception_has_its_place_and_its_reason():
    for (fault, mode, axis), law in EXCEPTIONS.items():
        assert fault in FAULTS
        assert mode in COLUMNS
        assert axis in {"", "right/hip", "right/slide"}
        assert law.why


def test_all_cells_are_rows_times_columns_times_axes():
    axes = sum(2 if fault.of_an_axis else 1 for fault in FAULTS.values())

    assert len(cells()) == len(set(cells())) == axes * len(COLUMNS)


# --- the page -------------------------------------------------------------------------------------


def tables_of(text):
    """Rows of cells of each table, the header first."""
    lines = text.splitlines()
    for is_table, rows in groupby(lines, lambda line: line.startswith("| ")):
        if is_table:
            yield [[cell.strip() for cell in row.strip("| ").split(" | ")] for row in rows]


def test_the_page_has_every_row_and_every_column_and_no_empty_cell():
    text = (PROJECT / "docs/evidence" / page.PAGE).read_text()
    head, _, *rows = next(tables_of(text))

    assert head == ["fault", *COLUMNS]
    assert [row[0].strip("`") for row in rows] == list(FAULTS)
    assert {len(row) for row in rows} == {len(head)}
    assert all(cell and cell != "not played" for row in rows for cell in row)


def test_the_same_on_both_axes_is_one_entry_and_another_thing_is_two():
    hip = WELL
    slide = msgspec.structs.replace(WELL, axis="right/slide", hip_deg=9.0, told_cycles=4.5)
    other = msgspec.structs.replace(slide, causes=("HEARTBEAT_LOST",))

    assert page.entry([hip, slide]) == "DRIVE_SILENT S1 · 4.5 · 9.0°, 20 mm"
    assert page.entry([hip, other]).count("<br>") == 1
    assert "slide: HEARTBEAT_LOST" in page.entry([hip, other])


# --- the laws can be broken -----------------------------------------------------------------------

WELL = CellResult(
    fault="silent",
    mode="gait_impedance",
    axis="right/hip",
    seed=1,
    phase=0.4,
    driven=True,
    stopped=True,
    causes=("DRIVE_SILENT",),
    category="S1",
    drive="right/hip",
    final_mode="FAULT",
    final_cause="DRIVE_SILENT",
    told_cycles=4.2,
    left_cycles=5.1,
    rest_cycles=20.0,
    hip_deg=8.0,
    slide_mm=20.0,
)
REST = msgspec.structs.replace(WELL, mode="ready", driven=False, stopped=False, final_mode="OFF")
STILL = msgspec.structs.replace(WELL, mode="fault", driven=False, stopped=False)
ONWARDS = msgspec.structs.replace(
    WELL, fault="tpdo_lost_once", stopped=False, causes=(), category="", final_mode="GAIT"
)


REVERSED = msgspec.structs.replace(
    WELL,
    fault="wrong_sign",
    mode="gait_impedance",
    axis="right/hip",
    seed=1,
    causes=("SIGN_WRONG",),
    category="S0",
    final_cause="SIGN_WRONG",
    drive="right/hip",
    lost_power=("right/hip",),
    powerless_at_once=("right/hip",),
    told_cycles=4.0,
    hip_deg=2.86,
    slide_mm=50.4,
)
"""What was recorded of this cell."""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"seed": 4711, "told_cycles": 40.0}, None),
        ({"told_cycles": 4.1}, "a reversal told after 4.1 cycles, before it was 4"),
        ({"told_cycles": None}, "a reversal told after None cycles, before it was 4"),
        ({"hip_deg": 2.95}, "a reversal moved the hip by 2.95 deg, before 2.86"),
        ({"slide_mm": 51.0}, "a reversal moved the slide by 51 mm, before 50.4"),
    ],
)
def test_a_reversal_found_later_or_moved_farther_than_recorded_breaks_a_law(change, words):
    said = broken(msgspec.structs.replace(REVERSED, **change))

    assert [one for one in said if one.startswith("a reversal")] == ([words] if words else [])


PUSHED = msgspec.structs.replace(
    WELL,
    fault="end_stop:emcy_6xxx_fault@0",
    axis="right/slide",
    causes=("EMERGENCY", "SIGN_WRONG"),
    final_cause="SIGN_WRONG",
    lost_power=("right/hip",),
    beyond_hip_deg=12.8,
    rest_cycles=None,
)
"""A patient throws the leg, and the hip's drive is in fault."""
OVERPOWERED = msgspec.structs.replace(
    WELL,
    fault="end_stop",
    causes=("EFFORT_DEVIATION", "STOP_NOT_OBEYED"),
    final_mode="STOPPING",
    final_cause="STOP_NOT_OBEYED",
    lost_power=("right/hip",),
    rest_cycles=None,
)
"""A patient pushes harder than the hip's drive can brake, and its stop ends without power."""
RUNAWAY = msgspec.structs.replace(
    WELL,
    fault="encoder_reversed",
    axis="right/slide",
    seed=4711,
    causes=("SIGN_WRONG",),
    category="S0",
    final_cause="SIGN_WRONG",
    drive="right/slide",
    lost_power=("right/hip", "right/slide"),
    powerless_at_once=("right/slide",),
    beyond_hip_deg=11.15,
)
"""The slide's fault reaction brakes by a reversed encoder, and overpowers the hip's drive."""
MOVES_ON = msgspec.structs.replace(
    STILL, category="S0", final_mode="STOPPING", causes=("STO_ACTIVE",)
)
"""A leg without power that has not come to rest yet."""


@pytest.mark.parametrize(
    "well",
    [
        WELL,
        REST,
        STILL,
        ONWARDS,
        PUSHED,
        OVERPOWERED,
        RUNAWAY,
        msgspec.structs.replace(MOVES_ON, fault="end_stop+sto@3"),
        msgspec.structs.replace(
            WELL,
            fault="wrong_sign+drive_bus_off@0",
            causes=("DRIVE_SILENT", "STOP_NOT_OBEYED"),
            rest_cycles=None,
        ),
    ],
)
def test_a_good_cell_breaks_no_law(well):
    assert broken(well) == []


@pytest.mark.parametrize(
    ("well", "changes", "said"),
    [
        (WELL, {"enabled_anew": ("right/hip",)}, "enabled without a request: right/hip"),
        (WELL, {"active_again": True}, "without a request"),
        (WELL, {"together": False}, "between the same two SYNCs"),
        (WELL, {"causes": ("TRACKING_LIMIT",)}, "cause TRACKING_LIMIT"),
        (WELL, {"causes": ("DRIVE_SILENT", "ENCODER_JUMP")}, "then ENCODER_JUMP"),
        (WELL, {"category": "S2"}, "category S2, right is S1"),
        (WELL, {"told_cycles": 6.1}, "told after 6.1 cycles"),
        (WELL, {"told_cycles": None}, "no frame told both drives"),
        (WELL, {"rest_cycles": None}, "at rest after None"),
        (WELL, {"final_mode": "STOPPING"}, "in mode STOPPING"),
        (WELL, {"beyond_hip_deg": 9.0}, "beyond its limit"),
        (WELL, {"beyond_slide_mm": 97.0}, "beyond its limit"),
        (WELL, {"stopped": False}, "went on"),
        (WELL, {"exit_code": 4, "trouble": "KeyError"}, "exit code 4"),
        (WELL, {"trouble": "KeyError"}, "an exception: KeyError"),
        (WELL, {"fault": "adapter_gone", "causes": ("BUS_DOWN",), "left_cycles": 15.0}, "15.0"),
        (ONWARDS, {"causes": ("DRIVE_SILENT",)}, "right is to go on"),
        (ONWARDS, {"final_mode": "HOLD"}, "in mode HOLD"),
        (REST, {"final_mode": "FAULT"}, "in mode FAULT"),
        (REST, {"causes": ("ENCODER_JUMP",)}, "cause ENCODER_JUMP"),
        (REST, {"causes": ()}, "nothing was told"),
        (STILL, {"final_mode": "READY"}, "right is FAULT"),
        (STILL, {"causes": ("SPASM",)}, "cause SPASM"),
        (MOVES_ON, {"fault": "sto"}, "right is FAULT"),
        (PUSHED, {"lost_power": ()}, "beyond its limit"),
        (PUSHED, {"lost_power": (), "causes": ("EMERGENCY",)}, "at rest after None"),
        (PUSHED, {"fault": "emcy_6xxx_fault"}, "beyond its limit"),
        (OVERPOWERED, {"lost_power": ()}, "in mode STOPPING"),
        (
            OVERPOWERED,
            {"causes": ("EFFORT_DEVIATION",), "final_cause": "EFFORT_DEVIATION"},
            "in mode STOPPING",
        ),
        (WELL, {"powerless_at_once": ("right/hip",)}, "without power at once: right/hip"),
        (RUNAWAY, {"powerless_at_once": ("right/hip", "right/slide")}, "right is right/slide"),
        (OVERPOWERED, {"beyond_hip_deg": 36.1}, "36 is its stop"),
        (RUNAWAY, {"lost_power": ("right/slide",)}, "8.9 is its stop"),
        (RUNAWAY, {"beyond_hip_deg": 36.1}, "36 is its stop"),
        (RUNAWAY, {"beyond_slide_mm": 169.1}, "169 is its stop"),
        (PUSHED, {"causes": ("DRIVE_SILENT",), "category": "S0"}, "category S0, right is S1"),
    ],
)
def test_each_law_can_be_broken_and_says_what_is_wrong(well, changes, said):
    reasons = broken(msgspec.structs.replace(well, **changes))

    assert len(reasons) >= 1
    assert any(said in reason for reason in reasons)


def test_a_cause_is_a_name_of_the_record_s():
    assert all(isinstance(cause, Cause) for law in LAWS.values() for cause in law.causes)
