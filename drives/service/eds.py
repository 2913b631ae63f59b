"""Check of a plan against the EDS: the data sheet must define every object that bring-up uses.

For `gaitd check`, without any bus. The file is read by canopen; the virtual drives read the same
file with a parser of their own, so a parser error does not cancel out. Checked are existence,
width, sign, access and range of what is read and written, constants in the file (identity, modes),
and whether the objects of the PDOs can be mapped.
"""

import configparser
from dataclasses import replace
from pathlib import Path
from typing import Final

import canopen
from canopen.objectdictionary import SIGNED_TYPES, ObjectDictionary, ODVariable

from drives.bringup.plan import DrivePlan
from drives.bringup.steps import Step, StepKind
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


def load_eds(path: str, node_id: int) -> ObjectDictionary:
    """Read an EDS.

    Raises:
        DescriptionError: the file is missing, or is no EDS.
    """
    try:
        with Path(path).open(encoding=_encoding(Path(path))) as file:
            return canopen.import_od(file, node_id)
    except (OSError, ValueError, KeyError, configparser.Error) as error:
        what = " ".join(str(error).split())
        allowed = f"a readable EDS file: {type(error).__name__}: {what}"
        raise DescriptionError("axis", "eds", path, allowed) from error


def _encoding(path: Path) -> str:
    """Encoding of the file: CiA 306 requires ASCII, but many files use a Windows code page."""
    try:
        path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def objections(plan: DrivePlan, dictionary: ObjectDictionary) -> list[str]:
    """List the conflicts between plan and EDS, one line per object; empty without any."""
    steps = [part for step in plan.steps for part in _parts(step)]
    found = [_objection(step, dictionary) for step in steps]
    pdos = layouts(plan.description.profile, plan.description.node_id)
    found += [
        _mapping_objection(item, str(layout), dictionary)
        for layout in pdos
        for item in layout.objects
    ]
    has = plan.description.profile.optional_objects
    if not has.polarity and Object.POLARITY in dictionary:
        found.append("607Eh:00 is in the EDS, but optional_objects.polarity is false")
    return list(dict.fromkeys(line for line in found if line is not None))


def unused(has: OptionalObjects, dictionary: ObjectDictionary) -> list[str]:
    """Protective objects in the EDS that the profile declares absent."""
    return [
        name
        for name, index in _PROTECTIVE.items()
        if not getattr(has, name) and index in dictionary
    ]


def _parts(step: Step) -> tuple[Step, ...]:
    """Split a range into its two objects; a step without an object gives none."""
    if step.kind is StepKind.RANGE:
        upper = replace(step, sub=step.sub + 1, value=step.second)
        return step, upper
    return (step,) if step.kind in _READ | _WRITTEN else ()


def _objection(step: Step, dictionary: ObjectDictionary) -> str | None:
    variable = dictionary.get_variable(step.index, step.sub)
    if variable is None:
        absent_is_well = step.kind is StepKind.CLEAR
        return None if absent_is_well else f"{step.place} is not in the EDS ({step.why})"
    if len(variable) != step.bits:
        return f"{step.place} has {len(variable)} bits in the EDS, not {step.bits} ({step.why})"
    if step.kind in _WRITTEN and not variable.writable:
        return f"{step.place} cannot be written by the EDS ({step.why})"
    if step.kind is StepKind.CHECK:
        return _other_value(step, variable)
    judged = step.kind in _WITH_VALUE and step.index not in _RANGE_NOT_JUDGED
    return _out_of_range(step, variable) if judged else None


def _other_value(step: Step, variable: ODVariable) -> str | None:
    """Conflict with a constant in the EDS, if it has one; many files leave it empty, or 0."""
    told = variable.default
    if variable.writable or not told or told & step.mask == step.value:
        return None
    expected = f"expected {step.value_text(step.value)} ({step.why})"
    return f"{step.place} is {step.value_text(told)} in the EDS, {expected}"


def _out_of_range(step: Step, variable: ODVariable) -> str | None:
    low, high = variable.min, variable.max
    if (low is not None and step.value < low) or (high is not None and step.value > high):
        return f"{step.place} = {step.value} is outside {low} .. {high} of the EDS ({step.why})"
    return None


def _mapping_objection(item: MappedObject, layout: str, dictionary: ObjectDictionary) -> str | None:
    place = f"{item.index:04X}h:{item.sub:02X}"
    variable = dictionary.get_variable(item.index, item.sub)
    if variable is None:
        return f"{place} is not in the EDS ({layout} carries it)"
    if len(variable) != item.bits:
        return f"{place} has {len(variable)} bits in the EDS, not {item.bits} ({layout} carries it)"
    if (variable.data_type in SIGNED_TYPES) != item.signed:
        sign = "no sign" if item.signed else "a sign"
        return f"{place} has {sign} in the EDS ({layout} carries it)"
    if not variable.pdo_mappable:
        return f"{place} cannot be mapped by the EDS ({layout} carries it)"
    return None
