"""The lease of a controller, and the loop that answers each estimate with a setpoint.

A law computes the assist for one estimate. It is called in modes torque and gait only; in all
other modes the lease is kept with neutral setpoints, as the protocol requires. The newest estimate
of a leg is answered: a law that takes longer than a cycle skips estimates.
docs/control_by_others.md of gaitd has the rules of the service.
"""

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import msgspec
import zenoh
from zenoh import CongestionControl, Priority

from gaitd_client import wire
from gaitd_client.errors import ClientError, RequestRefusedError
from gaitd_client.stream import POLL_S, NotValid
from gaitd_client.wire.names import Mode, Outcome
from gaitd_client.wire.refusals import REFUSAL_TEXT, SetpointRefusal

if TYPE_CHECKING:
    from gaitd_client.stream import Stream
    from gaitd_client.trainer import Trainer

ASSISTED: Final = frozenset({Mode.TORQUE, Mode.GAIT})
"""Modes in which assist is added."""
NO_LEASE: Final = frozenset({Mode.STOPPING, Mode.FAULT})
"""Modes in which no lease can be acquired."""
NS_PER_S: Final = 1_000_000_000


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


class Lease:
    """The right of one controller to send setpoints; made by `Trainer.lease`, held by `with`.

    If the lease ends by itself (a stop, a restart of the gateway or of the core), it is acquired
    again as soon as the service grants it. Assist then starts again only where an operator requests
    mode torque or gait again.

    An exception of the law ends the answers, so assist fades and the leg is held; `wait` and the
    end of `with` raise it.
    """

    def __init__(
        self,
        trainer: "Trainer",
        name: str,
        law: Law,
        legs: Sequence[str] | None,
        duration_ms: int | None,
        on_refusal: OnRefusal | None,
    ) -> None:
        """See `Trainer.lease`."""
        self._trainer, self._law, self._legs = trainer, law, legs
        self._duration_ms, self._on_refusal = duration_ms, on_refusal
        credentials = trainer.target.credentials
        self.name = name if credentials is None else credentials.file.name
        self.why_not = ""
        """Why the lease is not held at present; empty if it is."""
        self.answered_count = 0
        """Setpoints sent."""
        self.refused_count: dict[str, int] = {}
        """Setpoints of the trainer that were refused since `with`, by reason. The service counts
        those of all clients together, and reports once a second."""
        self._number: int | None = None
        self._acquired: wire.Reply | None = None
        self._counts: Mapping[str, int] | None = None
        self._not_finite_count = 0
        """Not sent, because JSON has no such number; since the last report."""
        self._seq = 0
        self._error: Exception | None = None
        self._is_over = threading.Event()
        self._lock = threading.Lock()
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._streams: list[Stream[wire.Estimate] | Stream[wire.Safety] | Stream[wire.Health]] = []

    @property
    def is_held(self) -> bool:
        """True if this controller holds the lease, as far as it knows."""
        return self._number is not None

    def __enter__(self) -> Self:
        """Acquire the lease, and start to answer.

        Raises:
            RequestRefusedError: another client holds it, or the machine is stopped.
            NoAnswerError: the service does not answer.
        """
        legs = self._legs or self._trainer.configuration().leg_names
        self._acquire()
        session = self._trainer.connected_session()
        for leg in legs:
            self._publishers[leg] = session.declare_publisher(
                wire.key(self._trainer.target.trainer, leg, wire.SETPOINT),
                encoding=wire.encoding(wire.SetpointMessage),
                congestion_control=CongestionControl.DROP,
                priority=Priority.REAL_TIME,
                express=True,
            )
            estimates = self._trainer.estimate(leg)
            self._streams.append(estimates)
            estimates.call(self._answer)
        safety, health = self._trainer.safety(), self._trainer.health()
        self._streams += [safety, health]
        safety.call(self._follow)
        health.call(self._count)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the answers and release the lease; raise the law's exception."""
        self._is_over.set()
        for stream in self._streams:
            stream.close()
        for publisher in self._publishers.values():
            publisher.undeclare()
        if self._number is not None:
            number, self._number = self._number, None
            # Refused if it has ended by itself in the meantime, which is as good.
            self._trainer.request("release", client=self.name, lease=number)
        if self._error is not None and error is None:
            raise self._error

    def wait(self, duration_s: float | None = None) -> None:
        """Let the law work for this time, by the trainer's clock; None: until it raises.

        Raises:
            Exception: what the law has raised.
        """
        clock = self._trainer.clock
        end_ns = None if duration_s is None else clock.now_ns() + round(duration_s * NS_PER_S)
        while end_ns is None or clock.now_ns() < end_ns:
            if self._is_over.wait(POLL_S):
                break
        if self._error is not None:
            raise self._error

    # --- in threads of the streams --------------------------------------------------------------

    def _answer(self, estimate: wire.Estimate | NotValid) -> None:
        """Answer one estimate; without one there is nothing to answer, and assist fades."""
        if isinstance(estimate, NotValid) or self._is_over.is_set():
            return
        with self._lock:
            number = self._number
            if number is None:
                return
            try:
                assist = self._law(estimate) if estimate.mode in ASSISTED else Assist()
            except Exception as error:  # noqa: BLE001 - raised by `wait` and at the end of `with`
                self._error = error
                self._is_over.set()
                return
            if not all(map(math.isfinite, assist)):
                self._not_finite_count += 1
                return
            self._seq += 1
            setpoint = wire.SetpointMessage(
                lease=number,
                seq=self._seq,
                for_cycle=estimate.cycle,
                hip_assist_nm=assist.hip_nm,
                slide_assist_n=assist.slide_n,
                stiffness_ratio=assist.stiffness_ratio,
            )
            self._publishers[estimate.leg].put(msgspec.json.encode(setpoint))
            self.answered_count += 1

    def _follow(self, safety: wire.Safety | NotValid) -> None:
        """Notice the end of the lease, and acquire it again."""
        if isinstance(safety, NotValid) or not safety.valid or self._is_over.is_set():
            return
        if self._number is not None and safety.lease_holder != self.name and self._is_newer(safety):
            self._number = None
            self.why_not = (
                f"held by {safety.lease_holder or 'no client'} since cycle {safety.cycle}"
            )
        if self._number is None and safety.lease_holder is None and safety.mode not in NO_LEASE:
            try:
                self._acquire()
            except ClientError as error:
                self.why_not = str(error)

    def _is_newer(self, safety: wire.Safety) -> bool:
        """Return whether the message was made after the lease was granted."""
        granted = self._acquired
        if granted is None or safety.core_boot_id != granted.core_boot_id:
            return True
        return (safety.cycle or 0) > (granted.cycle or 0)

    def _acquire(self) -> None:
        reply = self._trainer.acquire(self.name, self._duration_ms)
        if reply.outcome != Outcome.DONE:
            raise RequestRefusedError(reply)
        self._acquired, self._number, self.why_not = reply, reply.lease, ""

    def _count(self, health: wire.Health | NotValid) -> None:
        """Report what the service has refused since its last report."""
        if isinstance(health, NotValid):
            return
        with self._lock:
            not_finite_count, self._not_finite_count = self._not_finite_count, 0
        if not_finite_count:
            self._refuse(SetpointRefusal.NON_FINITE, not_finite_count)
        before, self._counts = self._counts, health.setpoint_refused_count
        for reason, count in self._counts.items():
            was = count if before is None else before.get(reason, 0)
            # A gateway that was restarted counts from 0.
            new = count - was if count >= was else count
            if new:
                self._refuse(reason, new)

    def _refuse(self, reason: str, count: int) -> None:
        self.refused_count[reason] = self.refused_count.get(reason, 0) + count
        text = REFUSAL_TEXT.get(reason)
        meaning = text.meaning if text else "a reason of a later version of the service"
        remedy = text.remedy if text else "see its documentation"
        if self._on_refusal is not None:
            self._on_refusal(Refusal(reason, count, meaning, remedy))
