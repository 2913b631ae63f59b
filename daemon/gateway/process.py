"""The gateway's process: opens ipc and Zenoh, runs the loop until it must end, closes both.

The loop runs in one thread; other threads of ours only wait for the disk. It sleeps in poll() and
is woken by the core's datagram, by a query or by a setpoint, and after 20 ms at the latest, so that
the core keeps receiving the gateway state. Only this loop triggers the watchdog.
"""

import ctypes
import gc
import select
from collections.abc import Callable, Sequence
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Final

from gaitd_toml import ConfigError

from daemon.config.settings import Lease
from daemon.gateway.clients import PLAN_FILE, Clients, PlanStore
from daemon.gateway.events import DescriptorEvents
from daemon.gateway.reload import Reload
from daemon.gateway.service import STATE_PERIOD_NS, Gateway
from daemon.gateway.setpoints import SetpointBox
from daemon.ipc.transport import GatewayChannel
from daemon.keys.folder import Keys
from daemon.recorder.recorder import DiskRecorder
from daemon.system.clock import AgeClock, MonotonicClock
from daemon.system.descriptors import has_free_descriptor
from daemon.system.sd_notify import Notifier
from daemon.zenoh_io.publish import Mailbox, ZenohOutlet
from daemon.zenoh_io.session import open_session
from daemon.zenoh_io.subscribe import SetpointSubscriber

_POLL_MS: Final = STATE_PERIOD_NS // 1_000_000
_REST_MS: Final = 1
"""Pause after publishing estimates, if no client sends a request: on a machine with few processors
Zenoh's thread needs this one's. Without the pause estimates arrived 0.1 ms later on two processors.
"""
_M_ARENA_MAX: Final = -8
"""M_ARENA_MAX of mallopt(3)."""
_NOTIFY_NS: Final = 500_000_000
"""Interval between two notifications to systemd."""


def share_one_heap() -> None:
    """Let all threads allocate from one heap; must be called before Zenoh starts its threads.

    By default glibc gives each thread a heap of its own, up to eight per processor. Zenoh opens and
    closes links in any of its threads, so each heap in turn grows to the size of a link's buffers:
    memory use rises for hours although memory is free in other heaps.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # mallopt is glibc's; other C libraries have one heap anyway
        mallopt(_M_ARENA_MAX, 1)


def serve(
    trainer: str,
    listen: Sequence[str],
    runtime: Path,
    state: Path,
    clock: AgeClock,
    ended: Callable[[], bool],
    lease: Lease,
    notify_address: str | None,
    reload: Reload,
    read_keys: Callable[[], Keys | None],
) -> bool:
    """Run the gateway until `ended` returns true; it is called at least every 20 ms.

    Returns: whether a client requested a restart, so that changed keys take effect.

    Ages of records, leases and setpoints are measured by `clock`. The gateway's own work and the
    interval of notifications to systemd are measured by the computer's monotonic clock.

    Raises:
        zenoh.ZError: an endpoint cannot be listened on.
        ConfigError: the folder of keys cannot be used.
        OSError: the runtime directory does not exist or cannot be written.
    """
    keys = read_keys()
    # The order of closing matters: outlet and subscriber undeclare and wait for their callbacks,
    # then the session closes (an open one would hang the process), and then mailbox and box.
    with (
        closing(Notifier(notify_address)) as supervisor,
        closing(GatewayChannel(runtime)) as ipc,
        closing(Mailbox()) as mailbox,
        closing(SetpointBox()) as box,
        closing(open_session(listen, trainer, keys)) as session,
        closing(ZenohOutlet(session, trainer, mailbox)) as outlet,
        closing(SetpointSubscriber(session, trainer, box)),
        closing(
            DiskRecorder(state, runtime, clock, version("gaitd"), have_keys=keys is not None)
        ) as recorder,
        closing(
            Gateway(
                ipc,
                outlet,
                clock,
                trainer,
                listen,
                lease,
                Clients(keys),
                PlanStore(state / PLAN_FILE, recorder.submit),
                lambda: _trouble(read_keys),
            )
        ) as gateway,
    ):
        poller = select.poll()
        poller.register(ipc.fileno(), select.POLLIN)
        poller.register(mailbox.fileno(), select.POLLIN)
        poller.register(box.fileno(), select.POLLIN)
        _freeze()
        supervisor.send("READY=1")
        wall, notify_ns, descriptors = MonotonicClock(), 0, DescriptorEvents()
        while not (ended() or (gateway.ending.may_end and mailbox.is_empty)):
            poller.poll(_POLL_MS)
            woken_ns = wall.now_ns()
            has_put = gateway.publish_estimates(clock.now_ns())
            hurried_ns = wall.now_ns() - woken_ns
            if has_put:
                poller.poll(_REST_MS)
            begun_ns, resumed_ns = clock.now_ns(), wall.now_ns()
            inquiries = recorder.wrap(mailbox.drain())
            gateway.turn(begun_ns, inquiries, box.drain(begun_ns))
            gateway.events.publish(recorder.turn(ipc.ring, begun_ns))
            hashes = ipc.header.config_hashes if ipc.header else {}
            gateway.events.publish(reload.turn(gateway.lease_control.leases, hashes))
            gateway.health.counters.not_kept_count = recorder.not_kept_count
            box.expect(gateway.lease_control.lease)
            gateway.health.counters.request_dropped_count = mailbox.dropped_count
            gateway.health.add_wake(hurried_ns + wall.now_ns() - resumed_ns)
            if resumed_ns >= notify_ns:
                gateway.events.publish(descriptors.turn(has_one=has_free_descriptor()))
                status = "; ".join(filter(None, (gateway.status, reload.needs_restart)))
                supervisor.send("WATCHDOG=1", f"STATUS={status}")
                notify_ns = resumed_ns + _NOTIFY_NS
        if not gateway.ending.restart_requested:
            supervisor.send("STOPPING=1")
        # A stop that had arrived counts, also if Zenoh has not called back yet.
        outlet.end_queries()
        now_ns = clock.now_ns()
        gateway.last_turn(now_ns, recorder.wrap(mailbox.drain()), box.drain(now_ns))
        return gateway.ending.restart_requested


def _trouble(read_keys: Callable[[], Keys | None]) -> str:
    """Why the folder of keys cannot be used; empty if it can."""
    try:
        read_keys()
    except ConfigError as error:
        return str(error)
    return ""


def _freeze() -> None:
    """Exclude all objects built so far from garbage collection: scanning them would cost ms."""
    gc.collect()
    gc.freeze()
