"""Virtual CiA 402 drives with a gait trainer and a scripted patient behind them.

The slave's side of CANopen, written from the standard on raw frames; it shares no protocol code
with `drives/`, so that a mistake on one side does not cancel out on the other. Reading order:

    settings, build    what plant.toml may say; the machine made from it
    frame              a frame, with or without its time
    canopen/           one node: dictionary, SDO, PDO, NMT, heartbeat, emergencies
    cia402/            the drive: power state, motion, homing, measurements, makes
    plant/             mechanics, motors, friction, stops, patient, the truth
    one_leg, world     nodes and plant from event to event, in lock-step
    faults/            what goes wrong, by script and by command
    time/              simulated time: seats, sockets, pace; or the computer's clock
    control            the command socket
"""
