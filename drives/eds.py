"""Plan against EDS: does the drive's data sheet know every object that bring-up will touch?

For `gaitd check`, without any bus. The file is read by canopen; the virtual drives read the same
file with a parser of their own, so a misreading does not cancel out.
"""

import configparser
from typing import Final

import canopen
from canopen.objectdictionary import ObjectDictionary, ODVariable

from drives.errors import DescriptionError
from drives.plan import DrivePlan, Step, StepKind

_READ: Final = frozenset((StepKind.CHECK, StepKind.COMPARE, StepKind.REPORT))
_WRITTEN: Final = frozenset(
    (StepKind.WRITE, StepKind.RANGE, StepKind.SWITCH_OFF, StepKind.SEED_POSITION)
)


def load_eds(path: str, node_id: int) -> ObjectDictionary:
    """Read an EDS.

    Raises:
        DescriptionError: it is not there, or is none.
    """
    try:
        return canopen.import_od(path, node_id)
    except (OSError, ValueError, KeyError, configparser.Error) as error:
        allowed = f"a readable EDS file: {type(error).__name__}: {error}"
        raise DescriptionError("axis", "eds", path, allowed) from error


def objections(plan: DrivePlan, dictionary: ObjectDictionary) -> list[str]:
    """What the EDS has against the plan, one line for each object; empty if nothing."""
    found = (_objection(step, dictionary) for step in plan.steps if step.kind in _READ | _WRITTEN)
    return [line for line in found if line is not None]


def _objection(step: Step, dictionary: ObjectDictionary) -> str | None:
    variable = dictionary.get_variable(step.index, step.sub)
    if variable is None:
        return f"{step.place} is not in the EDS ({step.why})"
    if len(variable) != step.bits:
        return f"{step.place} has {len(variable)} bits in the EDS, not {step.bits} ({step.why})"
    if step.kind in _WRITTEN and not variable.writable:
        return f"{step.place} cannot be written by the EDS ({step.why})"
    return _out_of_range(step, variable) if step.kind is StepKind.WRITE else None


def _out_of_range(step: Step, variable: ODVariable) -> str | None:
    low, high = variable.min, variable.max
    if (low is not None and step.value < low) or (high is not None and step.value > high):
        return f"{step.place} = {step.value} is outside {low} .. {high} of the EDS ({step.why})"
    return None
