"""Connection to a service: its address, its Zenoh session, and one query on it."""

import contextlib
import re
import threading
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeVar

import msgspec
import zenoh

from gaitd_client import wire
from gaitd_client.credentials import Credentials
from gaitd_client.errors import EndpointError, NoAnswerError, NoServiceError, reason_of

Message = TypeVar("Message", bound=msgspec.Struct)

CONNECT_TIMEOUT_MS: Final = 3000
"""Longest wait for a connection. A port without a service is tried again until then, because a
computer whose processors are busy needs some seconds."""
ANSWER_TIMEOUT_S: Final = 10.0
"""Longest wait for an answer: longer than the gateway lets any request wait."""
RECONNECT: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
"""When Zenoh tries to connect again after the gateway was away; its own names and units."""
RETRY_S: Final = 1.0
"""Time between two attempts to connect."""
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""Endpoint of a service on this computer."""
DEFAULT_TRAINER: Final = "trainer"
"""TRAINER in the keys of a service that has no other name."""
ENDPOINT: Final = re.compile(r"unixsock-stream/.+|(?:tcp|tls|udp|quic|ws)/.+:(?P<port>[0-9]{1,5})")
"""Form of an endpoint: transport and address as Zenoh writes them."""
PORT_MAX: Final = 65535
"""Largest port of an endpoint."""
PLACE_IN_ZENOH: Final = re.compile(r" at \S+\.rs:\d+")
"""Place in Zenoh's source within the text of its errors, which is left out."""


class Target(NamedTuple):
    """Address of a service: its endpoints, and the TRAINER of its keys."""

    endpoints: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    trainer: str = DEFAULT_TRAINER
    credentials: Credentials | None = None
    """None: for a service without keys."""

    def control(self, name: str) -> str:
        """Return the key of control/NAME, with the client's name if it has one and it acts."""
        key = wire.key(self.trainer, wire.CONTROL, name)
        if self.credentials is None or name in wire.READING:
            return key
        return f"{key}/{self.credentials.file.name}"

    def __str__(self) -> str:
        return f"{self.trainer} on {' or '.join(self.endpoints)}"


