"""A client reads what a service of wire v1 has sent: traffic recorded in simulated time.

`tests/support/recorded_traffic.py` says how; the recording is never made anew.
"""

import gzip
import json
from pathlib import Path

import msgspec
from gaitd_client import NotValid, wire
from gaitd_client.clock import MonotonicClock
from gaitd_client.connection import decode_answer
from gaitd_client.stream import Stream, Watch

TRAFFIC = Path(__file__).parents[2] / "traces" / "traffic_v1.jsonl.gz"
KIND = {wire.schema_name(kind): kind for kind in wire.MESSAGES.values()}


def of_its_time(understood, sent):
    """What was understood, without the fields that the sender did not know, at every depth."""
    if isinstance(sent, dict):
        return {name: of_its_time(understood[name], one) for name, one in sent.items()}
    if isinstance(sent, list):
        return [of_its_time(*pair) for pair in zip(understood, sent, strict=True)]
    return understood


def test_recorded_traffic_of_v1_is_read_without_a_loss():
    read: dict[str, msgspec.Struct] = {}
    for line in gzip.decompress(TRAFFIC.read_bytes()).splitlines():
        one = json.loads(line)
        kind, payload = KIND[one["schema"]], one["payload"].encode()
        if "/control/" in one["key"]:
            message = decode_answer(payload, kind, one["key"])
        else:
            stream = Stream(one["key"], kind, Watch(MonotonicClock()))
            stream.receive(payload, one["schema"])
            message = stream.newest()
        assert not isinstance(message, NotValid), message
        sent, understood = json.loads(payload), json.loads(msgspec.json.encode(message))
        # A field that was added since then has its default; none that was sent is lost.
        assert of_its_time(understood, sent) == sent
        read[one["key"].removeprefix("gaitd/trainer/")] = message

    assert {type(message) for message in read.values()} == {
        wire.Activity,
        wire.Configuration,
        wire.DriveState,
        wire.Estimate,
        wire.Event,
        wire.Friction,
        wire.Health,
        wire.Reply,
        wire.Safety,
        wire.Status,
        wire.Stride,
    }
    assert read["right/activity"].hip.patient == 6.854751219923397
    assert read["right/stride"].number == 1
    assert read["control/enable"].outcome == "refused"
    assert read["safety"].verdict.cause == "stop_requested"
