"""The calls by which a piece of code changes the files below one folder, in their order.

The code runs in a fork under ptrace. So every call of it is seen, also those of SQLite and Arrow,
which write in C, and of its threads. What is written through a shared mapping is no call: mapped
files are compared at each later call. A call that is not known here fails the test.
"""

import contextlib
import ctypes
import os
import platform
import signal
import struct
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

import pytest

MARK_FD: Final = 1 << 30
"""A descriptor that nothing has: a write to it is a mark."""


class Node(NamedTuple):
    """A file or a folder, whatever its name is."""

    number: int
    is_folder: bool


ROOT: Final = Node(0, is_folder=True)


class Write(NamedTuple):
    """Bytes of a file."""

    node: Node
    offset: int
    data: bytes


class Resize(NamedTuple):
    """Another size of a file."""

    node: Node
    size: int


class Names(NamedTuple):
    """Entries of folders that change at once: folder, name, and its node; None: removed."""

    entries: tuple[tuple[Node, str, Node | None], ...]


class Sync(NamedTuple):
    """Fsync of a file or a folder has returned."""

    node: Node


class Mark(NamedTuple):
    """The scenario has said something, for example that a change was acknowledged."""

    text: str


Event = Write | Resize | Names | Sync | Mark
State = dict[str, bytes | None]
"""Content by path; None: a folder."""


class Log(NamedTuple):
    """What happened below a folder: what was there before, and each change with its call."""

    names: dict[tuple[Node, str], Node]
    contents: dict[Node, bytes]
    events: list[tuple[Event, str]]


def mark(text: str) -> None:
    """Mark the log, from within a scenario."""
    with contextlib.suppress(OSError):
        os.write(MARK_FD, text.encode())


def record(folder: Path, scenario: Callable[[], object]) -> Log:
    """Run the scenario in a fork, and return what it changed below the folder.

    Raises:
        AssertionError: it failed, or made a call that is not known here.
    """
    if sys.platform != "linux" or platform.machine() != "x86_64":
        pytest.skip("the numbers of calls are those of Linux on x86-64")
    return _Tracer(folder.resolve()).run(scenario)


# --- calls of Linux on x86-64 ---------------------------------------------------------------------

WRITES: Final = {1: "write", 18: "pwrite64", 20: "writev", 296: "pwritev"}
SYNCS: Final = {26: "msync", 74: "fsync", 75: "fdatasync"}
OPENS: Final = {2: "open", 257: "openat"}
NAMES: Final = {
    82: "rename",
    83: "mkdir",
    84: "rmdir",
    86: "link",
    87: "unlink",
    258: "mkdirat",
    263: "unlinkat",
    264: "renameat",
    265: "linkat",
    316: "renameat2",
}
SIZES: Final = {76: "truncate", 77: "ftruncate", 285: "fallocate"}
MMAP: Final = 9
KNOWN: Final = {**WRITES, **SYNCS, **OPENS, **NAMES, **SIZES, MMAP: "mmap"}
HARMLESS: Final = frozenset(
    {0, *range(3, 9), *range(10, 18), 19, *range(21, 26), 27, 28, *range(32, 40), *range(41, 64)}
    | {72, 73, *range(78, 82), *range(89, 133), 137, 138, *range(140, 149), 157, 158, 160, 186}
    | {*range(191, 194), *range(200, 205), 217, 218, 221, *range(228, 236), 247}
    | {*range(260, 263), *range(267, 275), 280, *range(281, 285), *range(286, 296), 302, 309}
    | {318, 327, 332, 334, 424, 434, 435, 436, 439}
)
"""Calls that change no content and no name: reading, memory, threads, sockets, times and rights."""

O_TMPFILE: Final = 0o20000000
MAP_SHARED: Final = 1
PROT_WRITE: Final = 2
AT_FDCWD: Final = -100
AT_REMOVEDIR: Final = 0x200

# --- ptrace ---------------------------------------------------------------------------------------

