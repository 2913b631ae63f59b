"""The tables of docs/bits.md: status bits of an estimate, statusword and controlword of a drive.

Names and values are those of the code; meanings are the texts below each name, which Python keeps
in the source only.
"""

import ast
import inspect
import re
from collections.abc import Iterator
from itertools import pairwise
from types import ModuleType
from typing import Final, cast

from gaitd_names import StatusBit

from analysis import markdown
from drives.cia402 import power_state
from drives.signals import PowerRequest, PowerState
from observer.filter.status import Status

HOMING_BITS: Final = ("STATUS_TARGET_REACHED", "STATUS_HOMING_ATTAINED", "STATUS_HOMING_ERROR")
WORDS: Final = (
    "SHUTDOWN",
    "SWITCH_ON",
    "ENABLE_OPERATION",
    "START_HOMING",
    "HALT",
    "QUICK_STOP",
    "DISABLE_VOLTAGE",
    "FAULT_RESET",
)


def parts() -> dict[str, str]:
    """Return the generated parts of docs/bits.md by name."""
    return {
        "estimate": _estimate(),
        "states": _states(),
        "statusword": _statusword(),
        "homing": _homing(),
        "controlword": _controlword(),
        "requests": _requests(),
    }


def _estimate() -> str:
    set_when, shown = _texts(Status), _texts(StatusBit)
    rows = (
        (f"{number}", f"`0x{bit:04X}`", f"`{StatusBit[name]}`", set_when[name], shown[name])
        for number, (name, bit) in enumerate(Status.__members__.items())
    )
    return markdown.table(("bit", "mask", "name", "it is set when", "a display does"), rows)


def _states() -> str:
    texts = _texts(PowerState)
    rows = ((f"`{state.name.lower()}`", _pattern(state), texts[state.name]) for state in PowerState)
    return markdown.table(("power state", "bits 6 to 0 of 6041h", "meaning"), rows)


def _pattern(state: PowerState) -> str:
    """Bits that all words of a state share; x: either."""
    words = [word for word in range(0x80) if power_state.decode_statusword(word) is state]
    if state is PowerState.UNKNOWN:
        return "any other"
    digits = ({word >> bit & 1 for word in words} for bit in reversed(range(7)))
    return "`" + "".join(str(*one) if len(one) == 1 else "x" for one in digits) + "`"


def _statusword() -> str:
    texts = _texts(power_state)
    names = ("STATUS_WARNING", "STATUS_FOLLOWS", *HOMING_BITS)
    rows = ((f"`0x{vars(power_state)[name]:04X}`", texts[name]) for name in names)
    return markdown.table(("mask", "meaning"), rows)


def _homing() -> str:
    rows = (
        (*("1" if one else "0" for one in bits), state.value)
        for bits, state in power_state.HOMING_STATES.items()
    )
    return markdown.table(("bit 10", "bit 12", "bit 13", "homing"), rows)


def _controlword() -> str:
    texts = _texts(power_state)
    rows = (
        (f"`0x{vars(power_state)[name]:04X}`", name.lower().replace("_", " "), texts[name])
        for name in WORDS
    )
    return markdown.table(("6040h", "word", "what it asks of the drive"), rows)


def _requests() -> str:
    """The word of each request in each state, in a request's first cycle."""
    requests = [one for one in PowerRequest if one is not PowerRequest.FAULT_RESET]
    head = ("the drive shows", *(f"`{one.value}`" for one in requests))
    rows = (
        (f"`{state.name.lower()}`", *(_word(state, request) for request in requests))
        for state in PowerState
    )
    return markdown.table(head, rows)


def _word(state: PowerState, request: PowerRequest) -> str:
    sent = power_state.next_word(state, request, power_state.Sent(), resume=False)
    return f"`0x{sent.controlword:04X}`"


def _texts(of: type | ModuleType) -> dict[str, str]:
    """Texts below the names that a class or a module sets; empty where there is none."""
    tree = ast.parse(inspect.getsource(of))
    body = cast("ast.ClassDef", tree.body[0]).body if isinstance(of, type) else tree.body
    return dict(_named(body))


def _named(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    for before, node in pairwise([*body, ast.Pass()]):
        match before:
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                pass
            case _:
                continue
        match node:
            case ast.Expr(value=ast.Constant(value=str() as text)):
                yield name, re.sub(r"\s+", " ", text)
            case _:
                yield name, ""
