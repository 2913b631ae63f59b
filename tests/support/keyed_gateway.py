"""A gateway with keys or without, on real links in a thread, its core, and clients of it."""

import contextlib
import datetime
import json
import tempfile
import threading
from math import inf
from pathlib import Path

import zenoh
from gaitd_client.connection import Target, client_settings
from gaitd_client.credentials import read_credentials
from gaitd_names import Outcome
from processes import CONFIGS

from daemon.config.settings import Lease
from daemon.config.trainer import load_trainer
from daemon.gateway.process import serve
from daemon.gateway.reload import Reload
from daemon.keys import issuing
from daemon.keys.folder import read_keys
from daemon.system.clock import MonotonicClock
from gaitd_lab.processes import free_port

BASE = "gaitd/trainer"
LEASE = Lease(duration_ms=500, duration_max_ms=60_000)
NOW = datetime.datetime.now(datetime.UTC)
YEAR = 365
ROLES = ("display", "controller", "session", "operator", "service")
CLIENTS = {f"{role}.{place}": place == "ward" for role in ROLES for place in ("desk", "ward")}


class HeldClock(MonotonicClock):
    """The computer's clock, without the time in which it was held."""

    def __init__(self):
        self._held_ns, self._since_ns = 0, None

    def now_ns(self):
        now_ns = super().now_ns() if self._since_ns is None else self._since_ns
        return now_ns - self._held_ns

    def hold(self):
        self._since_ns = super().now_ns()

    def go_on(self):
        self._held_ns += super().now_ns() - self._since_ns
        self._since_ns = None


class Service:
    """A gateway with keys on two links, or without keys on one, and a core that answers all."""

    def __init__(self, runtime, core, clients=CLIENTS):
        """`clients`: whether each is remote, by name; None: no client has keys."""
        self.folder, self.runtime, self.core = runtime / "keys", runtime, core
        self.local = f"tcp/127.0.0.1:{free_port()}"
        self.remote = f"tls/localhost:{free_port()}"
        self.have_keys = clients is not None
        self.listen = (self.local, self.remote) if self.have_keys else (self.local,)
        self._clock = HeldClock()
        self._ended, self._turns_left, self._stands = False, inf, False
        self._changed = threading.Condition()
        if clients is not None:
            issuing.init(self.folder, "trainer", [], NOW, YEAR)
            for name, is_remote in clients.items():
                self.issue(name, remote=is_remote)
        self._thread = threading.Thread(target=self._run)
        self.restarts = self._waited = 0

    def issue(self, name, *, remote=False, now=NOW, folder=None):
        endpoint = self.remote if remote else self.local
        return issuing.issue(
            folder or self.folder, name, [endpoint], "trainer", now, YEAR, remote=remote
        )

    def _run(self):
        while serve(
            *("trainer", self.listen, self.runtime, self.runtime / "state"),
            *(self._clock, self._is_ended, LEASE, None),
            Reload(load_trainer(CONFIGS / "demo.toml"), load_trainer),
            lambda: read_keys(self.folder) if self.have_keys else None,
        ):
            self.restarts += 1

    def _is_ended(self):
        """Called by the gateway between two turns of its loop."""
        with self._changed:
            self._stands = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._turns_left)
            self._turns_left -= 1
            self._stands = False
            return self._ended

    @contextlib.contextmanager
    def held(self):
        """The loop and its clock stand between two turns; Zenoh goes on to receive."""
        with self._changed:
            self._turns_left = 0
            assert self._changed.wait_for(lambda: self._stands, 30)
        self._clock.hold()
        try:
            yield
        finally:
            self._clock.go_on()
            self._let(inf)

    def turn(self):
        """Inside `held`: let the loop turn once."""
        self._let(1)
        with self._changed:
            assert self._changed.wait_for(lambda: self._stands and not self._turns_left, 30)

    def _let(self, turns):
        with self._changed:
            self._turns_left = turns
            self._changed.notify_all()

    def start(self):
        self._thread.start()

    def wait_for_restart(self, eventually):
        """Wait until the next gateway listens on all links."""
        before, self._waited = self._waited, self.restarts
        eventually(lambda: self.restarts > before)
        self._waited = self.restarts
        for name in ("operator.desk", "operator.ward"):
            eventually(lambda one=name: status_of(self.target(one)))

    def target(self, name):
        if not self.have_keys:
            return Target((self.local,), "trainer")
        return target_of(self.folder / issuing.ISSUED / name)

    def end_soon(self):
        """Let the loop end, as SIGTERM does."""
        self._ended = True

    def end(self):
        self.end_soon()
        self._thread.join(60)


@contextlib.contextmanager
def running(make_core, clients=CLIENTS):
    """A gateway that runs, and its core, which does what it is asked."""
    with tempfile.TemporaryDirectory() as folder:
        core = make_core(Path(folder))
        for name in ("enable", "disable", "reset", "mode"):
            core.answer(name, Outcome.DONE)
        made = Service(Path(folder), core, clients)
        made.start()
        try:
            yield made
        finally:
            made.end()
            core.end()


def target_of(bundle):
    credentials = read_credentials(bundle)
    return Target(credentials.file.endpoints, "trainer", credentials)


@contextlib.contextmanager
def connected(target, timeout_ms=10_000, **changes):
    config = zenoh.Config()
    # A router listens at Zenoh's own port otherwise, where one of another test may be.
    listens = {"listen/endpoints": ["tcp/127.0.0.1:0"]} if changes.get("mode") == "router" else {}
    settings = client_settings(target) | {"connect/timeout_ms": timeout_ms} | listens | changes
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with contextlib.closing(zenoh.open(config)) as session:
        yield session


def ask(session, key, timeout=30.0, **payload):
    """The replies to one query; none if the client has no right to it."""
    replies = session.get(key, payload=json.dumps(payload), timeout=timeout)
    return [
        json.loads((one.ok or one.err).payload.to_bytes()) for one in replies if one.ok or one.err
    ]


def status_of(target):
    """The status that a new link gets; empty while the gateway restarts."""
    try:
        with connected(target, timeout_ms=500) as session:
            replies = ask(session, f"{BASE}/control/status", timeout=5.0)
            return replies[0] if replies else {}
    except zenoh.ZError:
        return {}


def is_valid(session):
    """Whether records arrive; a gateway that has just begun to listen answers no query yet."""
    replies = ask(session, f"{BASE}/control/status")
    return replies and replies[0]["safety"]["valid"]


def is_alive(session):
    """Whether the gateway holds its token."""
    return [one.ok for one in session.liveliness().get(f"{BASE}/alive", timeout=30.0)]


def flush(session):
    """Wait until the gateway has received what this client sent before."""
    is_alive(session)  # answered by Zenoh, on the same link and in its order
