"""Configuration: TOML files into frozen structs, every range checked, nothing defaulted.

Reading order: `settings.py` and `limit_settings.py` (what a file may say), `strict.py` (one file
into its struct, errors that name file, key, value and range), `trainer.py` (the file of `--config`
and its paths; all that the gateway reads), `baseline.py` (a leg without a patient), `bundle.py`
(all files of a configuration), `robot.py` and `drive_plan.py` (in the terms of observer and
drives). Rules over several files are in `daemon/preflight/`.
"""
