"""Simulated time across processes: who owns it, how it is asked for, where it is read.

`gaitd sim` owns time. Every other process of a simulated trainer is a seat on its local socket.
A seat that is in step says with each wait how far time may go for it; time passes only while every
such seat waits. So what a process computes, or how long the computer stands still, takes no
simulated time, and the same frames come at the same instants on a busy computer.

    wire       frames and messages on the socket, and their layout
    page       the time page: simulated time as a file in memory, for those who only read it
    link       a seat's end: in another process over the socket, behind a protocol
    processes  whether one that is waited for is stopped

This package is neutral ground: `drives`, `daemon` and `sim_drives` import it, and it imports
nothing of ours. docs/simulated_bus.md describes the protocol for programs of others.
"""
