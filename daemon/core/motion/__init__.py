"""Where a leg is wanted over time. Pure: each plan is a value that is advanced by a cycle.

Reading order: `leg_plan.py` (the plan of one leg as the core sees it), `trajectory.py` (brake,
hold, gait, excitation), `hand_guiding.py`, `self_test.py`, `single_axis.py` (homing and sign
test), `assist.py` (what a controller's setpoints may add).
"""
