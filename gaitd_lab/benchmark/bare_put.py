"""A process that only puts: the bare Zenoh that the service's delivery is compared with.

`python -m gaitd_lab.benchmark.bare_put ENDPOINT SIZE_BYTES SECONDS`

The session is opened as the gateway opens its own, the publisher is declared as that of an
estimate, the payload is as long. The time of a put stands in its first eight bytes: CLOCK_MONOTONIC
is the same for all processes of a machine.
"""

import sys
import time
from typing import Final

from daemon import wire
from daemon.zenoh_io.publish import ESTIMATE, declare
from daemon.zenoh_io.session import open_session

TRAINER: Final = "bench"
KEY: Final = wire.key(TRAINER, "bare", "estimate")
PERIOD_S: Final = 0.0101
"""The pace of the service, but for a hundredth: so the puts come at all phases of its cycle."""
STAMP_SIZE: Final = 8


def stamped(time_ns: int, size: int) -> bytes:
    """A payload that tells when it was put."""
    return time_ns.to_bytes(STAMP_SIZE, "little") + bytes(max(size - STAMP_SIZE, 0))


def stamp_of(payload: bytes) -> int:
    """When it was put, CLOCK_MONOTONIC in ns."""
    return int.from_bytes(payload[:STAMP_SIZE], "little")


def main(endpoint: str, size: int, seconds: float) -> None:
    """Put, and sleep, until the time is over."""
    with open_session([endpoint], TRAINER) as session:
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
