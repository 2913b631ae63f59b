"""Login of the therapist's server: password, attempts, sessions. Nothing here reads a clock."""

import base64
import hashlib
import hmac
import secrets
from collections import deque
from typing import Final, NamedTuple

from gaitd_client import Clock

SCRYPT_N: Final = 2**15
SCRYPT_R: Final = 8
SCRYPT_P: Final = 1
SCRYPT_MEMORY_MAX_BYTES: Final = 64 * 1024 * 1024
SALT_BYTES: Final = 16
KEY_BYTES: Final = 32
PASSWORD_MAX_CHARACTERS: Final = 200
PASSWORD_MIN_CHARACTERS: Final = 12
FAILURES_MAX: Final = 5
FAILURES_WITHIN_NS: Final = 60_000_000_000
SESSIONS_MAX: Final = 8
NS_PER_MIN: Final = 60_000_000_000


class PasswordError(Exception):
    """A password or its hash cannot be used; the text says why."""


def hash_password(password: str) -> str:
    """Return `scrypt$N$r$p$SALT$KEY` for a file; salt and key are base64.

    Raises:
        PasswordError: too short or too long.
    """
    if not PASSWORD_MIN_CHARACTERS <= len(password) <= PASSWORD_MAX_CHARACTERS:
        raise PasswordError(
            f"the password has {len(password)} characters, allowed {PASSWORD_MIN_CHARACTERS} to "
            f"{PASSWORD_MAX_CHARACTERS}; several words are easy to remember"
        )
    salt = secrets.token_bytes(SALT_BYTES)
    key = _key(password, salt, SCRYPT_N, SCRYPT_R, SCRYPT_P)
    words = (base64.b64encode(part).decode() for part in (salt, key))
    return "$".join(("scrypt", str(SCRYPT_N), str(SCRYPT_R), str(SCRYPT_P), *words))


class PasswordHash(NamedTuple):
    """A hash as it was read from a file."""

    n: int
    r: int
    p: int
    salt: bytes
    key: bytes

    def fits(self, password: str) -> bool:
        """Return whether it is the hash of this password; takes about 0.1 s and 32 MB."""
        if len(password) > PASSWORD_MAX_CHARACTERS:
            return False
        return hmac.compare_digest(_key(password, self.salt, self.n, self.r, self.p), self.key)


def read_hash(text: str) -> PasswordHash:
    """Read the output of `gaitd-display password`.

    Raises:
        PasswordError: it is no such text, or weaker than this version's.
    """
    try:
        kind, n, r, p, salt, key = text.split("$")
        made = PasswordHash(int(n), int(r), int(p), _decoded(salt), _decoded(key))
    except ValueError as error:
        raise PasswordError("login.password_hash: `gaitd-display password` makes it") from error
    is_strong = kind == "scrypt" and made.n >= SCRYPT_N and made.r >= SCRYPT_R and made.p >= 1
    if not is_strong or len(made.salt) < SALT_BYTES or len(made.key) != KEY_BYTES:
        raise PasswordError(f"login.password_hash: weaker than scrypt with N = {SCRYPT_N}")
    return made


def _decoded(text: str) -> bytes:
    return base64.b64decode(text, validate=True)


def _key(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    return hashlib.scrypt(
        password.encode(), salt=salt, n=n, r=r, p=p, maxmem=SCRYPT_MEMORY_MAX_BYTES, dklen=KEY_BYTES
    )


class Attempts:
    """Limit of attempts: of all clients together, because addresses are easy to change."""

    def __init__(self, clock: Clock) -> None:
        """Start without a failure."""
        self._clock = clock
        self._failures_ns: deque[int] = deque(maxlen=FAILURES_MAX)

    @property
    def are_exhausted(self) -> bool:
        """True while `FAILURES_MAX` attempts have failed within a minute."""
        if len(self._failures_ns) < FAILURES_MAX:
            return False
        return self._clock.now_ns() - self._failures_ns[0] < FAILURES_WITHIN_NS

    def fail(self) -> None:
        """Count an attempt before its password is checked."""
        self._failures_ns.append(self._clock.now_ns())

    def succeed(self) -> None:
        """Take the attempt back: its password was right."""
        self._failures_ns.pop()


class Session(NamedTuple):
    """One logged-in browser."""

    csrf: str
    """Sent by the page with each request; another site cannot read it."""
    ends_ns: int


class Sessions:
    """All sessions, by the hash of their token: a copy of the memory is no login."""

    def __init__(self, clock: Clock, max_min: int) -> None:
        """Start without a session.

        Args:
            clock: measures their age.
            max_min: a session ends after this time, in any case.
        """
        self._clock, self._max_ns = clock, max_min * NS_PER_MIN
        self._sessions: dict[bytes, Session] = {}

    def begin(self) -> str:
        """Begin a session and return its token; the oldest one ends if there are too many."""
        self._drop_old()
        if len(self._sessions) >= SESSIONS_MAX:
            del self._sessions[next(iter(self._sessions))]
        token = secrets.token_urlsafe(32)
        ends_ns = self._clock.now_ns() + self._max_ns
        self._sessions[_digest(token)] = Session(secrets.token_urlsafe(32), ends_ns)
        return token

    def of(self, token: str | None) -> Session | None:
        """Return the session of a token; None: unknown or over."""
        self._drop_old()
        return None if token is None else self._sessions.get(_digest(token))

    def end(self, token: str | None) -> None:
        """End a session."""
        if token is not None:
            self._sessions.pop(_digest(token), None)

    def _drop_old(self) -> None:
        now_ns = self._clock.now_ns()
        over = [key for key, session in self._sessions.items() if session.ends_ns <= now_ns]
        for key in over:
            del self._sessions[key]


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()
