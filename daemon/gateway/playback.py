"""Recorded records in place of a core: the gateway publishes them as it publishes live ones.

Nothing can be requested of a recording: every query that acts is refused, a stop too.
"""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from gaitd_client import wire
from gaitd_names import RefusalCode, Role

from daemon.config.settings import Lease
from daemon.gateway.clients import PLAN_FILE, ClientRefusedError, Clients, PlanStore
from daemon.gateway.outlet import Outlet
from daemon.gateway.service import Gateway
from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.transport import RingHeader
from daemon.report_messages import refused
from daemon.system.clock import AgeClock, MonotonicClock
from daemon.zenoh_io.publish import Mailbox, ZenohOutlet
from daemon.zenoh_io.session import open_session

POLL_S: Final = 0.002
NO_LEASE: Final = Lease(duration_ms=50, duration_max_ms=50)
"""None is granted."""


class NoCore:
    """The part of a `CoreLink` that needs a core."""

    def __init__(self, header: RingHeader) -> None:
        """Begin with the header of a recording."""
        self.header: RingHeader | None = header
        self.starting = False

    def take_unread(self) -> int:
        """Return none: no core writes any."""
        return 0

    def send(self, _gateway_state: GatewayState, /) -> bool:
        """Do nothing: there is no core."""
        return True


class Recorded(NoCore):
    """Records that become due in the pace of their times; the gateway's `CoreLink`."""

    def __init__(
        self, header: RingHeader, records: Sequence[CycleRecord], clock: AgeClock, pace: float
    ) -> None:
        """Begin now.

        Args:
            header: of the recording.
            records: at least one, oldest first.
            clock: measures the time since now.
            pace: recorded time in a time of the clock.
        """
        super().__init__(header)
        self._waiting, self._clock, self._pace = list(reversed(records)), clock, pace
        self._begin_ns, self._first_ns = clock.now_ns(), records[0].sync_mono_ns

    @property
    def is_over(self) -> bool:
        """True if all records were given."""
        return not self._waiting

    def records(self) -> list[CycleRecord]:
        """Return the records that have become due since the last call."""
        now_ns = self._first_ns + (self._clock.now_ns() - self._begin_ns) * self._pace
        due: list[CycleRecord] = []
        while self._waiting and self._waiting[-1].sync_mono_ns <= now_ns:
            due.append(self._waiting.pop())
        return due


class Readers(Clients):
    """Clients of a recording: they may read."""

    def __init__(self) -> None:
        """All clients that reach the endpoint."""
        super().__init__(None)

    def role(self, name: str, client: str) -> Role:
        """See `Clients`.

        Raises:
            ClientRefusedError: the query acts.
        """
        if name in wire.READING:
            return super().role(name, client)
        raise ClientRefusedError(refused(RefusalCode.RECORDING_PLAYED))


class RecordedClock:
    """The times of the newest record that was published."""

    def __init__(self, record: CycleRecord) -> None:
        """Begin at a record."""
        self.record = record

    def now_ns(self) -> int:
        """Monotonic time of its SYNC."""
        return self.record.sync_mono_ns

    def utc_ns(self) -> int:
        """UTC of its SYNC."""
        return self.record.sync_utc_ns


class Given(NoCore):
    """Records as they are given, one at a time; the gateway's `CoreLink`."""

    def __init__(self, header: RingHeader) -> None:
        """Begin without a record."""
        super().__init__(header)
        self.next: list[CycleRecord] = []

    def records(self) -> list[CycleRecord]:
        """Return what was given since the last call."""
        given, self.next = self.next, []
        return given


def publish_at_once(header: RingHeader, records: Sequence[CycleRecord], outlet: Outlet) -> None:
    """Give an outlet the messages of all records, as a gateway that is never late publishes them.

    Args:
        header: of the recording; `trainer` is TRAINER in the keys.
        records: at least one, oldest first.
        outlet: takes the messages.
    """
    clock, source, trainer = RecordedClock(records[0]), Given(header), header.trainer
    with TemporaryDirectory(prefix="gaitd-") as folder:
        plans = PlanStore(Path(folder) / PLAN_FILE, lambda _what, _run: False)
        gateway = Gateway(source, outlet, clock, trainer, (), NO_LEASE, Readers(), plans, str)
        for record in records:
            clock.record, source.next = record, [record]
            gateway.publish_estimates(clock.now_ns())
            gateway.turn(clock.now_ns(), ())


def play(
    header: RingHeader,
    records: Sequence[CycleRecord],
    listen: Sequence[str],
    pace: float,
) -> None:
    """Publish a recording on Zenoh to its end.

    Args:
        header: of the recording; `trainer` is TRAINER in the keys.
        records: at least one, oldest first.
        listen: endpoints.
        pace: recorded time in real time, above 0.

    Raises:
        zenoh.ZError: an endpoint cannot be listened on.
    """
    clock = MonotonicClock()
    with (
        TemporaryDirectory(prefix="gaitd-") as folder,
        closing(Mailbox()) as mailbox,
        closing(open_session(listen, header.trainer, None)) as session,
        closing(ZenohOutlet(session, header.trainer, mailbox)) as outlet,
    ):
        source = Recorded(header, records, clock, pace)
        plans = PlanStore(Path(folder) / PLAN_FILE, lambda _what, _run: False)
        trainer, readers = header.trainer, Readers()
        with closing(
            Gateway(source, outlet, clock, trainer, listen, NO_LEASE, readers, plans, str)
        ) as gateway:
            while not source.is_over:
                clock.sleep_until(clock.now_ns() + round(POLL_S * 1e9))
                gateway.publish_estimates(clock.now_ns())
                gateway.turn(clock.now_ns(), mailbox.drain())
