"""The gateway's process: opens the seam and Zenoh, turns until it is told to end, closes both.

One thread of ours, beside those that wait for the disk. It sleeps in poll() and is woken by the
core's datagram, by a query, or after 20 ms without either, so that the core goes on hearing us. The
watchdog is fed from here alone.
"""

import ctypes
import gc
import select
from collections.abc import Callable, Sequence
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Final

from daemon.config.settings import Lease
from daemon.gateway.reload import Reload
from daemon.gateway.service import LEVEL_PERIOD_NS, Gateway
from daemon.gateway.setpoints import SetpointBox
from daemon.ipc.transport import GatewaySeam
from daemon.recorder.recorder import Keeper
from daemon.system.clock import AgeClock, MonotonicClock
from daemon.system.sd_notify import Notifier
from daemon.zenoh_io.publish import Mailbox, ZenohOutlet
from daemon.zenoh_io.session import open_session
from daemon.zenoh_io.subscribe import SetpointSubscriber

_POLL_MS: Final = LEVEL_PERIOD_NS // 1_000_000
_REST_MS: Final = 1
"""Behind the estimates, if nobody asks for anything: where processors are few, Zenoh's thread sends
them on this one. Without it they came 0.1 ms later on two."""
_M_ARENA_MAX: Final = -8
"""mallopt(3)."""
_TELL_NS: Final = 500_000_000
"""Between two words to the supervisor."""


def share_one_heap() -> None:
    """Let Zenoh's threads allocate where everybody does; to be called before there are any.

    By default glibc gives each of them a heap of its own, eight for each processor. Links come and
    go in any of them, and each in turn grows to the buffers of one: for hours, memory that was free
    elsewhere.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:  # glibc's; others have one heap anyway
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
) -> None:
    """Run the gateway until `ended` says so, which is asked at least every 20 ms.

    Ages of records, leases and setpoints go by `clock`. How long its own work takes, and when the
    supervisor is told, goes by the computer's.

    Raises:
        zenoh.ZError: an endpoint cannot be listened on.
        OSError: the runtime directory does not exist or cannot be written.
    """
    # Order matters at the end: the outlet undeclares, then the session closes (an open one would
    # hang the process), and only then mailbox and box go, because callbacks may use it until then.
    with (
        closing(Notifier(notify_address)) as supervisor,
        closing(GatewaySeam(runtime)) as seam,
        closing(Mailbox()) as mailbox,
        closing(SetpointBox()) as box,
        closing(open_session(listen, trainer)) as session,
        closing(ZenohOutlet(session, trainer, mailbox)) as outlet,
        closing(SetpointSubscriber(session, trainer, box)),
        closing(Keeper(state, runtime, clock, version("gaitd"))) as keeper,
        closing(Gateway(seam, outlet, clock, trainer, listen, lease)) as gateway,
    ):
        poller = select.poll()
        poller.register(seam.fileno(), select.POLLIN)
        poller.register(mailbox.fileno(), select.POLLIN)
        poller.register(box.fileno(), select.POLLIN)
        _freeze()
        supervisor.send("READY=1")
        wall, tell_ns = MonotonicClock(), 0
        while not ended():
            poller.poll(_POLL_MS)
            woken_ns = wall.now_ns()
            has_put = gateway.hurry(clock.now_ns())
            hurried_ns = wall.now_ns() - woken_ns
            if has_put:
                poller.poll(_REST_MS)
            begun_ns, resumed_ns = clock.now_ns(), wall.now_ns()
            inquiries = keeper.watch(mailbox.drain())
            gateway.turn(begun_ns, inquiries, box.drain(begun_ns))
            gateway.tell(keeper.turn(seam.ring, begun_ns))
            hashes = seam.header.config_hashes if seam.header else {}
            gateway.tell(reload.turn(gateway.steering.leases, hashes))
            gateway.health.counters.not_kept_count = keeper.not_kept_count
            box.expect(gateway.steering.lease)
            gateway.health.counters.request_dropped_count = mailbox.dropped_count
            gateway.health.note_wake(hurried_ns + wall.now_ns() - resumed_ns)
            if resumed_ns >= tell_ns:
                status = "; ".join(filter(None, (gateway.status, reload.needs_restart)))
                supervisor.send("WATCHDOG=1", f"STATUS={status}")
                tell_ns = resumed_ns + _TELL_NS
        supervisor.send("STOPPING=1")


def _freeze() -> None:
    """What is built by now stays: looking through it again costs a subscriber milliseconds."""
    gc.collect()
    gc.freeze()
