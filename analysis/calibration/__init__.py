"""Calibration: friction, springs, drive inertia and encoder noise of the empty machine.

Reading order: `motion` (recordings made ready), `innovations` (the filter whose surprises are
scored), `quantities` (what may be calibrated), `start` (a guess by regression), `likelihood` and
`fit` (maximum likelihood, intervals, what cannot be told), `empty_check` (wrong recline, spring or
offset), `verdict` (before and after on held-out data), `advice`, `robot_file`, `figures`, `page`.
"""
