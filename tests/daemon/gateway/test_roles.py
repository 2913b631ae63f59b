"""The matrix of roles: what each client can do with its keys, over real TCP and TLS.

Expectations are written here by hand, not taken from the table of the product. Nothing is timed: a
query without a right ends without a reply, and a message that must not arrive is followed by one
that does, on the same link.
"""

import datetime
import json
import shutil
import socket
import tempfile
from pathlib import Path

import pytest
import zenoh
from command_line import gaitd
from gaitd_client.connection import Target
from gaitd_names import Mode, Role
from keyed_gateway import (
    BASE,
    NOW,
    ROLES,
    YEAR,
    Service,
    ask,
    connected,
    is_valid,
    running,
    status_of,
    target_of,
)

from daemon.ipc.record import AxisPlan, Plan
from daemon.keys import issuing
from daemon.keys.certificates import Pair, new_authority, new_certificate
from daemon.keys.folder import read_keys

ALL = frozenset(ROLES)
MAY = {
    "status": ALL,
    "config": ALL,
    "schema": ALL,
    "acquire": {"controller"},
    "enable": {"session", "operator"},
    "disable": {"session", "operator", "service"},
    "mode": {"session", "operator", "service"},
    "reset": {"session", "operator", "service"},
    "plan": {"operator"},
    "mark": {"operator"},
    "restart": {"operator", "service"},
    "release": {"controller"},
    "report": {"controller"},
    "stop": ALL,
}
PLAN = {
    "cadence_max_hz": 0.5,
    "amplitude_max_ratio": 0.8,
    "duration_max_s": 600.0,
    "hip": {"assist_max": 10.0},
    "slide": {"assist_max": None},
}
PAYLOADS = {
    "mode": {"mode": "hold"},
    "plan": {"plan": PLAN},
    "mark": {"text": "a remark"},
    "release": {"lease": 1},
    "report": {"lease": 1, "leg": "right", "values": {}},
}
PUBLISHED = ("right/activity", "right/estimate", "safety", "events", "health", "drives/right/hip")
LIE = b'{"forged": true}'
PLACES = tuple(zip(ROLES, ("desk", "ward") * len(ROLES), strict=False))
"""Each role once: the rights are the same on this machine and beyond it."""


@pytest.fixture(scope="module")
def service(fake_core):
    with running(fake_core) as made:
        yield made


@pytest.fixture(autouse=True)
def valid(service, eventually):
    """Records arrive, and nothing is left of the test before."""
    service.core.changes.clear()
    service.core.changes["mode"] = Mode.HOLD  # in which no restart is granted
    service.core.requests.clear()
    display = service.target("display.desk")
    eventually(lambda: status_of(display).get("safety", {}).get("valid"))


def listens(endpoint):
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    with socket.socket() as made:
        return made.connect_ex((host, int(port))) == 0


def rights_of(target, eventually):
    """Names of the queries that are answered; published messages arrive meanwhile."""
    heard, answered = [], set()
    with connected(target) as session, session.declare_subscriber(f"{BASE}/**", heard.append):
        for name in MAY:
            payload = {**PAYLOADS.get(name, {}), "client": "another one"}
            if ask(session, target.control(name), **payload):
                answered.add(name)
        activity = f"{BASE}/right/activity"
        eventually(lambda: any(str(sample.key_expr) == activity for sample in heard))
    return answered


@pytest.mark.parametrize(("role", "place_of_client"), PLACES)
def test_each_role_may_what_its_row_says(service, role, place_of_client, eventually):
    answered = rights_of(service.target(f"{role}.{place_of_client}"), eventually)

    assert answered == {name for name, roles in MAY.items() if role in roles}
    roles = {request.role for request in service.core.requests}
    assert roles == ({Role[role.upper()]} if MAY["reset"] & {role} else set())


@pytest.mark.parametrize(("role", "place_of_client"), PLACES)
def test_no_client_can_act_as_another_one_as_the_gateway_or_without_a_name(
    service, role, place_of_client
):
    heard, asked = [], []
    operator = service.target("operator.desk")
    with (
        connected(service.target("display.desk")) as present,
        connected(service.target(f"{role}.{place_of_client}")) as session,
        present.declare_subscriber("**", lambda sample: heard.append(sample.payload.to_bytes())),
    ):
        for name in ("enable", "mode", "plan", "restart"):
            assert not ask(session, f"{BASE}/control/{name}", **PAYLOADS.get(name, {}))
            if role != "operator" or place_of_client != "desk":
                assert not ask(session, operator.control(name), **PAYLOADS.get(name, {}))
        for key in PUBLISHED:
            session.put(f"{BASE}/{key}", LIE)
        assert ask(session, f"{BASE}/control/status")
        with session.declare_queryable(f"{BASE}/**", asked.append):
            assert len(ask(present, f"{BASE}/control/status")) == 1
            assert ask(present, f"{BASE}/control/stop")[0]["core_boot_id"] == "boot-a"

    assert LIE not in heard
    assert not asked
    assert not service.core.requests


