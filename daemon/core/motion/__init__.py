"""The shape of the gait, and the assist of a controller. Pure.

`gait_shape.py` has the periodic reference and the poses of a leg; `assist.py` has the rules for a
controller's setpoints. The exercises that use the shape are in `daemon/core/exercises`.
"""
