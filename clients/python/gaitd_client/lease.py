"""The lease of a controller, and the loop that answers each estimate with a setpoint.

A law computes the assist for one estimate. It is called in modes torque and gait only; in all
other modes the lease is kept with neutral setpoints, as the protocol requires. The newest estimate
of a leg is answered: a law that takes longer than a cycle skips estimates.
docs/control_by_others.md of gaitd has the rules of the service.
"""

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from types import MappingProxyType, TracebackType
from typing import Final, NamedTuple, Protocol, Self, SupportsFloat, TypeVar

import msgspec
import zenoh
from gaitd_names import Mode, Outcome, SetpointRefusal
from gaitd_texts import Reader, catalogue
from zenoh import CongestionControl, Priority

from gaitd_client import wire
from gaitd_client.clock import Clock
from gaitd_client.connection import Target
from gaitd_client.errors import (
    ClientError,
    NoAnswerError,
    NotReturnedError,
    RequestRefusedError,
)
from gaitd_client.stream import POLL_S, NotValid, Stream

T = TypeVar("T", bound=msgspec.Struct)

ASSISTED: Final = frozenset({Mode.TORQUE, Mode.GAIT})
"""Modes in which assist is added."""
NO_LEASE: Final = frozenset({Mode.STOPPING, Mode.FAULT})
"""Modes in which no lease can be acquired."""
NS_PER_S: Final = 1_000_000_000
"""Nanoseconds in a second."""
REQUEST_NEEDED: Final = (
    "the lease was lost and acquired again: setpoints are neutral until the mode is left and"
    " requested again"
)
"""What `Lease.why_not` says of a lease that was lost in a mode that goes on."""


class Assist(NamedTuple):
    """A controller's wish for one leg, on top of gravity; the default is neutral."""

    hip_nm: float = 0.0
    """Torque at the hip in N·m, positive in the direction of rising hip angle."""
    slide_n: float = 0.0
    """Force at the slide in N, positive in the direction of rising slide position."""
    stiffness_ratio: float = 1.0
    """0..1 of the configured guidance's stiffness, for mode gait."""


class Refusal(NamedTuple):
    """Setpoints of the trainer that were refused for one reason."""

    reason: str
    """A `SetpointRefusal`, or the name of a reason that this version does not know."""
    setpoint_count: int
    """New ones since the last report."""
    meaning: str
    remedy: str


Law = Callable[[wire.Estimate], Assist]
OnRefusal = Callable[[Refusal], object]


class Leased(Protocol):
    """What a lease needs of `gaitd_client.trainer.Trainer`."""

    @property
    def clock(self) -> Clock:
        """Clock of this client."""
        ...

    @property
    def target(self) -> Target:
        """Which service."""
        ...

    def configuration(self) -> wire.Configuration:
        """Ask for the service's configuration."""
        ...

    def connected_session(self) -> zenoh.Session:
        """Return the connection."""
        ...

    def estimate(self, leg: str) -> Stream[wire.Estimate]:
        """Open the estimates of a leg."""
        ...

    def health(self) -> Stream[wire.Health]:
        """Open the messages on the service itself."""
        ...

    def safety(self) -> Stream[wire.Safety]:
        """Open the messages on mode and stops."""
        ...

    def acquire(self, client: str, duration_ms: int | None) -> wire.Reply:
        """Request the lease."""
        ...

    def request(self, name: str, **arguments: object) -> wire.Reply:
        """Send a request, and wait for its outcome."""
        ...


