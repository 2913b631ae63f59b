"""Offline work on recordings: read them, run the observer over them, evaluate and draw the result.

Reading order: `recording.py` (CSV in, checked), `replay.py` (the observer over a CSV or a black
box), `estimates.py` (CSV out), `column_check.py`
(swapped columns and wrong signs), `accuracy.py` (an estimate against the truth), `drawing.py` and
`replay_figure.py` (pictures). `delay.py` measures the delay of an effort. `replay_files.py` and
`replay_report.py` are the files and the text of `gaitd replay`, `stop_recording.py` and
`stop_tables.py` a stop's recording and its tables. `fleet.py` makes one result of each of many
recordings; `self_tests.py`, `friction_weeks.py` and `friction_figure.py` are friction of trainers
by week. `acceptance` is the record of a drive's acceptance.
"""
