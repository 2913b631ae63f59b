"""Checks of a machine's real-time behaviour: kernel, limits, processors, clocks, memory.

Each check reads small files of the kernel below `root`, so that a test can supply those of another
machine. A file that cannot be read makes the result unknown, not good.
"""

import re
from pathlib import Path
from typing import Final

from daemon.system.machine.finding import Finding, Grade, read

SLOW_CLOCKS: Final = frozenset({"hpet", "acpi_pm", "jiffies", "refined-jiffies"})
IDLE_LATENCY_MAX_US: Final = 200
"""Exit latency of the deepest usable idle state: a fiftieth of a cycle, and half of the budget."""
TIMER_RESOLUTION_MAX_NS: Final = 1_000
UNIT: Final = "gaitd-core.service"
UNIT_PLACES: Final = ("etc/systemd/system", "usr/local/lib/systemd/system", "lib/systemd/system")
PRIORITY_MIN: Final = 50
"""`realtime_priority` of the shipped configurations."""
MEMLOCK_MIN_MB: Final = 256
SIZES: Final = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


def kernel(root: Path) -> Finding:
    """Check the kernel's release, and how far real-time tasks may preempt the kernel."""
    flavour = read(root / "proc/version")
    found = read(root / "proc/sys/kernel/osrelease") or "unknown"
    if read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in flavour:
        return Finding("kernel", f"{found}, PREEMPT_RT", Grade.GOOD)
    remedy = "for a machine with a person in it, run a PREEMPT_RT kernel (linux-image-rt-amd64)"
    if "PREEMPT_DYNAMIC" not in flavour:
        return Finding("kernel", f"{found}, without PREEMPT_RT", Grade.LIMITED, remedy)
    chosen = re.search(r"\bpreempt=(\w+)", read(root / "proc/cmdline"))
    mode = chosen.group(1) if chosen else "its default"
    if mode != "full":
        remedy += "; until then boot with preempt=full"
    return Finding("kernel", f"{found}, PREEMPT_DYNAMIC, preempt={mode}", Grade.LIMITED, remedy)


def throttling(root: Path) -> Finding:
    """Check how much of each second the kernel leaves to real-time tasks."""
    runtime = read(root / "proc/sys/kernel/sched_rt_runtime_us")
    if runtime == "0":
        remedy = "sysctl kernel.sched_rt_runtime_us=950000"
        return Finding("RT throttling", "no real-time at all", Grade.LIMITED, remedy)
    if runtime == "-1":
        remedy = (
            "sysctl kernel.sched_rt_runtime_us=950000: a core that hangs would hang the machine"
        )
        return Finding("RT throttling", "off", Grade.LIMITED, remedy)
    return Finding("RT throttling", f"{runtime or 'unknown'} µs of each second", Grade.GOOD)


def unit_limits(root: Path) -> Finding:
    """Check the limits that the installed unit grants the core, independent of the current user."""
    text = _unit_text(root)
    if not text:
        remedy = "make install; not needed for `gaitd run` at a desk"
        return Finding("limits of the unit", f"no {UNIT}", Grade.MISSING, remedy)
    priority, locked = _setting(text, "LimitRTPRIO"), _setting(text, "LimitMEMLOCK")
    lacks: list[str] = []
    if not _is_enough(priority, PRIORITY_MIN):
        lacks.append(f"LimitRTPRIO={PRIORITY_MIN}")
    if not _is_enough(locked, MEMLOCK_MIN_MB * 2**20):
        lacks.append(f"LimitMEMLOCK={MEMLOCK_MIN_MB}M")
    found = f"LimitRTPRIO={priority or 'none'}, LimitMEMLOCK={locked or 'none'}"
    if not lacks:
        return Finding("limits of the unit", found, Grade.GOOD)
    remedy = f"systemctl edit {UNIT}: [Service] {' '.join(lacks)}"
    return Finding("limits of the unit", found, Grade.LIMITED, remedy)


def _unit_text(root: Path) -> str:
    """Text of the unit and its drop-ins, in the order in which later settings win."""
    for place in UNIT_PLACES:
        text = read(root / place / UNIT)
        if text:
            drop_ins = sorted((root / "etc/systemd/system" / f"{UNIT}.d").glob("*.conf"))
            return "\n".join([text, *(read(path) for path in drop_ins)])
    return ""


def _setting(text: str, name: str) -> str:
    values = re.findall(rf"^{name}=(\S*)\s*$", text, re.MULTILINE)
    return values[-1] if values else ""


