"""CAN interfaces of a machine, from `ip -details -json link show type can` and `type vcan`.

A CAN controller needs its bit rate before it is up. It should restart by itself after bus-off,
which enables no drive. Its queue must hold the frames that a bring-up and two legs send at once.
"""

import json
import subprocess
from typing import Any, Final

from daemon.system.machine.finding import Finding, Grade

SUBJECT: Final = "CAN interfaces"
QUEUE_LENGTH_MIN: Final = 32
"""Frames. A cycle of one leg sends seven at once; two legs and a bring-up need a margin."""
WELL: Final = frozenset({"ERROR-ACTIVE", ""})
"""Good states of a controller; a virtual interface has none."""
BIT_RATE: Final = 1_000_000
RESTART_MS: Final = 100


def ip_links() -> str:
    """Output of `ip` for all CAN interfaces, as JSON; empty if there is no `ip`."""
    found: list[Any] = []
    for kind in ("can", "vcan"):
        command = ["ip", "-details", "-json", "link", "show", "type", kind]
        try:
            output = subprocess.run(command, capture_output=True, text=True, check=False).stdout
        except FileNotFoundError:
            return ""
        found += _links(output)
    return json.dumps(found)


def can_interfaces(ip_json: str) -> Finding:
    """Check the CAN interfaces: whether they are up, their bit rate, state, restart and queue."""
    links = _links(ip_json)
    if not ip_json:
        return Finding(SUBJECT, "unknown: no `ip`", Grade.MISSING, "apt-get install iproute2")
    if not links:
        remedy = "ip link add dev vcan0 type vcan; ip link set vcan0 up"
        return Finding(SUBJECT, "none", Grade.MISSING, remedy)
    found = "; ".join(_described(link) for link in links)
    remedies = [command for link in links for command in _remedies(link)]
    grade = Grade.LIMITED if remedies else Grade.GOOD
    return Finding(SUBJECT, found, grade, "; ".join(remedies))


def _links(text: str) -> list[Any]:
    """Entries that are interfaces; `ip` prints empty entries for interfaces of another type."""
    try:
        return [link for link in json.loads(text or "[]") if link]
    except json.JSONDecodeError:
        return []


def _is_up(link: dict[str, Any]) -> bool:
    return "UP" in link.get("flags", ())


def _controller(link: dict[str, Any]) -> dict[str, Any]:
    """Controller settings of a real CAN interface; empty for vcan."""
    info = link.get("linkinfo", {})
    return info.get("info_data", {}) if info.get("info_kind") == "can" else {}


def _is_virtual(link: dict[str, Any]) -> bool:
    return link.get("linkinfo", {}).get("info_kind") == "vcan"


def _bit_rate(link: dict[str, Any]) -> int:
    return int(_controller(link).get("bittiming", {}).get("bitrate", 0))


def _described(link: dict[str, Any]) -> str:
    words = [f"{link['ifname']} {'up' if _is_up(link) else 'down'}"]
    if not _is_virtual(link):
        rate, controller = _bit_rate(link), _controller(link)
        words.append(f"{rate} bit/s" if rate else "no bit rate")
        words.append(f"restart after {controller.get('restart_ms', 0)} ms")
        words += [state for state in (controller.get("state", ""),) if _is_up(link)]
    words.append(f"queue of {link.get('txqlen', 0)}")
    return ", ".join(words)


def _remedies(link: dict[str, Any]) -> list[str]:
    name, controller = link["ifname"], _controller(link)
    commands: list[str] = []
    if not _is_virtual(link) and not (_bit_rate(link) and controller.get("restart_ms")):
        rate = _bit_rate(link) or BIT_RATE
        down = f"ip link set {name} down; " if _is_up(link) else ""
        wanted = f"type can bitrate {rate} restart-ms {RESTART_MS}"
        commands.append(f"{down}ip link set {name} {wanted}; ip link set {name} up")
    elif not _is_up(link):
        commands.append(f"ip link set {name} up")
    if link.get("txqlen", 0) < QUEUE_LENGTH_MIN:
        commands.append(f"ip link set {name} txqueuelen {QUEUE_LENGTH_MIN * 4}")
    if _is_up(link) and controller.get("state", "") not in WELL:
        commands.append(f"{name} is {controller['state']}: cable, termination, bit rate, power")
    return commands
