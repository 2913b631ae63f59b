"""Power cuts: the states that a disk may have after one, at each point of what some code wrote.

`record` (traced_calls.py) logs each call of a scenario that changes a file or a name below one
folder. `check` makes the states that the disk may have after a cut behind each of these calls,
restores each in the folder, and calls the test's function on it.

The disk is an ext4-like one, seen pessimistically:

1. What fsync or fdatasync of a file has returned for is there. Of what was written since, each
   sector of 512 or 4096 bytes is there or not, in any order; a file may have its new size and zeros
   in it.
2. A name is on the disk after fsync of its folder, and not before: fsync of the file does not
   suffice. Of the changes of names since, each is there or not, a rename as a whole. A change of an
   entry needs the earlier changes of the same entry.
3. Times, owners and rights of files are not modelled; what is restored belongs to its owner alone.

A kill of the process alone leaves all that was written: that is one of the states.
"""

import random
import shutil
from collections.abc import Callable, Iterator, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

from traced_calls import ROOT, Event, Log, Mark, Names, Node, Resize, State, Sync, Write, record

SECTORS = (512, 4096)
Entries = dict[tuple[Node, str], Node]


class Cut(NamedTuple):
    """A state of the disk after a cut."""

    after: str
    """The call behind which the power failed."""
    marks: tuple[str, ...]
    """What the scenario had marked until then."""
    state: State


class Disk:
    """What a disk has for certain, and what it may have."""

    def __init__(self, before: Entries, contents: dict[Node, bytes]) -> None:
        self._names, self._contents = dict(before), dict(contents)
        self._changes: dict[Node, list[Write | Resize]] = {}
        self._renames: list[tuple[Names, set[Node]]] = []
        """Each with the folders that were not synced since."""

    def apply(self, event: Event) -> None:
        match event:
            case Write() | Resize():
                self._changes.setdefault(event.node, []).append(event)
            case Names():
                self._renames.append((event, {folder for folder, _, _ in event.entries}))
            case Sync(node):
                changes = self._changes.pop(node, [])
                if changes:
                    before = self._contents.get(node, b"")
                    self._contents[node] = _changed(before, changes, lambda: True, SECTORS[0])
                for names, unsynced in self._renames:
                    unsynced.discard(node)
                    if not unsynced:
                        _rename(self._names, names)
                self._renames = [one for one in self._renames if one[1]]
            case Mark():
                pass

    def state(self, holds: Callable[[], bool], sector: int) -> State:
        """One state: `holds` is asked for each change whether the disk has it."""
        names, missing = dict(self._names), set[tuple[Node, str]]()
        for change, _ in self._renames:
            touched = {(folder, name) for folder, name, _ in change.entries}
            if touched & missing or not holds():
                missing |= touched
            else:
                _rename(names, change)
        state: State = {}

        def walk(folder: Node, path: str) -> None:
            for (parent, name), node in names.items():
                if parent == folder and node.is_folder:
                    state[path + name] = None
                    walk(node, f"{path}{name}/")
                elif parent == folder:
                    before, changes = self._contents.get(node, b""), self._changes.get(node, ())
                    state[path + name] = _changed(before, changes, holds, sector)

        walk(ROOT, "")
        return state


def _rename(names: Entries, change: Names) -> None:
    for folder, name, node in change.entries:
        if node is None:
            names.pop((folder, name), None)
        else:
            names[folder, name] = node


def _changed(
    before: bytes, changes: Sequence[Write | Resize], holds: Callable[[], bool], sector: int
) -> bytes:
    if not changes:
        return before
    data = bytearray(before)
    for change in changes:
        if isinstance(change, Resize):
            if holds():
                data[change.size :] = bytes(max(change.size - len(data), 0))
            continue
        begin, end = change.offset, change.offset + len(change.data)
        if holds():
            data.extend(bytes(max(end - len(data), 0)))
        while begin < end:
            stop = min((begin // sector + 1) * sector, end)
            if holds():
                data.extend(bytes(max(stop - len(data), 0)))
                data[begin:stop] = change.data[begin - change.offset : stop - change.offset]
            begin = stop
    return bytes(data)


def cuts(log: Log, random_count: int = 4, seed: int = 1) -> Iterator[Cut]:
    """All different states: all that was written, only what is certain, and random ones."""
    choose, disk = random.Random(seed), Disk(log.names, log.contents)
    marks: tuple[str, ...] = ()
    seen: set[bytes] = set()
    for number, (event, call) in enumerate([(Mark("begin"), "begin"), *log.events]):
        disk.apply(event)
        if isinstance(event, Mark):
            marks = (*marks, event.text)
        for chance in (1.0, 0.0, *(choose.random() for _ in range(random_count))):

            def holds(chance: float = chance) -> bool:
                return choose.random() < chance

            state = disk.state(holds, choose.choice(SECTORS))
            digest = _digest(state, marks)
            if digest not in seen:
                seen.add(digest)
                yield Cut(f"{number}: {call}, chance {chance:.2f}", marks[1:], state)


def _digest(state: State, marks: tuple[str, ...]) -> bytes:
    digest = blake2b(repr((marks, [*sorted(state)])).encode())
    for path in sorted(state):
        digest.update(state[path] or b"")
        digest.update(b"\0")
    return digest.digest()


def restore(state: State, folder: Path) -> None:
    """Make a folder have this state, and nothing else."""
    shutil.rmtree(folder)
    folder.mkdir(mode=0o700)
    for path in sorted(state):
        data = state[path]
        if data is None:
            (folder / path).mkdir(mode=0o700)
        else:
            (folder / path).write_bytes(data)
            (folder / path).chmod(0o600)


def check(
    folder: Path,
    scenario: Callable[[], object],
    recover: Callable[[tuple[str, ...]], object],
    random_count: int = 4,
    seed: int = 1,
) -> int:
    """Call `recover` with the marks of each cut, after the folder was restored; count the cuts.

    A failure names the cut; `restore` and the same seed repeat it.
    """
    count = 0
    for cut in cuts(record(folder, scenario), random_count, seed):
        restore(cut.state, folder)
        count += 1
        try:
            recover(cut.marks)
        except BaseException as error:
            sizes = {path: data and len(data) for path, data in cut.state.items()}
            error.add_note(f"power cut after {cut.after}; marks {cut.marks}; files {sizes}")
            raise
    return count
