"""The central difference Kalman filter of one leg.

Reading order: `cdkf.py` (Appendix A, for any model), `states.py`, `leg_model.py` (the model and its
integrators), `leg_noise.py`, `patient_rate.py` (a patient who works), `leg_filter.py` (one cycle,
compiled) with `leg_memory.py`, `validity.py`, `status.py`, `considered.py` (parameters that are not
sure) with `sensitivity.py` (the derivative of the estimate by each of them), `transmission.py`
(what a drive that gives way hides) and `surprise.py` (what innovations show beyond these);
`leg_observer.py` (samples in, estimates out).
"""
