"""What is refused before anything moves: rules over several files, sweeps, and the report.

`load.py` reads all files of a configuration, or names the first thing that is wrong.
`judgement.py` is the one verdict over a set of files, for `gaitd check` and for every command that
starts something. Rules over several files: `files.py`, `drives.py`, `homing.py`, `motion.py`,
`assist.py`. Computed from the settings: `workspace.py`, `runaway.py`, `backstop.py`. The report of
`gaitd check`: `report.py`, `axes.py`, `braking.py`, `runaway_report.py`.
"""
