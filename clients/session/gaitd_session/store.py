"""History of sessions in one SQLite file.

Rules:
1. One writer: a lock beside the file. Readers take none, and see by it whether a session goes on.
2. WAL with synchronous=FULL: a commit that has returned is on the disk. What a batch holds is
   committed whole or not at all, so a power cut loses the batches that were not yet written.
3. Times are those of the trainer, UTC in ns.
4. A file of another program, of a later version, or a damaged one raises `StoreError`. Nothing
   of it is changed.
5. Migration: MIGRATIONS[n] leads from version n to n + 1, in one transaction, when a writer opens
   the file. An entry is never edited after a release; a change of the schema is another entry.
6. The file is bounded: where it has more than STRIDES_BYTES_MAX, a session that begins deletes the
   strides of the oldest sessions. All else stays.
7. Deleted rows are overwritten (secure_delete), and `erase` leaves none in free pages or in the
   write-ahead log.
"""

import fcntl
import os
import sqlite3
import struct
from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TextIO

APPLICATION_ID: Final = 0x67616974
"""`gait` in the header of the file."""
MODE: Final = 0o660
"""Rights of a new file, less the umask. SQLite gives them to log and index, too: a reader of the
group may create these, and the writer must be able to use them afterwards."""
STRIDES_BYTES_MAX: Final = 256_000_000
"""About 850 hours of walking with two legs."""
TRIMMED_SESSIONS_MAX: Final = 20
"""Sessions whose strides are deleted at once, so that a patient never waits for it."""
BUSY_S: Final = 5.0
"""Longest wait for a reader's lock."""

MIGRATIONS: Final[tuple[tuple[str, ...], ...]] = (
    (
        """
        CREATE TABLE session (
            number INTEGER PRIMARY KEY AUTOINCREMENT,
            profile TEXT NOT NULL,
            trainer TEXT NOT NULL,
            begun_utc_ns INTEGER NOT NULL,
            ended_utc_ns INTEGER,
            end TEXT
        ) STRICT
        """,
        "CREATE INDEX session_profile ON session (profile)",
        """
        CREATE TABLE block (
            session INTEGER NOT NULL REFERENCES session ON DELETE CASCADE,
            number INTEGER NOT NULL,
            kind TEXT NOT NULL,
            cadence_hz REAL NOT NULL,
            amplitude_ratio REAL NOT NULL,
            planned_s REAL NOT NULL,
            walked_s REAL NOT NULL,
            PRIMARY KEY (session, number)
        ) STRICT, WITHOUT ROWID
        """,
        """
        CREATE TABLE goal (
            session INTEGER NOT NULL REFERENCES session ON DELETE CASCADE,
            block INTEGER NOT NULL,
            leg TEXT NOT NULL,
            middle_ratio REAL NOT NULL,
            next_middle_ratio REAL NOT NULL,
            PRIMARY KEY (session, block, leg)
        ) STRICT, WITHOUT ROWID
        """,
        """
        CREATE TABLE stride (
            session INTEGER NOT NULL REFERENCES session ON DELETE CASCADE,
            block INTEGER NOT NULL,
            leg TEXT NOT NULL,
            end_utc_ns INTEGER NOT NULL,
            duration_s REAL NOT NULL,
            share_ratio REAL,
            share_ratio_std REAL,
            work_positive_j REAL,
            work_negative_j REAL,
            is_valid INTEGER NOT NULL,
            PRIMARY KEY (session, leg, end_utc_ns)
        ) STRICT, WITHOUT ROWID
        """,
        """
        CREATE TABLE interruption (
            session INTEGER NOT NULL REFERENCES session ON DELETE CASCADE,
            utc_ns INTEGER NOT NULL,
            phase TEXT NOT NULL,
            reason TEXT NOT NULL
        ) STRICT
        """,
        "CREATE TABLE self_test (profile TEXT NOT NULL, utc_ns INTEGER NOT NULL) STRICT",
    ),
    (
        """
        CREATE TABLE mark (
            session INTEGER REFERENCES session ON DELETE CASCADE,
            profile TEXT NOT NULL,
            utc_ns INTEGER NOT NULL,
            said TEXT NOT NULL,
            PRIMARY KEY (profile, utc_ns, said)
        ) STRICT, WITHOUT ROWID
        """,
    ),
)

_FLOCK: Final = "hhqqi0q"
"""struct flock of fcntl(2), for a lock of an open file description: type, from where, which bytes,
process."""
INTERRUPTED: Final = "interrupted"
"""End of a session whose program has ended without one: killed, or a power cut."""


class StoreError(Exception):
    """The history cannot be used: which file, why, and what to do."""


