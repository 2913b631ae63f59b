"""Queries of a program that knows Zenoh and JSON and nothing of ours."""

import json
import threading

import zenoh
from gaitd_names import Outcome


def query(session: zenoh.Session, name: str, payload: object = None) -> tuple[dict, bool]:
    """The JSON of the only reply, and whether it came as an error."""
    data = payload if isinstance(payload, bytes) or payload is None else json.dumps(payload)
    replies = list(session.get(f"gaitd/trainer/control/{name}", payload=data, timeout=60.0))
    assert len(replies) == 1
    if replies[0].ok:
        return json.loads(replies[0].ok.payload.to_string()), False
    return json.loads(replies[0].err.payload.to_string()), True


def test_a_stop_works_while_another_request_is_outstanding(session, start_core, eventually):
    core = start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    core.answer("enable", Outcome.PENDING)
    enabled: list[dict] = []
    enabling = threading.Thread(target=lambda: enabled.append(query(session, "enable")[0]))
    enabling.start()
    eventually(lambda: core.requests)

    refused, _ = query(session, "mode", {"mode": "hold"})
    stopped, _ = query(session, "stop")
    before = list(enabled)
    core.end()
    enabling.join(60)

    assert refused["outcome"] == "refused"
    assert refused["refusal"]["code"] == "busy"
    assert stopped["outcome"] == "done"
    assert before == []
    assert enabled[0]["outcome"] == "pending"


def test_garbage_in_a_query_gets_a_clear_error(session, start_core, eventually):
    start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])

    for name, payload, word in (
        ("enable", b"\xff\xfe", "known fields: client"),
        ("enable", b"{", "truncated"),
        ("enable", {"torque": 1}, "torque"),
        ("mode", {"mode": "dance"}, "dance"),
        ("mode", {}, "mode"),
        ("mode", {"mode": "gait", "amplitude_ratio": 2.0}, "amplitude_ratio"),
        ("mode", b'{"mode": "gait", "duration_s": NaN}', "malformed"),
        ("enable", b" " * 5000, "4096"),
    ):
        answer, failed = query(session, name, payload)
        assert failed
        assert answer["outcome"] == "refused"
        assert answer["refusal"]["code"] == "bad_payload"
        assert word in answer["refusal"]["said"]
