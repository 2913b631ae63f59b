"""The modes of the service, and what is kept across restarts.

`table.py` has the modes with their guards; `persistent_state.py` has where each axis was left,
proven signs, and a latched stop.
"""
