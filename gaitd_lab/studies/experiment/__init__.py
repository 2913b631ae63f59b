"""The experiment of the paper's Figs. 4 and 5, over several seeds, with the paper's claims.

Reading order: `measures` (a played run, and what is measured of it), `rows` (all of it as lines of
a table), `targets` and `claims` (what the lines are held against), `figures`, `study` (the report).
docs/evidence/experiment.md says what is seen.
"""
