"""Checks before anything moves: rules over several files, sweeps of motion, and the report.

Reading order: `load.py` reads all files of a configuration, or names all faults.
`acceptance.py` is the one check of a set of files, for `gaitd check` and for every command that
starts something. Rules over several files: `files.py`, `drives.py`, `homing.py`, `motion.py`,
`assist.py`, `real_bus.py`; over the robot file: `robot.py`; warnings: `doubts.py` and, of limits
that are never reached, `thresholds.py`. Computed from the settings: `workspace.py`, `runaway.py`,
`stability.py`. The report of `gaitd check`: `report.py`, `axes.py`, `braking.py`,
`runaway_report.py`, as text `report_tables.py`.
"""
