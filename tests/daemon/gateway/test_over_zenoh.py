"""The service as a program sees it that knows Zenoh and JSON and nothing of ours."""

import itertools
import json
import subprocess
import sys
import threading
import time

import pytest
import zenoh
from gaitd_names import Cause, Outcome, RefusalCode, StopCategory
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from daemon.ipc.record import Verdict
from daemon.ipc.report import Refusal

pytestmark = pytest.mark.realtime

PLAIN_SUBSCRIBER = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
got = {"activity": [], "friction": []}
def take(sample):
    message = json.loads(sample.payload.to_string())
    got[str(sample.key_expr).rpartition("/")[2]].append((message, str(sample.encoding)))
subscribers = [session.declare_subscriber(f"gaitd/trainer/right/{name}", take) for name in got]
print("ready", flush=True)
time.sleep(2.2)
session.close()
packages = {"daemon", "drives", "observer", "gaitd", "sim_drives"}
ours = packages & {name.partition(".")[0] for name in sys.modules}
print(json.dumps({"got": got, "ours": sorted(ours)}))
"""


def query(session: zenoh.Session, name: str, payload: object = None) -> tuple[dict, bool]:
    """The JSON of the only reply, and whether it came as an error."""
    data = payload if isinstance(payload, bytes) or payload is None else json.dumps(payload)
    replies = list(session.get(f"gaitd/trainer/control/{name}", payload=data, timeout=10.0))
    assert len(replies) == 1
    if replies[0].ok:
        return json.loads(replies[0].ok.payload.to_string()), False
    return json.loads(replies[0].err.payload.to_string()), True


def test_a_plain_subscriber_receives_activity_and_friction_of_every_cycle(endpoint, start_core):
    start_core()
    process = subprocess.run(
        [sys.executable, "-c", PLAIN_SUBSCRIBER, endpoint],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
        cwd="/",
    )

    result = json.loads(process.stdout.splitlines()[-1])
    assert result["ours"] == []
    for name, received in result["got"].items():
        messages = [message for message, _ in received]
        steps = [b["seq"] - a["seq"] for a, b in itertools.pairwise(messages)]
        assert set(steps) == {1}
        # By cycle and not by the clock: a busy machine's cycles come late.
        assert {b["cycle"] - a["cycle"] for a, b in itertools.pairwise(messages)} == {1}
        assert {encoding for _, encoding in received} == {f"application/json;gaitd.{name}.v1"}
        assert {message["core_boot_id"] for message in messages} == {"boot-a"}
    assert result["got"]["activity"][0][0]["hip"]["patient"] == 8.0
    assert result["got"]["friction"][0][0]["slide"]["friction"] == 20.0


def test_a_query_to_schema_explains_every_message_that_is_published(
    session, start_core, eventually
):
    samples: dict[str, zenoh.Sample] = {}
    subscriber = session.declare_subscriber(
        "gaitd/trainer/**", lambda sample: samples.setdefault(str(sample.key_expr), sample)
    )
    start_core()
    keys = {f"right/{name}" for name in ("estimate", "activity", "friction")}
    keys |= {"drives/right/hip", "drives/right/slide", "safety", "events", "health"}
    eventually(lambda: {key.removeprefix("gaitd/trainer/") for key in samples} >= keys)
    subscriber.undeclare()

    answer, failed = query(session, "schema")

    assert not failed
    for key in keys:
        sample = samples[f"gaitd/trainer/{key}"]
        media, _, name = str(sample.encoding).partition(";")
        schema = answer["schemas"][name]
        message = json.loads(sample.payload.to_string())
        assert media == "application/json"
        assert schema["type"] == "object"
        assert set(schema["required"]) == set(message) == set(schema["properties"])
        assert all(field.get("description") for field in schema["properties"].values())
        assert {"seq", "core_boot_id", "cycle", "sample_time_ns"} <= set(message)


def test_a_late_joiner_gets_the_events_of_before_and_then_the_new_ones(
    session, start_core, eventually
):
    core = start_core()
    stop = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip")
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    core.changes = {"verdict": stop}
    eventually(lambda: query(session, "status")[0]["safety"]["verdict"]["category"] == "S1")
    got: list[dict] = []

    late = declare_advanced_subscriber(
        session,
        "gaitd/trainer/events",
        lambda sample: got.append(json.loads(sample.payload.to_string())),
        history=HistoryConfig(detect_late_publishers=True, max_samples=50),
    )
    eventually(lambda: len(got) >= 2)
    core.changes = {}
    eventually(lambda: len(got) >= 3)
    late.undeclare()

    assert [event["kind"] for event in got] == ["core", "stop", "stop"]
    assert got[1]["cause"] == "hand_switch_open"
    assert got[1]["priority"] == "medium"
    assert got[1]["remedy"]
    assert [event["seq"] for event in got] == [1, 2, 3]


def test_a_plain_subscriber_gets_events_as_they_happen(session, start_core, eventually):
    core = start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    got: list[dict] = []
    subscriber = session.declare_subscriber(
        "gaitd/trainer/events", lambda sample: got.append(json.loads(sample.payload.to_string()))
    )
    time.sleep(0.1)

    core.changes = {"events": ("gait: announced",)}
    eventually(lambda: got)
    core.changes = {}
    subscriber.undeclare()

    assert got[0]["text"] == "gait: announced"


def test_alive_falls_200_to_300_ms_after_the_last_record(session, start_core, eventually):
    changes: list[tuple[zenoh.SampleKind, float]] = []
    subscriber = session.liveliness().declare_subscriber(
        "gaitd/trainer/alive", lambda sample: changes.append((sample.kind, time.monotonic()))
    )
    time.sleep(0.1)
    assert not changes
    core = start_core()
    eventually(lambda: changes)

    core.end()
    ended = time.monotonic()
    eventually(lambda: len(changes) == 2)
    subscriber.undeclare()

    assert [kind for kind, _ in changes] == [zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE]
    assert 0.18 <= changes[1][1] - ended <= 0.3


def test_a_stop_works_while_another_request_is_outstanding(session, start_core, eventually):
    core = start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    core.answer("enable", Outcome.PENDING)
    enabled: list[dict] = []
    enabling = threading.Thread(target=lambda: enabled.append(query(session, "enable")[0]))
    enabling.start()
    eventually(lambda: core.requests)

    refused, _ = query(session, "mode", {"mode": "hold"})
    begun = time.monotonic()
    stopped, _ = query(session, "stop")
    took_s = time.monotonic() - begun
    core.end()
    enabling.join(10)

    assert refused["outcome"] == "refused"
    assert refused["refusal"]["code"] == "busy"
    assert stopped["outcome"] == "done"
    assert took_s < 0.1
    assert enabled[0]["outcome"] == "pending"


def test_a_request_is_answered_with_the_outcome_and_the_reason_of_the_core(
    session, start_core, eventually
):
    core = start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    core.answer("mode", Outcome.DONE)
    core.answer("enable", Outcome.REFUSED, Refusal(RefusalCode.HAND_SWITCH_OPEN))

    mode = {"mode": "gait", "cadence_hz": 0.25, "amplitude_ratio": 1.0, "duration_s": 20.0}
    done, _ = query(session, "mode", mode)
    refused, _ = query(session, "enable", {"client": "display"})

    assert done["outcome"] == "done"
    assert core.requests[0].mode.cadence_hz == 0.25
    assert refused["outcome"] == "refused"
    assert refused["refusal"]["code"] == "hand_switch_open"


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


def test_a_lease_is_given_to_who_asks_and_setpoints_under_it_reach_the_core(
    session, start_core, eventually
):
    core = start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])

    given, _ = query(session, "acquire", {"client": "pusher", "duration_ms": 5000})
    other, _ = query(session, "acquire", {"client": "other"})
    for leg in ("right", "left"):
        setpoint = {"lease": given["lease"], "seq": 1, "for_cycle": 1}
        setpoint |= {"hip": {"assist": 3.5}, "slide": {"assist": -20.0}, "stiffness_ratio": 0.5}
        session.put(f"gaitd/trainer/{leg}/setpoint", json.dumps(setpoint))
    session.put("gaitd/trainer/right/setpoint", b"x" * 1_000_000)

    eventually(lambda: core.levels and core.levels[-1].setpoints)
    assert (given["outcome"], given["lease_duration_ms"]) == ("done", 5000)
    assert (other["outcome"], other["lease"]) == ("refused", None)
    assert other["refusal"]["code"] == "lease_taken"
    assert core.levels[-1].lease == given["lease"]
    (forwarded,) = core.levels[-1].setpoints
    assert (forwarded.leg, forwarded.hip.assist, forwarded.stiffness_ratio) == (
        "right",
        3.5,
        0.5,
    )
    assert query(session, "status")[0]["safety"]["lease_holder"] == "pusher"
    told = query(session, "status")[0]["events"]
    refusals = [event["values"].get("setpoint_refusal") for event in told]
    assert {"too_large", "unknown_leg"} <= {*refusals}
    assert str(given["lease"]) not in json.dumps(told)


def test_config_tells_what_the_service_runs_with(session, start_core, eventually):
    start_core()
    eventually(lambda: query(session, "status")[0]["safety"]["valid"])

    answer, _ = query(session, "config")

    assert answer["leg_names"] == ["right"]
    assert answer["limits"]["hip"]["torque_max_nm"] == 60.0
    assert answer["config_hashes"]["robot.toml"] == "ab" * 32


def test_a_core_that_starts_again_is_found_by_its_new_boot_id(session, start_core, eventually):
    start_core("boot-a").end()
    eventually(lambda: not query(session, "status")[0]["safety"]["valid"])

    start_core("boot-b")

    eventually(lambda: query(session, "status")[0]["safety"]["valid"])
    assert query(session, "status")[0]["core_boot_id"] == "boot-b"


def test_without_a_core_status_says_so_and_nothing_is_accepted(session):
    status, _ = query(session, "status")
    refused, _ = query(session, "enable")
    begun = time.monotonic()
    stop, _ = query(session, "stop")

    assert status["safety"]["valid"] is False
    assert status["safety"]["mode"] is None
    assert status["core_boot_id"] is None
    assert refused["outcome"] == "refused"
    assert refused["refusal"]["code"] == "core_silent"
    assert stop["outcome"] == "pending"
    assert stop["refusal"]["code"] == "stop_unconfirmed"
    assert time.monotonic() - begun < 1.0
