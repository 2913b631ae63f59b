"""The gateway: everything that a network can reach, and nothing that can reach the CAN bus.

Reading order: `service.py` (one turn of the loop), `translate.py` (what may be shown), `control.py`
(requests), `lease.py`, `setpoints.py` and `steering.py` (who may command torque), `alive.py`,
`events.py`, `emergencies.py`, `strides.py` and `health.py` (what is made from many records), then
the outside: `endpoints.py`, `session.py`, `publish.py` and `subscribe.py` (Zenoh), `notes_disk.py`
(fsync), `process.py` (the loop itself).
"""
