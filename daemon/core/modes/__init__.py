"""The modes of the service, and the state kept across restarts.

`table.py` has the modes with their guards; `persistent_state.py` has the last pose of each axis,
proven signs, and a latched stop.
"""