def _is_enough(value: str, least: int) -> bool:
    soft = value.partition(":")[0]
    parts = re.fullmatch(r"(\d+)([KMGT]?)", soft)
    return soft == "infinity" or (
        parts is not None and int(parts.group(1)) * SIZES[parts.group(2)] >= least
    )


def clock_source(root: Path) -> Finding:
    """Check the clock source: with a slow one each reading of the time takes a microsecond."""
    folder = root / "sys/devices/system/clocksource/clocksource0"
    found = read(folder / "current_clocksource")
    if found in SLOW_CLOCKS:
        remedy = f"boot with clocksource=tsc ({read(folder / 'available_clocksource')} are there)"
        return Finding("clock source", found, Grade.LIMITED, remedy)
    if not found:
        remedy = "look into /sys/devices/system/clocksource where there is one"
        return Finding("clock source", "unknown", Grade.MISSING, remedy)
    return Finding("clock source", found, Grade.GOOD)


def time_of_day(root: Path) -> Finding:
    """Check that the time of day is right after a power cut: a clock with a battery, or NTP."""
    clocks = sorted(path.name for path in root.glob("sys/class/rtc/rtc[0-9]*"))
    if (root / "run/systemd/timesync/synchronized").exists():
        return Finding("time of day", "set by NTP", Grade.GOOD)
    if clocks:
        found = f"{', '.join(clocks)}; no NTP"
        return Finding("time of day", found, Grade.GOOD)
    remedy = (
        "add a clock with a battery: without one the computer continues with an old time after a"
        " power cut, and a daily self-test may count for too long, or not at all"
    )
    return Finding("time of day", "no clock with a battery, no NTP", Grade.LIMITED, remedy)


def timers(resolution_ns: int) -> Finding:
    """Check by the clock's resolution that a sleep can end between two ticks of the kernel."""
    if resolution_ns <= TIMER_RESOLUTION_MAX_NS:
        return Finding("timers", f"high resolution, {resolution_ns} ns", Grade.GOOD)
    found = f"only every {resolution_ns / 1e6:g} ms"
    return Finding("timers", found, Grade.LIMITED, "boot without highres=off, nohpet, notsc")


def governor(root: Path) -> Finding:
    """Check the CPU governor: one that saves power delays wake-ups."""
    files = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor"))
    governors = sorted({read(file) for file in files})
    if not governors:
        return Finding("CPU governor", "none: the frequency is not ours to set", Grade.GOOD)
    found = ", ".join(governors)
    if governors == ["performance"]:
        return Finding("CPU governor", found, Grade.GOOD)
    return Finding("CPU governor", found, Grade.LIMITED, "cpupower frequency-set -g performance")


def idle_states(root: Path) -> Finding:
    """Check the wake-up latency of the deepest idle state of a processor."""
    states = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpuidle/state[0-9]*"))
    usable = [state for state in states if read(state / "disable") in {"", "0"}]
    latencies = {int(read(s / "latency") or 0): read(s / "name") for s in usable}
    if not latencies:
        return Finding("idle states", "none: not ours to set", Grade.GOOD)
    deepest = max(latencies)
    found = f"down to {latencies[deepest]}, {deepest} µs to wake up"
    if deepest <= IDLE_LATENCY_MAX_US:
        return Finding("idle states", found, Grade.GOOD)
    remedy = f"cpupower idle-set -D {IDLE_LATENCY_MAX_US}"
    return Finding("idle states", found, Grade.LIMITED, remedy)


def isolated_cores(root: Path) -> Finding:
    """Report the isolated processors, for `realtime_cpus`; useful, not required."""
    isolated = read(root / "sys/devices/system/cpu/isolated")
    if not isolated:
        return Finding("isolated processors", "none (isolcpus=N, realtime_cpus = [N])", Grade.GOOD)
    return Finding("isolated processors", f"{isolated}, for realtime_cpus", Grade.GOOD)


def swap(root: Path) -> Finding:
    """Check for swap, which may take unlocked pages: those of gateway and virtual drives."""
    places = [line.split()[0] for line in read(root / "proc/swaps").splitlines()[1:]]
    if not places:
        return Finding("swap", "none", Grade.GOOD)
    found = ", ".join(places)
    if all("zram" in place for place in places):
        return Finding("swap", f"{found}: in memory", Grade.GOOD)
    remedy = "swapoff -a and out of /etc/fstab, or MemorySwapMax=0 in the unit of the gateway"
    return Finding("swap", found, Grade.LIMITED, remedy)
