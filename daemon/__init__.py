"""The service: a core process in real time, a gateway process for the network, and what they share.

Reading order:
    ipc/        what crosses between the processes: records, gateway state, the ring, two sockets
    core/       one cycle of 10 ms, what decides in it, and the loop around it
    gateway/    records into messages, requests and setpoints into gateway state
    keys/       which clients may connect, and how each proves its name
    zenoh_io/   sessions, publishers and subscribers: the only code that touches Zenoh
    recorder/   the black box around each stop, and the audit log of requests
    wire/       what core and gateway both know of the wire: categories of stop causes, roles,
                values of reports.
                The messages are in clients/python/gaitd_client/wire
    config/     TOML files into frozen structs
    preflight/  what is refused before anything starts, and the report of `gaitd check`
    system/     clocks, journal, sd_notify, the lock of a directory, the choice of a bus

To add, in this order:
    a stop cause     ARCHITECTURE.md, "How to add"
    an exercise      its class in core/exercises/ and its row in core/modes/table.py. A mode that is
                     new on the wire first: `Mode` in gaitd_names/modes.py, its request in
                     gaitd_client/wire/messages.py
    a message field  gaitd_client/wire/messages.py, leg_messages.py or health_messages.py. A
                     value of the core first becomes the last field of its struct in ipc/record.py,
                     filled in core/cycle_record.py; with the same name in both it is in the
                     message, else gateway/translate.py, strides.py or health.py fills it. A
                     field that is added within v1 has a default
    a request        `ROUTES` in gateway/requests.py and its payload in
                     gaitd_client/wire/messages.py; one for the core also `RequestKind` in
                     gaitd_names/requests.py and core/steps/requests.py
    a role           `Role` in gaitd_names/requests.py, its row in wire/roles.py; docs/security.md
    a limit          config/limit_settings.py and configs/limits.toml; SI in core/safety/limits.py;
                     its use in core/safety/checks.py or bounds.py. A rule over several files is in
                     preflight/files.py; a limit in the drive, in config/drive_plan.py
"""
