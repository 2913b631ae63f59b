"""The trainer behind one leg's two drives.

`plant.py`, `dynamics.py` (one compiled loop), `motor.py`, `stick_slip.py`, `stops.py`,
`patient.py`, `settings.py` (plant.toml), `truth.py` (what really happened), `port.py` and
`actuation.py` (what the protocol side sees).
"""
