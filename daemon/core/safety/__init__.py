"""What stands between a number and a leg. Pure: raw drive values in, verdicts out.

Reading order: `inputs.py` (what is known in one cycle), `limits.py` (limits.toml in SI units and
cycles), `checks.py` (reasons to stop), `stop_sequence.py` (what each drive is told of a verdict,
and what follows if it does not obey), `bounds.py` and `soft_limits.py` (what may be sent); then
what the checks need over more than one cycle: `stopping_path.py`, `inverse_dynamics.py`,
`effort_monitor.py`, `friction_monitor.py`, `energy.py`, `spasm.py`.
"""
