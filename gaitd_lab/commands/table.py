"""Commands of the laboratory; the command line finds the table by an entry point."""

from typing import Final

LABORATORY: Final = "Laboratory: virtual drives, tests, benchmarks"
_LINES: Final = {
    "demo": "Virtual drives, service and a patient, with a live view.",
    "sim": "The virtual drives of a configuration; inject, patient.",
    "experiment": "The paper's experiment on the virtual machine.",
    "strides": "Work of strides in gait beside the true one.",
    "patients": "Patients who work, at each cadence and friction.",
    "ablation": "Every choice of the observer on and off.",
    "consistency": "The observer's sigmas, gaps, rest and drift.",
    "real-data": "The observer on recordings of real machines.",
    "matrix": "Every fault in every mode on both axes, in lock-step.",
    "rig": "Run a command where there is SocketCAN, or systemd.",
    "bench": "The project's benchmarks.",
}
COMMANDS: Final = {
    name: (f"gaitd_lab.commands.{name.replace('-', '_')}", LABORATORY, line)
    for name, line in _LINES.items()
}
"""Module, group and short help of each command, in the order of `gaitd --help`."""
