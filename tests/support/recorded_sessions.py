"""Recordings of lock-step sessions, as `gaitd record` makes them when nothing is lost."""

import msgspec
from gaitd_record import Begun, Finished, Options, Purpose, Recorder, Room
from published import Published

from daemon.ipc.transport import RingHeader


def published_by(session, trainer="trainer"):
    """All messages of a session, of a trainer of this name."""
    settings = session.settings
    header = RingHeader(
        core_boot_id="boot",
        start_utc_ns=session.records[0].sync_utc_ns,
        period_ns=10_000_000,
        trainer=trainer,
        drive_names=("right/hip", "right/slide"),
        leg_names=("right",),
        config_hashes={str(path): digest for path, digest in settings.hashes.items()},
        version="0.1.0",
        robot=msgspec.to_builtins(settings.robot),
        limits=msgspec.to_builtins(settings.limits),
    )
    return Published(header, session.records)


def recorder(published, folder, purpose=Purpose.ALL, events=None, limit_mb=1000):
    room = Room(folder, limit_mb)
    report = [].append if events is None else events.append
    return Recorder(Options(purpose, room), published.configuration, report)


def record(published, folder, purpose=Purpose.ALL):
    events = []
    with recorder(published, folder, purpose, events) as made:
        for one in published.messages:
            made.add(one)
    assert [type(event) for event in events] == [Begun, Finished]
    return events[1]
