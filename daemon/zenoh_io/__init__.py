"""Zenoh: the only code of the service that touches it.

Reading order: `endpoints.py` (where to listen), `access.py` (who may say what), `session.py` (how a
session is opened), `publish.py` (messages out, queries in), `subscribe.py` (setpoints in).
"""
