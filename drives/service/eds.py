"""Check of a plan against the EDS: the data sheet must define every object that bring-up uses.

For `gaitd check`, without any bus. Checked are existence, width, sign, access and range of what is
read and written, constants in the file (identity, modes), and whether the objects of the PDOs can
be mapped. A line of the file that cannot be meant as written is an objection where bring-up needs
it, and a note elsewhere.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from drives.bringup.plan import DrivePlan
from drives.bringup.steps import Step, StepKind
from drives.canopen.data_sheet import DataSheet, DataSheetError, Variable, read
from drives.canopen.objects import Object
from drives.cia402.pdo import MappedObject, layouts
from drives.cia402.profile import OptionalObjects
from drives.errors import DescriptionError

_READ: Final = frozenset((StepKind.CHECK, StepKind.COMPARE, StepKind.REPORT))
_WRITTEN: Final = frozenset(
    (
        StepKind.WRITE,
        StepKind.CLEAR,
        StepKind.RANGE,
        StepKind.SWITCH_OFF,
        StepKind.SEED_POSITION,
    )
)
_WITH_VALUE: Final = frozenset((StepKind.WRITE, StepKind.RANGE))
_RANGE_NOT_JUDGED: Final = frozenset((Object.HEARTBEAT_CONSUMER,))
"""An entry of 1016h is a node id and a time; Elmo's file gives the range of the time alone."""
_PROTECTIVE: Final = {
    "interpolation_time": Object.INTERPOLATION_TIME,
    "position_limits": Object.POSITION_LIMITS,
    "speed_limit": Object.SPEED_LIMIT,
    "following_error": Object.FOLLOWING_WINDOW,
}


def load_eds(path: str, node_id: int) -> DataSheet:
    """Read an EDS or a DCF.

    Raises:
        DescriptionError: the file cannot be opened, or describes no object.
    """
    try:
        return read(Path(path), node_id)
    except OSError as error:
        allowed = f"a readable EDS file ({(error.strerror or 'cannot be read').lower()})"
        raise DescriptionError("axis", "eds", path, allowed) from error
    except DataSheetError as error:
        raise DescriptionError("axis", "eds", path, f"a readable EDS file: {error}") from error


def objections(plan: DrivePlan, sheet: DataSheet) -> list[str]:
    """List the conflicts between plan and EDS, one line per object; empty without any."""
    steps = [part for step in plan.steps for part in _parts(step)]
    found = [_objection(step, sheet) for step in steps]
    pdos = layouts(plan.description.profile, plan.description.node_id)
    found += [
        _mapping_objection(item, str(layout), sheet) for layout in pdos for item in layout.objects
    ]
    has = plan.description.profile.optional_objects
    if not has.polarity and sheet.has(Object.POLARITY):
        found.append("607Eh:00 is in the EDS, but optional_objects.polarity is false")
    return list(dict.fromkeys(line for line in found if line is not None))


def unused(has: OptionalObjects, sheet: DataSheet) -> list[str]:
    """Protective objects in the EDS that the profile declares absent."""
    return [
        name for name, index in _PROTECTIVE.items() if not getattr(has, name) and sheet.has(index)
    ]


def doubtful(sheet: DataSheet, told: Sequence[str]) -> str | None:
    """The lines of the EDS that cannot be meant as written, but for those of the objections."""
    faults = [str(one) for one in sheet.faults if not any(str(one) in line for line in told)]
    if not faults:
        return None
    more = f", and {len(faults) - 1} more lines" if len(faults) > 1 else ""
    return f"its EDS has a line that nothing uses and that cannot be meant so: {faults[0]}{more}"


def _parts(step: Step) -> tuple[Step, ...]:
    """Split a range into its two objects; a step without an object gives none."""
    if step.kind is StepKind.RANGE:
        upper = replace(step, sub=step.sub + 1, value=step.second)
        return step, upper
    return (step,) if step.kind in _READ | _WRITTEN else ()


def _objection(step: Step, sheet: DataSheet) -> str | None:
    variable = sheet.get(step.index, step.sub)
    if variable is None:
        absent_is_well = step.kind is StepKind.CLEAR
        return None if absent_is_well else f"{step.place} is not in the EDS ({step.why})"
    if (fault := variable.fault_in("DataType")) is not None:
        return f"{step.place}: {fault} ({step.why})"
    if (bits := _integer_bits(variable)) != step.bits:
        return f"{step.place} has {bits} bits in the EDS, not {step.bits} ({step.why})"
    judged = step.kind in _WITH_VALUE and step.index not in _RANGE_NOT_JUDGED
    keys = ["AccessType"] if step.kind in _WRITTEN else []
    keys += ["DefaultValue"] if step.kind is StepKind.CHECK else []
    keys += ["LowLimit", "HighLimit"] if judged else []
    if (fault := variable.fault_in(*keys)) is not None:
        return f"{step.place}: {fault} ({step.why})"
    if step.kind in _WRITTEN and not variable.writable:
        return f"{step.place} cannot be written by the EDS ({step.why})"
    if step.kind is StepKind.CHECK:
        return _other_value(step, variable)
    return _out_of_range(step, variable) if judged else None


def _integer_bits(variable: Variable) -> int:
    """Width of an integer; 0 for every other type."""
    return variable.bits if variable.is_integer else 0


def _other_value(step: Step, variable: Variable) -> str | None:
    """Conflict with a constant in the EDS, if it has one; many files leave it empty, or 0."""
    told = variable.default
    if variable.writable or not isinstance(told, int) or told == 0:
        return None
    if told & step.mask == step.value:
        return None
    expected = f"expected {step.value_text(step.value)} ({step.why})"
    return f"{step.place} is {step.value_text(told)} in the EDS, {expected}"


def _out_of_range(step: Step, variable: Variable) -> str | None:
    low, high = variable.low, variable.high
    if (low is not None and step.value < low) or (high is not None and step.value > high):
        return f"{step.place} = {step.value} is outside {low} .. {high} of the EDS ({step.why})"
    return None


def _mapping_objection(item: MappedObject, layout: str, sheet: DataSheet) -> str | None:
    place = f"{item.index:04X}h:{item.sub:02X}"
    variable = sheet.get(item.index, item.sub)
    if variable is None:
        return f"{place} is not in the EDS ({layout} carries it)"
    if (fault := variable.fault_in("DataType", "PDOMapping")) is not None:
        return f"{place}: {fault} ({layout} carries it)"
    if (bits := _integer_bits(variable)) != item.bits:
        return f"{place} has {bits} bits in the EDS, not {item.bits} ({layout} carries it)"
    if variable.signed != item.signed:
        sign = "no sign" if item.signed else "a sign"
        return f"{place} has {sign} in the EDS ({layout} carries it)"
    if not variable.mappable:
        return f"{place} cannot be mapped by the EDS ({layout} carries it)"
    return None
