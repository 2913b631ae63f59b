"""The core's end of the IPC channel in simulated time: it waits for the gateway, with a time limit.

In simulated time the core could run ahead of a gateway that needs a millisecond of the computer
for each record. So before each cycle it waits for a gateway state made after record N - 3, and,
while a lease is held, for a setpoint made after it. Waiting only delays `receive`.

The core does not wait for a gateway whose socket refuses (it has ended), whose process is stopped
(state T), or that has sent nothing for PATIENCE_LOOKS, nor for a lease holder that has sent nothing
for HOLDER_LOOKS. It waits for each again from its next gateway state or setpoint on. It does wait
for a gateway stopped by a debugger (state t). The safety checks react to a silent gateway in
simulated time, as in real time.
"""

import select
from pathlib import Path
from typing import Final, Protocol

from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.report import Event
from daemon.ipc.transport import CoreChannel
from simtime.processes import IN_A_DEBUGGER, STOPPED, process_state

CREDIT_CYCLES: Final = 3
CHECK_MS: Final = 20
TIMEOUT_CHECKS: Final = 250
"""5 s, counted in polls of this process: a stall of the whole computer counts as one poll."""
STOPPED_CHECKS: Final = 3
"""Polls until a stopped gateway counts as stopped.

A signal to a process group that includes this process reaches its members one after the other.
"""
HOLDER_CHECKS: Final = 50
"""1 s, counted in polls."""


class Seat(Protocol):
    """What the channel needs of `simtime.link.SocketLink`."""

    @property
    def is_in_step(self) -> bool:
        """True while time is simulated."""
        ...

    def send_alive(self) -> None:
        """Report to the owner of simulated time that this process is not hung."""
        ...


class InStepChannel:
    """An IPC channel that keeps the core in step with the gateway and the lease holder."""

    def __init__(
        self,
        ipc: CoreChannel,
        boot_id: str,
        gateway_lock: Path,
        seat: Seat,
    ) -> None:
        """Wrap an IPC channel.

        Args:
            ipc: IPC channel to the gateway.
            boot_id: boot id of this core.
            gateway_lock: lock file with the gateway's process id.
            seat: of this core.
        """
        self._ipc, self._boot_id = ipc, boot_id
        self._lock, self._seat = gateway_lock, seat
        self._poller = select.poll()
        self._poller.register(ipc.fileno(), select.POLLIN)
        self._published_cycle = 0
        self._gateway_state_cycle = 0
        self._setpoint_cycle = 0
        self._is_leased = False
        self._gateway_expected = False
        self._holder_expected = False

    def publish(self, record: CycleRecord) -> bool:
        """As `CoreChannel.publish`."""
        self._published_cycle = record.cycle
        taken = self._ipc.publish(record)
        self._gateway_expected = self._gateway_expected and taken
        return taken

    def receive(self) -> list[GatewayState]:
        """As `CoreChannel.receive`, once gateway and lease holder have caught up."""
        gateway_states = self._read()
        checks = stopped_checks = 0
        while self._seat.is_in_step and self._lags() and checks < TIMEOUT_CHECKS:
            if self._poller.poll(CHECK_MS):
                gateway_states += self._read()
                continue
            state = _state_of_holder(self._lock)
            stopped_checks = stopped_checks + 1 if state == STOPPED else 0
            if stopped_checks >= STOPPED_CHECKS:
                break
            if state == IN_A_DEBUGGER:
                self._seat.send_alive()
                continue
            checks += 1
            self._holder_expected = self._holder_expected and checks < HOLDER_CHECKS
        if self._lags():
            self._gateway_expected = self._holder_expected = False
        return gateway_states

    def take_notices(self) -> list[Event]:
        """As `CoreChannel.take_notices`."""
        return self._ipc.take_notices()

    def _read(self) -> list[GatewayState]:
        gateway_states = self._ipc.receive()
        for gateway_state in gateway_states:
            if gateway_state.core_boot_id == self._boot_id:
                self._update(gateway_state)
        return gateway_states

    def _update(self, gateway_state: GatewayState) -> None:
        self._gateway_expected = True
        self._gateway_state_cycle = max(self._gateway_state_cycle, gateway_state.for_cycle)
        self._is_leased = gateway_state.lease != 0
        newest = max((setpoint.for_cycle for setpoint in gateway_state.setpoints), default=0)
        if newest > self._setpoint_cycle:
            self._setpoint_cycle, self._holder_expected = newest, True

    def _lags(self) -> bool:
        oldest = self._published_cycle - CREDIT_CYCLES
        gateway_lags = self._gateway_expected and self._gateway_state_cycle < oldest
        holder_is_due = self._gateway_expected and self._holder_expected and self._is_leased
        return gateway_lags or (holder_is_due and self._setpoint_cycle < oldest)


def _state_of_holder(lock: Path) -> str:
    """The state of the process that holds a lock; empty if there is none."""
    try:
        return process_state(int(lock.read_text(encoding="ascii")))
    except (OSError, ValueError):
        return ""
