"""Configuration: TOML files into frozen structs, every range checked, nothing defaulted.

Reading order: `settings.py` (what a file may say), `strict.py` (one file into its struct, errors
that name file, key, value and range), `trainer.py` (the file of `--config` and its paths; all that
the gateway reads), `load.py` (all files into `bundle.Settings`), `cross.py` and `cross_motion.py`
(the files compared with each other), `robot.py` and `axes.py` (in the terms of observer and
drives), `workspace.py` (where the leg goes when it is stopped), `check.py` (the report).
"""
