"""Safety gates: gated files, the unit tests of each, and branch coverage: `make coverage`.

Every file with code in a gated folder has a row in UNIT_TESTS (`tests/test_safety_gates.py`). The
tests of all rows together must reach every branch of all files, those of Hypothesis not counted:
tracing these costs most, and which branch is drawn may change. `scripts/mutants.py` changes each
file, and runs the tests of its row for each change.

`make test` runs these tests here only; `make test-all` runs them with compiled kernels, too.
Kernels run as plain Python: what numba compiles is neither traced nor, once cached, changed.
"""

import os
import sys
from collections.abc import Generator
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import Final

PROJECT: Final = Path(__file__).resolve().parent.parent

GATED_FOLDERS: Final = (
    "daemon/core/exercises",
    "daemon/core/modes",
    "daemon/core/runtime",
    "daemon/core/safety",
    "daemon/core/steps",
    "daemon/ipc",
    "drives/bringup",
    "drives/cia402",
)

_EXERCISES = "daemon/core/exercises"
_MODES = "daemon/core/modes"
_MOTION = "daemon/core/motion"
_RUNTIME = "daemon/core/runtime"
_SAFETY = "daemon/core/safety"
_STEPS = "daemon/core/steps"
_BEGUN = f"{_EXERCISES}/test_requests.py", f"{_MOTION}/test_trajectory.py"
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
_SUPERVISOR = f"{_STEPS}/test_supervisor_rules.py", f"{_STEPS}/test_supervisor.py"

