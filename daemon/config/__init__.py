"""Configuration: TOML files into frozen structs, every range checked, nothing defaulted.

Reading order: `settings.py` and `limit_settings.py` (what a file may say), `strict.py` (one file
into its struct, errors that name file, key, value and range), `trainer.py` (the file of `--config`
and its paths; all that the gateway reads), `baseline.py` (a leg without a patient), `load.py` (all
files into `bundle.Settings`, in `bundle.py`), `cross.py`, `cross_assist.py`, `cross_drives.py`,
`cross_motion.py` and `cross_homing.py` (the files compared with each other), `robot.py` and
`axes.py` (in the terms of observer and drives), `workspace.py` (where the leg goes when it is
stopped), `runaway.py` (and when nobody stops it), `backstop.py` (what the drives hold), `check.py`,
`check_axes.py`, `check_braking.py` (has each ramp the torque) and `check_runaway.py` (the report).
"""
