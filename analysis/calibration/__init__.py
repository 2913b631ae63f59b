"""Calibration: friction, springs, drives, transmissions and encoder noise of the empty machine.

Reading order: `motion` (recordings prepared), `innovations` (the filter whose innovations are
scored), `quantities` (what can be calibrated), `start` (initial values by regression), `likelihood`
and `fit` (maximum likelihood, intervals, unidentifiable values), `transmission` (softness and
backlash), `process_noise` (of the observer), `empty_check` (wrong recline, spring or offset),
`verdict` (before and after on held-out data), `uncertainty`, `advice`, `robot_file`, `figures`,
`page`.
"""
