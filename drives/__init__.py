"""The CANopen master: CiA 301 and CiA 402 on frames, in drive units (counts, amperes).

Nothing in this package knows about legs. Reading order:
    signals, errors   inputs and outputs of one cycle; the exceptions, by who is at fault
    canopen/          the bus, object indices, NMT, emergencies
    cia402/           power state, PDOs, units, torque, profiles; `drive.py` is the cycle's part
    bringup/          from unknown to OPERATIONAL as a plan of steps
    service/          for the operator: scan, dump, compare, store, restore
"""
