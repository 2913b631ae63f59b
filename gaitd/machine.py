"""What a machine can do for gaitd: each check reads one fact and says what it means.

A check of the system takes the root of its file system, so that its reading of /proc and /sys can
be tested. Nothing is changed but, for a moment, our own scheduling class.
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
from enum import Enum
from pathlib import Path
from typing import Final, NamedTuple

REALTIME_PRIORITY: Final = 60
CAN_INTERFACE_TYPE: Final = "280"
"""ARPHRD_CAN, as /sys/class/net/*/type says it."""
QUEUE_LENGTH_MIN: Final = 32
"""Frames. A cycle of one leg sends seven at once; two legs and a bring-up need some air."""
MEMLOCK_MIN_MB: Final = 256
WAKEUPS: Final = 200
WAKEUP_GOOD_MS: Final = 0.5
SLOW_CLOCKS: Final = frozenset({"hpet", "acpi_pm", "jiffies", "refined-jiffies"})
SYSTEMD_MIN: Final = 252
IMPORTS: Final = {
    "python-can": "can",
    "python-can-remote": "can_remote",
    "canopen": "canopen",
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "eclipse-zenoh": "zenoh",
    "msgspec": "msgspec",
    "typer": "typer",
    "rich": "rich",
    "plotext": "plotext",
    "matplotlib": "matplotlib",
}


class Grade(Enum):
    """How a fact serves us."""

    GOOD = "good"
    LIMITED = "limited"
    """Works with the limit that is said: fine for a desk, not with a person in the machine."""
    MISSING = "missing"
    """What needs it does not work here; the rest does."""
    BROKEN = "broken"
    """Nothing works until this is mended."""


class Finding(NamedTuple):
    """One fact, what it means, and what to do about it."""

    subject: str
    found: str
    grade: Grade
    remedy: str = ""


def _read(path: Path) -> str:
    """The text of a small file of the kernel; empty where there is none to read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def python() -> Finding:
    """Version, and whether assertions are on: they guard our own invariants."""
    found = f"{platform.python_implementation()} {platform.python_version()}"
    if sys.version_info < (3, 11) or platform.python_implementation() != "CPython":
        return Finding("python", found, Grade.BROKEN, "use CPython 3.11 or newer")
    if sys.flags.optimize:
        return Finding("python", found + " -O", Grade.BROKEN, "never run with -O: it drops asserts")
    return Finding("python", found, Grade.GOOD)


def packages() -> Finding:
    """Every dependency is installed and can be imported; a wheel may not fit the machine."""
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
    """The middleware's version: measured behaviour is that of 1.10."""
    try:
        version = importlib.metadata.version("eclipse-zenoh")
    except importlib.metadata.PackageNotFoundError:
        return Finding("zenoh", "not installed", Grade.BROKEN, "install requirements/run.txt")
    grade = Grade.GOOD if version.startswith("1.10.") else Grade.BROKEN
    return Finding("zenoh", version, grade, "" if grade is Grade.GOOD else "install 1.10")


def kernel(root: Path) -> Finding:
    """Release, and whether it preempts for real-time tasks."""
    flavour = _read(root / "proc/version")
    found = _read(root / "proc/sys/kernel/osrelease") or platform.release()
    if _read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in flavour:
        return Finding("kernel", f"{found}, PREEMPT_RT", Grade.GOOD)
    remedy = "for a machine with a person in it, run a PREEMPT_RT kernel (linux-image-rt-amd64)"
    return Finding("kernel", f"{found}, without PREEMPT_RT", Grade.LIMITED, remedy)


def scheduling() -> Finding:
    """Whether this user may run the core with SCHED_FIFO, tried for a moment."""
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


def throttling(root: Path) -> Finding:
    """How much of a second the kernel leaves to real-time tasks."""
    runtime = _read(root / "proc/sys/kernel/sched_rt_runtime_us")
    if runtime == "0":
        remedy = "sysctl kernel.sched_rt_runtime_us=950000"
        return Finding("RT throttling", "no real-time at all", Grade.LIMITED, remedy)
    return Finding("RT throttling", f"{runtime or 'unknown'} µs of each second", Grade.GOOD)


def memory_lock() -> Finding:
    """Whether the core may keep its pages from being swapped out."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if limit == resource.RLIM_INFINITY or os.geteuid() == 0:
        return Finding("memory lock", "unlimited", Grade.GOOD)
    found = f"{limit / 2**20:.0f} MB"
    if limit >= MEMLOCK_MIN_MB * 2**20:
        return Finding("memory lock", found, Grade.GOOD)
    return Finding("memory lock", found, Grade.LIMITED, "LimitMEMLOCK=infinity in the unit")


def cores() -> Finding:
    """Core and gateway, and the virtual drives on a desk, each want one to themselves."""
    count = len(os.sched_getaffinity(0))
    if count >= 2:
        return Finding("processors", f"{count} to run on", Grade.GOOD)
    return Finding("processors", "1 to run on", Grade.LIMITED, "the demo may come late; use two")


def clock_source(root: Path) -> Finding:
    """A slow clock source costs a microsecond at every look at the time."""
    folder = root / "sys/devices/system/clocksource/clocksource0"
    found = _read(folder / "current_clocksource") or "unknown"
    if found in SLOW_CLOCKS:
        remedy = f"boot with clocksource=tsc ({_read(folder / 'available_clocksource')} are there)"
        return Finding("clock source", found, Grade.LIMITED, remedy)
    return Finding("clock source", found, Grade.GOOD)


def governor(root: Path) -> Finding:
    """A governor that saves power wakes late."""
    files = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"))
    governors = sorted({_read(file) for file in files})
    if not governors:
        return Finding("CPU governor", "none: the frequency is not ours to set", Grade.GOOD)
    found = ", ".join(governors)
    if governors == ["performance"]:
        return Finding("CPU governor", found, Grade.GOOD)
    return Finding("CPU governor", found, Grade.LIMITED, "cpupower frequency-set -g performance")


def wake_up() -> Finding:
    """How late a sleeping thread wakes up here, measured without any real-time class."""
    late_ms: list[float] = []
    for _ in range(WAKEUPS):
        due = time.monotonic_ns() + 1_000_000
        time.sleep(0.001)
        late_ms.append((time.monotonic_ns() - due) / 1e6)
    late_ms.sort()
    median, worst = statistics.median(late_ms), late_ms[-1]
    found = f"{median:.2f} ms late at the median, {worst:.2f} ms at worst of {WAKEUPS}"
    if median < WAKEUP_GOOD_MS:
        return Finding("wake-up", found, Grade.GOOD)
    return Finding("wake-up", found, Grade.LIMITED, "something else runs here; SCHED_FIFO helps")


def socket_can() -> Finding:
    """Whether the kernel has AF_CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        remedy = "modprobe can-raw; without it use the loopback bus (configs/demo.toml)"
        return Finding("SocketCAN", f"no ({error.strerror})", Grade.MISSING, remedy)
    return Finding("SocketCAN", "yes", Grade.GOOD)


def can_interfaces(root: Path) -> Finding:
    """Interfaces of type CAN, whether they are up, and how many frames they queue."""
    interfaces = [
        path.parent
        for path in sorted(root.glob("sys/class/net/*/type"))
        if _read(path) == CAN_INTERFACE_TYPE
    ]
    if not interfaces:
        remedy = "ip link add dev vcan0 type vcan; ip link set vcan0 up"
        return Finding("CAN interfaces", "none", Grade.MISSING, remedy)
    said: list[str] = []
    remedies: list[str] = []
    for interface in interfaces:
        queue = int(_read(interface / "tx_queue_len") or 0)
        up = int(_read(interface / "flags") or "0", 16) & 1
        said.append(f"{interface.name} {'up' if up else 'down'}, queue of {queue}")
        if not up:
            remedies.append(f"ip link set {interface.name} up")
        if queue < QUEUE_LENGTH_MIN:
            remedies.append(f"ip link set {interface.name} txqueuelen {QUEUE_LENGTH_MIN * 4}")
    grade = Grade.LIMITED if remedies else Grade.GOOD
    return Finding("CAN interfaces", "; ".join(said), grade, "; ".join(remedies))


