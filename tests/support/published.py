"""Messages of a recording, without Zenoh and without a clock."""

import msgspec
from gaitd_client import wire
from gaitd_names.joints import JOINTS
from gaitd_record import Received

from daemon.gateway.playback import publish_at_once

RECEIVED_AFTER_NS = 3_000_000
"""From the time of a sample to the receipt of its messages."""


class Published:
    """All messages of a session, as a gateway that is never late publishes them."""

    def __init__(self, header, records):
        self.header, self.messages, self._seqs = header, [], {}
        publish_at_once(header, records, self)

    def next_seq(self, *parts):
        self._seqs[parts] = self._seqs.get(parts, 0) + 1
        return self._seqs[parts]

    def put(self, message, *parts):
        schema, payload = wire.schema_name(type(message)), msgspec.json.encode(message)
        received_ns = (message.sample_time_ns or 0) + RECEIVED_AFTER_NS
        self.messages.append(Received("/".join(parts), schema, payload, received_ns))

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
            joints=JOINTS,
            config_hashes=header.config_hashes,
            robot=header.robot,
            limits=header.limits,
            guidance=header.guidance,
        )

    def of(self, key, kind):
        return [
            msgspec.json.decode(one.payload, type=kind) for one in self.messages if one.key == key
        ]
