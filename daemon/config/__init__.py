"""Configuration: TOML files read into frozen structs, every range checked, no defaults.

Reading order: `settings.py` and `limit_settings.py` (tables of the files), `unread.py` (a table
that was refused), `trainer.py` (the file of `--config`
and its paths; all that the gateway reads), `baseline.py` (a leg without a patient), `bundle.py`
(all files of a configuration), `robot.py` and `drive_plan.py` (settings converted for observer and
drives), `shipped.py` (the configurations that come with the project), `edits.py` (some keys of a
file changed). Rules over several files are in `daemon/preflight/`.
"""
