"""The service: a core process in real time, a gateway process for the network, and what they share.

Reading order:
    ipc/        what crosses between the processes: records, gateway state, the ring, two sockets
    core/       one cycle of 10 ms, what decides in it, and the loop around it
    gateway/    records into messages, requests and setpoints into gateway state
    zenoh_io/   sessions, publishers and subscribers: the only code that touches Zenoh
    recorder/   the black box around each stop, and the audit log of requests
    wire/       what programs outside rely on: messages, enums, refusals, stop causes, schemas
    config/     TOML files into frozen structs
    preflight/  what is refused before anything starts, and the report of `gaitd check`
    system/     clocks, journal, sd_notify, the lock of a directory, the choice of a bus
"""
