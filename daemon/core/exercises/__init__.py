"""The exercises: what the legs do in each mode. Pure: a frozen value that is advanced each cycle.

Reading order: `exercise.py` (the protocol of an exercise of all legs), `hold.py`, `torque.py`,
`gait.py` with `approach.py` (the way to its first pose), `excite.py`, `hand_guiding.py`,
`self_test.py`; `single_axis.py` (the protocol of an exercise of one axis), `homing.py`,
`sign_test.py`. `guards.py` has what a request is judged by.

A new exercise is a file here and its row in `modes/table.py`; a mode that is new to the record and
the wire also needs its name in `daemon/ipc/record.py`. `steps/exercises.py` plays them.
"""
