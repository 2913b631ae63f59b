"""Reference motion of a leg over time. Pure: each plan is a value that is advanced by a cycle.

Reading order: `leg_plan.py` (the plan of one leg in the core's state), `trajectory.py` (brake,
hold, gait, excitation), `hand_guiding.py`, `self_test.py`, `single_axis.py` (homing and sign
test), `assist.py` (assist from a controller's setpoints).
"""
