"""Evaluation of a survey: stations, the configuration's drives among them, and errors.

Pure. Every finding has a kind for programs and a text for the operator. Kinds in WRONG mean that
the machine of the configuration cannot work as it is; the others are for information.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from drives.canopen.bus_state import BusCondition
from drives.canopen.emcy import decode_emergency
from drives.canopen.nmt import NMT_ID, SYNC_ID
from drives.canopen.sniffer import NodeTraffic
from drives.cia402.profile import DriveDescription
from drives.service.scan import DRIVE_PROFILE, Survey
from drives.service.stations import Expected, Station, member_text, station
from drives.signals import NmtState


class FindingKind(Enum):
    """Subject of a finding."""

    MISSING = "expected drive is missing"
    OTHER_DEVICE = "another device than the files describe"
    DUPLICATE_NODE = "node id is used twice"
    NO_ACKNOWLEDGE = "frames are not acknowledged"
    BUS_OFF = "controller was bus-off"
    SILENT_NODE = "sends, but does not answer"
    FELL_SILENT = "stopped answering"
    BUS_ERRORS = "controller reports errors"
    SERVICE = "a service runs"
    FOREIGN_MASTER = "another master is active"
    SDO_CLIENT = "another SDO client is active"
    EMERGENCY = "emergency message"
    ERROR_PENDING = "error pending"
    BOOTED = "booted during the scan"
    UNEXPLAINED = "frames without a known sender"


WRONG: Final = frozenset(
    (
        FindingKind.MISSING,
        FindingKind.OTHER_DEVICE,
        FindingKind.DUPLICATE_NODE,
        FindingKind.FELL_SILENT,
        FindingKind.NO_ACKNOWLEDGE,
        FindingKind.BUS_OFF,
    )
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact to report."""

    kind: FindingKind
    text: str
    node_id: int | None = None
    drive: str = ""


@dataclass(frozen=True, slots=True)
class Inventory:
    """Result of a scan."""

    stations: tuple[Station, ...]
    findings: tuple[Finding, ...]

    @property
    def is_wrong(self) -> bool:
        """True if the machine cannot work as it is."""
        return any(finding.kind in WRONG for finding in self.findings)


def inventory_of(survey: Survey, expected: Expected) -> Inventory:
    """List stations and findings, each in order of node ids; findings of the bus come first."""
    nodes = sorted(
        node_id
        for node_id, traffic in survey.sniffer.nodes.items()
        if _is_there(traffic) and (node_id != expected.master_node_id or traffic.answered)
    )
    stations = tuple(station(node_id, survey, expected) for node_id in nodes)
    findings = (
        *_of_the_controller(survey),
        *_of_masters(survey, expected),
        *(finding for one in stations for finding in _of_station(one, survey, expected)),
        *_missing(stations, expected),
        *_unknown_traffic(survey, nodes, expected),
    )
    return Inventory(stations, findings)


def _is_there(traffic: NodeTraffic) -> bool:
    return (
        traffic.answered or traffic.watch.state is not NmtState.UNKNOWN or bool(traffic.emergencies)
    )


# --- findings -------------------------------------------------------------------------------------


def _of_the_controller(survey: Survey) -> Iterator[Finding]:
    state = survey.sniffer.bus_state
    if state.bus_off_count:
        yield Finding(FindingKind.BUS_OFF, "the controller was bus-off: wiring, bit rate?")
    elif survey.not_queried and survey.sniffer.is_silent:
        remedy = "drives without power, a cable, a terminator, another bit rate?"
        yield Finding(FindingKind.NO_ACKNOWLEDGE, f"no node acknowledges our frames: {remedy}")
    elif survey.not_queried:
        text = (
            f"the transmit queue stays full: nodes from {min(survey.not_queried)} were not queried"
        )
        yield Finding(FindingKind.NO_ACKNOWLEDGE, text)
    elif state.condition is not BusCondition.ACTIVE:
        text = f"the controller is {state.condition.value}: frames get damaged on this bus"
        yield Finding(FindingKind.BUS_ERRORS, text)
    if state.overflow_count:
        text = f"the controller lost frames {state.overflow_count} times"
        yield Finding(FindingKind.BUS_ERRORS, text)


def _of_masters(survey: Survey, expected: Expected) -> Iterator[Finding]:
    sniffer, master = survey.sniffer, expected.master_node_id
    traffic = None if master is None else sniffer.nodes.get(master)
    if traffic is not None and traffic.heartbeat_count:
        state = member_text(traffic.watch.state.name)
        text = f"a service runs: heartbeat of the master ({state}), SYNC {sniffer.sync_count} times"
        yield Finding(FindingKind.SERVICE, text, master)
    elif sniffer.sync_count:
        owner = "a master is at work" if master is None else f"and no heartbeat of node {master}"
        text = f"SYNC {sniffer.sync_count} times: {owner}"
        yield Finding(FindingKind.FOREIGN_MASTER, text)
    if traffic is not None and traffic.answered:
        text = "a device answers with the master's node id"
        yield Finding(FindingKind.DUPLICATE_NODE, text, master)
    if sniffer.nmt_count:
        text = f"another node sent {sniffer.nmt_count} NMT commands"
        yield Finding(FindingKind.FOREIGN_MASTER, text)


def _of_station(station: Station, survey: Survey, expected: Expected) -> Iterator[Finding]:
    node_id, name = station.node_id, station.drive
    traffic, drive = survey.sniffer.node(node_id), expected.drive(node_id)
    for kind, text in (
        *_of_presence(station, survey, traffic, drive),
        *_of_errors(station, traffic, expected),
    ):
        yield Finding(kind, text, node_id, name)
    if drive is not None and station.answers and node_id not in survey.fell_silent:
        yield from _of_identity(station, drive)


