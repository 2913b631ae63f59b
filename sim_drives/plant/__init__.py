"""Physics of the trainer behind one leg's two drives.

Reading order: `plant.py`, `dynamics.py` (one compiled loop), `motor.py`, `stick_slip.py` (the
plant's friction laws), `transmission.py` (between a drive and its joint), `stops.py`, `patient.py`,
`recorded.py` (measured efforts of a patient), `led.py` (an axis that follows a drive on the bus),
`settings.py` (the physics tables of plant.toml), `truth.py` (the true state), `port.py` and
`actuation.py` (the interface to the protocol side).
"""
