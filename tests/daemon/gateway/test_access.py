"""What a client can do to another one through the gateway: nothing. And what everybody still can.

Over Zenoh against the real gateway. Nothing here is timed: a message that must not arrive was sent
before one that does, on the same link, so that a client that has the second would have the first.
"""

import contextlib
import json
from typing import NamedTuple
from unittest import mock

import pytest
import zenoh
from gaitd_client.connection import Target
from gaitd_names import Role
from keyed_gateway import BASE, Service, ask, connected, flush, is_alive, is_valid, running
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from daemon.gateway.requests import ROUTES
from daemon.zenoh_io.access import ANY_KEY, RIGHTS, Flow, Message, access_control
from daemon.zenoh_io.publish import ZenohInquiry

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


# --- what no client can ---------------------------------------------------------------------------


class Scene(NamedTuple):
    """A gateway, the client of a victim, and what an attacker has."""

    service: Service
    victim: Target
    attacker: Target


@pytest.fixture(scope="module")
def scene(fake_core):
    """Without keys; what clients with keys may is in test_roles.py."""
    with running(fake_core, None) as service:
        yield Scene(service, service.target("controller.desk"), service.target("controller.other"))


@pytest.fixture(params=["client", "router"])
def mode(request):
    return request.param


def test_a_client_that_forges_what_the_gateway_sends_is_believed_by_none(
    scene, mode, listening, eventually
):
    """Values, answers and the token, one after the other."""
    asked, changes = [], []

    def answer(query):
        asked.append(query.payload.to_bytes() if query.payload else b"")
        query.reply(f"{BASE}/control/status", LIE)

    def changed(sample):
        changes.append(sample.kind)

    with connected(scene.victim) as victim, connected(scene.attacker, mode=mode) as attacker:
        present = listening(victim)
        watched = victim.liveliness().declare_subscriber(f"{BASE}/alive", changed, history=True)
        eventually(lambda: present.count("right/activity") and changes)
        for name in TOLD:
            attacker.put(f"{BASE}/{name}", LIE)
            attacker.delete(f"{BASE}/{name}")
        attacker.put(f"{BASE}/**", LIE)
        keys = (f"{BASE}/control/status", f"{BASE}/control/*", f"{BASE}/**", "**")
        queryables = [attacker.declare_queryable(key, answer) for key in keys]
        token = attacker.liveliness().declare_token(f"{BASE}/alive")
        flush(attacker)
        reached = present.count("right/activity") + TRUTHS
        eventually(lambda: present.count("right/activity") >= reached)
        replies = ask(victim, f"{BASE}/control/status")
        scene.service.core.silent = True
        eventually(lambda: changes[-1] == zenoh.SampleKind.DELETE)
        assert not is_alive(victim)
        scene.service.core.silent = False
        for declared in (*queryables, token, watched):
            declared.undeclare()

    assert [reply["core_boot_id"] for reply in replies] == ["boot-a"]
    assert not asked
    assert not [payload for payload in present.texts() if payload in {LIE, b""}]


def test_a_client_that_listens_to_everything_learns_no_setpoint_no_lease_and_no_request(
    scene, mode, listening, eventually
):
    asked = []
    core = scene.service.core
    with connected(scene.victim) as victim, connected(scene.attacker, mode=mode) as attacker:
        eventually(lambda: is_valid(victim))
        present = listening(attacker)
        queryables = [
            attacker.declare_queryable(key, asked.append) for key in (f"{BASE}/control/**", "**")
        ]
        eventually(lambda: present.count("right/activity"))
        lease = ask(victim, scene.victim.control("acquire"), client="good", duration_ms=60_000)[0][
            "lease"
        ]
        setpoint = {
            **{"lease": lease, "seq": 1, "for_cycle": 1},
            **{"hip": {"assist": 1.0}, "slide": {"assist": 0.0}},
        }
        victim.put(f"{BASE}/right/setpoint", json.dumps(setpoint))
        victim.put("another/program", LIE)
        eventually(lambda: core.levels[-1].setpoints and core.levels[-1].lease == lease)
        reached = present.count("right/activity") + TRUTHS
        eventually(lambda: present.count("right/activity") >= reached)
        ask(victim, scene.victim.control("release"), client="good", lease=lease)
        for declared in queryables:
            declared.undeclare()

    heard = [name for name, _ in present.samples if name.endswith(("setpoint", "program"))]
    assert not heard
    assert not [payload for payload in present.texts() if str(lease).encode() in payload]
    assert not asked


# --- what everybody can ---------------------------------------------------------------------------


def test_without_keys_everybody_may_ask_stop_listen_and_learn_what_was_before(
    scene, mode, eventually
):
    payloads = {"mode": {"mode": "hold"}, "acquire": {"client": "bad"}}
    events = []

    with connected(scene.attacker, mode=mode) as session:
        eventually(lambda: is_valid(session))
        for name in ("enable", "disable", "reset", "mode", "acquire", "stop"):
            replies = ask(session, f"{BASE}/control/{name}", **payloads.get(name, {}))
            assert [reply["outcome"] for reply in replies] == ["done"]
        for name in ("status", "config", "schema"):
            assert len(ask(session, f"{BASE}/control/{name}")) == 1
        late = declare_advanced_subscriber(
            session,
            f"{BASE}/events",
            lambda sample: events.append(json.loads(sample.payload.to_bytes())["kind"]),
            history=HistoryConfig(detect_late_publishers=True, max_samples=50),
        )
        eventually(lambda: "core" in events)
        late.undeclare()
        eventually(lambda: is_alive(session))


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
