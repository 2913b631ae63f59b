"""Checks of this machine for `gaitd doctor`: each reads one fact and grades it.

A check of the operating system takes the root of its file system, so that a test can supply other
/proc and /sys files. The only change made to the machine is temporary: this process's own
scheduling class.
"""

import importlib
import importlib.metadata
import os
import platform
import resource
import shutil
import socket
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from daemon.system.machine import timing
from daemon.system.machine.can_interfaces import can_interfaces, ip_links
from daemon.system.machine.finding import Finding, Grade, read
from daemon.system.machine.timing import MEMLOCK_MIN_MB

REALTIME_PRIORITY: Final = 60
STATE: Final = Path("var/lib/gaitd")
DISK_MIN_MB: Final = 500
"""Space for the black boxes of a hundred stops, and for the request log of a year."""
WAKEUPS: Final = 200
WAKEUP_MAX_MS: Final = 4.0
"""What is left of a cycle of 10 ms: window 4 ms, computing 0.8 ms, frames of both directions."""
SYSTEMD_MIN: Final = 252
IMPORTS: Final = {
    "python-can": "can",
    "canopen": "canopen",
    "numpy": "numpy",
    "numba": "numba",
    "eclipse-zenoh": "zenoh",
    "msgspec": "msgspec",
    "typer": "typer",
    "rich": "rich",
}


def python() -> Finding:
    """Check the Python version, and that assertions are on: they guard internal invariants."""
    found = f"{platform.python_implementation()} {platform.python_version()}"
    if sys.version_info < (3, 11) or platform.python_implementation() != "CPython":
        return Finding("python", found, Grade.BROKEN, "use CPython 3.11 or newer")
    if sys.flags.optimize:
        return Finding("python", found + " -O", Grade.BROKEN, "never run with -O: it drops asserts")
    return Finding("python", found, Grade.GOOD)


def packages() -> Finding:
    """Check that every dependency can be imported: an installed wheel may not fit the machine."""
    broken: list[str] = []
    for distribution, module in IMPORTS.items():
        try:
            importlib.import_module(module)
        except (ImportError, OSError) as error:
            broken.append(f"{distribution} ({error})")
    if broken:
        remedy = "install requirements/run.txt again (`make clean demo`)"
        return Finding("packages", "; ".join(broken), Grade.BROKEN, remedy)
    return Finding("packages", f"all {len(IMPORTS)} can be imported", Grade.GOOD)


def zenoh() -> Finding:
    """Check the version of Zenoh: its behaviour was measured with 1.10."""
    try:
        version = importlib.metadata.version("eclipse-zenoh")
    except importlib.metadata.PackageNotFoundError:
        return Finding("zenoh", "not installed", Grade.BROKEN, "install requirements/run.txt")
    grade = Grade.GOOD if version.startswith("1.10.") else Grade.BROKEN
    return Finding("zenoh", version, grade, "" if grade is Grade.GOOD else "install 1.10")


def scheduling() -> Finding:
    """Check, by a short trial, that this user may run the core with SCHED_FIFO."""
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(
            0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(REALTIME_PRIORITY)
        )
    except PermissionError:
        remedy = f"LimitRTPRIO={REALTIME_PRIORITY} in the unit, or rtprio in limits.conf"
        return Finding("SCHED_FIFO", f"refused (RLIMIT_RTPRIO {limit})", Grade.LIMITED, remedy)
    os.sched_setscheduler(0, before & ~os.SCHED_RESET_ON_FORK, parameters)
    return Finding("SCHED_FIFO", f"allowed at priority {REALTIME_PRIORITY}", Grade.GOOD)


def memory_lock() -> Finding:
    """Check that the core may lock its pages in memory."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit == resource.RLIM_INFINITY or os.geteuid() == 0:
        return Finding("memory lock", "unlimited", Grade.GOOD)
    found = f"{limit / 2**20:.0f} MB"
    if limit >= MEMLOCK_MIN_MB * 2**20:
        return Finding("memory lock", found, Grade.GOOD)
    return Finding("memory lock", found, Grade.LIMITED, "LimitMEMLOCK=infinity in the unit")


def cores() -> Finding:
    """Check for two processors: core, gateway and virtual drives each want their own."""
    count = len(os.sched_getaffinity(0))
    if count >= 2:
        return Finding("processors", f"{count} to run on", Grade.GOOD)
    return Finding("processors", "1 to run on", Grade.LIMITED, "the demo may come late; use two")


def wake_up() -> Finding:
    """Measure how late a sleeping thread wakes up on this machine, without any real-time class."""
    late_ms: list[float] = []
    for _ in range(WAKEUPS):
        due = time.monotonic_ns() + 1_000_000
        time.sleep(0.001)
        late_ms.append((time.monotonic_ns() - due) / 1e6)
    late_ms.sort()
    median, worst = statistics.median(late_ms), late_ms[-1]
    found = f"{median:.2f} ms late at the median, {worst:.2f} ms at worst of {WAKEUPS}"
    if worst < WAKEUP_MAX_MS:
        return Finding("wake-up", found, Grade.GOOD)
    remedy = f"above {WAKEUP_MAX_MS:g} ms a cycle is left out; end other programs, or SCHED_FIFO"
    return Finding("wake-up", found, Grade.LIMITED, remedy)


def socket_can() -> Finding:
    """Check that the kernel has AF_CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        remedy = "modprobe can-raw; without it use the simulated bus (configs/demo.toml)"
        return Finding("SocketCAN", f"no ({error.strerror})", Grade.MISSING, remedy)
    return Finding("SocketCAN", "yes", Grade.GOOD)