class Lease:
    """The right of one controller to send setpoints; made by `Trainer.lease`, held by `with`.

    If the lease ends by itself (a stop, a restart of the gateway or of the core), it is acquired
    again once the service grants it, estimates arrive, and no call of the law is running. Setpoints
    are then neutral until the machine was in a mode without assist; so the law is called again only
    after a new request of mode torque or gait.

    An exception of the law or of `on_refusal`, SystemExit too, ends the answers for all legs, so
    assist fades and the leg is held; `wait` and the end of `with` raise it.
    """

    def __init__(
        self,
        trainer: Leased,
        name: str,
        law: Law,
        legs: Sequence[str] | None,
        duration_ms: int | None,
        on_refusal: OnRefusal | None,
    ) -> None:
        """See `Trainer.lease`."""
        if isinstance(legs, str):
            raise TypeError(f"legs = {legs!r}: a sequence of names is needed, such as [{legs!r}]")
        self.clock = trainer.clock
        """The trainer's clock, by which `wait` ends."""
        self._trainer, self._law, self._legs = trainer, law, legs
        self._duration_ms, self._on_refusal = duration_ms, on_refusal
        credentials = trainer.target.credentials
        self.name = name if credentials is None else credentials.file.name
        self.answered_count = 0
        """Setpoints sent."""
        self.refused_count: dict[str, int] = {}
        """Setpoints of the trainer that were refused, by reason. The service counts those of all
        clients together, and reports once a second; those before its first report after `with`, or
        after a restart, in the first second, are not counted."""
        self._grant: wire.Reply | None = None
        self._not_granted = "`with` was not entered"
        self._unknown = ""
        """Why nothing is known about the lease at present."""
        self._lost: wire.Safety | None = None
        """The loss of a lease after which no new request of an assisted mode was seen."""
        self._loss_lock = threading.Lock()
        """Held while a loss is noted, or cleared: a later one must not be cleared with it."""
        self._has_estimate = False
        """True if an estimate was processed since the lease was granted."""
        self._counts: Mapping[str, int] | None = None
        self._not_finite_count = self._not_finite_reported = 0
        """Not sent, because JSON has no such number."""
        self._seq = 0
        self._error: BaseException | None = None
        self._is_over = threading.Event()
        self._law_lock = threading.Lock()
        """Held while the law is called, and while the lease is acquired again."""
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._ending = ExitStack()

    @property
    def is_held(self) -> bool:
        """True if this controller holds the lease and answers, as far as it knows."""
        return self._grant is not None and not self._unknown and not self._is_over.is_set()

    @property
    def why_not(self) -> str:
        """Why the law is not in force: no lease, or a new request is needed; empty if it is."""
        if self._error is not None:
            return f"ended by {type(self._error).__name__}: {self._error}"
        if self._grant is None:
            return self._not_granted
        return self._unknown or (REQUEST_NEEDED if self._lost is not None else "")

    def __enter__(self) -> Self:
        """Acquire the lease, and start to answer.

        Raises:
            RequestRefusedError: another client holds it, or the machine is stopped.
            NoAnswerError: the service does not answer, or its core was never there.
            ValueError: `legs` names none, or one that the trainer does not have.
        """
        # It may be entered again, after a refusal for example.
        self._error, self._lost, self._counts = None, None, None
        self._is_over.clear()
        trainer, known = self._trainer, self._trainer.configuration().leg_names
        if not known:
            raise NoAnswerError(
                f"{trainer.target}: the gateway has no records of a core yet, so its legs are not"
                " known; start the core, or look at its log, then enter the lease again"
            )
        legs = known if self._legs is None else tuple(dict.fromkeys(self._legs))
        if not legs or not set(legs) <= set(known):
            raise ValueError(f"legs = {legs}: one or more of {known} are allowed")
        session = trainer.connected_session()
        with ExitStack() as ending:
            # Called in the reverse order. Only after `safety` is closed nothing acquires again.
            ending.callback(self._release)
            for leg in legs:
                self._publishers[leg] = session.declare_publisher(
                    wire.key(trainer.target.trainer, leg, wire.SETPOINT),
                    encoding=wire.encoding(wire.SetpointMessage),
                    congestion_control=CongestionControl.DROP,
                    priority=Priority.REAL_TIME,
                    express=True,
                )
                ending.callback(self._publishers[leg].undeclare)
            estimates = [self._opened(ending, trainer.estimate(leg), "the law") for leg in legs]
            health = self._opened(ending, trainer.health(), "on_refusal")
            safety = self._opened(ending, trainer.safety(), "the request of the lease")
            ending.callback(self._is_over.set)
            self._acquire()
            for stream in estimates:
                stream.call(self._guarded(self._answer))
            health.call(self._guarded(self._count))
            safety.call(self._guarded(self._follow))
            self._ending = ending.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the answers and release the lease; raise the law's exception.

        The first exception is raised (of `with`, of the law, of the end), but KeyboardInterrupt
        before all others; those are its notes.

        Raises:
            NotReturnedError: the law, or `on_refusal`, does not return.
        """
        trouble: BaseException | None = None
        try:
            self._ending.close()
        except BaseException as end_error:  # noqa: BLE001 - raised below, or a note of another one
            trouble = end_error
        law_error = None if self._error is error else self._error
        raised = [one for one in (error, law_error, trouble) if one is not None]
        raised.sort(key=lambda one: not isinstance(one, KeyboardInterrupt))
        first, *others = raised or [None]
        if first is None:
            return
        for other in others:
            first.add_note(f"At the end of the lease: {type(other).__name__}: {other}")
        if first is not error:
            raise first

    def wait(self, duration_s: float | None = None) -> None:
        """Let the law work for this time, by the trainer's clock; None: until it raises.

        Raises:
            BaseException: what the law or `on_refusal` has raised.
        """
        clock = self.clock
        end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * NS_PER_S)
        while end_ns is None or clock.now_ns() < end_ns:
            if self._is_over.wait(POLL_S):
                break
        if self._error is not None:
            raise self._error

    def report(
        self,
        leg: str,
        for_cycle: int,
        values: Mapping[str, object],
        hip: Mapping[str, object] = MappingProxyType({}),
        slide: Mapping[str, object] = MappingProxyType({}),
    ) -> None:
        """Publish the state of this controller for one leg, for displays; once a stride is usual.

        Waits for the service, so do not call it in the law. Without the lease nothing is sent.

        Args:
            leg: right or left.
            for_cycle: `cycle` to which the state belongs.
            values: of the leg; numbers, None or arrays of up to 64, by names that end in the unit.
            hip: of the hip; its positions, velocities and efforts have no unit in their name.
            slide: of the slide, as for the hip.

        Raises:
            RequestRefusedError: the lease has ended in the meantime, or a value is not allowed.
            NoAnswerError: the service does not answer.
        """
        grant = self._grant
        if grant is None:
            return
        reply = self._trainer.request(
            "report",
            client=self.name,
            lease=grant.lease,
            leg=leg,
            for_cycle=for_cycle,
            values=values,
            hip=dict(hip),
            slide=dict(slide),
        )
        if reply.outcome != Outcome.DONE:
            raise RequestRefusedError(reply)

    def _opened(self, ending: ExitStack, stream: Stream[T], function_name: str) -> Stream[T]:
        def close() -> None:
            try:
                stream.close()
            except NotReturnedError as error:
                raise NotReturnedError(f"{function_name} does not return: {error}") from error

        ending.callback(close)
        return stream

    def _release(self) -> None:
        grant, self._grant, self._not_granted = self._grant, None, "`with` was left"
        if grant is not None:
            # Refused if it has ended by itself in the meantime, which is as good.
            self._trainer.request("release", client=self.name, lease=grant.lease)

    # --- in threads of the streams --------------------------------------------------------------

    def _guarded(self, function: Callable[[T | NotValid], None]) -> Callable[[T | NotValid], None]:
        """Return the function with its exceptions kept for `wait` and the end of `with`."""

        def call(item: T | NotValid) -> None:
            if self._is_over.is_set():
                return
            try:
                function(item)
            except BaseException as error:  # noqa: BLE001 - raised by `wait` and the end of `with`
                if self._error is None:
                    self._error = error
                self._is_over.set()

        return call

    def _answer(self, estimate: wire.Estimate | NotValid) -> None:
        """Answer one estimate; without one there is nothing to answer, and assist fades."""
        if isinstance(estimate, NotValid):
            return
        while not self._law_lock.acquire(timeout=POLL_S):
            if self._is_over.is_set():
                return
        try:
            self._answer_alone(estimate)
        finally:
            self._law_lock.release()

    def _answer_alone(self, estimate: wire.Estimate) -> None:
        is_assisted = estimate.mode in ASSISTED
        with self._loss_lock:
            lost = self._lost
            # An estimate that has waited behind a call of the law may be older than the loss.
            if not is_assisted and lost is not None and _is_newer(estimate, lost):
                self._lost = None
        self._has_estimate = True
        grant = self._grant
        if grant is None or grant.lease is None:
            return
        assist = Assist()
        if is_assisted and self._lost is None:
            assist = _checked(self._law(estimate), estimate)
        if self._is_over.is_set() or self._grant is not grant:
            return
        if not all(map(math.isfinite, assist)):
            self._not_finite_count += 1
            return
        self._seq += 1
        setpoint = wire.SetpointMessage(
            lease=grant.lease,
            seq=self._seq,
            for_cycle=estimate.cycle,
            hip=wire.AxisSetpoint(assist=assist.hip_nm),
            slide=wire.AxisSetpoint(assist=assist.slide_n),
            stiffness_ratio=assist.stiffness_ratio,
        )
        self._publishers[estimate.leg].put(msgspec.json.encode(setpoint))
        self.answered_count += 1

    def _follow(self, safety: wire.Safety | NotValid) -> None:
        """Notice the end of the lease, and acquire it again."""
        if isinstance(safety, NotValid):
            self._unknown = f"the service is away: {safety.text}"
            return
        self._unknown = "" if safety.valid else "the gateway receives nothing from the core"
        if not safety.valid:
            return
        holder, grant = safety.lease_holder, self._grant
        if grant is not None and holder != self.name and _is_newer(safety, grant):
            with self._loss_lock:
                self._lost = safety
            self._grant, self._not_granted = None, f"it has ended before cycle {safety.cycle}"
        if self._grant is None:
            self._acquire_again(safety)

    def _acquire_again(self, safety: wire.Safety) -> None:
        if safety.lease_holder is not None:
            self._not_granted = f"held by {safety.lease_holder}"
        elif safety.mode in NO_LEASE:
            self._not_granted = f"mode {safety.mode}: the machine must be reset first"
        elif not self._law_lock.acquire(timeout=POLL_S):
            self._not_granted = "the law does not return"
        else:
            try:
                if self._has_estimate:
                    self._acquire()
                else:
                    self._not_granted = "it has ended, and no estimate arrives"
            except ClientError as error:
                self._not_granted = str(error)
            finally:
                self._law_lock.release()

    def _acquire(self) -> None:
        reply = self._trainer.acquire(self.name, self._duration_ms)
        if reply.outcome != Outcome.DONE:
            raise RequestRefusedError(reply)
        self._has_estimate = False
        self._grant = reply

    def _count(self, health: wire.Health | NotValid) -> None:
        """Report what the service has refused since its last report."""
        if isinstance(health, NotValid):
            return
        not_finite_count = self._not_finite_count
        if not_finite_count > self._not_finite_reported:
            self._refuse(SetpointRefusal.NON_FINITE, not_finite_count - self._not_finite_reported)
            self._not_finite_reported = not_finite_count
        before, self._counts = self._counts, health.setpoint_refused_count
        for reason, count in self._counts.items():
            was = count if before is None else before.get(reason, 0)
            # Less: the gateway or the core has restarted, and the sum of both is the new base.
            if count > was:
                self._refuse(reason, count - was)

    def _refuse(self, reason: str, count: int) -> None:
        self.refused_count[reason] = self.refused_count.get(reason, 0) + count
        if self._on_refusal is not None:
            texts = catalogue(Reader.OPERATOR, "en")
            meaning = texts.text(f"setpoint_refusal.{reason}")
            remedy = texts.text(f"remedy.{reason}")
            self._on_refusal(Refusal(reason, count, meaning, remedy))


def _is_newer(message: wire.Stated, other: wire.Stated) -> bool:
    """Return whether the message is of a later cycle than the other, or of another core."""
    if message.core_boot_id != other.core_boot_id:
        return True
    return (message.cycle or 0) > (other.cycle or 0)


def _checked(assist: object, estimate: wire.Estimate) -> Assist:
    """Return what the law has returned, with numbers of Python (numpy's cannot be encoded).

    Raises:
        TypeError: it is no `Assist` of numbers.
    """
    where = f"the law has returned for leg {estimate.leg}, cycle {estimate.cycle}"
    if not isinstance(assist, Assist):
        raise TypeError(f"{where}: {assist!r}; return an Assist, Assist() is neutral")
    for name, value in assist._asdict().items():
        if not isinstance(value, SupportsFloat):
            raise TypeError(f"{where}: {name} = {value!r}; a number is needed")
    return Assist(*map(float, assist))