UNIT_TESTS: Final[dict[str, tuple[str, ...]]] = {
    "daemon/core/inputs.py": ("daemon/core/test_inputs.py",),
    "daemon/core/exercises/approach.py": _BEGUN,
    "daemon/core/exercises/excite.py": _BEGUN,
    "daemon/core/exercises/exercise.py": _BEGUN,
    "daemon/core/exercises/gait.py": _BEGUN,
    "daemon/core/exercises/guards.py": (f"{_MODES}/test_modes.py", f"{_MODES}/test_modes_table.py"),
    "daemon/core/exercises/hand_guiding.py": (f"{_EXERCISES}/test_hand_guiding.py",),
    "daemon/core/exercises/hold.py": _BEGUN,
    "daemon/core/exercises/homing.py": (f"{_MOTION}/test_single_axis.py",),
    "daemon/core/exercises/self_test.py": (
        *(f"{_EXERCISES}/test_self_test.py", f"{_MOTION}/test_trajectory.py"),
    ),
    "daemon/core/exercises/sign_test.py": (f"{_MOTION}/test_single_axis.py",),
    "daemon/core/exercises/single_axis.py": (f"{_MOTION}/test_single_axis.py",),
    "daemon/core/exercises/torque.py": _BEGUN,
    "daemon/core/modes/daily_test.py": (f"{_MODES}/test_daily_test.py",),
    "daemon/core/modes/latched_stop.py": (f"{_MODES}/test_latched_stop.py",),
    "daemon/core/modes/persistent_state.py": (f"{_MODES}/test_persistent_state.py",),
    "daemon/core/modes/roles.py": (f"{_MODES}/test_roles.py",),
    "daemon/core/modes/table.py": (f"{_MODES}/test_modes.py", f"{_MODES}/test_modes_table.py"),
    "daemon/core/motion/assist.py": (f"{_MOTION}/test_assist.py",),
    "daemon/core/runtime/arrivals.py": (f"{_RUNTIME}/test_arrivals.py",),
    "daemon/core/runtime/bring_up.py": (f"{_RUNTIME}/test_bring_up_attempts.py",),
    "daemon/core/runtime/build.py": (f"{_RUNTIME}/test_build.py",),
    "daemon/core/runtime/bus_link.py": (f"{_RUNTIME}/test_bus_link.py",),
    "daemon/core/runtime/bus_load.py": (f"{_RUNTIME}/test_bus_load.py",),
    "daemon/core/runtime/commands.py": (f"{_RUNTIME}/test_commands.py",),
    "daemon/core/runtime/grid.py": (f"{_RUNTIME}/test_grid.py",),
    "daemon/core/runtime/loop.py": (f"{_RUNTIME}/test_loop.py",),
    "daemon/core/runtime/loop_settings.py": (f"{_RUNTIME}/test_loop.py",),
    "daemon/core/runtime/process.py": (f"{_RUNTIME}/test_process.py",),
    "daemon/core/runtime/realtime.py": (f"{_RUNTIME}/test_requests_to_the_kernel.py",),
    "daemon/core/runtime/shutdown.py": (f"{_RUNTIME}/test_shutdown.py",),
    "daemon/core/runtime/state_file.py": (f"{_RUNTIME}/test_state_file.py",),
    "daemon/core/runtime/sync_window.py": (f"{_RUNTIME}/test_sync_window.py",),
    "daemon/core/runtime/systemd.py": (f"{_RUNTIME}/test_systemd.py",),
    "daemon/core/runtime/texts.py": (f"{_RUNTIME}/test_systemd.py",),
    "daemon/core/runtime/warm_up.py": (f"{_RUNTIME}/test_build.py",),
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
    "daemon/core/steps/bring_up.py": (f"{_STEPS}/test_bring_up.py",),
    "daemon/core/steps/checking.py": (f"{_STEPS}/test_checking.py",),
    "daemon/core/steps/controllers.py": (f"{_STEPS}/test_controllers.py",),
    "daemon/core/steps/estimation.py": (f"{_STEPS}/test_estimation.py",),
    "daemon/core/steps/exercises.py": (f"{_STEPS}/test_exercises.py",),
    "daemon/core/steps/impedance.py": (f"{_STEPS}/test_impedance.py",),
    "daemon/core/steps/monitors.py": (f"{_STEPS}/test_monitors.py",),
    "daemon/core/steps/passive.py": (f"{_STEPS}/test_passive.py",),
    "daemon/core/steps/persistence.py": (f"{_STEPS}/test_persistence.py",),
    "daemon/core/steps/requests.py": (f"{_STEPS}/test_requests_of_clients.py",),
    "daemon/core/steps/sampling.py": (f"{_STEPS}/test_sampling.py",),
    "daemon/core/steps/sensing.py": (f"{_STEPS}/test_sensing.py",),
    "daemon/core/steps/single_axis.py": (f"{_STEPS}/test_one_axis.py",),
    "daemon/core/steps/status.py": (f"{_STEPS}/test_status.py",),
    "daemon/core/steps/supervisor.py": _SUPERVISOR,
    "daemon/core/steps/targets.py": (f"{_STEPS}/test_targets.py",),
    "daemon/core/steps/wanted.py": (f"{_STEPS}/test_wanted.py",),
    "daemon/gateway/clients.py": ("daemon/gateway/test_clients.py",),
    "daemon/gateway/lease.py": ("daemon/gateway/test_lease.py",),
    "daemon/gateway/lease_control.py": ("daemon/gateway/test_setpoints.py",),
    "daemon/gateway/setpoints.py": ("daemon/gateway/test_setpoints.py",),
    "daemon/ipc/cycle_timing.py": ("daemon/test_record.py",),
    "daemon/ipc/decoding.py": ("daemon/test_record.py",),
    "daemon/ipc/record.py": ("daemon/test_record.py",),
    "daemon/ipc/report.py": ("daemon/test_record.py",),
    "daemon/ipc/ring_clip.py": ("daemon/test_ring_clip.py",),
    "daemon/ipc/starting.py": ("daemon/test_starting.py",),
    "daemon/ipc/state_file.py": (f"{_RUNTIME}/test_state_file.py",),
    "daemon/ipc/transport.py": ("daemon/test_transport.py",),
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
    "drives/cia402/drive.py": ("drives/test_drive.py", "drives/test_temperature.py"),
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
    measured = coverage.Coverage(include=list(UNIT_TESTS))
    with measured.collect():
        for file in UNIT_TESTS:
            import_module(file.removesuffix(".py").replace("/", "."))

    class Traced:
        """Traces fixtures and tests, but no test of Hypothesis nor the work of pytest."""

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_setup(self) -> Generator[None, None, None]:
            with measured.collect():
                return (yield)

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, None, None]:
            is_drawn = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
            with nullcontext() if is_drawn else measured.collect():
                return (yield)

    tests = {f"tests/{test}" for tests in UNIT_TESTS.values() for test in tests}
    if code := pytest.main(["-q", *sorted(tests)], plugins=[Traced()]):
        return int(code)
    return int(measured.report(skip_covered=True) < 100)


if __name__ == "__main__":
    if sys.argv[1:] == ["--ignored"]:
        print(ignored())
    else:
        sys.exit(main())
