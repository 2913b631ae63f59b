"""The clients of the gateway: roles, dates, and the released plan on the disk."""

import contextlib
import datetime
import os
from pathlib import Path
from unittest import mock

import msgspec
import pytest
from gaitd_client.wire import AskedPlan, AxisPlan
from gaitd_names import Outcome, Role

from daemon.gateway.clients import PLAN_FILE, ClientRefusedError, Clients, PlanStore
from daemon.gateway.events import Kind, Priority
from daemon.gateway.requests import Answer
from daemon.ipc.record import Plan
from daemon.keys.folder import Client, Keys, Register
from daemon.wire.roles import ROLES, Access, RoleRules

TODAY = "2026-11-23"
LIMITS = AskedPlan(cadence_max_hz=0.5, amplitude_max_ratio=0.8, duration_max_s=600.0)
NARROW = AskedPlan(cadence_max_hz=0.1, amplitude_max_ratio=0.2, duration_max_s=60.0)
RETURNS, LOST = "plan_may_return", "plan_may_be_lost"


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


ACTING = ("acquire", "release", "report", "plan", "mark", "restart")


@pytest.mark.parametrize(
    ("role", "may"),
    [
        (Role.DISPLAY, ()),
        (Role.CONTROLLER, ("acquire", "release", "report")),
        (Role.SESSION, ()),
        (Role.OPERATOR, ("plan", "mark", "restart")),
        (Role.SERVICE, ("restart",)),
    ],
)
def test_a_role_requests_what_it_has_a_right_to(role, may):
    client = f"{role}.desk"
    clients = Clients(keys(client))

    assert [clients.role(name, client) for name in may] == [role] * len(may)
    for name in sorted(set(ACTING) - set(may)):
        with pytest.raises(ClientRefusedError) as caught:
            clients.role(name, client)
        refusal = caught.value.refusal
        assert (refusal.code, refusal.values) == (
            "role_may_not",
            {"role": role, "request": name},
        )


@pytest.mark.parametrize("right", [Access.PLAN, Access.MARK])
def test_a_plan_and_a_mark_have_each_their_own_right(monkeypatch, right):
    monkeypatch.setitem(ROLES, Role.DISPLAY, RoleRules(access=frozenset({right})))
    clients = Clients(keys("display.desk"))

    assert clients.role(right.value, "display.desk") is Role.DISPLAY
    other = {"plan", "mark"} - {right.value}
    with pytest.raises(ClientRefusedError):
        clients.role(*other, "display.desk")


def test_a_query_that_acts_needs_a_name_of_the_register():
    clients = Clients(keys("session.desk"))

    assert clients.role("enable", "session.desk") is Role.SESSION
    for name in ("stop", "status", "config", "schema"):
        assert clients.role(name, "") is Role.DISPLAY
    for name in ("", "operator.desk"):
        with pytest.raises(ClientRefusedError, match=r"^client_unnamed$") as caught:
            clients.role("enable", name)
        refusal = caught.value.refusal
        assert (refusal.code, refusal.values) == ("client_unnamed", {"request": "enable"})
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


def release(store, limits, ticket=7):
    """Release a plan; what the answer says is not reached."""
    store.release(ticket, limits, "operator.desk")
    (answer,) = store.answers()
    assert answer == Answer(ticket, Outcome.DONE, answer.refusal)
    return answer.refusal


def test_the_plan_outlives_its_gateway_and_a_damaged_one_is_none(file):
    def store():
        return PlanStore(file, at_once)

    assert (store().plan, store().trouble) == (None, "")
    assert release(store(), LIMITS) is None
    assert store().plan == Plan(0.5, 0.8, 600.0)
    file.write_text('{"cadence_max_hz": 9}')
    assert (store().plan, str(file) in store().trouble) == (None, True)
    limits = '"cadence_max_hz": 0.5, "amplitude_max_ratio": 0.8, "duration_max_s": 600.0'
    file.write_text(f'{{{limits}, "hip_assist_max_nm": 5.5, "slide_assist_max_n": null}}')
    assert (store().plan, "unknown field `hip_assist_max_nm`" in store().trouble) == (None, True)
    for _ in range(2):
        assert release(store(), None) is None
        assert (store().plan, store().trouble, file.exists()) == (None, "", False)


@pytest.mark.parametrize(
    ("limits", "code", "values"),
    [
        (
            msgspec.structs.replace(
                LIMITS, hip=AxisPlan(assist_max=5.5), slide=AxisPlan(assist_max=30.0)
            ),
            "plan_released",
            {
                "cadence_max_hz": 0.5,
                "amplitude_max_ratio": 0.8,
                "duration_max_s": 600.0,
                "hip_assist_max": 5.5,
                "slide_assist_max": 30.0,
            },
        ),
        (None, "plan_withdrawn", {}),
    ],
)
def test_a_release_and_a_withdrawal_are_events_with_who_and_what(file, limits, code, values):
    told = PlanStore(file, at_once).release(7, limits, "operator.desk")

    assert (told.priority, told.kind, told.code) == (Priority.INFO, Kind.NOTE, code)
    assert told.values == {"client": "operator.desk", **values}


