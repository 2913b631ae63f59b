"""Numerics only: from positions and efforts to friction and patient activity. No I/O, no clock.

Reading order: `mechanism/` (the leg in closed form, friction laws 11 to 13), `filter/` (the central
difference Kalman filter over the eight states of eq. 23), `smoother.py` (with a lag of 150 ms;
`leg_smoother.py` is the live one), `strides.py` (the patient's work in each stride), `drift.py`
(friction drift), `baseline.py` (a passive patient), `offline/` (the same over recorded columns).
`jit.py` describes how all of it is compiled and why its cache cannot be stale, `cache_files.py` why
a power cut cannot tear it; `quantities.py` has types for units.

To add an integrator: `Integrator`, its step and its stability bound in `filter/leg_model.py`; its
use in `filter/leg_filter.py`; `integrator` in daemon/config/settings.py; its row in
gaitd_lab/studies/ablation/choices.py.
"""