class UnusableFileError(StoreError):
    """What the file holds is no history that this version can read."""


class SessionRow(NamedTuple):
    """A session begins; the rows that follow belong to it."""

    profile: str
    trainer: str
    begun_utc_ns: int


class EndRow(NamedTuple):
    """The session is over."""

    ended_utc_ns: int
    end: str


class BlockRow(NamedTuple):
    """A block as far as it was walked; a later row of the same block replaces it."""

    number: int
    kind: str
    cadence_hz: float
    amplitude_ratio: float
    planned_s: float
    walked_s: float


class GoalRow(NamedTuple):
    """Middle of a leg's target band in a block, and that for the next one; replaced alike."""

    block: int
    leg: str
    middle_ratio: float
    next_middle_ratio: float


class StrideRow(NamedTuple):
    """A stride."""

    block: int
    leg: str
    end_utc_ns: int
    duration_s: float
    share_ratio: float | None
    share_ratio_std: float | None
    work_positive_j: float | None
    work_negative_j: float | None
    is_valid: bool
    """Goals follow it."""


class InterruptionRow(NamedTuple):
    """The session left its course."""

    utc_ns: int
    phase: str
    reason: str
    """A cause of a stop, a `Why`, or the code of a refusal; empty: the phase says it."""


class SelfTestRow(NamedTuple):
    """A self-test was passed."""

    profile: str
    utc_ns: int


class MarkRow(NamedTuple):
    """A person has written a remark; the same one twice is kept once."""

    profile: str
    utc_ns: int
    said: str
    is_before: bool
    """It belongs to the session of the profile that begins next; else to the newest one."""


Row = SessionRow | EndRow | BlockRow | GoalRow | StrideRow | InterruptionRow | SelfTestRow | MarkRow

_OF_SESSION: Final[dict[type, str]] = {
    BlockRow: "block",
    GoalRow: "goal",
    StrideRow: "stride",
    InterruptionRow: "interruption",
}


class SessionSummary(NamedTuple):
    """One session in figures."""

    number: int
    begun_utc_ns: int
    end: str
    """Empty: it goes on. Without an end it is `INTERRUPTED` once no program writes any more."""
    walked_s: float
    stride_count: int
    valid_count: int
    mean_share_ratio: float | None
    """Mean over the valid strides."""
    interruption_count: int
    last_interruption: str
    """Its reason, or its phase where it needs none; empty: there is none."""


class GoalSummary(NamedTuple):
    """Target of a leg in one block, and the strides that have reached it."""

    session: int
    block: int
    leg: str
    middle_ratio: float
    """Middle of the target band."""
    next_middle_ratio: float
    """That for the next block."""
    goes_on: bool
    """The session has no end yet, and the block was not walked to its end."""
    reached_count: int
    """Valid strides at or above the band's lower end."""


EXPORTED: Final = (
    "profile",
    "session",
    "begun_utc_ns",
    "block",
    "kind",
    "cadence_hz",
    "amplitude_ratio",
    "leg",
    "end_utc_ns",
    "duration_s",
    "share_ratio",
    "share_ratio_std",
    "work_positive_j",
    "work_negative_j",
    "is_valid",
    "band_middle_ratio",
)
"""Columns of an exported stride."""