def test_the_disk_loses_the_plan_of_before_first_and_has_the_new_one_before_the_answer(
    file, monkeypatch
):
    synced = []

    def fsync(descriptor):
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        synced.append((name, PlanStore(file, at_once).limits))

    release(PlanStore(file, at_once), LIMITS)
    left_over = file.with_name(".plan.json.new")
    left_over.write_text("of a gateway that was killed")
    open_count = len(list(Path("/proc/self/fd").iterdir()))
    monkeypatch.setattr(os, "fsync", fsync)

    release(PlanStore(file, at_once), NARROW)
    assert f"{file.stat().st_mode & 0o777:o}" == "600"
    assert not left_over.exists()
    release(PlanStore(file, at_once), None)

    folder = file.parent.name
    released = [(folder, None), (left_over.name, None), (folder, NARROW)]
    assert synced == [*released, (folder, None)]
    assert len(list(Path("/proc/self/fd").iterdir())) == open_count


@pytest.mark.parametrize("limits", [NARROW, None])
@pytest.mark.parametrize("is_queue_full", [False, True])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OSError("no disk")])
def test_a_plan_of_before_comes_back_only_where_the_answer_says_so(
    file, limits, is_queue_full, error
):
    """Each call of the system in turn fails, and the next gateway starts."""
    reason = error.strerror or str(error)
    told = []
    for failing in range(1, 11):
        release(PlanStore(file, at_once), LIMITS)
        store = PlanStore(file, lambda _what, run: not is_queue_full and run() is None)
        with failing_call(failing, error) as calls, contextlib.suppress(OSError):
            store.release(7, limits, "operator.desk")
        (answer,) = store.answers()
        after = PlanStore(file, at_once).limits

        assert (store.limits, answer.outcome) == (limits, Outcome.DONE)
        why = answer.refusal
        if why is None:
            assert after == limits
        else:
            assert why.said == reason
            assert after in {LIMITS if why.code == RETURNS else limits, None}
        told.append(why and why.code)
        if len(calls) < failing:
            break

    lost = 0 if limits is None else 6  # unlink, open, fsync, rename; open and fsync the folder
    assert told == [RETURNS] * 3 + [LOST] * lost + [None]


@contextlib.contextmanager
def failing_call(number, error):
    """The call of that number, of those that change the disk, fails; all calls so far."""
    calls = []

    def counted(real):
        def call(*words, **named):
            calls.append(real)
            if len(calls) == number:
                raise error
            return real(*words, **named)

        return call

    with (
        mock.patch.object(Path, "unlink", counted(Path.unlink)),
        mock.patch.object(Path, "replace", counted(Path.replace)),
        mock.patch.object(os, "open", counted(os.open)),
        mock.patch.object(os, "fsync", counted(os.fsync)),
    ):
        yield calls


def test_a_plan_is_written_into_no_file_of_another(file, tmp_path, monkeypatch):
    theirs = tmp_path / "theirs"
    theirs.write_text("theirs")

    def unlink(self, missing_ok):
        self.symlink_to(theirs)

    monkeypatch.setattr(Path, "unlink", unlink)
    with pytest.raises(FileExistsError):
        PlanStore(file, at_once).release(7, LIMITS, "operator.desk")

    assert theirs.read_text() == "theirs"


def test_a_withdrawn_plan_is_not_written_by_a_disk_that_was_slow(file):
    waiting = []
    store = PlanStore(file, lambda _what, run: len(waiting) < 1 and waiting.append(run) is None)
    store.release(7, LIMITS, "operator.desk")
    assert store.answers() == []
    store.release(8, None, "operator.desk")
    waiting[0]()

    assert not file.exists()
    assert [answer.ticket for answer in store.answers()] == [8, 7]


def test_a_plan_that_another_user_could_have_written_is_none(file, tmp_path, monkeypatch):
    release(PlanStore(file, at_once), LIMITS)
    (tmp_path / "link.json").symlink_to(file)
    assert "link.json" in PlanStore(tmp_path / "link.json", at_once).trouble
    refused = f"{file}: another user could have written it"
    us = os.geteuid()
    for other in (us - 1, us + 1):
        with mock.patch.object(os, "geteuid", return_value=other):
            assert PlanStore(file, at_once).trouble == refused
    for mode in (0o620, 0o602):
        file.chmod(mode)
        assert PlanStore(file, at_once).trouble == refused
