"""The observer on recordings of a real servo axis, beside classical estimators.

Reading order: `emps` (the benchmark's files, its axis as a robot file), `situations` (what the
observer sees, and the truth), `classical` (inverse dynamics, momentum observer), `judgement`
(errors, coverage, speed), `comparison` (all estimators in all situations), `figures`, `page`.
"""
