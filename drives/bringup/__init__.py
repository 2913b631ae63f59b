"""Bring-up: all drives of a bus from unknown to OPERATIONAL.

`plan.py` (what is done with one drive, as a list of steps), `steps.py` and `objects.py` (one step),
`bringup.py` (runs the plans), `port.py` (what it needs of the world) and `configurator.py` (that,
by canopen's SDO client).
"""
