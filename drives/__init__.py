"""The CANopen master: CiA 301 and CiA 402 on frames. Knows counts and amperes, nothing of legs.

In the cycle, in reading order:
    signals      what this package takes and gives
    bus          frames in and out; the only file that touches python-can in the cycle
    simulated    the bus of simulated time
    pdo          frames as fixed structs
    cia402       statusword to state, state and request to controlword: two tables
    drive        one drive, and all drives of a bus, through one cycle
    units        counts, mA and per mille to rad, N·m, m, N at the joint, and back
    nmt, emcy    SYNC, heartbeats, boot-up, emergencies (texts: emcy_codes); bus_state: bus-off
Before the cycle:
    profile      what configs/drives/ may say: axis_file (one drive), torque (units and bases),
                 option_codes (what a drive does by itself), homing
    plan         bring-up as a list of steps that can be printed (steps: one of them)
    bringup      runs the plan: objects (one object each), presence (who else is on the bus), port
                 (what it needs of the world), configurator (that, over a bus, with canopen's SDO
                 client)
    busload, eds what can be judged without a bus
For people in front of a bus (`gaitd scan`, `gaitd drive`):
    witness, scanning                who is there: listen, then read
    stations, inventory, vendors     who they are, and what is wrong
    dump, object_words, comparison   what a drive holds, means, and should hold
    keeping                          store and restore, on request
Everywhere:
    errors       what can go wrong, by whose matter it is
"""
