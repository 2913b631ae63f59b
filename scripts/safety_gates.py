"""Safety gates: gated files, the unit tests of each, and branch coverage: `make coverage`.

Every file with code in a gated folder has a row in UNIT_TESTS (`tests/test_safety_gates.py`). The
tests of all rows together must reach every branch of all files. `scripts/mutants.py` changes each
file, and runs the tests of its row for each change.

`make test` runs these tests here only; `make test-all` runs them with compiled kernels, too.
Kernels run as plain Python: what numba compiles is neither traced nor, once cached, changed.
"""

import os
import sys
from pathlib import Path
from typing import Final

PROJECT: Final = Path(__file__).resolve().parent.parent

GATED_FOLDERS: Final = (
    "daemon/core/modes",
    "daemon/core/safety",
    "drives/bringup",
    "drives/cia402",
)

_MODES = "daemon/core/modes"
_SAFETY = "daemon/core/safety"
_CHECKS = (
    *(f"{_SAFETY}/test_safety_checks.py", f"{_SAFETY}/test_every_limit.py"),
    f"{_SAFETY}/test_safety.py",
)
_BRING_UP = (
    "drives/test_bringup.py",
    "drives/test_boot_failures.py",
    "drives/test_bringup_plan.py",
    "drives/test_bringup_rules.py",
)

UNIT_TESTS: Final[dict[str, tuple[str, ...]]] = {
    "daemon/core/inputs.py": ("daemon/core/test_inputs.py",),
    "daemon/core/modes/daily_test.py": (f"{_MODES}/test_daily_test.py",),
    "daemon/core/exercises/guards.py": (f"{_MODES}/test_modes.py", f"{_MODES}/test_modes_table.py"),
    "daemon/core/modes/latched_stop.py": (f"{_MODES}/test_latched_stop.py",),
    "daemon/core/modes/persistent_state.py": (f"{_MODES}/test_persistent_state.py",),
    "daemon/core/modes/roles.py": (f"{_MODES}/test_roles.py",),
    "daemon/core/modes/table.py": (f"{_MODES}/test_modes.py", f"{_MODES}/test_modes_table.py"),
    "daemon/core/motion/assist.py": ("daemon/core/motion/test_assist.py",),
    "daemon/core/safety/bounds.py": (
        *(f"{_SAFETY}/test_safety_checks.py", f"{_SAFETY}/test_safety.py"),
        f"{_SAFETY}/test_safety_bounds.py",
    ),
    "daemon/core/safety/checks.py": _CHECKS,
    "daemon/core/safety/clonus.py": (f"{_SAFETY}/test_clonus.py",),
    "daemon/core/safety/sign_response.py": (f"{_SAFETY}/test_sign_response.py",),
    "daemon/core/safety/effort_monitor.py": (f"{_SAFETY}/test_effort_monitor.py",),
    "daemon/core/safety/energy.py": (f"{_SAFETY}/test_effort_monitor.py",),
    "daemon/core/safety/friction_monitor.py": (f"{_SAFETY}/test_friction_monitor.py",),
    "daemon/core/safety/inputs.py": _CHECKS,
    "daemon/core/safety/inverse_dynamics.py": (f"{_SAFETY}/test_effort_monitor.py",),
    "daemon/core/safety/joints.py": (f"{_SAFETY}/test_joints.py",),
    "daemon/core/safety/limits.py": (f"{_SAFETY}/test_limits.py", *_CHECKS),
    "daemon/core/safety/soft_limits.py": (f"{_SAFETY}/test_soft_limits.py",),
    "daemon/core/safety/spasm.py": (f"{_SAFETY}/test_spasm.py",),
    "daemon/core/safety/stop_sequence.py": (f"{_SAFETY}/test_stop_sequence.py",),
    "daemon/core/safety/stopping_path.py": (
        f"{_SAFETY}/test_stopping_path.py",
        f"{_SAFETY}/test_soft_limits.py",
    ),
    "daemon/core/steps/bring_up.py": ("daemon/core/steps/test_bring_up.py",),
    "daemon/core/steps/supervisor.py": (
        "daemon/core/steps/test_supervisor_rules.py",
        "daemon/core/steps/test_supervisor.py",
    ),
    "daemon/gateway/clients.py": ("daemon/gateway/test_clients.py",),
    "daemon/gateway/lease.py": ("daemon/gateway/test_lease.py",),
    "daemon/gateway/lease_control.py": ("daemon/gateway/test_setpoints.py",),
    "daemon/gateway/setpoints.py": ("daemon/gateway/test_setpoints.py",),
    "drives/bringup/bringup.py": ("drives/test_bringup_rules.py",),
    "drives/bringup/bus_load.py": ("drives/test_busload.py",),
    "drives/bringup/configurator.py": ("drives/test_configurator.py", "drives/test_sdo_client.py"),
    "drives/bringup/objects.py": _BRING_UP,
    "drives/bringup/plan.py": ("drives/test_plan_golden.py", *_BRING_UP),
    "drives/bringup/port.py": _BRING_UP,
    "drives/bringup/presence.py": ("drives/test_presence.py", *_BRING_UP),
    "drives/bringup/steps.py": ("drives/test_plan_golden.py", *_BRING_UP),
    "drives/cia402/axis_file.py": (
        *("drives/test_units.py", "drives/test_torque.py", "drives/test_profile.py"),
    ),
    "drives/cia402/drive.py": ("drives/test_drive.py",),
    "drives/cia402/emergencies.py": ("drives/test_nmt_emcy.py", "drives/test_profile.py"),
    "drives/cia402/homing.py": ("drives/test_profile.py",),
    "drives/cia402/option_codes.py": ("drives/test_option_codes.py",),
    "drives/cia402/pdo.py": ("drives/test_pdo.py", "drives/test_profile.py"),
    "drives/cia402/power_state.py": ("drives/test_cia402.py",),
    "drives/cia402/profile.py": ("drives/test_torque.py", "drives/test_profile.py"),
    "drives/cia402/sources.py": ("drives/test_sources.py", "drives/test_profile.py"),
    "drives/cia402/temperature.py": ("drives/test_temperature.py",),
    "drives/cia402/torque.py": ("drives/test_torque.py",),
    "drives/cia402/units.py": ("drives/test_units.py", "drives/test_torque.py"),
}
"""The gated files, and their unit tests under `tests`, the quick ones first."""


