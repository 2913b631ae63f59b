"""The simulated bus as an interface of python-can: `can.Bus(interface="gaitd", channel=PATH)`.

Registered by an entry point, so that `can.logger -i gaitd -c PATH`, `can.viewer`, and other
programs can join the bus of `gaitd sim`. By default the program is a listener: it receives all
frames, may send, and its time-outs use the computer's clock. With `in_step=True` it is a seat that
simulated time waits for: its time-outs are simulated, and time passes only while it receives.

There is no `fileno`, so python-can's Notifier receives in a thread: of a readable descriptor it
would take one frame, but a message of the server may hold several.
"""

import select
from collections import deque
from pathlib import Path

import can

from drives.canopen.frame import Frame
from simtime.link import LinkLostError, SocketLink
from simtime.wire import Role

_FOR_EVER_S = 3600.0


class SimulatedCanBus(can.BusABC):
    """A python-can bus that is a seat on the simulated bus."""

    def __init__(
        self,
        channel: str,
        *,
        in_step: bool = False,
        name: str = "python-can",
        can_filters: can.typechecking.CanFilters | None = None,
        **kwargs: object,
    ) -> None:
        """Join the bus.

        Args:
            channel: path of the socket of `gaitd sim`.
            in_step: simulated time waits for this program.
            name: name of the seat.
            can_filters: as python-can's.
            kwargs: what python-can passes to every interface, such as `bitrate`; unused.

        Raises:
            can.CanInitializationError: `gaitd sim` does not answer there.
        """
        del kwargs
        self._in_step = in_step
        self._link = SocketLink(Path(channel), Role.IN_STEP if in_step else Role.LISTENER, name)
        self._frames: deque[Frame] = deque()
        try:
            self._link.open()
        except LinkLostError as error:
            raise can.CanInitializationError(f"{channel}: {error}") from error
        self.channel_info = f"gaitd {channel}"
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame on the bus.

        Raises:
            can.CanOperationError: it is extended, remote or CAN FD, or `gaitd sim` has ended.
        """
        del timeout
        if msg.is_extended_id or msg.is_remote_frame or msg.is_fd:
            raise can.CanOperationError("the simulated bus has classic 11-bit data frames only")
        try:
            self._link.send([Frame(msg.arbitration_id, bytes(msg.data))])
        except LinkLostError as error:
            raise can.CanOperationError(str(error)) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if not self._frames:
                self._receive(timeout)
        except LinkLostError as error:
            raise can.CanOperationError(str(error)) from error
        return (_message(self._frames.popleft()) if self._frames else None), False

    def _receive(self, timeout: float | None) -> None:
        if self._in_step:
            until_ns = self._link.now_ns() + int(
                (_FOR_EVER_S if timeout is None else timeout) * 1e9
            )
            self._link.wait(until_ns, for_frame=True)
        elif select.select([self._link], [], [], timeout)[0]:
            self._link.receive()
        self._frames.extend(self._link.take())

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._link.close()


def _message(frame: Frame) -> can.Message:
    return can.Message(
        timestamp=frame.time_ns * 1e-9,
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_error,
        is_error_frame=frame.is_error,
        is_rx=True,
    )
