"""SIGHUP: which settings of the trainer file change in a running gateway, and which need a restart.

Rules:
1. The file is read and checked as at the start. An invalid file changes nothing: the error is
   reported as by `gaitd check`, and the gateway keeps its settings.
2. `[log]` takes effect at once. `[lease]` takes effect if no lease is held.
3. Everything else needs a restart and is named: endpoints and paths that of the gateway, all
   other tables and files that of the core. Nothing that acts on the drives changes in a running
   core (docs/running.md).
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

from gaitd_names import EventCode
from gaitd_toml import ConfigError

from daemon.config.trainer import TrainerFile
from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.lease import LeaseManager
from daemon.gateway.log import set_level

OURS: Final = frozenset({"lease", "log", "zenoh", "paths"})
"""Tables that the gateway reads. It shares `paths` with the core."""
WITHOUT_RESTART: Final = frozenset({"sim"})
"""Tables of the virtual drives, which need no restart of gateway or core."""


class Reload:
    """The configuration in force, and the pending request to reload it."""

    def __init__(self, file: TrainerFile, read: Callable[[Path], TrainerFile]) -> None:
        """`file` is in force now; `read` reads and checks a file, or raises ConfigError."""
        self._file = file
        self._log = file.trainer.log
        self._read = read
        self._requested = False
        self.needs_restart = ""
        """Changes found by the newest reload that need a restart; empty if none."""

    def request(self, *_signal: object) -> None:
        """Request a reload; used as the signal handler of SIGHUP."""
        self._requested = True

    def turn(self, leases: LeaseManager, core_hashes: Mapping[str, str]) -> list[EventDraft]:
        """Carry out a requested reload once, and return its events.

        Args:
            leases: takes the new rules.
            core_hashes: SHA-256 of each file that the core runs with, by its path.
        """
        if not self._requested:
            return []
        self._requested = False
        try:
            new = self._read(self._file.path)
        except ConfigError as error:
            refused = EventDraft(
                Priority.MEDIUM, Kind.NOTE, EventCode.CONFIG_REFUSED, said=str(error)
            )
            return [refused]
        return [self._apply(new, leases, core_hashes)]

    def _apply(
        self, new: TrainerFile, leases: LeaseManager, core_hashes: Mapping[str, str]
    ) -> EventDraft:
        applied: list[str] = []
        waiting: list[str] = []
        if new.trainer.log != self._log:
            self._log = new.trainer.log
            set_level(self._log.level)
            applied.append("log")
        if new.trainer.lease != leases.rules:
            if leases.holder is None:
                leases.rules = new.trainer.lease
                applied.append("lease")
            else:
                waiting.append(
                    f"lease unchanged while {leases.holder} holds it: reload again later"
                )
        waiting += restarts(self._file, new, changed_files(core_hashes, self._file.path))
        self.needs_restart = "; ".join(waiting)
        done = ", ".join(applied) or "-"
        said = f"{done}; {self.needs_restart}" if waiting else done
        priority = Priority.LOW if waiting else Priority.INFO
        return EventDraft(priority, Kind.NOTE, EventCode.CONFIG_RELOADED, said=said)


def changed_tables(old: TrainerFile, new: TrainerFile) -> set[str]:
    """Names of the tables and keys that differ between two trainer files."""
    fields = old.trainer.__struct_fields__
    return {name for name in fields if getattr(old.trainer, name) != getattr(new.trainer, name)}


def changed_files(hashes: Mapping[str, str], trainer: Path) -> list[str]:
    """Names of the core's files, except the trainer file, that changed since the core read them."""
    others = {Path(path): sha256 for path, sha256 in hashes.items() if Path(path) != trainer}
    return sorted(path.name for path, sha256 in others.items() if _sha256(path) != sha256)


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def restarts(old: TrainerFile, new: TrainerFile, files: Iterable[str]) -> list[str]:
    """Changes that need a restart, one line for each process."""
    changed = changed_tables(old, new)
    gateway = sorted(changed & {"zenoh", "paths"})
    core = sorted(changed - OURS - WITHOUT_RESTART | changed & {"paths"}) + list(files)
    drafts: list[str] = []
    if gateway:
        drafts.append(f"needs a restart of the gateway: {', '.join(gateway)}")
    if core:
        what = ", ".join(core)
        drafts.append(f"needs gaitd check and a restart of the core on the empty machine: {what}")
    return drafts
