"""Safety checks, bounds and stop sequence. Pure: raw drive values in, verdicts and bounds out.

Reading order: `inputs.py` (the safety inputs of one cycle), `joints.py` (position, speed and effort
of a joint, and standstill), `limits.py` (limits.toml in SI units
and cycles), `checks.py` (reasons to stop), `stop_sequence.py` (the stop of each drive for a
verdict, and its escalation), `bounds.py` and `soft_limits.py` (bounds of the commands); then the
monitors over more than one cycle: `stopping_path.py`, `inverse_dynamics.py`, `effort_monitor.py`,
`sign_response.py` (a wrong sign, or a person), `friction_monitor.py`, `energy.py`, `spasm.py`,
`clonus.py`.
"""