def without_compiled_kernels() -> None:
    """Make numba leave kernels as they are; to be called before its first import."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"


def ignored() -> str:
    """Options with which pytest leaves out the files that the gate runs as a whole."""
    tests = {test for tests in UNIT_TESTS.values() for test in tests}
    return " ".join(f"--ignore=tests/{test}" for test in sorted(tests))


def main() -> int:
    """Run the unit tests of all gated files; 0 only if they pass and reach every branch."""
    import coverage  # noqa: PLC0415 - `scripts/mutants.py` needs only the tables
    import pytest  # noqa: PLC0415

    os.chdir(PROJECT)
    without_compiled_kernels()
    tests = {f"tests/{test}" for tests in UNIT_TESTS.values() for test in tests}
    measured = coverage.Coverage(include=list(UNIT_TESTS))
    with measured.collect():
        code = pytest.main(["-q", *sorted(tests)])
    if code:
        return int(code)
    found = {
        Path(file).relative_to(PROJECT).as_posix() for file in measured.get_data().measured_files()
    }
    untouched = sorted(set(UNIT_TESTS) - found)
    if untouched:
        print("no test imports", *untouched)
    return int(measured.report(skip_covered=True) < 100 or bool(untouched))


if __name__ == "__main__":
    if sys.argv[1:] == ["--ignored"]:
        print(ignored())
    else:
        sys.exit(main())
