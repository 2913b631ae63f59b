"""What a client can do to another one through the gateway: nothing. And what everybody still can.

Over Zenoh against the real gateway. Nothing here is timed: a message that must not arrive was sent
before one that does, on the same link, so that a client that has the second would have the first.
"""

import contextlib
import json
from pathlib import Path
from unittest import mock

import pytest
import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from daemon.gateway.requests import ROUTES
from daemon.ipc.record import Outcome, Role
from daemon.zenoh_io.access import ANY_KEY, RIGHTS, Flow, Message, access_control
from daemon.zenoh_io.publish import ZenohInquiry

DOCUMENT = Path(__file__).parents[3] / "docs" / "security.md"
BASE = "gaitd/trainer"
LIE = b'{"forged": true}'
TOLD = (
    *(f"right/{name}" for name in ("estimate", "activity", "friction", "stride")),
    *(
        "drives/right/hip",
        "drives/setpoint",
        "safety",
        "events",
        "events/@adv/pub/forged",
        "health",
    ),
)
TRUTHS = 20
"""So many messages of the gateway's behind a forged one would have been overtaken by it."""


def client(endpoint, mode="client"):
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 10_000,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return contextlib.closing(zenoh.open(config))


def ask(session, name, **payload):
    """Every reply to one query, as the asking client sees them."""
    replies = session.get(f"{BASE}/control/{name}", payload=json.dumps(payload), timeout=30.0)
    return [json.loads((one.ok or one.err).payload.to_bytes()) for one in replies]


def is_alive(session):
    """Whether the gateway says so; it has had everything that this client sent before."""
    return [one.ok for one in session.liveliness().get(f"{BASE}/alive", timeout=30.0)]


class Heard:
    """All that reaches a client that subscribes to everything there is."""

    def __init__(self, session):
        self.samples = []
        keys = (f"{BASE}/*/setpoint", f"{BASE}/**", "gaitd/**", "**")
        self._subscribers = [session.declare_subscriber(key, self._hear) for key in keys]

    def _hear(self, sample):
        self.samples.append((str(sample.key_expr), sample.payload.to_bytes()))

    def count(self, name):
        return sum(key == f"{BASE}/{name}" for key, _ in self.samples)

    def texts(self):
        return [payload for _, payload in self.samples]

    def close(self):
        for subscriber in self._subscribers:
            subscriber.undeclare()


@pytest.fixture
def listening():
    """Make a client hear everything."""
    with contextlib.ExitStack() as stack:
        yield lambda session: stack.enter_context(contextlib.closing(Heard(session)))


@pytest.fixture
def good(endpoint):
    with client(endpoint) as session:
        yield session


@pytest.fixture(params=["client", "peer", "router"])
def bad(endpoint, request):
    with client(endpoint, request.param) as session:
        yield session


@pytest.fixture
def core(start_core, good, eventually):
    made = start_core()
    eventually(lambda: ask(good, "status")[0]["safety"]["valid"])
    return made


# --- what no client can ---------------------------------------------------------------------------


def test_a_client_cannot_publish_what_the_gateway_tells(good, bad, core, listening, eventually):
    present = listening(good)
    eventually(lambda: present.count("right/activity"))

    for name in TOLD:
        bad.put(f"{BASE}/{name}", LIE)
        bad.delete(f"{BASE}/{name}")
    bad.put(f"{BASE}/**", LIE)
    bad.put("another/program", LIE)
    assert ask(bad, "status")
    reached = present.count("right/activity") + TRUTHS
    eventually(lambda: present.count("right/activity") >= reached)

    assert not [payload for payload in present.texts() if payload in {LIE, b""}]


def test_a_client_cannot_answer_in_the_gateways_place_nor_hear_what_others_ask(good, bad, core):
    asked = []

    def answer(query):
        asked.append(query.payload.to_bytes() if query.payload else b"")
        query.reply(f"{BASE}/control/status", LIE)

    keys = (f"{BASE}/control/status", f"{BASE}/control/*", f"{BASE}/**", "**")
    queryables = [bad.declare_queryable(key, answer) for key in keys]
    assert is_alive(bad)
    lease = ask(good, "acquire", client="good")[0]["lease"]

    assert [told["core_boot_id"] for told in ask(good, "status", client="good")] == ["boot-a"]
    assert [told["outcome"] for told in ask(good, "release", client="good", lease=lease)] == [
        "done"
    ]
    assert not asked
    for queryable in queryables:
        queryable.undeclare()


def test_a_client_cannot_keep_the_gateway_alive(good, bad, core, eventually):
    changes = []
    watched = good.liveliness().declare_subscriber(
        f"{BASE}/alive", lambda sample: changes.append(sample.kind), history=True
    )
    eventually(lambda: changes)
    token = bad.liveliness().declare_token(f"{BASE}/alive")
    assert ask(bad, "status")

    core.end()

    eventually(lambda: changes[-1] == zenoh.SampleKind.DELETE)
    assert not is_alive(good)
    watched.undeclare()
    token.undeclare()


