"""The modes of the service, and the state kept across restarts.

`table.py` has the modes with their transitions and rules, `guards.py` the inputs of the guards of a
request; `persistent_state.py` has the last pose of each axis, proven signs, and a latched stop.
"""