class Store:
    """The history; `write`, `erase` and the reading methods are for one thread at a time."""

    def __init__(self, file: Path, *, is_writer: bool) -> None:
        """Open the file; a writer creates it, and closes sessions that were interrupted.

        Raises:
            UnusableFileError: the file is of another program, of a later version, or damaged.
            StoreError: the file cannot be opened, or another program writes to it.
        """
        self.file = file
        self._session: int | None = None
        self._is_writer = is_writer
        mode = "rwc" if is_writer else "rw"
        with ExitStack() as ending:
            if is_writer:
                ending.enter_context(_locked(file))
            with _readable_errors(file):
                # The thread that writes is not the one that opens.
                self._database = sqlite3.connect(
                    f"{file.absolute().as_uri()}?mode={mode}",
                    uri=True,
                    timeout=BUSY_S,
                    isolation_level=None,
                    check_same_thread=False,
                )
                ending.callback(self._database.close)
                self._prepare(self._database, is_writer)
            self._ending = ending.pop_all()

    def _prepare(self, database: sqlite3.Connection, is_writer: bool) -> None:
        version = _version(database, self.file)
        if is_writer:
            database.execute("PRAGMA journal_mode = WAL")
        elif version == 0:
            raise UnusableFileError(f"{self.file} is empty: there is no session yet")
        elif version < len(MIGRATIONS):
            raise UnusableFileError(
                f"{self.file} is of an earlier gaitd-session: start the program that writes it,"
                " the patient's page or `gaitd-session run`, which brings it up to date"
            )
        for setting in ("synchronous = FULL", "foreign_keys = ON", "secure_delete = ON"):
            database.execute(f"PRAGMA {setting}")
        if not is_writer:
            return
        for number in range(version, len(MIGRATIONS)):
            with _transaction(database):
                for statement in MIGRATIONS[number]:
                    database.execute(statement)
                database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                database.execute(f"PRAGMA user_version = {number + 1}")
        with _transaction(database):
            database.execute(
                "UPDATE session SET end = ?, ended_utc_ns = coalesce("
                "(SELECT max(end_utc_ns) FROM stride WHERE session = number), begun_utc_ns)"
                " WHERE end IS NULL",
                (INTERRUPTED,),
            )

    def close(self) -> None:
        """Close the file, and let another writer open it."""
        self._ending.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- writing --------------------------------------------------------------------------------

    def write(self, rows: Sequence[Row]) -> None:
        """Commit rows, all or none; after it has returned they survive a power cut.

        Rows belong to the session whose `SessionRow` was written last; after its `EndRow` to none,
        and are refused.

        Raises:
            StoreError: nothing of them was written: the disk is full, or does not work.
        """
        session = self._session
        with _readable_errors(self.file), _transaction(self._database):
            for row in rows:
                session = self._write(session, row)
        self._session = session

    def _write(self, session: int | None, row: Row) -> int | None:
        match row:
            case SessionRow():
                self._make_room()
                number = self._database.execute(
                    "INSERT INTO session (profile, trainer, begun_utc_ns) VALUES (?, ?, ?)", row
                ).lastrowid
                self._database.execute(
                    "UPDATE mark SET session = ? WHERE session IS NULL AND profile = ?",
                    (number, row.profile),
                )
                return number
            case EndRow():
                self._database.execute(
                    "UPDATE session SET ended_utc_ns = ?, end = ? WHERE number = ?", (*row, session)
                )
                return None
            case SelfTestRow():
                self._database.execute("INSERT INTO self_test VALUES (?, ?)", row)
            case MarkRow():
                self._database.execute(
                    "INSERT OR IGNORE INTO mark SELECT"
                    " iif(?4, NULL, (SELECT max(number) FROM session WHERE profile = ?1)),"
                    " ?1, ?2, ?3",
                    row,
                )
            case _:
                marks = ", ".join("?" * (len(row) + 1))
                self._database.execute(
                    f"INSERT OR REPLACE INTO {_OF_SESSION[type(row)]} VALUES ({marks})",
                    (session, *row),
                )
        return session

    def _make_room(self) -> None:
        for _ in range(TRIMMED_SESSIONS_MAX):
            if _used_bytes(self._database) <= STRIDES_BYTES_MAX:
                return
            self._database.execute(
                "DELETE FROM stride WHERE session = (SELECT min(session) FROM stride)"
            )

    def erase(self, profile: str) -> int:
        """Delete all rows of a profile, without a trace in the file; return its sessions.

        Raises:
            StoreError: they are not deleted, or a reader keeps the write-ahead log from being
                emptied.
        """
        with _readable_errors(self.file):
            with _transaction(self._database):
                of_profile = "WHERE profile = ?"
                found = self._database.execute(f"DELETE FROM session {of_profile}", (profile,))
                for table in ("self_test", "mark"):
                    self._database.execute(f"DELETE FROM {table} {of_profile}", (profile,))
            self._database.execute("VACUUM")
            is_busy, *_ = self._database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        if is_busy:
            raise StoreError(
                f"{self.file}: the rows are deleted, but another program reads the file, and keeps"
                " its log; close that program, and erase again"
            )
        return found.rowcount

    # --- reading --------------------------------------------------------------------------------

    def middles(self, profile: str) -> dict[str, float]:
        """Return, by leg, the middle of the target band that comes next."""
        return dict(
            self._read(
                "SELECT leg, next_middle_ratio FROM goal JOIN session ON session = session.number"
                " WHERE profile = ? ORDER BY session, block",
                profile,
            )
        )

    def self_test_utc_ns(self, profile: str) -> int:
        """Return when the last self-test was passed; 0: never."""
        ((utc_ns,),) = self._read(
            "SELECT coalesce(max(utc_ns), 0) FROM self_test WHERE profile = ?", profile
        )
        return utc_ns

    def summaries(self, profile: str) -> list[SessionSummary]:
        """Return the sessions of a profile, oldest first."""
        rows = self._read(
            "SELECT number, begun_utc_ns, coalesce(end, ?2),"
            " (SELECT coalesce(sum(walked_s), 0.0) FROM block WHERE session = session.number),"
            " count(leg), coalesce(sum(is_valid), 0), avg(iif(is_valid, share_ratio, NULL)),"
            " (SELECT count(*) FROM interruption WHERE session = session.number),"
            " coalesce((SELECT iif(reason = '', phase, reason) FROM interruption"
            " WHERE session = session.number ORDER BY utc_ns DESC LIMIT 1), '')"
            " FROM session LEFT JOIN stride ON stride.session = number"
            " WHERE profile = ?1 GROUP BY number ORDER BY number",
            profile,
            "" if self._is_written() else INTERRUPTED,
        )
        return [SessionSummary(*row) for row in rows]

    def goals(self, profile: str, half_width_ratio: float) -> list[GoalSummary]:
        """Return the targets of all blocks of a profile, oldest first.

        Args:
            profile: of the patient.
            half_width_ratio: from the middle of a band to its lower end.
        """
        rows = self._read(
            "SELECT goal.session, goal.block, goal.leg, middle_ratio, next_middle_ratio,"
            " ?3 AND end IS NULL AND walked_s < planned_s,"
            " (SELECT count(*) FROM stride WHERE stride.session = goal.session AND is_valid"
            " AND stride.leg = goal.leg AND stride.block = goal.block"
            " AND share_ratio >= middle_ratio - ?2)"
            " FROM goal JOIN session ON session.number = goal.session"
            " JOIN block ON block.session = goal.session AND block.number = goal.block"
            " WHERE profile = ?1 ORDER BY goal.session, goal.block, goal.leg",
            profile,
            half_width_ratio,
            self._is_written(),
        )
        return [GoalSummary(*row) for row in rows]

    def blocks(self, session: int) -> list[BlockRow]:
        """Return the blocks of a session, in their order."""
        rows = self._read(
            "SELECT number, kind, cadence_hz, amplitude_ratio, planned_s, walked_s FROM block"
            " WHERE session = ? ORDER BY number",
            session,
        )
        return [BlockRow(*row) for row in rows]

    def strides_of(self, session: int) -> list[StrideRow]:
        """Return the strides of a session, in order of time."""
        rows = self._read(
            "SELECT block, leg, end_utc_ns, duration_s, share_ratio, share_ratio_std,"
            " work_positive_j, work_negative_j, is_valid FROM stride"
            " WHERE session = ? ORDER BY end_utc_ns, leg",
            session,
        )
        return [StrideRow(*row)._replace(is_valid=bool(row[-1])) for row in rows]

    def interruptions(self, session: int) -> list[InterruptionRow]:
        """Return the interruptions of a session, in order of time."""
        rows = self._read(
            "SELECT utc_ns, phase, reason FROM interruption WHERE session = ? ORDER BY utc_ns",
            session,
        )
        return [InterruptionRow(*row) for row in rows]

    def marks(self, profile: str) -> dict[int, list[MarkRow]]:
        """Return the marks of a profile in order of time, by the number of their session."""
        rows = self._read(
            "SELECT session, utc_ns, said FROM mark WHERE profile = ? AND session IS NOT NULL"
            " ORDER BY utc_ns",
            profile,
        )
        marks: dict[int, list[MarkRow]] = {}
        for session, utc_ns, said in rows:
            marks.setdefault(session, []).append(MarkRow(profile, utc_ns, said, is_before=False))
        return marks

    def strides(self, profile: str) -> list[tuple[Any, ...]]:
        """Return all strides of a profile with the columns `EXPORTED`, in order of time."""
        return self._read(
            "SELECT profile, session.number, begun_utc_ns, stride.block, kind, cadence_hz,"
            " amplitude_ratio, stride.leg, end_utc_ns, duration_s, share_ratio, share_ratio_std,"
            " work_positive_j, work_negative_j, is_valid, middle_ratio"
            " FROM stride JOIN session ON stride.session = session.number"
            " LEFT JOIN block ON block.session = session.number AND block.number = stride.block"
            " LEFT JOIN goal ON goal.session = session.number AND goal.block = stride.block"
            " AND goal.leg = stride.leg"
            " WHERE profile = ? ORDER BY session.number, end_utc_ns, stride.leg",
            profile,
        )

    def _is_written(self) -> bool:
        """Return whether the program that writes is alive."""
        return self._is_writer or _has_writer(self.file)

    def _read(self, query: str, *values: str | float) -> list[tuple[Any, ...]]:
        with _readable_errors(self.file):
            return self._database.execute(query, values).fetchall()