TRACEME, SYSCALL, SETOPTIONS, SYSCALL_INFO = 0, 24, 0x4200, 0x420E
TRACESYSGOOD, TRACEFORKS, EXITKILL = 1, 0b1110, 1 << 20
ENTRY, EXIT = 1, 2
_LIBC: Final = ctypes.CDLL(None, use_errno=True)
_LIBC.ptrace.argtypes = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
_LIBC.ptrace.restype = ctypes.c_long


def _ptrace(request: int, pid: int, address: int = 0, data: object = 0) -> int:
    done = _LIBC.ptrace(request, pid, address, data)
    if done < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return int(done)


class _Call(NamedTuple):
    number: int
    arguments: tuple[int, ...]
    paths: tuple[str, ...]
    """Absolute; only calls of NAMES and OPENS, and truncate, have some."""


class _Tracer:
    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._count = 0
        self._by_inode: dict[int, Node] = {folder.stat().st_ino: ROOT}
        self._names: dict[tuple[Node, str], Node] = {}
        self._contents: dict[Node, bytes] = {}
        self._mapped: dict[Node, tuple[int, bytes]] = {}
        """Files that are mapped for writing: a descriptor of ours, and the content last seen."""
        self._events: list[tuple[Event, str]] = []
        for path in sorted(folder.rglob("*")):
            node = self._new(path.stat().st_ino, is_folder=path.is_dir())
            self._names[self._node_at(str(path.parent)), path.name] = node
            if path.is_file():
                self._contents[node] = path.read_bytes()
        self._log = Log(dict(self._names), self._contents, self._events)

    def run(self, scenario: Callable[[], object]) -> Log:
        sys.stdout.flush()
        sys.stderr.flush()
        pid = os.fork()
        if pid == 0:
            _play(scenario)
        try:
            code = self._trace(pid)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            for own, _ in self._mapped.values():
                os.close(own)
        assert code == 0, f"the scenario ended with {code}"
        return self._log

    def _trace(self, first: int) -> int:
        """Follow all threads and forks of the scenario; returns the exit code of its process."""
        calls: dict[int, _Call] = {}
        known: set[int] = set()
        code = -1
        while True:
            try:
                # Its process group: other children of this process are none of our business.
                pid, status = os.waitpid(-first if known else first, os.WUNTRACED | 0x40000000)
            except ChildProcessError:
                return code
            if not os.WIFSTOPPED(status):
                if pid == first:
                    code = os.waitstatus_to_exitcode(status)
                continue
            given = 0
            if pid not in known:
                known.add(pid)
                if pid == first:
                    _ptrace(SETOPTIONS, pid, 0, TRACESYSGOOD | TRACEFORKS | EXITKILL)
            elif os.WSTOPSIG(status) == signal.SIGTRAP | 0x80:
                try:
                    self._stopped(pid, calls)
                except ProcessLookupError:  # killed meanwhile, as the others at the process's end
                    calls.pop(pid, None)
                except BaseException:
                    os.killpg(first, signal.SIGKILL)
                    raise
            elif not status >> 16:
                given = os.WSTOPSIG(status)
            with contextlib.suppress(ProcessLookupError):
                _ptrace(SYSCALL, pid, 0, given)

    def _stopped(self, pid: int, calls: dict[int, _Call]) -> None:
        info = ctypes.create_string_buffer(88)
        _ptrace(SYSCALL_INFO, pid, len(info), ctypes.addressof(info))
        if info.raw[0] == ENTRY:
            number, *arguments = struct.unpack_from("=7Q", info.raw, 24)
            self._compare_mapped()
            calls[pid] = self._entered(pid, number, tuple(arguments))
        elif info.raw[0] == EXIT and pid in calls:
            (result,) = struct.unpack_from("=q", info.raw, 24)
            call = calls.pop(pid)
            if call.number in KNOWN and result >= 0:
                self._returned(pid, call, result)

    # --- what a call means ------------------------------------------------------------------------

    def _entered(self, pid: int, number: int, arguments: tuple[int, ...]) -> _Call:
        assert number in KNOWN or number in HARMLESS, f"call {number} is not known here"
        if number == 1 and arguments[0] == MARK_FD:
            text = _memory(pid, arguments[1], arguments[2]).decode()
            self._add(Mark(text), f"mark {text}")
        paths: tuple[str, ...] = ()
        name, at = KNOWN.get(number, ""), [_signed(one) for one in arguments]
        if name in {"open", "rmdir", "mkdir", "unlink", "truncate"}:
            paths = (_path(pid, AT_FDCWD, arguments[0]),)
        elif name in {"rename", "link"}:
            paths = (_path(pid, AT_FDCWD, arguments[0]), _path(pid, AT_FDCWD, arguments[1]))
        elif name in {"openat", "mkdirat", "unlinkat"}:
            paths = (_path(pid, at[0], arguments[1]),)
        elif name in {"renameat", "renameat2", "linkat"}:
            paths = (_path(pid, at[0], arguments[1]), _path(pid, at[2], arguments[3]))
        return _Call(number, arguments, paths)

    def _returned(self, pid: int, call: _Call, result: int) -> None:
        name, arguments = KNOWN[call.number], call.arguments
        if name in OPENS.values():
            self._opened(pid, call, result)
        elif name in NAMES.values():
            self._renamed(name, call)
        elif name == "msync":
            for node in [*self._mapped]:
                self._add(Sync(node), "msync")
        elif name == "truncate":
            if self._is_ours(call.paths[0]):
                self._add(Resize(self._node_at(call.paths[0]), arguments[1]), name)
        elif name == "mmap" and (_signed(arguments[4]) < 0 or not arguments[3] & MAP_SHARED):
            return
        elif (node := self._node_of(pid, arguments[4 if name == "mmap" else 0])) is not None:
            path = f"/proc/{pid}/fd/{arguments[4 if name == 'mmap' else 0]}"
            text = f"{name} {Path(path).readlink().name}"
            if name in SYNCS.values():
                self._add(Sync(node), text)
            elif name == "mmap" and arguments[2] & PROT_WRITE and node not in self._mapped:
                own = os.open(path, os.O_RDONLY)
                self._mapped[node] = own, _content(own)
            elif name in WRITES.values():
                is_at = name.startswith("p")
                offset = arguments[3] if is_at else _position(pid, arguments[0]) - result
                with open(path, "rb") as file:  # noqa: PTH123 - a descriptor of another process
                    data = os.pread(file.fileno(), result, offset)
                assert len(data) == result, f"{text}: read back {len(data)} of {result} bytes"
                self._add(Write(node, offset, data), f"{text} {result} at {offset}")
                self._look_again(node)
            elif name == "ftruncate":
                self._add(Resize(node, arguments[1]), f"{text} {arguments[1]}")
                self._look_again(node)
            elif name == "fallocate":
                assert arguments[1] == 0, "fallocate with a mode is not known here"
                size = os.stat(path).st_size  # noqa: PTH116 - as above
                self._add(Resize(node, size), f"{text} {size}")
                self._look_again(node)

    def _opened(self, pid: int, call: _Call, descriptor: int) -> None:
        path, flags = call.paths[0], call.arguments[1 if KNOWN[call.number] == "open" else 2]
        if not self._is_ours(path):
            return
        assert flags & O_TMPFILE != O_TMPFILE, "O_TMPFILE is not known here"
        if flags & os.O_CREAT and self._find(path) is None:
            status = os.stat(f"/proc/{pid}/fd/{descriptor}")  # noqa: PTH116 - as above
            self._enter(path, self._new(status.st_ino, is_folder=False), "create")
        elif flags & os.O_TRUNC and (node := self._find(path)) is not None:
            self._add(Resize(node, 0), f"truncate {Path(path).name}")

    def _renamed(self, name: str, call: _Call) -> None:
        first, last = call.paths[0], call.paths[-1]
        if not self._is_ours(first) and not self._is_ours(last):
            return
        assert self._is_ours(first) and self._is_ours(last), f"{name} from or to another folder"
        if name in {"mkdir", "mkdirat"}:
            node = self._new(os.stat(first).st_ino, is_folder=True)  # noqa: PTH116
            self._enter(first, node, name)
        elif name in {"rmdir", "unlink", "unlinkat"}:
            self._change(f"{name} {Path(first).name}", (*self._entry(first), None))
        else:
            assert name != "renameat2" or call.arguments[4] in {0, 1}, "an exchange is not known"
            node = self._node_at(first)
            entries = [] if "link" in name else [(*self._entry(first), None)]
            text = f"{name} {Path(first).name} {Path(last).name}"
            self._change(text, *entries, (*self._entry(last), node))

    # --- mapped files -----------------------------------------------------------------------------

    def _compare_mapped(self) -> None:
        for node, (own, before) in self._mapped.items():
            now = _content(own)
            if now == before:
                continue
            for offset in range(0, len(now), 512):
                data = now[offset : offset + 512]
                if data != before[offset : offset + 512]:
                    self._add(Write(node, offset, data), f"mapped write at {offset}")
            self._mapped[node] = own, now

    def _look_again(self, node: Node) -> None:
        if node in self._mapped:
            own, _ = self._mapped[node]
            self._mapped[node] = own, _content(own)

    # --- names and nodes --------------------------------------------------------------------------

    def _add(self, event: Event, text: str) -> None:
        self._events.append((event, text))

    def _new(self, inode: int, *, is_folder: bool) -> Node:
        self._count += 1
        node = self._by_inode[inode] = Node(self._count, is_folder)
        return node

    def _is_ours(self, path: str) -> bool:
        return path.startswith(f"{self._folder}/")

    def _find(self, path: str) -> Node | None:
        node: Node | None = ROOT
        for name in filter(None, path.removeprefix(self._folder).split("/")):
            node = self._names.get((node, name)) if node is not None else None
        return node

    def _node_at(self, path: str) -> Node:
        node = self._find(path)
        assert node is not None, f"{path} was not seen to be made"
        return node

    def _entry(self, path: str) -> tuple[Node, str]:
        folder, _, name = path.rpartition("/")
        return self._node_at(folder), name

    def _enter(self, path: str, node: Node, text: str) -> None:
        self._change(f"{text} {Path(path).name}", (*self._entry(path), node))

    def _change(self, text: str, *entries: tuple[Node, str, Node | None]) -> None:
        for folder, name, node in entries:
            if node is None:
                del self._names[folder, name]
            else:
                self._names[folder, name] = node
        self._add(Names(entries), text)

    def _node_of(self, pid: int, descriptor: int) -> Node | None:
        """The node of a descriptor; None if it is not of the folder."""
        path = f"/proc/{pid}/fd/{descriptor}"
        try:
            target = str(Path(path).readlink())
        except OSError:
            return None
        if target != self._folder and not self._is_ours(target):
            return None
        return self._by_inode[os.stat(path).st_ino]  # noqa: PTH116 - of another process


