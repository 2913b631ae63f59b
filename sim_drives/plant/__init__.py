"""Physics of the trainer behind one leg's two drives.

`plant.py`, `dynamics.py` (one compiled loop), `motor.py`, `stick_slip.py`, `stops.py`,
`patient.py`, `settings.py` (plant.toml), `truth.py` (the true state), `port.py` and
`actuation.py` (the interface to the protocol side).
"""