def tmpfs(root: Path) -> Finding:
    """A tmpfs for the seam: on a disk, the ring of records would be written to it for ever."""
    mounts = [line.split() for line in _read(root / "proc/mounts").splitlines()]
    places = [fields[1] for fields in mounts if len(fields) > 2 and fields[2] == "tmpfs"]
    usable = [place for place in ("/run", "/dev/shm", "/tmp") if place in places]
    if not usable:
        remedy = "mount a tmpfs and name it in [paths] runtime"
        return Finding("tmpfs", "none of /run, /dev/shm, /tmp", Grade.LIMITED, remedy)
    return Finding("tmpfs", ", ".join(usable), Grade.GOOD)


def numba_cache() -> Finding:
    """Where compiled kernels are kept; without a place every start compiles for a minute."""
    told = os.environ.get("NUMBA_CACHE_DIR", "")
    place = Path(told) if told else Path.home() / ".cache"
    while not place.exists() and place != place.parent:
        place = place.parent
    if os.access(place, os.W_OK | os.X_OK):
        return Finding("numba cache", told or "~/.cache", Grade.GOOD)
    remedy = "CacheDirectory= and NUMBA_CACHE_DIR in the unit"
    return Finding("numba cache", f"{place} cannot be written", Grade.LIMITED, remedy)


def systemd(root: Path) -> Finding:
    """The version of systemd, and whether it runs this machine."""
    if not shutil.which("systemctl"):
        return Finding("systemd", "none", Grade.MISSING, "use `gaitd run` under your supervisor")
    said = subprocess.run(
        ["systemctl", "--version"], capture_output=True, text=True, check=False
    ).stdout.split()
    version = int(said[1]) if len(said) > 1 and said[1].isdigit() else 0
    if _read(root / "proc/1/comm") != "systemd":
        remedy = "not needed: `gaitd run` starts both halves"
        return Finding("systemd", f"{version}, not the first process", Grade.MISSING, remedy)
    grade = Grade.GOOD if version >= SYSTEMD_MIN else Grade.LIMITED
    return Finding("systemd", str(version), grade, "" if grade is Grade.GOOD else "252 or newer")


def compiler() -> Finding:
    """Only `gaitd bench` wants one, for its anchor in C."""
    found = shutil.which("cc") or shutil.which("gcc")
    if not found:
        return Finding(
            "C compiler", "none", Grade.MISSING, "apt-get install gcc, for `gaitd bench`"
        )
    return Finding("C compiler", Path(found).name, Grade.GOOD)


def findings(root: Path = Path("/")) -> tuple[Finding, ...]:
    """All checks, in the order they are printed."""
    return (
        python(),
        packages(),
        zenoh(),
        numba_cache(),
        kernel(root),
        scheduling(),
        throttling(root),
        memory_lock(),
        cores(),
        clock_source(root),
        governor(root),
        wake_up(),
        socket_can(),
        can_interfaces(root),
        tmpfs(root),
        systemd(root),
        compiler(),
    )