def _play(scenario: Callable[[], object]) -> NoReturn:
    code = 1
    try:
        os.setpgid(0, 0)
        _ptrace(TRACEME, 0)
        os.kill(os.getpid(), signal.SIGSTOP)
        scenario()
        code = 0
    except BaseException:  # noqa: BLE001 - a fork must not go on as a copy of its parent
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _signed(argument: int) -> int:
    return ctypes.c_int32(argument & 0xFFFFFFFF).value


def _memory(pid: int, address: int, count: int) -> bytes:
    with open(f"/proc/{pid}/mem", "rb", buffering=0) as memory:  # noqa: PTH123
        return os.pread(memory.fileno(), count, address)


def _path(pid: int, folder: int, address: int) -> str:
    text = b""
    while b"\0" not in text:
        # To the end of a page: the next one may not be there.
        count = 4096 - (address + len(text)) % 4096
        text += _memory(pid, address + len(text), count)
    path = os.fsdecode(text.partition(b"\0")[0])
    at = f"/proc/{pid}/cwd" if folder == AT_FDCWD else f"/proc/{pid}/fd/{folder}"
    return os.path.normpath(path if path.startswith("/") else f"{Path(at).readlink()}/{path}")


def _position(pid: int, descriptor: int) -> int:
    with open(f"/proc/{pid}/fdinfo/{descriptor}") as file:  # noqa: PTH123
        return int(file.readline().split()[1])


def _content(descriptor: int) -> bytes:
    return os.pread(descriptor, os.fstat(descriptor).st_size, 0)
