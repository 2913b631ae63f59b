"""The gateway: the process that clients reach over the network; it has no access to the CAN bus.

Reading order: `process.py` (the loop), `service.py` (one turn of it), `core_view.py` (newest record
of the core, and do more arrive), `leg_messages.py` (estimates, published first),
`machine_messages.py` (drives and safety), `translate.py` (rules of validity), `control.py` (queries
and their answers), `requests.py` (requests of clients), `clients.py` (role of a query's client,
released plan), `lease.py`, `setpoints.py` and `lease_control.py` (which client may command torque),
`events.py`, `emergencies.py`, `strides.py` and `health.py` (messages made from records),
`tremor.py` (what stands out of the patient's effort), `outlet.py` (interface for publishing),
`reload.py` (SIGHUP), `log.py`, `playback.py` (a recording in place of a core: `gaitd replay
--publish`). Zenoh itself is in `daemon/zenoh_io/`; files on disk are in `daemon/recorder/`.
"""
