"""The clients of the gateway: roles, dates, and the released plan on the disk."""

import datetime
import os
from pathlib import Path
from unittest import mock

import msgspec
import pytest
from gaitd_client.wire import PlanLimits

from daemon.gateway.clients import PLAN_FILE, ClientRefusedError, Clients, PlanStore
from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.ipc.record import Plan, Role
from daemon.keys.folder import Client, Keys, Register

TODAY = "2026-11-23"
LIMITS = PlanLimits(cadence_max_hz=0.5, amplitude_max_ratio=0.8, duration_max_s=600.0)
RELEASED = "plan released by operator.desk: up to 0.5 Hz, amplitude 0.8, 600 s"


def keys(*local, **remote):
    """Clients with a password, and those with a certificate and its last day."""
    clients = tuple(
        Client(name=name, password="x" * 32, remote=day is not None, issued=TODAY, expires=day)
        for name, day in {**dict.fromkeys(local), **remote}.items()
    )
    dates = {"authority_expires": "2036-11-20", "gateway_expires": "2027-11-23"}
    return Keys(Path(), Register(clients=clients, **dates))


# --- names, roles, links, dates -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("at", "expiring"),
    [
        ("1970-01-01T00:00:00", ()),
        ("2027-10-23T23:59:59", ("session.ward_3",)),
        ("2027-10-24T00:00:00", ("gateway", "session.ward_3")),
        ("2031-01-01T12:00:00", ("gateway", "session.ward_3")),
        ("2036-11-01T12:00:00", ("authority", "gateway", "session.ward_3")),
    ],
)
def test_certificates_that_end_within_30_days_are_named_and_a_password_never(at, expiring):
    clients = Clients(keys("display.desk", **{"session.ward_3": "2027-11-01"}))
    utc = datetime.datetime.fromisoformat(at).replace(tzinfo=datetime.UTC)

    assert clients.expiring(round(utc.timestamp()) * 10**9) == expiring
    assert Clients(None).expiring(round(utc.timestamp()) * 10**9) == ()


ACTING = ("acquire", "release", "report", "plan", "restart")


@pytest.mark.parametrize(
    ("role", "may"),
    [
        (Role.DISPLAY, ()),
        (Role.CONTROLLER, ("acquire", "release", "report")),
        (Role.SESSION, ()),
        (Role.OPERATOR, ("plan", "restart")),
        (Role.SERVICE, ("restart",)),
    ],
)
def test_a_role_requests_what_it_has_a_right_to(role, may):
    client = f"{role.name.lower()}.desk"
    clients = Clients(keys(client))

    assert [clients.role(name, client) for name in may] == [role] * len(may)
    for name in sorted(set(ACTING) - set(may)):
        with pytest.raises(ClientRefusedError) as caught:
            clients.role(name, client)
        assert str(caught.value) == f"the role {role.name.lower()} may not request {name}"


def test_a_query_that_acts_needs_a_name_of_the_register():
    clients = Clients(keys("session.desk"))

    assert clients.role("enable", "session.desk") is Role.SESSION
    for name in ("stop", "status", "config", "schema"):
        assert clients.role(name, "") is Role.DISPLAY
    for name in ("", "operator.desk"):
        with pytest.raises(ClientRefusedError) as caught:
            clients.role("enable", name)
        asked = "control/enable needs the client's name in its key: control/enable/ROLE.NAME"
        assert str(caught.value) == asked
    for name in ("enable", *ACTING):
        assert Clients(None).role(name, "") is Role.UNRESTRICTED


def test_a_link_matches_an_entry_only_by_a_certificate_of_the_register():
    clients = Clients(keys("session.ward"))

    assert clients.have_keys
    assert clients.link("tls", "10.0.0.9:5", "session.ward").client == "session.ward"
    assert clients.link("tls", "10.0.0.9:5", "session.gone").client is None
    assert clients.link("tcp", "127.0.0.1:5", None).client is None
    assert not Clients(None).have_keys
    assert Clients(None).link("tls", "10.0.0.9:5", "session.ward").client is None


# --- the plan -------------------------------------------------------------------------------------


def at_once(what, run):
    """The disk's thread, which has nothing else to do."""
    assert what == "plan"
    run()
    return True


@pytest.fixture
def file(tmp_path):
    return tmp_path / PLAN_FILE


