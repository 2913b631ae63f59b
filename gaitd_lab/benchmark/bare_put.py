"""A process that only puts: the bare Zenoh baseline for the service's delivery.

`python -m gaitd_lab.benchmark.bare_put ENDPOINT SIZE_BYTES SECONDS`

Session and publisher have the same settings as the gateway's for an estimate, and the payload has
the same length. Its first eight bytes are the time of the put: CLOCK_MONOTONIC is the same for all
processes of a machine.
"""

import sys
import time
from typing import Final

from gaitd_client import wire

from daemon.zenoh_io.publish import ESTIMATE, declare
from daemon.zenoh_io.session import open_session

TRAINER: Final = "bench"
KEY: Final = wire.key(TRAINER, "bare", "estimate")
PERIOD_S: Final = 0.0101
"""Period of the service plus a hundredth, so that the puts come at all phases of its cycle."""
STAMP_SIZE: Final = 8


def stamped(time_ns: int, size: int) -> bytes:
    """Return a payload that contains the time of its put."""
    return time_ns.to_bytes(STAMP_SIZE, "little") + bytes(max(size - STAMP_SIZE, 0))


def stamp_of(payload: bytes) -> int:
    """Return the time of the put, CLOCK_MONOTONIC in ns."""
    return int.from_bytes(payload[:STAMP_SIZE], "little")


def main(endpoint: str, size: int, seconds: float) -> None:
    """Put and sleep alternately until the time is over."""
    with open_session([endpoint], TRAINER, None) as session:
        publisher = declare(session, KEY, wire.Estimate, ESTIMATE)
        due_s = time.monotonic()
        end_s = due_s + seconds
        while due_s < end_s:
            time.sleep(max(due_s - time.monotonic(), 0.0))
            publisher.put(stamped(time.monotonic_ns(), size))
            due_s += PERIOD_S
        publisher.undeclare()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