def _of_presence(
    station: Station, survey: Survey, traffic: NodeTraffic, drive: DriveDescription | None
) -> Iterator[tuple[FindingKind, str]]:
    if traffic.answered_twice:
        yield FindingKind.DUPLICATE_NODE, "two answers to one request: two devices with one id"
    if not traffic.answered and not survey.not_queried:
        text = f"sends ({station.nmt_state}), but does not answer"
        if traffic.watch.state is NmtState.STOPPED:
            text += ": no SDO in STOPPED"
        elif not station.drive:
            text += ": a master?"
        yield FindingKind.SILENT_NODE, text
    if station.node_id in survey.fell_silent:
        yield FindingKind.FELL_SILENT, "stopped answering during the scan"
    of_service = None if drive is None else drive.profile.uploaded_in_cycle
    if other_count := traffic.foreign_count_besides(of_service):
        text = f"another client sent it {other_count} SDO requests"
        yield FindingKind.SDO_CLIENT, text
    if traffic.watch.boot_up_count:
        text = f"booted {traffic.watch.boot_up_count} times during the scan"
        yield FindingKind.BOOTED, text
    if traffic.watch.strange_count:
        text = (
            f"{traffic.watch.strange_count} malformed frames with the identifier of its heartbeat"
        )
        yield FindingKind.UNEXPLAINED, text


def _of_errors(
    station: Station, traffic: NodeTraffic, expected: Expected
) -> Iterator[tuple[FindingKind, str]]:
    if station.error_code:
        text = f"error code {station.error_code:04X}h pending: {station.error_text}"
        yield FindingKind.ERROR_PENDING, text
    elif station.error_register:
        yield FindingKind.ERROR_PENDING, f"error register {station.error_register:02X}h, no code"
    codes = expected.error_codes(station.node_id)
    for data in traffic.emergencies:
        emergency = decode_emergency(data, station.node_id, codes, 0)
        if emergency is None:
            yield FindingKind.UNEXPLAINED, f"an EMCY of {len(data)} bytes"
        elif emergency.code:
            text = f"EMCY {emergency.code:04X}h during the scan: {emergency.text}"
            yield FindingKind.EMERGENCY, text


def _of_identity(station: Station, drive: DriveDescription) -> Iterator[Finding]:
    identity = drive.axis.identity
    pairs = (
        ("device profile", station.profile_number, DRIVE_PROFILE, "d"),
        ("vendor", station.vendor_id, identity.vendor_id, "08X"),
        ("product", station.product_code, identity.product_code, "08X"),
        ("revision", station.revision, identity.revision, "08X"),
        ("serial number", station.serial, identity.serial, "d"),
    )
    for what, found, wanted, style in pairs:
        if wanted is None or found == wanted:
            continue
        suffix = "h" if style == "08X" else ""
        has = "none" if found is None else f"{found:{style}}{suffix}"
        text = f"{what} is {has}, its axis file says {wanted:{style}}{suffix}"
        yield Finding(FindingKind.OTHER_DEVICE, text, drive.node_id, drive.name)


def _missing(stations: Sequence[Station], expected: Expected) -> Iterator[Finding]:
    answering = {station.node_id for station in stations if station.answers}
    for drive in expected.drives:
        if drive.node_id not in answering:
            text = f"no answer from node {drive.node_id}{_elsewhere(drive, stations)}"
            yield Finding(FindingKind.MISSING, text, drive.node_id, drive.name)


def _elsewhere(drive: DriveDescription, stations: Sequence[Station]) -> str:
    """Name a device of the same kind at an unconfigured node id, which may be the drive."""
    identity = drive.axis.identity
    same = [
        str(station.node_id)
        for station in stations
        if not station.drive
        and (station.vendor_id, station.product_code) == (identity.vendor_id, identity.product_code)
    ]
    return f"; such a device is at node {' and '.join(same)}" if same else ""


# --- frames without a known sender ----------------------------------------------------------------

_TIME_ID: Final = 0x100
_LSS_IDS: Final = frozenset((0x7E4, 0x7E5))
_OF_ALL: Final = frozenset((NMT_ID, SYNC_ID, _TIME_ID)) | _LSS_IDS
_FIRST_PDO: Final = 0x180
_LAST_PDO: Final = 0x57F
_NODE: Final = 0x07F


def _unknown_traffic(survey: Survey, nodes: Sequence[int], expected: Expected) -> Iterator[Finding]:
    known = {*nodes, *(drive.node_id for drive in expected.drives)}
    for can_id, count in sorted(survey.sniffer.received_count.items()):
        owner = can_id & _NODE
        if can_id in _OF_ALL or _is_service(can_id):
            continue
        if not _FIRST_PDO < can_id <= _LAST_PDO:
            text = f"{count} frames {can_id:03X}h: not an identifier of CANopen"
        elif owner not in known:
            text = f"{count} frames {can_id:03X}h: a PDO of node {owner}, which does not exist"
        else:
            continue
        yield Finding(FindingKind.UNEXPLAINED, text)
    for node_id, traffic in sorted(survey.sniffer.nodes.items()):
        if traffic.foreign_request_count and node_id not in nodes:
            text = f"another SDO client queries node {node_id}, which does not exist"
            yield Finding(FindingKind.SDO_CLIENT, text)
    if survey.sniffer.odd_sync_count:
        text = f"{survey.sniffer.odd_sync_count} SYNC with data: with a counter (1019h)?"
        yield Finding(FindingKind.UNEXPLAINED, text)


def _is_service(can_id: int) -> bool:
    """True for EMCY, SDO and NMT error control, which are counted per node."""
    return bool(can_id & _NODE) and can_id & ~_NODE in (0x080, 0x580, 0x600, 0x700)
