"""Numerics only: from positions and efforts to friction and patient activity. No I/O, no clock.

Reading order: `mechanism/` (the leg in closed form, friction laws 11 to 13), `filter/` (the central
difference Kalman filter over the eight states of eq. 23), `smoother.py` (150 ms later),
`strides.py` (what the patient did in each stride), `drift.py` (does friction drift), `baseline.py`
(a patient who does nothing), `offline/` (the same over recorded columns). `jit.py` says how all of
it is compiled and why its cache cannot be stale; `quantities.py` has types for units.
"""
