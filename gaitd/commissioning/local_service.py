"""A running service on this computer, by the ring of its core and by its bus.

The raw values of each cycle come from the ring; objects are read by SDO beside the service, while
the drives have no power. Requests go over Zenoh.
"""

import time
from collections import deque
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Final

from gaitd_client import ClientError, NoAnswerError, Reply, Trainer

from analysis.acceptance.record import Finding, Report, Service
from daemon.config.bundle import Settings
from daemon.config.drive_plan import plan_of
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RING_NAME, RingError, RingReader
from daemon.report_messages import event_values, judgement
from daemon.system.bus_choice import bus_of, opened
from drives.bringup.configurator import Configurator
from drives.canopen.sniffer import BusSniffer, SniffedBus
from drives.errors import BringUpRefused, BusError, DescriptionError, DriveSilent, SdoTimeout
from drives.service.dump import check_alone
from drives.service.scan import listen
from gaitd.commissioning.messages import Observation, ReadObjects, Request
from gaitd.commissioning.objects import read_findings, unread
from gaitd.terminal import run_with_progress

RING_S: Final = 0.02
SILENT_S: Final = 10.0
"""If no record comes for so much of the computer's time, the service is gone."""
RECORDS_KEPT: Final = 6000
"""One minute."""
LISTEN_NS: Final = 500_000_000
TRIES: Final = 10
"""Attempts to read a drive's objects while the service's bring-up reads them."""


class CoreRestartedError(ClientError):
    """The records go on with those of another core, which knows nothing of the steps before."""


def observed(records: Iterable[CycleRecord], kept: deque[CycleRecord]) -> Observation:
    """The observation of new records; nothing but what is kept if there are none."""
    new = list(records)
    if not kept:
        return Observation(is_silent=True)
    newest = kept[-1]
    return Observation(
        newest.sync_mono_ns * 1e-9,
        Service(newest.mode, judgement(newest.verdict)),
        kept,
        tuple(
            Report(event.code, event.subject, event_values(event), event.said)
            for record in new
            for event in record.events
        ),
    )


class LocalService:
    """A service on this computer."""

    def __init__(self, trainer: Trainer | None, settings: Settings) -> None:
        self._trainer, self._settings = trainer, settings
        self._records: deque[CycleRecord] = deque(maxlen=RECORDS_KEPT)
        self._ring: RingReader | None = None
        self._seq = 0

    def request(self, request: Request) -> Reply:
        """See `Source`."""
        if self._trainer is None:
            raise NoAnswerError("no service")
        return self._trainer.request(request.name, **request.arguments)

    def newest(self) -> Observation:
        """See `Source`."""
        return observed(self._new(), self._records)

    def following(self) -> Observation:
        """See `Source`; records that come while it waits are handed over one by one."""
        heard = time.monotonic()
        while time.monotonic() < heard + SILENT_S:
            for record in self._new():
                return observed((record,), self._records)
            time.sleep(RING_S)
        return observed((), self._records)._replace(is_silent=True)

    def read(self, wanted: ReadObjects) -> tuple[Finding, ...]:
        """See `Source`."""
        why = ""
        for _ in range(TRIES):
            try:
                return self._read(wanted)
            except (BringUpRefused, BusError, DriveSilent, SdoTimeout, DescriptionError) as error:
                why = str(error)
        return unread(wanted.drive, why)

    def _read(self, wanted: ReadObjects) -> tuple[Finding, ...]:
        plan = plan_of(wanted.drive, self._settings)
        with opened(bus_of(self._settings.file)) as (bus, clock):
            sniffer = BusSniffer()
            beside = SniffedBus(bus, clock, sniffer)
            run_with_progress(listen(beside, clock, LISTEN_NS))
            check_alone(plan, sniffer.node(plan.description.node_id))
            port = Configurator(beside, clock)
            return run_with_progress(read_findings(plan, port, is_set_up=wanted.is_set_up))

    def _new(self) -> Generator[CycleRecord]:
        """Records that have come since the last look.

        Raises:
            CoreRestartedError: they are those of another core.
        """
        path = self._settings.runtime / RING_NAME
        try:
            if self._ring is None or self._ring.inode != path.stat().st_ino:
                if self._records:
                    raise CoreRestartedError("the core was started anew: give the command again")
                self._ring = RingReader(path)
                self._seq = self._ring.newest_seq() - 1
            if self._ring.raw(self._seq) is None:  # not looked at for longer than the ring is
                self._seq = max(self._ring.newest_seq() - 1, 0)
            while (record := self._ring.read(self._seq + 1)) is not None:
                self._seq += 1
                self._records.append(record)
                yield record
        except (FileNotFoundError, RingError):
            return

    def foreign_files(self) -> str:
        """Names of the files of this command that are not those of the service; empty if none."""
        self.newest()
        if self._ring is None:
            return ""
        running = set(self._ring.header.config_hashes.values())
        files = self._settings.hashes.items()
        return ", ".join(sorted(Path(name).name for name, digest in files if digest not in running))

    @property
    def boot_id(self) -> str:
        """Boot id of the core; empty if there is none."""
        return "" if self._ring is None else self._ring.header.core_boot_id
