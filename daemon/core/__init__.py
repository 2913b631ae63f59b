"""The core: everything between the CAN frames of one cycle and the frames of the next.

Reading order:
    cycle           one cycle, the whole story
    period          the period of the cycle, durations in cycles
    state, tick     the state kept from cycle to cycle; time and bus data of a cycle
    slices          the frozen parts of the state, which steps of a cycle return
    core_config     the part of the configuration that the core uses
    inputs          what is received from the gateway
    safety/         pure: reasons to stop, limits, bounds, the stop sequence
    modes/          pure: the table of modes; the persistent state
    exercises/      pure: what the legs do in each mode
    motion/         pure: the shape of the gait, the assist of a controller
    steps/          steps that change the state: supervisor, requests, exercises, targets, monitors
    cycle_record    the record of a cycle
    runtime/        not pure: the process, the 10 ms loop, the bus, systemd
"""
