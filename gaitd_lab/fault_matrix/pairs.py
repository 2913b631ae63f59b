"""Two faults in one cell: in the same cycle, or up to five cycles apart.

A pair has a name like a fault, and is run and judged like one: `silent+hand_switch@3` is
`hand_switch` three cycles after `silent` on the same axis, `silent:hand_switch@3` on the other one.
Its law is made of both laws (`both`). The pairs to run are a covering array (`covering`): every
pair of values of any two columns is in one of its rows.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, product
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_names import Cause

from gaitd_lab.fault_matrix.cell import Cell
from gaitd_lab.fault_matrix.exceptions import law
from gaitd_lab.fault_matrix.faults import FAMILIES, FAULTS, LAWS
from gaitd_lab.fault_matrix.kinds import Fault, FaultAction, Scene, nothing
from gaitd_lab.fault_matrix.law import LOST, S0, S1, Law, Resting
from gaitd_lab.fault_matrix.modes import COLUMNS
from gaitd_lab.fault_matrix.watch import AXES, CYCLE_NS

OFFSETS: Final = (0, 1, 2, 3, 4, 5)
"""Cycles from the first fault to the second one."""
SAME, OTHER = "+", ":"
"""The second fault is on the axis of the first one, or on the other axis."""
NS_PER_S: Final = 1_000_000_000
SAMPLE_MODES: Final = ("hold", "gait_impedance", "stopping", "reference")
SAMPLE_OFFSETS: Final = (0, 1, 2, 5)
SAMPLE_FAMILIES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "communication": FAMILIES["drive"] + FAMILIES["bus"],
        "emergency": FAMILIES["emergency"],
        "sensor": FAMILIES["sensor"] + FAMILIES["number"],
        "mechanics": FAMILIES["mechanics"],
        "gateway": FAMILIES["gateway"],
        "core": FAMILIES["time"] + FAMILIES["process"],
    }
)
"""Values of the sample, which is to be short."""
_SILENCES: Final = frozenset({"gateway_dead", "gateway_35ms", "gateway_200ms", "gateway_2s"})
REVERSED: Final = frozenset({"wrong_sign", "encoder_reversed"})
"""Faults of a drive whose own quick stop drives the joint on."""
CORE_ENDS: Final = frozenset(name for name, one in LAWS.items() if one.exit_code is not None)
CUT_OFF: Final = frozenset({"deaf", "unplugged", "drive_bus_off"})
"""Faults after which a drive receives no command."""
REPLACING: Final = (
    CORE_ENDS,
    frozenset(FAMILIES["gateway"]) - _SILENCES | {"nan_setpoint"},
    _SILENCES,
)
"""Groups of which two faults cannot be combined, because they set the same thing: the core ends
once, the gateway sends one kind of state, and it is either silent or not. Such pairs are not run.
"""
CONSEQUENCES: Final = frozenset(
    {Cause.DRIVE_FAULT, Cause.EMERGENCY, Cause.DRIVE_LEFT_ENABLED, *LOST}
)
"""Causes that a second fault may add to the stop of the first one, or by which it comes first."""
PUSH: Final = "end_stop"
"""The fault in which the patient pushes harder than a drive can hold."""
LOSING: Final = frozenset({"core_35ms", "queue_full_once"})
"""Two faults that each lose samples, alone fewer than make a drive silent: together they may."""
OF_PATIENT: Final = frozenset({"end_stop", "voluntary_push", "spasm"})
"""What the patient does: the second of two replaces the first, which then need not show."""
JAMS: Final = frozenset({"blocked_rotor", "brake_stuck"})
"""Faults that hold a joint: where it stands, they hide what would move it."""
DELAYS: Final = frozenset(
    {"suspended", "overrun_1", "overrun_3", "overrun_6", "core_35ms", "core_2s"}
)
"""Faults in which the core stands still as long as they last: the other fault is found later."""
JUMPS: Final = frozenset({"encoder_jump", "encoder_jump_once"})
WITHIN_REACH: Final = frozenset({Cause.STOPPING_PATH, Cause.VELOCITY_LIMIT})
"""First causes of a jump during a delay: in the longer time between two samples the joint could
have come so far, at a speed above its limit. It must stop all the same.
"""
ADDING: Final = MappingProxyType({frozenset({"sync_late_2ms", "tpdo_late_2ms"}): "tpdo_late_6ms"})
"""Two faults that are harmless alone, and the fault whose law they have together: the delays add,
and the samples come after the window.
"""
SLACK_CYCLES: Final = 6.0
"""Time by which a second fault may delay the detection of the first: it may take its samples."""


class Parts(NamedTuple):
    """The two faults of a pair."""

    first: Fault
    second: Fault
    offset_cycles: int
    on_other_axis: bool


@cache
def parts_of(name: str) -> Parts | None:
    """The faults of a pair by its name; None for the name of a single fault.

    Raises:
        KeyError: there is no such fault.
    """
    faults, _, offset = name.partition("@")
    relation = OTHER if OTHER in faults else SAME
    first, is_pair, second = faults.partition(relation)
    if not is_pair:
        return None
    if not offset.isdigit():
        raise KeyError(name)
    return Parts(FAULTS[first], FAULTS[second], int(offset), relation == OTHER)


def fault_named(name: str) -> Fault:
    """A fault or a pair of faults by its name.

    Raises:
        KeyError: there is no such fault.
    """
    parts = parts_of(name)
    if parts is None:
        return FAULTS[name]
    first, second, offset_cycles, _ = parts
    offset_s = offset_cycles * CYCLE_NS / NS_PER_S
    return Fault(
        name,
        f"{first.text}; then {second.text}",
        FaultAction(lambda scene, axis: _begin(parts, scene, axis), nothing),
        of_an_axis=first.of_an_axis or second.of_an_axis,
        lasts_s=max(first.lasts_s, offset_s + second.lasts_s),
    )


def _begin(parts: Parts, scene: Scene, axis: str) -> None:
    """Begin the first fault; the second one and both ends come at their times."""
    first, second, offset_cycles, _ = parts
    bus, now_ns = scene.session.bus, scene.session.world_ns
    axes = _axes(parts, axis)
    second_ns = now_ns + offset_cycles * CYCLE_NS
    bus.at(second_ns, lambda: second.play.begin(scene, axes[1]))
    for one, begun_ns, its_axis in ((first, now_ns, axes[0]), (second, second_ns, axes[1])):
        ends_ns = begun_ns + round(one.lasts_s * NS_PER_S)
        bus.at(ends_ns, lambda one=one, its_axis=its_axis: one.play.end(scene, its_axis))
    first.play.begin(scene, axes[0])


def _axes(parts: Parts, axis: str) -> tuple[str, str]:
    """The axis of each fault; empty for a fault that belongs to no axis."""
    other = axis
    if parts.on_other_axis and parts.first.of_an_axis:
        leg, _, joint = axis.partition("/")
        other = f"{leg}/{'slide' if joint == 'hip' else 'hip'}"
    return axis if parts.first.of_an_axis else "", other if parts.second.of_an_axis else ""


# --- laws -----------------------------------------------------------------------------------------


def law_of(cell: Cell, exit_code: int | None) -> Law:
    """The law of a cell: its fault's, or that of both faults of a pair.

    Args:
        cell: the cell.
        exit_code: the exit code of its core, which may be that of either fault.
    """
    parts = parts_of(cell.fault)
    if parts is None:
        return law(*cell)
    axes = _axes(parts, cell.axis)
    first, second = (
        law(name, cell.mode, axis) for name, axis in zip(_law_names(parts), axes, strict=True)
    )
    pair_law = both((first, second), cell.mode, parts.offset_cycles, exit_code)
    names = {one.name for one in parts[:2]}
    delay_s = sum(one.lasts_s for one in parts[:2] if one.name in DELAYS)
    within_cycles = pair_law.within_cycles
    if within_cycles is not None:
        within_cycles += delay_s * NS_PER_S / CYCLE_NS
    unlike_a_jump = WITHIN_REACH if delay_s and names & JUMPS else frozenset[Cause]()
    pushed = PUSH in names
    hidden = not parts.on_other_axis and any(
        one.name in JAMS and its_law.may_go_on
        for one, its_law in zip(parts[:2], (first, second), strict=True)
    )
    unheard = CORE_ENDS if parts.on_other_axis else CORE_ENDS | CUT_OFF
    if names >= LOSING:
        pair_law = replace(pair_law, stops=True, may_go_on=True)
    return replace(
        pair_law,
        unreachable=bool(names & REVERSED and names & unheard),
        causes=pair_law.causes | unlike_a_jump,
        within_cycles=within_cycles,
        pushed=pushed,
        may_go_on=pair_law.may_go_on or (pushed and hidden) or names <= OF_PATIENT,
    )


def _law_names(parts: Parts) -> tuple[str, str]:
    """The faults whose laws hold for a pair."""
    first, second = parts.first.name, parts.second.name
    together = ADDING.get(frozenset({first, second}))
    return (first, second) if together is None else (together, together)


def both(laws: tuple[Law, Law], mode: str, offset_cycles: int, exit_code: int | None) -> Law:
    """The law of two faults: what one of them requires holds, what one of them allows may be."""
    stopping = [one for one in laws if one.stops]
    codes = {one.exit_code for one in laws} - {None}
    bounds = [one.within_cycles for one in stopping if not one.may_go_on]
    bounded = bool(bounds) and None not in bounds
    ends_in = laws[0].ends_in | laws[1].ends_in
    untouched = all(one.resting is Resting.UNTOUCHED for one in laws)
    column = COLUMNS[mode]
    return Law(
        stops=bool(stopping),
        causes=frozenset().union(CONSEQUENCES, *(one.causes | one.later for one in stopping)),
        categories=frozenset({S0, S1}).union(*(one.categories for one in stopping)),
        later=frozenset({Cause.STOP_NOT_OBEYED}),
        within_cycles=(
            max(one or 0.0 for one in bounds) + offset_cycles + SLACK_CYCLES if bounded else None
        ),
        by_drives=any(one.by_drives for one in laws),
        runs_away=any(one.runs_away for one in laws),
        may_go_on=all(one.may_go_on for one in stopping),
        resting=Resting.UNTOUCHED if untouched else Resting.EITHER,
        ends_in=ends_in | {column.mode, *column.leads_to} if ends_in else ends_in,
        exit_code=exit_code if exit_code in codes else next(iter(codes), None),
    )


# --- which pairs ----------------------------------------------------------------------------------


def covering(
    fault_kinds: Sequence[str], columns: Mapping[str, Sequence[object]], rng: random.Random
) -> list[dict[str, object]]:
    """Rows of two fault kinds, first and second, and a value of each column.

    Each two kinds are together in at least one row, in one of both orders, and so is each kind
    with each value, and each two values of two columns. Greedy: each column takes the value
    that adds most of the missing pairs.
    """
    kinds = {"first": fault_kinds, "second": fault_kinds}
    missing: set[frozenset[tuple[str, object]]] = set()
    for one, other in combinations({**kinds, **columns}.items(), 2):
        missing |= {_pair((one[0], a), (other[0], b)) for a, b in product(one[1], other[1])}
    order = sorted(missing, key=lambda pair: sorted(map(repr, pair)))
    rng.shuffle(order)
    order.sort(key=lambda pair: {name for name, _ in pair} != {"fault"})
    rows: list[dict[str, object]] = []
    for wanted in order:
        if wanted in missing:
            row = _row(wanted, {**kinds, **columns}, missing, rng)
            missing -= {_pair(one, other) for one, other in combinations(row.items(), 2)}
            rows.append(row)
    return rows


def _pair(one: tuple[str, object], other: tuple[str, object]) -> frozenset[tuple[str, object]]:
    """A pair of values; the two fault kinds are alike."""
    return frozenset(
        ("fault" if name in {"first", "second"} else name, value) for name, value in (one, other)
    )


def _row(
    wanted: frozenset[tuple[str, object]],
    columns: Mapping[str, Sequence[object]],
    missing: set[frozenset[tuple[str, object]]],
    rng: random.Random,
) -> dict[str, object]:
    """A row with the pair that is wanted, in which each other value adds most that is missing."""
    faults = sorted(str(value) for name, value in wanted if name == "fault")
    if len(wanted) == 1:
        faults *= 2  # a kind with itself
    rng.shuffle(faults)
    row = {**dict(zip(("first", "second"), faults, strict=False)), **dict(wanted)}
    row.pop("fault", None)
    for name in (name for name in columns if name not in row):
        values = list(columns[name])
        rng.shuffle(values)
        row[name] = max(
            values,
            key=lambda value, name=name: sum(
                _pair((name, value), pair) in missing for pair in row.items()
            ),
        )
    return row


def sample(seed: int) -> list[Cell]:
    """Pairs that cover each family of faults with each other one, each offset and each mode."""
    rng = random.Random(f"pairs/{seed}")
    columns = {"offset": SAMPLE_OFFSETS, "mode": SAMPLE_MODES}
    return [_drawn(row, rng) for row in covering(tuple(SAMPLE_FAMILIES), columns, rng)]


def _drawn(row: Mapping[str, object], rng: random.Random) -> Cell:
    """Draw the faults of two families."""
    while True:
        first, second = (
            rng.choice(SAMPLE_FAMILIES[str(row[name])]) for name in ("first", "second")
        )
        if not _is_replaced(first, second):
            return _cell(first, second, int(str(row["offset"])), str(row["mode"]), rng)


def every(seed: int) -> list[Cell]:
    """Every fault with every other one in this order, at offsets and in modes in turn."""
    rng = random.Random(f"all pairs/{seed}")
    names = [name for name in FAULTS if name != "none"]
    rows = [pair for pair in product(names, names) if not _is_replaced(*pair)]
    rng.shuffle(rows)
    modes = tuple(COLUMNS)
    return [
        _cell(*pair, OFFSETS[number % len(OFFSETS)], modes[number // 6 % len(modes)], rng)
        for number, pair in enumerate(rows)
    ]


def _is_replaced(first: str, second: str) -> bool:
    return first == second or any({first, second} <= group for group in REPLACING)


def _cell(first: str, second: str, offset_cycles: int, mode: str, rng: random.Random) -> Cell:
    name = f"{first}{rng.choice((SAME, OTHER))}{second}@{offset_cycles}"
    return Cell(name, mode, rng.choice(AXES) if fault_named(name).of_an_axis else "")