def test_a_client_cannot_hear_the_setpoints_of_another_one_nor_its_lease(
    good, bad, core, listening, eventually
):
    present = listening(bad)
    eventually(lambda: present.count("right/activity"))

    lease = ask(good, "acquire", client="good", duration_ms=60_000)[0]["lease"]
    setpoint = {
        "lease": lease,
        "seq": 1,
        "for_cycle": 1,
        "hip_assist_nm": 1.0,
        "slide_assist_n": 0.0,
    }
    good.put(f"{BASE}/right/setpoint", json.dumps(setpoint))
    eventually(lambda: core.levels and core.levels[-1].setpoints)
    reached = present.count("right/activity") + TRUTHS
    eventually(lambda: present.count("right/activity") >= reached)

    assert core.levels[-1].lease == lease
    assert not [name for name, _ in present.samples if name.endswith("setpoint")]
    assert not [payload for payload in present.texts() if str(lease).encode() in payload]


# --- what everybody can ---------------------------------------------------------------------------


def test_everybody_may_ask_stop_listen_and_learn_what_was_before(good, bad, core, eventually):
    for name in ("enable", "disable", "reset", "mode"):
        core.answer(name, Outcome.DONE)
    payloads = {"mode": {"mode": "hold"}, "acquire": {"client": "bad"}}

    for name in ("enable", "disable", "reset", "mode", "acquire", "stop"):
        assert [told["outcome"] for told in ask(bad, name, **payloads.get(name, {}))] == ["done"]
    for name in ("status", "config", "schema"):
        assert len(ask(bad, name)) == 1
    events = []
    late = declare_advanced_subscriber(
        bad,
        f"{BASE}/events",
        lambda sample: events.append(json.loads(sample.payload.to_bytes())["kind"]),
        history=HistoryConfig(detect_late_publishers=True, max_samples=50),
    )
    eventually(lambda: "core" in events)
    late.undeclare()
    eventually(lambda: is_alive(bad))


@pytest.mark.parametrize("trainer", ["trainer", "control", "stop"])
def test_a_query_is_understood_whatever_the_trainer_is_called(trainer):
    query = mock.Mock(key_expr=f"gaitd/{trainer}/control/stop/session.desk", payload=None)
    bare = mock.Mock(key_expr=f"gaitd/{trainer}/control/stop", payload=None)

    inquiry = ZenohInquiry(query)
    assert (inquiry.name, inquiry.identity) == ("stop", "session.desk")
    assert (ZenohInquiry(bare).name, ZenohInquiry(bare).identity) == ("stop", "")


# --- the table ------------------------------------------------------------------------------------


def keys_of(flow, message, role):
    return {
        key
        for right in RIGHTS
        if right.flow is flow and message in right.messages and role in right.roles
        for key in right.keys
    }


@pytest.mark.parametrize("role", Role)
def test_every_role_may_stop(role):
    assert "control/stop" in keys_of(Flow.IN, Message.QUERY, role)


def test_every_request_has_a_row_and_no_row_has_a_pattern_for_requests():
    asked = keys_of(Flow.IN, Message.QUERY, Role.UNRESTRICTED)

    assert {key for key in asked if key.startswith("control/")} == {
        f"control/{name}" for name in ROUTES
    }


@pytest.mark.parametrize("role", [Role.UNRESTRICTED, Role.CONTROLLER])
def test_what_may_be_put_and_what_is_told_have_no_key_in_common(role):
    put = [zenoh.KeyExpr(key) for key in keys_of(Flow.IN, Message.PUT, role)]
    told = [zenoh.KeyExpr(key) for key in keys_of(Flow.OUT, Message.PUT, role)]

    assert put
    assert not [(one, other) for one in put for other in told if one.intersects(other)]


def test_what_is_in_no_row_is_denied():
    made = access_control("ward_3", None)

    assert made["enabled"]
    assert made["default_permission"] == "deny"
    assert {rule["permission"] for rule in made["rules"]} == {"allow"}
    keys = {key for rule in made["rules"] for key in rule["key_exprs"]}
    assert all(key == ANY_KEY or key.startswith("gaitd/ward_3/") for key in keys)


def test_the_document_has_the_table_of_the_code():
    text = DOCUMENT.read_text().partition("<!-- rights: begin -->\n")[2]
    rows = [
        f"| {right.name} | {who(right.roles)} "
        f"| {'in' if right.flow is Flow.IN else 'out'} "
        f"| {', '.join(sorted(message.value for message in right.messages))} "
        f"| {', '.join(keys_in_words(right))} |"
        for right in RIGHTS
    ]

    assert text.partition("<!-- rights: end -->")[0].splitlines()[2:] == rows


def keys_in_words(right):
    return [f"`{key}/CLIENT`" if right.by_client else f"`{key}`" for key in right.keys]


def who(roles):
    return "all" if roles == set(Role) else ", ".join(role.name.lower() for role in sorted(roles))
