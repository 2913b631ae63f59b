"""Each part of the core's state is written in one module, each slice is made in one module."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from daemon import core
from daemon.core import slices
from daemon.core.state import Axis, Core, Leg

FOLDER = Path(core.__file__).parent
WRITERS = {
    "steps/supervisor.py": """mode verdict causes_reported disabling drives load_checked
        load_settle_cycles bring_up reset_cycles_left reset_settle_cycles stop""",
    "steps/requests.py": "request result",
    "steps/exercises.py": "exercise reference takes_over",
    "steps/single_axis.py": "single_axis evidence",
    "steps/sensing.py": "scaling serial_number",
    "steps/monitors.py": "energy residual spasm clonus",
    "steps/persistence.py": "persistent utc_newest_ns self_test_due inputs_untested sign_proven",
    "cycle_record.py": "seq events",
}
"""Fields of the state by the module that writes them. All other fields never change."""
SLICES = {
    "Inputs": ("inputs", "inputs.py"),
    "Passive": ("passive", "steps/passive.py"),
    "Placed": ("placed", "steps/sensing.py"),
    "Sensed": ("sensed", "steps/sensing.py"),
    "Estimated": ("estimated", "steps/estimation.py"),
    "LegAssist": ("assist", "steps/controllers.py"),
    "Assisted": ("assisted", "steps/controllers.py"),
    "Monitored": ("monitored", "steps/monitors.py"),
    "Softened": ("softened", "steps/monitors.py"),
    "Sent": ("sent", "steps/targets.py"),
}
"""Frozen slices: the field of the state that has it, and the module that makes it."""
KEEPERS = {"cycle.py", "steps/bring_up.py", "steps/supervisor.py"}
"""Other modules that put a slice into its field, as its maker has returned it."""
CHANGING_CALLS = frozenset({"append", "add", "clear", "extend", "pop", "reset", "update"})
FIELDS = frozenset(field.name for kind in (Core, Leg, Axis) for field in fields(kind))


def attributes(target: ast.expr) -> Iterator[ast.Attribute]:
    match target:
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            for part in parts:
                yield from attributes(part)
        case ast.Subscript(value=value) | ast.Starred(value=value):
            yield from attributes(value)
        case ast.Attribute():
            yield target
        case _:
            pass


def written(tree: ast.AST) -> Iterator[str]:
    """Names of the attributes of others that a module assigns, or changes by a call."""
    for node in ast.walk(tree):
        targets: list[ast.expr] = []
        match node:
            case ast.Assign(targets=several) | ast.Delete(targets=several):
                targets = several
            case ast.AugAssign(target=one) | ast.AnnAssign(target=one) | ast.For(target=one):
                targets = [one]
            case ast.NamedExpr(target=one):
                targets = [one]
            case ast.Call(func=ast.Attribute(value=value, attr=name)) if name in CHANGING_CALLS:
                targets = [value]
            case ast.Call(func=ast.Name(id="setattr"), args=[_, ast.Constant(value=str(name)), *_]):
                yield name
            case _:
                pass
        for target in targets:
            for attribute in attributes(target):
                if not (isinstance(attribute.value, ast.Name) and attribute.value.id == "self"):
                    yield attribute.attr


def writers(folder: Path) -> dict[str, set[str]]:
    """The modules that write each field of the state."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in folder.rglob("*.py"):
        for name in written(ast.parse(path.read_text(encoding="utf-8"))):
            if name in FIELDS:
                found[name].add(path.relative_to(folder).as_posix())
    return found


def test_each_part_of_the_state_is_written_in_one_module() -> None:
    expected = {name: {module} for module, names in WRITERS.items() for name in names.split()}
    found = writers(FOLDER)
    kept = {maker: found.pop(name) for name, maker in SLICES.values()}

    assert dict(found) == expected
    assert all(modules <= {maker, *KEEPERS} for maker, modules in kept.items())


def makers(folder: Path) -> dict[str, set[str]]:
    """The modules that make each slice: by its class, or from the one in the state."""
    fields_of = {field: kind for kind, (field, _) in SLICES.items()}
    found: dict[str, set[str]] = defaultdict(set)
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(func=ast.Name(id=kind)) if kind in SLICES:
                    found[kind].add(path.relative_to(folder).as_posix())
                case ast.Call(
                    func=ast.Name(id="replace"), args=[ast.Attribute(attr=field), *_]
                ) if field in fields_of:
                    found[fields_of[field]].add(path.relative_to(folder).as_posix())
                case _:
                    pass
    return found


def test_each_slice_is_made_in_one_module_and_is_frozen() -> None:
    assert all(modules == {SLICES[kind][1]} for kind, modules in makers(FOLDER).items())
    assert all(getattr(slices, kind).__struct_config__.frozen for kind in SLICES)


@pytest.mark.parametrize(
    "statement", ["Estimated(bad_cycles=1)", "x = replace(leg.estimated, bad_cycles=1)"]
)
def test_a_second_maker_is_found(tmp_path: Path, statement: str) -> None:
    (tmp_path / "planted.py").write_text(statement)

    assert makers(tmp_path) == {"Estimated": {"planted.py"}}


@pytest.mark.parametrize(
    "statement",
    [
        "core.mode = Mode.HOLD",
        "core.mode, x = Mode.HOLD, 1",
        "for core.mode in modes: pass",
        "core.causes_reported.add(1)",
        "core.evidence[3] += 1",
        "setattr(core, 'mode', Mode.HOLD)",
        "del core.events[:8]",
    ],
)
def test_a_second_writer_is_found(tmp_path: Path, statement: str) -> None:
    (tmp_path / "planted.py").write_text(statement)

    assert list(writers(tmp_path).values()) == [{"planted.py"}]