def checked(endpoints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the same endpoints, if a service may listen on each.

    Raises:
        EndpointError: on one of them none can.
    """
    for endpoint in endpoints:
        form = ENDPOINT.fullmatch(endpoint)
        if form is None or not 0 < int(form["port"] or 1) <= PORT_MAX:
            raise EndpointError(
                f"endpoint {endpoint!r}: allowed are tcp/HOST:PORT, tls/HOST:PORT or"
                f" unixsock-stream/PATH, with a port from 1 to {PORT_MAX}"
            )
    return endpoints


class Connection:
    """The session with a service, and what is to be declared on it once there is one."""

    def __init__(self, target: Target, *, keep_trying: bool = False) -> None:
        """Choose a service; `begin` connects.

        Args:
            target: its address.
            keep_trying: `begin` does not fail if the service is away, and tries again.
        """
        self.target = target
        self.is_over = threading.Event()
        """Set by `end`, until the next `begin`."""
        self._keep_trying = keep_trying
        self._session: zenoh.Session | None = None
        self._pending: list[Callable[[zenoh.Session], object]] = []
        self._lock = threading.RLock()
        self._trying: threading.Thread | None = None
        self._why_not = "use `with`"
        """Why there is no session."""

    def begin(self) -> None:
        """Connect, and declare what waits.

        Raises:
            NoServiceError: no service listens, or it does not accept the credentials.
        """
        self.is_over.clear()
        try:
            self._connect()
        except NoServiceError as error:
            if not self._keep_trying:
                raise
            self._why_not = str(error)
            self._trying = threading.Thread(target=self._try, name=f"{self.target}", daemon=True)
            self._trying.start()

    def end(self) -> None:
        """Try no longer; what is declared remains until `close`."""
        self.is_over.set()
        if self._trying is not None:
            self._trying.join()

    def close(self) -> None:
        """Close the session."""
        with self._lock:
            session, self._session = self._session, None
            self._why_not = "`with` was left"
            self._pending.clear()
        if session is not None:
            session.close()

    @property
    def is_open(self) -> bool:
        """True if there is a session."""
        return self._session is not None

    def session(self) -> zenoh.Session:
        """Return the session.

        Raises:
            NoAnswerError: there is none, with the reason.
        """
        session = self._session
        if session is None:
            raise NoAnswerError(f"{self.target}: not connected: {self._why_not}")
        return session

    def declare(self, declare: Callable[[zenoh.Session], object]) -> None:
        """Declare something now, or once there is a session."""
        with self._lock:
            if self._session is None:
                self._pending.append(declare)
            else:
                declare(self._session)

    def withdraw(self, declare: Callable[[zenoh.Session], object]) -> None:
        """Do not declare what waits; when this returns, it was declared before or never will be."""
        with self._lock:
            if declare in self._pending:
                self._pending.remove(declare)

    def _try(self) -> None:
        while not self.is_over.wait(RETRY_S):
            try:
                self._connect()
            except NoServiceError as error:
                self._why_not = str(error)
            else:
                return

    def _connect(self) -> None:
        """Open the session, and declare what waits.

        Raises:
            NoServiceError: there is none, or it was lost again; all is kept for the next attempt.
        """
        session = open_session(self.target)
        with self._lock, contextlib.ExitStack() as ending:
            ending.callback(session.close)
            try:
                for declare in self._pending:
                    declare(session)
            except zenoh.ZError as error:
                raise NoServiceError(f"{self.target}: the connection was lost: {error}") from error
            self._pending.clear()
            self._session = session
            ending.pop_all()


def client_settings(target: Target) -> dict[str, Any]:
    """Keys of Zenoh's configuration of a client, and their values."""
    return {
        "mode": "client",
        "connect/endpoints": list(target.endpoints),
        "connect/timeout_ms": CONNECT_TIMEOUT_MS,
        "connect/exit_on_failure": True,
        "connect/retry": RECONNECT,
        # Two programs that find each other would exchange messages without the gateway.
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": 1000,
        "transport/shared_memory/enabled": False,
        **(target.credentials.settings() if target.credentials else {}),
    }


def open_session(target: Target) -> zenoh.Session:
    """Open a session with a service; it must be closed, or the process hangs at its end.

    Raises:
        NoServiceError: no service listens on the endpoints, or it refuses the credentials.
    """
    zenoh.init_log_from_env_or("off")
    try:
        return zenoh.open(config_of(client_settings(target)))
    except zenoh.ZError as error:
        where = " or ".join(target.endpoints)
        raise NoServiceError(
            f"no service listens on {where}, too many connections wait there, or it does not"
            f" accept these keys: {PLACE_IN_ZENOH.sub('', str(error))}"
        ) from error


def config_of(settings: Mapping[str, object]) -> zenoh.Config:
    """Return a Zenoh configuration with these keys."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, msgspec.json.encode(value).decode())
    return config


def json_of(reply: zenoh.Reply) -> bytes | None:
    """Return the service's answer; None for Zenoh's own timeout, an error that is not JSON."""
    sample = reply.ok or reply.err
    is_json = sample is not None and str(sample.encoding).startswith("application/json")
    return sample.payload.to_bytes() if sample is not None and is_json else None


def query(
    session: zenoh.Session,
    target: Target,
    name: str,
    payload: bytes,
    timeout_s: float = ANSWER_TIMEOUT_S,
) -> bytes:
    """Query control/NAME with a JSON payload, and wait for the JSON of the answer.

    Raises:
        NoAnswerError: none came in time.
    """
    key = target.control(name)
    try:
        replies = session.get(key, payload=payload, timeout=timeout_s)
        answers = [data for reply in replies if (data := json_of(reply)) is not None]
    except zenoh.ZError as error:
        raise NoAnswerError(f"{key}: {error}") from error
    if not answers:
        role = "" if target.credentials is None else ", or the role may not request it"
        where = " or ".join(target.endpoints)
        raise NoAnswerError(f"no answer to {key} on {where}: another trainer, or it hangs{role}")
    return answers[0]


def decode_answer(data: bytes, kind: type[Message], name: str) -> Message:
    """Return the answer as a message of this kind.

    Raises:
        NoAnswerError: it is none; with the reason of the service, if it refused the query.
    """
    try:
        return msgspec.json.decode(data, type=kind)
    except (ValueError, RecursionError) as error:
        reason = _refusal(data) or f"the answer is no {wire.schema_name(kind)} ({error})"
        raise NoAnswerError(f"{name}: {reason}") from error


def _refusal(data: bytes) -> str:
    try:
        return reason_of(msgspec.json.decode(data, type=wire.Reply))
    except (ValueError, RecursionError):
        return ""
