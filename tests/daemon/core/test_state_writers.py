"""Each part of the core's state is written in one module."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from daemon import core
from daemon.core.state import Axis, Core, Leg

FOLDER = Path(core.__file__).parent
WRITERS = {
    "steps/supervisor.py": """mode verdict causes_reported disabling drives load_checked
        load_settle_cycles bring_up reset_cycles_left reset_settle_cycles stop""",
    "steps/requests.py": "request result",
    "steps/exercises.py": "exercise reference takes_over",
    "steps/single_axis.py": "single_axis evidence",
    "steps/sensing.py": """feedback joint referenced followed doubt scaling serial_number
        watched sign_trusted held_cycles shown_unpowered reached_enabled unready_cycles
        unexpected_enable_cycles emergencies_checked bring_up_error
        gravity_si tracking_si wanted_velocity_si singularity_ratio""",
    "steps/estimation.py": """estimate measured effort_used artificial observer_started
        observer_bad_cycles observer stride stride_count smoother strides drift
        calibration_advised""",
    "steps/monitors.py": """watch energy residual stopping_end_si spasm dynamics zone
        stopping_ratio spasm_ratio clonus clonus_ratio last_wanted_velocity window_cycles""",
    "steps/controllers.py": """assist assist_si stiffness_ratio torque_lease assist_cap_si
        lapse_count lapse_reason setpoint_accepted_count setpoint_refused_count""",
    "steps/targets.py": """mode_sent effort_sent_si position_sent_si effort_offset_si
        effort_mean_si position_offset_si speed_sent_si acceleration_sent_si""",
    "steps/persistence.py": "persistent utc_newest_ns self_test_due inputs_untested sign_proven",
    "inputs.py": "gateway_state_seq gateway_state_cycle setpoints lease lease_dropped stop_count",
    "cycle_record.py": "seq events",
}
"""Fields of the state by the module that writes them. All other fields never change."""
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
    for name in ("observer", "smoother"):
        found[name] -= {"runtime/warm_up.py"}  # of a core that is discarded

    assert dict(found) == expected


@pytest.mark.parametrize(
    "statement",
    [
        "core.mode = Mode.HOLD",
        "core.mode, x = Mode.HOLD, 1",
        "for core.mode in modes: pass",
        "core.causes_reported.add(1)",
        "core.setpoint_refused_count[3] += 1",
        "setattr(core, 'mode', Mode.HOLD)",
        "del core.events[:8]",
    ],
)
def test_a_second_writer_is_found(tmp_path: Path, statement: str) -> None:
    (tmp_path / "planted.py").write_text(statement)

    assert list(writers(tmp_path).values()) == [{"planted.py"}]
