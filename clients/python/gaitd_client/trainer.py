"""`Trainer`: a running service, as a client sees it. Messages as streams, requests as methods."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self, TypeVar

import msgspec
import zenoh
from gaitd_names import Mode, Outcome

from gaitd_client import wire
from gaitd_client.clock import Clock, MonotonicClock
from gaitd_client.connection import (
    ANSWER_TIMEOUT_S,
    DEFAULT_ENDPOINT,
    DEFAULT_TRAINER,
    Connection,
    Target,
    checked,
    decode_answer,
    query,
)
from gaitd_client.credentials import Credentials, read_credentials
from gaitd_client.errors import NoAnswerError, RequestRefusedError, reason_of
from gaitd_client.lease import Law, Lease, OnRefusal
from gaitd_client.stream import SECOND_SILENCE_NS, SILENCE_NS, Stream
from gaitd_client.subscriptions import Subscriptions

T = TypeVar("T", bound=msgspec.Struct)

ACQUIRE_TIMEOUT_S: Final = 2.0
"""Longest wait for a lease; shorter than other waits, because it is requested again."""
START_TIMEOUT_NS: Final = 600_000_000_000
"""Longest wait for a core that starts: on a new computer it compiles the observer first."""
START_RETRY_S: Final = 1.0
"""Time between two looks at a core that starts."""
STOP: Final = "stop"
"""Request that stops the machine."""
STOP_ANSWER_TIMEOUT_S: Final = 2.0
"""Longest wait for the answer to a stop, after which it is sent again: longer than a gateway lets a
stop wait."""
STOP_RETRY_S: Final = 0.1
"""Time between two attempts to stop, while the link reconnects."""
NOT_STOPPED: Final = (
    "the machine may not have stopped: let go of the hand switch, or press the emergency stop"
)
"""Text of the error where no answer to a stop came."""
LEGS: Final = ("right", "left")
"""Names of legs, as in keys and requests."""
DRIVES: Final = tuple(f"{leg}/{axis}" for leg in LEGS for axis in ("hip", "slide"))
"""Names of drives, as in keys and requests."""
EVENTS_KEPT: Final = 256
"""Events that a stream keeps until they are read; the oldest ones are dropped first."""
STRIDES_KEPT: Final = 64
"""Strides that a stream keeps until they are read; the oldest ones are dropped first."""


class Trainer:
    """A service; use it as a context manager.

    ::

        with Trainer("tcp/127.0.0.1:7447") as trainer:
            for activity in trainer.activity("right"):
                ...

    All methods may be called from several threads. After the gateway was away the connection comes
    back by itself, and the streams go on.
    """

    def __init__(
        self,
        endpoint: str | Sequence[str] | None = None,
        credentials: Credentials | Path | str | None = None,
        *,
        trainer: str | None = None,
        client: str = wire.UNNAMED_CLIENT,
        clock: Clock | None = None,
        keep_trying: bool = False,
    ) -> None:
        """Choose a service; the connection is made by `with`.

        Args:
            endpoint: Zenoh endpoint, or several of the same service; None: those of the
                credentials, or tcp/127.0.0.1:7447.
            credentials: folder of `gaitd keys issue`; None: the service has no keys.
            trainer: TRAINER of the keys; None: that of the credentials, or `trainer`.
            client: name in events, one line of at most 64 characters. With credentials their name
                replaces it.
            clock: measures silence; None: the computer's clock.
            keep_trying: `with` does not fail if the service is away; until it is there streams
                are silent, and requests are not answered, with the reason in their error.

        Raises:
            CredentialsError: the folder cannot be used.
            EndpointError: no service can listen on an endpoint.
        """
        if isinstance(credentials, str | Path):
            credentials = read_credentials(Path(credentials))
        if endpoint is None:
            endpoints = credentials.file.endpoints if credentials else (DEFAULT_ENDPOINT,)
        else:
            endpoints = (endpoint,) if isinstance(endpoint, str) else tuple(endpoint)
        name = trainer or (credentials.file.trainer if credentials else DEFAULT_TRAINER)
        self.target = Target(checked(endpoints), name, credentials)
        self.client = client if credentials is None else credentials.file.name
        """Name of this client in events and as holder of the lease."""
        self.clock: Clock = clock or MonotonicClock()
        self._connection = Connection(self.target, keep_trying=keep_trying)
        self._streams = Subscriptions(self._connection, self.clock)

    @classmethod
    def of(cls, target: Target, *, client: str = wire.UNNAMED_CLIENT) -> Self:
        """Make one for a known address."""
        return cls(target.endpoints, target.credentials, trainer=target.trainer, client=client)

    # --- connection -----------------------------------------------------------------------------

    def __enter__(self) -> Self:
        """Connect.

        Raises:
            NoServiceError: no service listens, or it does not accept the credentials.
        """
        self._connection.begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close all streams and the connection.

        Raises:
            NotReturnedError: a function that was given to `Stream.call` does not return.
            BaseException: what such a function has raised.
        """
        self._connection.end()
        with contextlib.ExitStack() as ending:
            ending.callback(self._connection.close)
            self._streams.close()

    @property
    def is_connected(self) -> bool:
        """True once the service has accepted a connection; streams tell whether it is there now."""
        return self._connection.is_open

    def connected_session(self) -> zenoh.Session:
        """Return the Zenoh session, for what this class does not offer.

        Raises:
            NoAnswerError: there is no connection yet, with the reason, or `with` was left.
        """
        return self._connection.session()

    # --- messages -------------------------------------------------------------------------------

    def estimate(self, leg: str, *, keep: int = 1) -> Stream[wire.Estimate]:
        """The observer's estimate of one leg, every cycle of 10 ms.

        Args:
            leg: right or left.
            keep: messages that may wait for the consumer; 1: the newest only.

        Raises:
            ClientError: `with` was left; so for every stream. A stream made before `with` is silent
                until then.
            ValueError: another leg; so for every stream of a leg or a drive.
        """
        return self._stream_of_leg(wire.Estimate, leg, "estimate", keep=keep)

    def activity(self, leg: str, *, keep: int = 1) -> Stream[wire.Activity]:
        """The patient's activity in one leg, every cycle; as `estimate`."""
        return self._stream_of_leg(wire.Activity, leg, "activity", keep=keep)

    def friction(self, leg: str, *, keep: int = 1) -> Stream[wire.Friction]:
        """Friction of one leg's axes, every cycle; as `estimate`."""
        return self._stream_of_leg(wire.Friction, leg, "friction", keep=keep)

    def drive(self, name: str, *, keep: int = 1) -> Stream[wire.DriveState]:
        """One drive, LEG/AXIS, ten times a second; as `estimate`."""
        key = wire.key(self.target.trainer, "drives", name)
        return self._streams.open(wire.DriveState, "drives", _known(key, name, DRIVES), keep=keep)

    def stride(self, leg: str, *, keep: int = STRIDES_KEPT) -> Stream[wire.Stride]:
        """The figures of one leg's strides, each at its end."""
        return self._stream_of_leg(wire.Stride, leg, "stride", keep=keep, silence_ns=None)

    def controller(self, leg: str, *, keep: int = STRIDES_KEPT) -> Stream[wire.ControllerState]:
        """Return what the holder of the lease has reported about its laws for one leg."""
        return self._stream_of_leg(
            wire.ControllerState, leg, wire.CONTROLLER, keep=keep, silence_ns=None
        )

    def safety(self, *, keep: int = 1) -> Stream[wire.Safety]:
        """Mode, verdict and lease, on change and once a second."""
        return self._streams.open(wire.Safety, wire.SAFETY, keep=keep, silence_ns=SECOND_SILENCE_NS)

    def health(self, *, keep: int = 1) -> Stream[wire.Health]:
        """State of the service itself, once a second."""
        return self._streams.open(wire.Health, wire.HEALTH, keep=keep, silence_ns=SECOND_SILENCE_NS)

    def events(self, *, history_count: int = 50, keep: int = EVENTS_KEPT) -> Stream[wire.Event]:
        """Events: first those of the past, then each as it happens.

        After a loss of the connection an event may come twice, with the same `id`.

        Args:
            history_count: number of events of the past; 0: none.
            keep: messages that may wait for the consumer.
        """
        return self._streams.open(
            wire.Event, wire.EVENTS, keep=keep, silence_ns=None, history_count=history_count
        )

    def _stream_of_leg(
        self, kind: type[T], leg: str, name: str, *, keep: int, silence_ns: int | None = SILENCE_NS
    ) -> Stream[T]:
        key = wire.key(self.target.trainer, leg, name)
        return self._streams.open(
            kind, _known(key, leg, LEGS), name, keep=keep, silence_ns=silence_ns
        )

    # --- requests -------------------------------------------------------------------------------

    def status(self) -> wire.Status:
        """Return the present state of the machine, and the newest events.

        Raises:
            NoAnswerError: none came; so for every request.
        """
        return self._ask("status", {}, wire.Status, ANSWER_TIMEOUT_S)

    def wait_for_core(self, report: Callable[[wire.Progress], object] = lambda _: None) -> None:
        """Wait while the core starts; where it compiles, that takes a minute or two.

        A core that does not run is not waited for.

        Args:
            report: called once with what is waited for.

        Raises:
            NoAnswerError: the service does not answer, or the core has not started after 600 s.
        """
        computer = MonotonicClock()
        end_ns = computer.now_ns() + START_TIMEOUT_NS
        is_reported = False
        while not (safety := self.status().safety).valid and safety.progress:
            if not is_reported:
                is_reported = True
                report(safety.progress)
            if computer.now_ns() >= end_ns or self._connection.is_over.wait(START_RETRY_S):
                raise NoAnswerError(f"{self.target}: still {safety.progress.code}")

    def configuration(self) -> wire.Configuration:
        """Return the configuration of the service: its legs, drives, limits."""
        return self._ask("config", {}, wire.Configuration, ANSWER_TIMEOUT_S)

    def enable(self) -> wire.Reply:
        """Let the service enable its drives; it then holds the pose.

        Raises:
            RequestRefusedError: with the reason; so for every request but status and configuration.
        """
        return self._done("enable")

    def disable(self) -> wire.Reply:
        """Stop in an orderly way, and switch the drives off."""
        return self._done("disable")

    def stop(self) -> wire.Reply:
        """Stop now, in any mode; every role may. This does not replace the emergency stop.

        Raises:
            NoAnswerError: the machine may not have stopped, although the stop was sent for 10 s.
        """
        return self._done(STOP)

    def reset(self) -> wire.Reply:
        """Reset a latched stop once its cause is gone; nothing is enabled by it."""
        return self._done("reset")

    def mode(
        self,
        mode: Mode | str,
        *,
        cadence_hz: float = 0.0,
        amplitude_ratio: float = 0.0,
        duration_s: float = 0.0,
        scenario: str = "",
        axis: str = "",
        witnessed: bool = False,
        baseline: bool = False,
    ) -> wire.Reply:
        """Go to another mode of the enabled machine.

        Args:
            mode: hold, gait, torque, excite, hand_guiding, self_test, reference or commission.
            cadence_hz: strides per second, for gait.
            amplitude_ratio: 0..1 of the full gait, for gait.
            duration_s: mandatory for gait and excite.
            scenario: name in the configuration, for excite.
            axis: LEG/AXIS, for reference and commission.
            witnessed: a person confirms that the axis moved as described, for commission.
            baseline: the patient is passive, for a gait of a minute; what is estimated meanwhile is
                taken off from then on.
        """
        return self._done(
            "mode",
            mode=mode,
            cadence_hz=cadence_hz,
            amplitude_ratio=amplitude_ratio,
            duration_s=duration_s,
            scenario=scenario,
            axis=axis,
            witnessed=witnessed,
            baseline=baseline,
        )

    def release_plan(self, limits: wire.PlanLimits) -> wire.Reply:
        """Release the limits within which a session may request a gait; for an operator."""
        return self._done("plan", plan=limits)

    def withdraw_plan(self) -> wire.Reply:
        """Withdraw the released limits: a session may not request a gait any more."""
        return self._done("plan", plan=None)

    def mark(self, text: str) -> wire.Reply:
        """Write a mark: an event with this text and the present time, for an operator.

        Args:
            text: one line of at most 80 characters, without a name of the patient.
        """
        return self._done("mark", text=text)

    def restart_gateway(self) -> wire.Reply:
        """Restart the gateway, so that changed keys take effect."""
        return self._done("restart")

    def request(self, name: str, **arguments: object) -> wire.Reply:
        """Send control/NAME with these arguments and return the reply, also a refusal.

        A stop is lost while the link reconnects. So it is sent again, for 10 s or until `with` is
        left, until it is answered; two stops are as one.

        Raises:
            NoAnswerError: none came.
        """
        if name != STOP:
            return self._ask(name, arguments, wire.Reply, ANSWER_TIMEOUT_S)
        computer = MonotonicClock()
        end_ns = computer.now_ns() + round(ANSWER_TIMEOUT_S * 1e9)
        while True:
            try:
                return self._ask(name, arguments, wire.Reply, STOP_ANSWER_TIMEOUT_S)
            except NoAnswerError as error:
                if computer.now_ns() >= end_ns or self._connection.is_over.wait(STOP_RETRY_S):
                    raise NoAnswerError(f"{NOT_STOPPED} ({error})") from error

    def acquire(self, client: str, duration_ms: int | None = None) -> wire.Reply:
        """Request the lease; `lease` does this, and keeps it."""
        arguments = {"client": client, "duration_ms": duration_ms}
        return self._ask("acquire", arguments, wire.Reply, ACQUIRE_TIMEOUT_S)

    def _ask(
        self, name: str, arguments: Mapping[str, object], kind: type[T], timeout_s: float
    ) -> T:
        payload = msgspec.json.encode({"client": self.client, **arguments})
        session = self._connection.session()
        return decode_answer(query(session, self.target, name, payload, timeout_s), kind, name)

    def _done(self, name: str, **arguments: object) -> wire.Reply:
        reply = self.request(name, **arguments)
        if reply.outcome == Outcome.REFUSED:
            raise RequestRefusedError(reply)
        if reply.outcome != Outcome.DONE:
            reason = reason_of(reply) or "the outcome is unknown"
            raise NoAnswerError(f"{name}: {reply.outcome}, {reason}; see `status`")
        return reply

    # --- assist ---------------------------------------------------------------------------------

    def lease(
        self,
        name: str,
        law: Law,
        *,
        legs: Sequence[str] | None = None,
        duration_ms: int | None = None,
        on_refusal: OnRefusal | None = None,
    ) -> Lease:
        """Return the lease to be held by `with`; inside, `law` answers each estimate.

        Args:
            name: of this controller, in events and as holder of the lease. With credentials their
                name replaces it.
            law: computes the assist for one estimate; see `Lease`.
            legs: whose estimates are answered; None: all of the trainer.
            duration_ms: of the lease without an accepted setpoint; None: as configured.
            on_refusal: called with each reason for which setpoints were refused.
        """
        return Lease(self, name, law, legs, duration_ms, on_refusal)


def _known(key: str, name: str, known: Sequence[str]) -> str:
    """Return the name of a leg or a drive.

    Raises:
        ValueError: another name; its key would have no messages, or those of several with `*`.
    """
    if name not in known:
        raise ValueError(f"{key}: {name!r} is none of {', '.join(known)}")
    return name
