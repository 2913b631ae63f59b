"""Records one message of each key and one answer of each kind, as any client receives them.

`python tests/support/recorded_traffic.py FILE` made tests/traces/traffic_v1.jsonl.gz, with a
virtual trainer in simulated time. That file is never made anew: it shows what a service of wire
v1 sends.
"""

import gzip
import json
import sys
from pathlib import Path

import zenoh
from gaitd_client import wire
from gaitd_client.connection import json_of, open_session

from gaitd_lab.testing.trainer import virtual_trainer

KEYS = ("right/estimate", "right/activity", "right/friction", "right/stride", "drives/right/hip")
SLOW_KEYS = ("safety", "events", "health")
ANSWERS = {"status": {}, "config": {}, "stop": {}, "enable": {}, "mode": {"mode": 7}}


def recorded() -> dict[str, dict[str, str]]:
    """By key: the encoding and the payload."""
    found: dict[str, dict[str, str]] = {}
    with virtual_trainer() as trainer:
        trainer.gait(cadence_hz=0.5)

        def take(sample: zenoh.Sample) -> None:
            data = json_of_sample(sample)
            # Of the events the one of a mode; of all other keys the newest.
            if sample.key_expr != wire.key("trainer", "events") or '"kind":"mode"' in data[1]:
                found[str(sample.key_expr)] = {"schema": data[0], "payload": data[1]}

        with open_session(trainer.target) as session:
            for key in (*KEYS, *SLOW_KEYS):
                session.declare_subscriber(wire.key("trainer", *key.split("/")), take)
            trainer.patient("active")
            trainer.wait(lambda: wire.key("trainer", "right", "stride") in found, 30)
            trainer.request("mode", mode="hold")
            trainer.wait(lambda: wire.key("trainer", "events") in found, 30)
            for name, arguments in ANSWERS.items():
                key = wire.key("trainer", wire.CONTROL, name)
                for reply in session.get(key, payload=json.dumps(arguments)):
                    sample = reply.ok or reply.err
                    if json_of(reply) is not None and sample is not None:
                        schema, payload = json_of_sample(sample)
                        found[key] = {"schema": schema, "payload": payload}
    return found


def json_of_sample(sample: zenoh.Sample) -> tuple[str, str]:
    return str(sample.encoding).partition(";")[2], sample.payload.to_string()


if __name__ == "__main__":
    lines = [json.dumps({"key": key, **one}) for key, one in sorted(recorded().items())]
    Path(sys.argv[1]).write_bytes(gzip.compress("\n".join(lines).encode()))
