"""One turn of the gateway's loop: records in, messages out; queries in, gateway state out.

The order within a turn: first read the new records and publish the estimates of the young ones
(`publish_estimates`). Then (`turn`) publish the records' other messages and their events; check for
the core's silence; take setpoints; take queries; answer what has an answer; send the gateway state;
publish the messages that are due once a second; look for tremor. Nothing here blocks, and the time
is an argument.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec
from gaitd_client import wire
from gaitd_names import EventCode, Role
from gaitd_texts import Reader, catalogue

from daemon.config.settings import Lease
from daemon.gateway import events
from daemon.gateway.clients import Clients, PlanStore
from daemon.gateway.control import Control, Ending
from daemon.gateway.core_view import SILENCE_NS, CoreLink, CoreView
from daemon.gateway.health import HealthWindow
from daemon.gateway.lease import LeaseManager
from daemon.gateway.lease_control import LeaseControl
from daemon.gateway.leg_messages import LegMessages
from daemon.gateway.machine_messages import MachineMessages, next_due
from daemon.gateway.outlet import Outlet
from daemon.gateway.requests import Inquiry, RequestQueue
from daemon.gateway.setpoints import NOTHING, Batch
from daemon.ipc.record import CycleRecord
from daemon.ipc.transport import RingHeader
from daemon.system.clock import AgeClock

STATE_PERIOD_NS: Final = 20_000_000
SECOND_NS: Final = 1_000_000_000
STATUS_EVENT_COUNT: Final = 20


class Gateway:
    """The gateway between the IPC channel and the outlet."""

    def __init__(
        self,
        ipc: CoreLink,
        outlet: Outlet,
        clock: AgeClock,
        trainer: str,
        listen: Sequence[str],
        lease: Lease,
        clients: Clients,
        plans: PlanStore,
        check_keys: Callable[[], str],
    ) -> None:
        """Begin without a core.

        Args:
            ipc: the channel to the core, or a recording (`playback.py`).
            outlet: publishes messages.
            clock: for ages.
            trainer: TRAINER in the keys.
            listen: endpoints, for the message `config`.
            lease: rules of the lease.
            clients: those that may connect.
            plans: the released plan.
            check_keys: reads the folder of keys as the next start will; returns why it cannot.
        """
        self._outlet, self._clock = outlet, clock
        self._clients, self._plans = clients, plans
        self._trainer, self._listen = trainer, tuple(listen)
        self._core = CoreView(ipc)
        self.events = events.EventLog(outlet, self._core, clock)
        self._requests = RequestQueue(first_state_seq=clock.now_ns())
        self.lease_control = LeaseControl(LeaseManager(lease))
        self.health = HealthWindow()
        self.health.counters.setpoint_refused_count = self.lease_control.refused_count
        self._legs = LegMessages(outlet, clock, self.health)
        self._machine = MachineMessages(outlet, self._core, self.lease_control.leases)
        self.ending = Ending(self._core, self._requests, check_keys)
        self._control = Control(
            outlet,
            self._core,
            self.events,
            self._requests,
            self.lease_control,
            clients,
            plans,
            self.ending,
            self._information,
        )
        self._fresh: list[CycleRecord] = []
        self._state_due_ns = 0
        self._second_due_ns = clock.now_ns() + SECOND_NS
        if plans.trouble:
            trouble = events.EventDraft(
                events.Priority.LOW,
                events.Kind.NOTE,
                EventCode.PLAN_UNREADABLE,
                said=plans.trouble,
            )
            self.events.publish([trouble])

    def publish_estimates(self, now_ns: int) -> bool:
        """Publish the estimates of new records; the rest of a turn can wait for a millisecond.

        Returns: whether there were new records.
        """
        records, header = self._core.read(), self._core.link.header
        if not records or header is None:
            return False
        self._fresh += records
        self._legs.publish_estimates(records, header.core_boot_id, now_ns)
        return True

    def turn(self, now_ns: int, inquiries: Sequence[Inquiry], batch: Batch = NOTHING) -> None:
        """One turn of the loop, after `publish_estimates`."""
        records, self._fresh = self._fresh, []
        self._receive(records, now_ns)
        if unread_count := self._core.link.take_unread():
            self.events.publish([events.unread(unread_count)])
        self.events.publish(self.lease_control.receive_setpoints(batch, now_ns))
        self._control.receive(inquiries, now_ns)
        self._control.settle(self._requests.tick(now_ns))
        self._control.settle(self._plans.answers())
        self.events.publish(self.lease_control.tick(now_ns))
        self.events.tick(now_ns)
        self._machine.publish_safety(is_due=now_ns >= self._second_due_ns)
        if records or inquiries or batch.arrivals or now_ns >= self._state_due_ns:
            self._state_due_ns = now_ns + STATE_PERIOD_NS
            self._send_state()
        if now_ns >= self._second_due_ns:
            self._second_due_ns = next_due(self._second_due_ns, SECOND_NS, now_ns)
            seq = self._outlet.next_seq(wire.HEALTH)
            expiring = self._clients.expiring(self._clock.utc_ns())
            self._outlet.put(self.health.close(self._core.stamp, seq, expiring), wire.HEALTH)
        self._legs.follow_tremors()

    def last_turn(self, now_ns: int, inquiries: Sequence[Inquiry], batch: Batch) -> None:
        """Read what had arrived when the loop ended: a stop counts, other requests are refused."""
        self.ending.is_last_turn = True
        self.turn(now_ns, inquiries, batch)

    def _send_state(self) -> None:
        control = self.lease_control
        holder = control.leases.holder
        role = self._clients.role("acquire", holder) if holder else Role.DISPLAY
        gateway_state = self._requests.gateway_state(control.setpoints, control.lease, role)
        if gateway_state and not self._core.link.send(gateway_state) and self._core.is_present:
            self.health.counters.gateway_state_dropped_count += 1

    @property
    def status(self) -> str:
        """One line for systemd's status."""
        record = self._core.record
        if record is None:
            return "no records from a core"
        mode = catalogue(Reader.OPERATOR, "en").text(f"mode.{record.mode}")
        return f"{mode} [{record.mode}]"

    def close(self) -> None:
        """Answer the queries that still wait."""
        self._control.close()

    # --- records ------------------------------------------------------------------------------

    def _receive(self, records: Sequence[CycleRecord], now_ns: int) -> None:
        core, header = self._core, self._core.link.header
        if records and header:
            is_new = core.newest is None or header.core_boot_id != core.boot_id
            is_back = not is_new and not core.is_present
            core.records_arrive(now_ns)
            if is_new:
                self._begin_core(header)
            self._legs.publish_others()
            for record in records:
                self._receive_record(record)
            if is_back:
                self.events.publish([events.CORE_BACK])
            # The newest record holds the outcomes of all stops and of the one request.
            self._control.settle(self._requests.receive(core.boot_id, records[-1]))
            self.events.publish(self.lease_control.receive_record(records[-1], now_ns))
            self._machine.publish_drives(now_ns)
        elif core.falls_silent(now_ns):
            self.events.publish([events.core_lost(SILENCE_NS // 1_000_000)])
            self._control.settle(self._requests.lose_core())
        self._outlet.set_alive(core.is_present)

    def _begin_core(self, header: RingHeader) -> None:
        """Reset what belongs to the previous core: a record of a new core has arrived."""
        self._core.boot_id, self._core.newest = header.core_boot_id, None
        self.events.publish(self.lease_control.begin_core(header.leg_names))
        self.health.core_started()
        self._machine.begin_core()

    def _receive_record(self, record: CycleRecord) -> None:
        before, self._core.newest = self._core.newest, record
        if before is not None:
            self.health.counters.record_missed_count += max(record.seq - before.seq - 1, 0)
        self.health.add(record)
        self._machine.add(record)
        self.events.publish(events.new_events(before, record), record.sync_utc_ns)

    # --- information --------------------------------------------------------------------------

    def _information(self, name: str, head: dict[str, Any]) -> msgspec.Struct:
        """The answer to a query that only reads."""
        match name:
            case "status":
                newest = tuple(self.events.history)[-STATUS_EVENT_COUNT:]
                return self._machine.status(head, newest, self._plans.limits)
            case "config":
                return self._configuration(head)
            case _:
                return wire.Schemas(**head, schemas=wire.schemas())

    def _configuration(self, head: dict[str, Any]) -> wire.Configuration:
        header = self._core.link.header
        return wire.Configuration(
            **head,
            version=header.version if header else None,
            trainer=self._trainer,
            listen=self._listen,
            period_ns=header.period_ns if header else None,
            drive_names=header.drive_names if header else (),
            leg_names=header.leg_names if header else (),
            joints=wire.JOINTS,
            config_hashes=header.config_hashes if header else {},
            robot=header.robot if header else {},
            limits=header.limits if header else {},
            guidance=header.guidance if header else {},
            keys=self._clients.have_keys,
            keys_expiring=self._clients.expiring(self._clock.utc_ns()),
            links=tuple(self._clients.link(*link) for link in self._outlet.links()),
        )
