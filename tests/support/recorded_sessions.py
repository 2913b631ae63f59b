"""Recordings of lock-step sessions, as `gaitd record` makes them when nothing is lost."""

import msgspec
from gaitd_client import wire
from gaitd_record import Begun, Finished, Options, Purpose, Received, Recorder, Room

from daemon.gateway.playback import publish_at_once
from daemon.ipc.transport import RingHeader


class Published:
    """All messages of a session, as a gateway that is never late publishes them."""

    def __init__(self, header, records):
        self.header, self.messages, self._seqs = header, [], {}
        publish_at_once(header, records, self)

    def next_seq(self, *parts):
        self._seqs[parts] = self._seqs.get(parts, 0) + 1
        return self._seqs[parts]

    def put(self, message, *parts):
        schema = wire.schema_name(type(message))
        self.messages.append(Received("/".join(parts), schema, msgspec.json.encode(message)))

    def put_event(self, event):
        self.put(event, wire.EVENTS)

    def links(self):
        return []

    def set_alive(self, alive):
        pass

    def configuration(self):
        header = self.header
        return wire.Configuration(
            seq=1,
            core_boot_id=header.core_boot_id,
            cycle=None,
            sample_time_ns=None,
            version=header.version,
            trainer=header.trainer,
            listen=(),
            period_ns=header.period_ns,
            drive_names=header.drive_names,
            leg_names=header.leg_names,
            config_hashes=header.config_hashes,
            robot=header.robot,
            limits=header.limits,
        )

    def of(self, key, kind):
        return [
            msgspec.json.decode(one.payload, type=kind) for one in self.messages if one.key == key
        ]


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
