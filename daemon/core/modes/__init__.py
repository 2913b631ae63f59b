"""The modes of the service, and the state kept across restarts. Pure.

`table.py` has the modes with their transitions and rules, `roles.py` the rights of a client's role.
`persistent_state.py` has the content of the state file: the last pose of each axis, proven signs, a
latched stop (`latched_stop.py`) and the daily test (`daily_test.py`).
"""