def test_the_plan_outlives_its_gateway_and_a_damaged_one_is_none(file):
    def store():
        return PlanStore(file, at_once)

    assert (store().plan, store().trouble) == (None, "")
    assert store().release(LIMITS, "operator.desk")[0] == ""
    assert store().plan == Plan(0.5, 0.8, 600.0)
    file.write_text('{"cadence_max_hz": 9}')
    assert (store().plan, "no plan is released" in store().trouble) == (None, True)
    for _ in range(2):
        assert store().release(None, "operator.desk")[0] == ""
        assert (store().plan, store().trouble, file.exists()) == (None, "", False)


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        (LIMITS, RELEASED),
        (
            msgspec.structs.replace(LIMITS, hip_assist_max_nm=5.5, slide_assist_max_n=30.0),
            f"{RELEASED}, assist 5.5 N·m, assist 30 N",
        ),
        (None, "the plan is withdrawn by operator.desk"),
    ],
)
def test_a_release_and_a_withdrawal_are_events_with_who_and_what(file, limits, text):
    told = PlanStore(file, at_once).release(limits, "operator.desk")

    assert told == ("", EventDraft(Priority.INFO, Kind.NOTE, text))


def test_a_plan_is_on_the_disk_before_it_has_its_name_and_gone_before_it_is_reported(
    file, monkeypatch
):
    synced = []

    def fsync(descriptor):
        synced.append((Path(f"/proc/self/fd/{descriptor}").readlink().name, file.exists()))

    monkeypatch.setattr(os, "fsync", fsync)
    left_over = file.with_suffix(".new")
    left_over.write_text("of a gateway that was killed")
    open_count = len(list(Path("/proc/self/fd").iterdir()))

    store = PlanStore(file, at_once)
    store.release(LIMITS, "operator.desk")
    assert f"{file.stat().st_mode & 0o777:o}" == "600"
    assert PlanStore(file, at_once).plan == Plan(0.5, 0.8, 600.0)
    assert not left_over.exists()
    store.release(None, "operator.desk")

    assert synced == [("plan.new", False), (file.parent.name, False)]
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count


def test_a_plan_is_written_into_no_file_of_another(file, tmp_path, monkeypatch):
    theirs = tmp_path / "theirs"
    theirs.write_text("theirs")

    def unlink(self, missing_ok):
        self.symlink_to(theirs)

    monkeypatch.setattr(Path, "unlink", unlink)
    with pytest.raises(FileExistsError):
        PlanStore(file, at_once).release(LIMITS, "operator.desk")

    assert theirs.read_text() == "theirs"


def test_a_withdrawn_plan_is_not_written_by_a_disk_that_was_slow(file):
    waiting = []
    store = PlanStore(file, lambda _what, run: waiting.append(run) is None)
    store.release(LIMITS, "operator.desk")
    store.release(None, "operator.desk")
    for run in waiting:
        run()

    assert not file.exists()


def test_a_plan_that_another_user_could_have_written_is_none(file, tmp_path, monkeypatch):
    PlanStore(file, at_once).release(LIMITS, "operator.desk")
    (tmp_path / "link.json").symlink_to(file)
    assert "no plan is released" in PlanStore(tmp_path / "link.json", at_once).trouble
    refused = f"{file}: no plan is released: another user could have written it"
    us = os.geteuid()
    for other in (us - 1, us + 1):
        with mock.patch.object(os, "geteuid", return_value=other):
            assert PlanStore(file, at_once).trouble == refused
    for mode in (0o620, 0o602):
        file.chmod(mode)
        assert PlanStore(file, at_once).trouble == refused


@pytest.mark.parametrize(
    ("error", "reason"),
    [(OSError(5, "Input/output error"), "Input/output error"), (OSError("no disk"), "no disk")],
)
def test_a_plan_that_the_disk_does_not_take_is_in_force_and_said_so(
    file, monkeypatch, error, reason
):
    store = PlanStore(file, lambda *_: False)
    until = "in force until the gateway's next restart only"

    trouble, event = store.release(LIMITS, "operator.desk")
    assert store.plan == Plan(0.5, 0.8, 600.0)
    assert trouble == f"{until}: the disk is too slow"
    assert event.text == f"{RELEASED}; {trouble}"

    monkeypatch.setattr(Path, "unlink", mock.Mock(side_effect=error))
    trouble, event = store.release(None, "operator.desk")
    assert store.plan is None
    assert trouble == f"{until}: {reason}"
    assert event.text == f"the plan is withdrawn by operator.desk; {trouble}"
