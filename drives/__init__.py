"""The CANopen master: CiA 301 and CiA 402 on frames, in drive units (counts, amperes).

Nothing in this package knows about legs. Reading order:
    signals, errors   inputs and outputs of one cycle; the exceptions, by who is at fault
    canopen/          the bus, object indices, NMT, emergencies
    cia402/           power state, PDOs, units, torque, profiles; `drive.py` is the cycle's part
    bringup/          from unknown to OPERATIONAL as a plan of steps
    service/          for the operator: scan, dump, compare, store, restore

To add, in this order:
    a drive profile  configs/drives/profiles/NAME.toml by the fields of cia402/profile.py, with its
                     maker's EMCY codes, and an axis file that names it; what it needs written in
                     bringup/plan.py; a virtual one in sim_drives/cia402/personality.py
    a homing method  `methods` in [homing] of the drive's profile, checked by cia402/homing.py; new
                     settings also in bringup/plan.py; daemon/preflight/homing.py (is the effort
                     sufficient); `METHODS` in sim_drives/cia402/homing.py
"""
