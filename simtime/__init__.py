"""Simulated time across processes: its owner, its protocol, and its time page.

`gaitd sim` owns time. Every other process of a simulated trainer is a seat on its local socket.
A seat that is in step states with each wait how far time may advance; time passes only while every
such seat waits. Computing time of a process, or a stall of the computer, therefore takes no
simulated time, and the same frames come at the same instants on a busy computer.

    wire       frames and messages on the socket, and their layout
    page       the time page: simulated time as a file in memory, for readers
    link       the client side of a seat: in another process over the socket, behind a protocol
    processes  whether a process that is waited for is stopped
    can_bus    a seat for programs of python-can
    bus, clock, in_step
               bus, clocks and channel of a service in simulated time
    service    what the service finds by its name, for `[bus] interface = "simulated"`

Nothing that runs on a trainer imports this package. docs/simulated_bus.md describes the protocol
for other programs.
"""
