"""The core: everything between the CAN frames of one cycle and the frames of the next.

Reading order:
    cycle           one cycle, the whole story
    state, tick     what the core keeps from cycle to cycle; the instant of a cycle
    inputs          what the gateway asks for
    safety/         pure: reasons to stop, limits, bounds, the stop sequence
    modes/          pure: the table of modes and its guards; what outlives a restart
    motion/         pure: where a leg is wanted over time
    steps/          what changes the state: supervisor, requests, exercises, targets, monitors
    cycle_record    the record of a cycle
    runtime/        not pure: the process, the 10 ms loop, the bus, systemd
"""
