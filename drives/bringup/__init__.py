"""Bring-up: all drives of a bus from unknown to OPERATIONAL.

Reading order: `plan.py` (the list of steps for one drive), `steps.py` and `objects.py` (one step),
`bringup.py` (runs the plans), `port.py` (the interface that it needs) and `configurator.py` (that
interface, implemented with canopen's SDO client); `presence.py` (nodes that should not be there)
and `bus_load.py` (how full the planned PDOs make the bus).
"""
