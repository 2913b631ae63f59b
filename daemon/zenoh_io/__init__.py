"""Zenoh input and output: the only code of the service that uses the Zenoh library.

Reading order: `endpoints.py` (where to listen), `access.py` (access rights), `session.py` (how a
session is opened), `publish.py` (messages out, queries in), `subscribe.py` (setpoints in),
`callbacks.py` (when the last query or setpoint has been received), `client.py` (the other side:
queries to a running service).
"""
