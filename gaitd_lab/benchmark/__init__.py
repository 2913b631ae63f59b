"""Benchmarks for `gaitd bench`: each returns rows of one table, with its ratios and budgets.

Reading order: `figures.py` (a row, and the table), `catalogue.py` (all benchmarks by name). Each of
them: `observer_step.py` (beside hand-written C and FilterPy, `step_times.py`), `cycle_time.py`,
`lateness.py` (of SYNC in real time, also beside `burning.py`), `replay_speed.py`,
`whole_service.py` (start, memory, delivery beside bare Zenoh, `bare_put.py`), `peers.py` (beside
python-canopen as a master, `bus_times.py`), `display_page.py` (the patient's page in a browser).
"""
