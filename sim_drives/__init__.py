"""Virtual CiA 402 drives coupled to a simulated gait trainer and a scripted patient.

The slave's side of CANopen, written from the standard on raw frames. It shares no protocol code
with `drives/`, so that a mistake on one side does not cancel out on the other. Reading order:

    settings, build    the content of plant.toml; the machine built from it
    canopen/           CiA 301: dictionary, SDO, PDO, NMT, heartbeat, emergencies
    cia402/            the drive: power state, motion, homing, measurements, makes
    node               one drive on the bus; `connection`: what it does when its master is lost
    plant/             mechanics, motors, friction, end stops, patient, true state
    one_leg, world     nodes and plant, event-driven and in lock-step
    faults/            fault injection, by script and by command
    time/              simulated time: seats, sockets, pace; or the computer's clock
    control            the command socket

To add, in this order:
    a fault kind       `FaultKind` in settings.py, its rule in faults/rules.py; its row and expected
                       reaction in gaitd_lab/fault_matrix/faults.py
    a friction term    plant/settings.py and plant.toml; the law in plant/stick_slip.py. The
                       observer's own law is observer/mechanism/friction.py
"""