@pytest.mark.parametrize("role", ["controller", "session"])
def test_only_a_controller_reaches_the_core_with_setpoints_and_no_client_hears_its_lease(
    service, role, eventually
):
    controller = service.target("controller.desk")
    heard = []
    with (
        connected(controller) as holder,
        connected(service.target(f"{role}.ward")) as session,
        connected(service.target(f"{role}.desk")) as listener,
        listener.declare_subscriber(f"{BASE}/**", lambda s: heard.append(s.payload.to_bytes())),
    ):
        reply = ask(holder, controller.control("acquire"), duration_ms=5000, client="forged")[0]
        status = ask(session, f"{BASE}/control/status")[0]
        setpoint = {
            **{"lease": reply["lease"], "seq": 1, "for_cycle": 1},
            **{"hip": {"assist": 1.0}, "slide": {"assist": 0.0}},
        }
        session.put(f"{BASE}/right/setpoint", json.dumps(setpoint))
        assert ask(session, f"{BASE}/control/status")
        reached = service.core.levels[-1].seq
        eventually(lambda: service.core.levels[-1].seq > reached + 5)
        taken = bool(service.core.levels[-1].setpoints)
        ask(holder, controller.control("release"), lease=reply["lease"])

    assert status["safety"]["lease_holder"] == "controller.desk"
    assert taken == (role == "controller")
    assert not [payload for payload in heard if str(reply["lease"]).encode() in payload]


def test_doctor_shows_what_each_live_link_matched(service, tmp_path):
    stranger = copied(service, tmp_path, "operator.ward")
    with_pair(stranger, new_certificate(authority_of(service), "operator.gone", NOW, YEAR))
    with connected(service.target("session.ward")), connected(target_of(stranger)):
        display = service.folder / "issued" / "display.desk"
        shown = gaitd("doctor", "--json", "--credentials", display).out

    assert "certificate of session.ward" in shown
    assert "a link on this machine" in shown
    assert "certificate of operator.gone, which is not in the register" in shown


def test_the_request_log_marks_a_name_that_is_only_claimed(service, eventually):
    with connected(service.target("display.desk")) as session:
        ask(session, f"{BASE}/control/stop", client="operator.desk")
        ask(session, service.target("display.desk").control("stop"), client="operator.desk")
    log = service.runtime / "state" / "requests.jsonl"

    def clients():
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        # A query and its answer are one line or two.
        stops = [one for one in lines if one.get("name") == "stop"]
        return [*{one["ticket"]: one["client"] for one in stops}.values()]

    eventually(lambda: clients()[-2:] == ["operator.desk (claimed)", "display.desk"])


# --- who does not get in --------------------------------------------------------------------------


def refused(bundle):
    """Whether the gateway refuses the link."""
    try:
        with connected(target_of(bundle), timeout_ms=1000):
            return False
    except zenoh.ZError:
        return True


def copied(service, tmp_path, name):
    return shutil.copytree(service.folder / issuing.ISSUED / name, tmp_path / name)


def with_pair(bundle, pair):
    (bundle / "client.pem").write_bytes(pair.certificate)
    (bundle / "client.key").write_bytes(pair.key)
    return bundle


def authority_of(service):
    keys = read_keys(service.folder)
    return Pair(keys.certificate("authority").read_bytes(), keys.key("authority").read_bytes())


def test_a_copy_of_the_keys_is_accepted_and_says_that_the_refusals_are_for_their_reasons(
    service, tmp_path
):
    bundle = copied(service, tmp_path, "operator.ward")
    assert not refused(bundle)
    fresh = new_certificate(authority_of(service), "operator.ward", NOW, YEAR)
    assert not refused(with_pair(bundle, fresh))


@pytest.mark.parametrize("kind", ["expired", "foreign", "gateway's own"])
def test_a_bad_certificate_is_refused_also_with_the_right_password(service, tmp_path, kind):
    bundle = copied(service, tmp_path, "operator.ward")
    long_ago = NOW - datetime.timedelta(days=2 * YEAR)
    keys = read_keys(service.folder)
    pair = {
        "expired": lambda: new_certificate(authority_of(service), "operator.ward", long_ago, YEAR),
        "foreign": lambda: new_certificate(
            new_authority("trainer", NOW), "operator.ward", NOW, YEAR
        ),
        "gateway's own": lambda: Pair(
            keys.certificate("gateway").read_bytes(), keys.key("gateway").read_bytes()
        ),
    }[kind]()

    assert refused(with_pair(bundle, pair))


def test_without_credentials_nothing_connects(service, tmp_path):
    for endpoint in (service.local, service.remote):
        with pytest.raises(zenoh.ZError), connected(Target((endpoint,), "trainer"), 500):
            pass


