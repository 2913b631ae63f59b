"""The observer on recordings of others: a servo axis, and a patient with a measured moment.

Reading order: `emps` (the benchmark's files, its axis as a robot file), `situations` (what the
observer sees, and the truth), `classical` (inverse dynamics, momentum observer), `judgement`
(errors, coverage, speed), `comparison` (all estimators in all situations), `hip_moment` (the file
of a patient), `measured_patient` (trials with it), `strides` (their work beside the truth),
`figures`, `study` (the report).
"""
