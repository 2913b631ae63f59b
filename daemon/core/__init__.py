"""The core: everything between the CAN frames of one cycle and the frames of the next.

Reading order:
    cycle                            one cycle, the whole story
    state, tick, limits              what it has: the core, the moment, the limits
    joints, sampling                 what the drives say, in SI
    friction_watch, looking_back     what the observer adds: drift, smoother, strides
    inbox                            what the gateway asks
    balance, effort_watch, energy, stopping_path, soft_limits, spasm, watching
                                     what is looked at over more than one cycle
    situation, safety                what is known, and the reasons to stop in it
    conduct, modes, requests, transition, stopping    what becomes of reasons and requests
    assist, assisting                what a controller may add
    plans, reference, guidance, targets, bounds       where a leg is wanted, what its drives get
    exercises, playing, release, self_test           how plans begin and go on: by hand, self-test
    daily                            what was seen and passed today, for how long it counts
    preparation, preparing           one axis at a time: homing, proof of its sign
    axis_notes, poses, latching      what outlives a restart
    recording                        the record of it all
    bringing                         before: from off to ready
Around it, and not pure:
    loop, loop_settings, grid, line, load_meter      the 10 ms grid and the bus
    window, arrivals                 a SYNC and its answers; what the kernel's stamps mean
    supervision                      what systemd and the journal are told
    notebook                         the file of the axis notes
    build, warm, realtime, process   a core from its configuration, in its process
"""