class History(NamedTuple):
    """The history of a session that must run in any case."""

    store: Store | None
    """None: nothing is kept."""
    trouble: str
    """What is wrong, for people; empty if the history of before goes on."""


def open_history(file: Path) -> History:
    """Open the history for writing; training is possible whatever the file is.

    An unusable file is renamed to FILE.aside-N with its log, and a new one begun: goals then start
    as in the profile. Where no file can be opened nothing is kept.
    """
    try:
        return History(Store(file, is_writer=True), "")
    except UnusableFileError as error:
        trouble = str(error)
    except StoreError as error:
        return History(None, f"{error}; this session is not kept")
    try:
        aside = _set_aside(file)
        store = Store(file, is_writer=True)
    except (OSError, StoreError) as error:
        return History(None, f"{trouble}; it cannot be replaced ({error}); nothing is kept")
    return History(store, f"{trouble}; it was renamed to {aside.name}, and a new history begun")


def files_aside(file: Path) -> list[Path]:
    """Return the files that `open_history` has renamed; they may hold rows of any profile."""
    return sorted(file.parent.glob(f"{file.name}.aside-*"))


def _set_aside(file: Path) -> Path:
    number = 1
    while (aside := file.with_name(f"{file.name}.aside-{number}")).exists():
        number += 1
    file.rename(aside)
    for suffix in ("-wal", "-shm"):
        beside = file.with_name(file.name + suffix)
        if beside.exists():
            beside.rename(aside.with_name(aside.name + suffix))
    return aside


