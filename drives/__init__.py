"""The CANopen master: CiA 301 and CiA 402 on frames. Knows counts and amperes, nothing of legs.

Reading order:
    signals, errors   what a cycle takes and gives; what can go wrong, and whose fault
    canopen/          the bus, NMT, emergencies, who is on the bus
    cia402/           power state, PDOs, units, torque, profiles; `drive.py` is the cycle's part
    bringup/          from unknown to OPERATIONAL as a plan of steps
    service/          for people in front of a bus: scan, dump, compare, store, restore
"""
