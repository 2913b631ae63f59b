"""Every design choice of the observer on and off: what each costs and gains, against the truth.

Reading order: `choices` (changes of the robot file), `trials` (recorded situations), `errors` (a
trial replayed with a choice), `questions` (which cells answer what), `figures`, `study` (the
report). docs/evidence/ablation.md says what was found.
"""
