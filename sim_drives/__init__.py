"""Virtual CiA 402 drives with a gait trainer and a scripted patient behind them.

The slave's side of CANopen, written from the standard on raw frames; it shares no protocol code
with `drives/`, so that a mistake on one side does not cancel out on the other. Reading order:

    settings, plant_settings    what plant.toml may say
    frame, line, timers         a frame, a station's way to the bus, time in ns
    actuation, plant_port       what passes between protocol and mechanics
    dictionary, aborts          the object dictionary from an EDS, its rules
    sdo_server                  access by SDO: at once, in sdo_segments, in blocks (sdo_block)
    cob_id, sync                identifiers that can be set; SYNC, its counter, its window
    pdo_rules, pdo_channel      PDOs: what may be mapped, what is
    pdo_transmit, pdo_receive   ... and what happens at a SYNC, in time, with a wrong length
    nmt, heartbeat, emergency   network states, silence, errors
    connection                  what a lost connection does
    power_state, drive          CiA 402's tables, and the machine that runs them
    statusword, supervision     6041h as the bus sees it; what a drive takes amiss of a motion
    motion, target_watch        modes, targets, limits; targets that stay away
    homing                      the ways to a reference
    measurement                 process values
    personality, scaling        what makes of drive do differently; units
    storage, node               saved parameters; all of it as one station on the bus
    one_leg, world              nodes and plant from event to event, in lock-step
    fault_rules, faults         what goes wrong, by script and command
    control, build              the command socket; wiring
    conductor                   simulated time: seats, and when each may go on
    bus_server, time_server     the same for other processes: sockets, and the pace
    realtime                    by the computer's clock
    plant                       the mechanics: dynamics, motor, stick_slip, stops, patient, truth
"""