def tmpfs(root: Path) -> Finding:
    """Check for a tmpfs for the IPC channel: on a disk, the ring would cause permanent writes."""
    mounts = [line.split() for line in read(root / "proc/mounts").splitlines()]
    places = [fields[1] for fields in mounts if len(fields) > 2 and fields[2] == "tmpfs"]
    usable = [place for place in ("/run", "/dev/shm", "/tmp") if place in places]
    if not usable:
        remedy = "mount a tmpfs and name it in [paths] runtime"
        return Finding("tmpfs", "none of /run, /dev/shm, /tmp", Grade.LIMITED, remedy)
    return Finding("tmpfs", ", ".join(usable), Grade.GOOD)


def numba_cache() -> Finding:
    """Check the folder of compiled kernels: without one, every start compiles for a minute."""
    named = os.environ.get("NUMBA_CACHE_DIR", "")
    place = Path(named) if named else Path.home() / ".cache"
    while not place.exists() and place != place.parent:
        place = place.parent
    if os.access(place, os.W_OK | os.X_OK):
        return Finding("numba cache", named or "~/.cache", Grade.GOOD)
    remedy = "CacheDirectory= and NUMBA_CACHE_DIR in the unit"
    return Finding("numba cache", f"{place} cannot be written", Grade.LIMITED, remedy)


def systemd(root: Path) -> Finding:
    """Check the version of systemd, and that it runs this machine."""
    if not shutil.which("systemctl"):
        return Finding("systemd", "none", Grade.MISSING, "use `gaitd run` under your supervisor")
    words = subprocess.run(
        ["systemctl", "--version"], capture_output=True, text=True, check=False
    ).stdout.split()
    version = int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
    if read(root / "proc/1/comm") != "systemd":
        remedy = "not needed: `gaitd run` starts both halves"
        return Finding("systemd", f"{version}, not the first process", Grade.MISSING, remedy)
    grade = Grade.GOOD if version >= SYSTEMD_MIN else Grade.LIMITED
    return Finding("systemd", str(version), grade, "" if grade is Grade.GOOD else "252 or newer")


def disk(root: Path) -> Finding:
    """Check the free space for black boxes, request log and state file of the installed service."""
    place = root / STATE
    while not place.exists() and place != place.parent:
        place = place.parent
    free_mb = shutil.disk_usage(place).free // 2**20
    return disk_room(place, free_mb)


def disk_room(place: Path, free_mb: int) -> Finding:
    """Grade an amount of free space; the service refuses to start on a full disk (exit code 2)."""
    found = f"{free_mb} MB free at {place}"
    if free_mb >= DISK_MIN_MB:
        return Finding("disk", found, Grade.GOOD)
    return Finding("disk", found, Grade.LIMITED, f"make room: {DISK_MIN_MB} MB are for a year")


def compiler() -> Finding:
    """Check for a C compiler; only `gaitd bench` uses one, for its C implementation."""
    found = shutil.which("cc") or shutil.which("gcc")
    if not found:
        return Finding(
            "C compiler", "none", Grade.MISSING, "apt-get install gcc, for `gaitd bench`"
        )
    return Finding("C compiler", Path(found).name, Grade.GOOD)


def findings(root: Path = Path("/")) -> tuple[Finding, ...]:
    """Run all checks, in the order in which they are printed."""
    resolution_ns = round(time.clock_getres(time.CLOCK_MONOTONIC) * 1e9)
    return (
        python(),
        packages(),
        zenoh(),
        numba_cache(),
        timing.kernel(root),
        scheduling(),
        timing.throttling(root),
        memory_lock(),
        timing.unit_limits(root),
        cores(),
        timing.isolated_cores(root),
        timing.clock_source(root),
        timing.time_of_day(root),
        timing.timers(resolution_ns),
        timing.governor(root),
        timing.idle_states(root),
        timing.swap(root),
        wake_up(),
        socket_can(),
        can_interfaces(ip_links()),
        tmpfs(root),
        disk(root),
        systemd(root),
        compiler(),
    )