def _lock_path(file: Path) -> Path:
    return file.with_name(f"{file.name}.lock")


def _locked(file: Path) -> TextIO:
    try:
        lock = _lock_path(file).open("w")
        if not file.exists():
            file.touch(mode=MODE)
    except OSError as error:
        raise StoreError(f"{error.filename}: {error.strerror}; choose another folder") from error
    try:
        fcntl.fcntl(lock, fcntl.F_OFD_SETLK, _whole_file(fcntl.F_WRLCK))
    except BlockingIOError as error:
        lock.close()
        raise StoreError(f"{file}: another session writes to it; end that one first") from error
    return lock


def _has_writer(file: Path) -> bool:
    """Return whether a program has the lock; it is asked for, and not taken.

    Raises:
        StoreError: this user may not see the lock.
    """
    try:
        with _lock_path(file).open() as lock:
            found = fcntl.fcntl(lock, fcntl.F_OFD_GETLK, _whole_file(fcntl.F_RDLCK))
    except FileNotFoundError:
        return False
    except OSError as error:
        told = f"{error.filename}: {error.strerror}; give this user the right to read it"
        raise StoreError(told) from error
    return struct.unpack(_FLOCK, found)[0] != fcntl.F_UNLCK


def _whole_file(kind: int) -> bytes:
    return struct.pack(_FLOCK, kind, os.SEEK_SET, 0, 0, 0)


def _version(database: sqlite3.Connection, file: Path) -> int:
    """Return the version of the schema; 0: an empty file.

    Raises:
        UnusableFileError: it is no history of this version.
    """
    (application,) = database.execute("PRAGMA application_id").fetchone()
    (version,) = database.execute("PRAGMA user_version").fetchone()
    (table_count,) = database.execute("SELECT count(*) FROM sqlite_schema").fetchone()
    if (application, version, table_count) == (0, 0, 0):
        return 0
    if application != APPLICATION_ID:
        raise UnusableFileError(f"{file} is a database of another program")
    if version > len(MIGRATIONS):
        raise UnusableFileError(
            f"{file} has version {version}, this program reads up to {len(MIGRATIONS)};"
            " install the later gaitd-session"
        )
    with closing(database.execute("PRAGMA quick_check(1)")) as found:
        (verdict,) = found.fetchone()
    if verdict != "ok":
        raise UnusableFileError(f"{file} is damaged ({verdict})")
    return version


def _used_bytes(database: sqlite3.Connection) -> int:
    """Return the size of the file without its free pages, which later rows will use."""
    page_count, free_count, page_bytes = (
        database.execute(f"PRAGMA {name}").fetchone()[0]
        for name in ("page_count", "freelist_count", "page_size")
    )
    return (page_count - free_count) * page_bytes


@contextmanager
def _transaction(database: sqlite3.Connection) -> Generator[None]:
    with database:
        database.execute("BEGIN IMMEDIATE")
        yield


@contextmanager
def _readable_errors(file: Path) -> Generator[None]:
    """Turn errors of SQLite into those of this module."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in {sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT}:
            raise UnusableFileError(f"{file} is damaged, or no SQLite file ({error})") from error
        raise StoreError(f"{file}: {error}; check the disk and the rights of the file") from error
