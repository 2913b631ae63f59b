"""`gaitd core` with what no signal can do to it: UTC that steps, and memory that is not there.

    altered_core.py core --config FILE

Lines on stdin: `utc SECONDS` moves the wall clock of this process by so much and nothing else;
`memory` makes every cycle fail as Python does when the system gives no memory. Only the UTC of the
simulated bus and the making of the record are replaced; everything else is the product's own.
"""

import sys
import threading

from daemon.core import cycle_record
from gaitd.__main__ import main
from simtime.link import SocketLink

step_ns = 0
record = cycle_record.record
utc_ns, take = SocketLink.utc_ns, SocketLink.take


def no_memory(*_: object) -> None:
    raise MemoryError("no memory for the record of this cycle")


def obey() -> None:
    global step_ns  # noqa: PLW0603 - one process, one clock
    for line in sys.stdin:
        word, _, seconds = line.strip().partition(" ")
        if word == "utc":
            step_ns += int(float(seconds) * 1e9)
        elif word == "memory":
            cycle_record.record = no_memory


SocketLink.utc_ns = lambda self: utc_ns(self) + step_ns
SocketLink.take = lambda self: [one._replace(time_ns=one.time_ns + step_ns) for one in take(self)]
threading.Thread(target=obey, daemon=True).start()
main()