def test_without_any_client_in_the_register_nothing_connects_either(eventually):
    with tempfile.TemporaryDirectory() as folder:
        empty = Service(Path(folder), None, clients={})
        empty.start()
        eventually(lambda: listens(empty.local))
        with pytest.raises(zenoh.ZError), connected(Target((empty.local,), "trainer"), 500):
            pass
        empty.end()


@pytest.mark.parametrize("mode", ["router"])
def test_a_peer_or_router_has_no_more_rights_than_a_client(service, mode):
    display = service.target("display.desk")
    with connected(display, mode=mode) as session:
        assert not ask(session, f"{BASE}/control/enable")
        assert not ask(session, service.target("operator.desk").control("enable"))
        assert ask(session, display.control("stop"))[0]["outcome"] == "done"
    assert not service.core.requests


@pytest.mark.parametrize("name", ["operator.desk", "operator.ward"])
def test_a_wrong_password_is_refused(service, tmp_path, name):
    bundle = copied(service, tmp_path, name)
    file = json.loads((bundle / "credentials.json").read_text())
    (bundle / "credentials.json").write_text(json.dumps({**file, "password": "guessed"}))

    assert refused(bundle)


def test_a_remote_password_on_a_local_link_may_stop_and_nothing_else(service, tmp_path):
    bundle = copied(service, tmp_path, "operator.ward")
    file = json.loads((bundle / "credentials.json").read_text())
    stolen = {**file, "is_remote": False, "endpoints": [service.local]}
    (bundle / "credentials.json").write_text(json.dumps(stolen))
    target = target_of(bundle)

    with connected(target) as session:
        assert not ask(session, target.control("enable"))
        assert not ask(session, f"{BASE}/control/status")
        assert ask(session, f"{BASE}/control/stop")[0]["outcome"] == "done"


def test_a_certificate_of_one_client_with_the_name_of_another_may_stop_and_nothing_else(
    service, tmp_path
):
    bundle = copied(service, tmp_path, "operator.ward")
    for name in ("client.pem", "client.key"):
        shutil.copy(service.folder / issuing.ISSUED / "display.ward" / name, bundle / name)
    target = target_of(bundle)

    with connected(target) as session:
        assert not ask(session, target.control("enable"))
        assert ask(session, f"{BASE}/control/stop")[0]["outcome"] == "done"


# --- changes --------------------------------------------------------------------------------------


def test_a_revoked_client_is_out_after_the_restart_which_the_machine_in_motion_refuses(
    service, eventually, tmp_path
):
    bundle = service.issue("display.gone", remote=True)
    bundle_kept = shutil.copytree(bundle, tmp_path / "kept")
    operator = service.target("operator.desk")
    service.core.changes["mode"] = Mode.GAIT
    with connected(operator) as session:
        eventually(lambda: ask(session, f"{BASE}/control/status")[0]["safety"]["mode"] == "gait")
        reply = ask(session, operator.control("restart"))[0]
        assert (reply["outcome"], reply["refusal"]["code"]) == ("refused", "would_stop")
        service.core.changes["mode"] = Mode.READY
        eventually(lambda: ask(session, f"{BASE}/control/status")[0]["safety"]["mode"] == "ready")
        for name in ("clients.json", "gateway.pem", "authority.pem"):
            text = (service.folder / name).read_text()
            (service.folder / name).write_text("")
            reply = ask(session, operator.control("restart"))[0]
            assert (reply["outcome"], name in str(reply["refusal"])) == ("refused", True)
            (service.folder / name).write_text(text)
        assert ask(session, operator.control("restart"))[0]["outcome"] == "done"
    service.wait_for_restart(eventually)
    assert not refused(bundle)

    issuing.revoke(service.folder, "display.gone")
    with connected(operator) as session:
        eventually(lambda: ask(session, operator.control("restart"))[0]["outcome"] == "done")
    service.wait_for_restart(eventually)

    assert not bundle.exists()
    assert refused(bundle_kept)
    assert not refused(service.folder / issuing.ISSUED / "display.ward")


def test_the_released_plan_reaches_the_core_with_a_session_and_outlives_the_gateway(
    service, eventually
):
    operator, session_target = service.target("operator.desk"), service.target("session.desk")
    service.core.changes["mode"] = Mode.READY
    gait = {"mode": "gait", "cadence_hz": 0.4, "amplitude_ratio": 0.5, "duration_s": 60.0}
    with connected(operator) as session:
        eventually(lambda: ask(session, f"{BASE}/control/status")[0]["safety"]["mode"] == "ready")
        assert ask(session, operator.control("plan"), plan=PLAN)[0]["outcome"] == "done"
        assert ask(session, operator.control("restart"))[0]["outcome"] == "done"
    service.wait_for_restart(eventually)
    eventually(lambda: status_of(session_target).get("plan") == PLAN)
    with connected(session_target) as session:
        eventually(lambda: is_valid(session))
        ask(session, session_target.control("mode"), **gait)

    assert service.core.requests[-1].plan == Plan(0.5, 0.8, 600.0, AxisPlan(10.0))
    assert service.core.requests[-1].role is Role.SESSION
