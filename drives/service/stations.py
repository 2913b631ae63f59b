"""Description of a node from its traffic and its objects: names, numbers and text. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from drives.canopen.emcy_codes import STANDARD, Codes, meaning
from drives.cia402.power_state import decode_statusword
from drives.cia402.profile import DriveDescription
from drives.service import scan
from drives.service.scan import Survey
from drives.service.vendors import vendor_name

ANY_VENDOR: Final = "any"
"""A profile's vendor that stands for every drive of a standard."""


@dataclass(frozen=True, slots=True)
class Station:
    """One node that sent frames or answered. None and "" mean unknown."""

    node_id: int
    drive: str
    """The configuration's drive with this node id, or an empty string."""
    nmt_state: str
    """State from received heartbeats and boot-ups; `unknown` without any."""
    answers: bool
    """True if it answers SDO requests."""
    device_type: int | None
    profile_number: int | None
    vendor_id: int | None
    vendor: str
    product_code: int | None
    revision: int | None
    serial: int | None
    device_name: str
    hardware_version: str
    software_version: str
    power_state: str
    error_register: int | None
    error_code: int | None
    error_text: str
    fitting_profile: str
    """Profile for drives of this kind; with a question mark where only the vendor matches."""


class ProfileFile(NamedTuple):
    """The drives that a profile is for."""

    name: str
    vendor: str
    family: str


class Expected(NamedTuple):
    """The configuration's bus; empty without a configuration."""

    drives: tuple[DriveDescription, ...] = ()
    master_node_id: int | None = None
    profiles: tuple[ProfileFile, ...] = ()

    def drive(self, node_id: int) -> DriveDescription | None:
        """The drive configured for a node id."""
        return next((drive for drive in self.drives if drive.node_id == node_id), None)

    def error_codes(self, node_id: int) -> Codes:
        """The error codes of a node's maker."""
        drive = self.drive(node_id)
        return STANDARD if drive is None else drive.profile.emergency_codes


def station(node_id: int, survey: Survey, expected: Expected) -> Station:
    """Describe one node of a survey."""
    traffic = survey.sniffer.node(node_id)
    objects = survey.objects.get(node_id, {})
    number = {place: int.from_bytes(data, "little") for place, data in objects.items()}
    device_type, vendor_id = number.get(scan.DEVICE_TYPE), number.get(scan.VENDOR)
    statusword, error_code = number.get(scan.STATUSWORD), number.get(scan.ERROR_CODE)
    name = _text(objects.get(scan.DEVICE_NAME))
    vendor = "" if vendor_id is None else vendor_name(vendor_id)
    profile_number = None if device_type is None else device_type & 0xFFFF
    drive = expected.drive(node_id)
    return Station(
        node_id=node_id,
        drive="" if drive is None else drive.name,
        nmt_state=member_text(traffic.watch.state.name),
        answers=traffic.answered,
        device_type=device_type,
        profile_number=profile_number,
        vendor_id=vendor_id,
        vendor=vendor,
        product_code=number.get(scan.PRODUCT),
        revision=number.get(scan.REVISION),
        serial=number.get(scan.SERIAL),
        device_name=name,
        hardware_version=_text(objects.get(scan.HARDWARE_VERSION)),
        software_version=_text(objects.get(scan.SOFTWARE_VERSION)),
        power_state="" if statusword is None else member_text(decode_statusword(statusword).name),
        error_register=number.get(scan.ERROR_REGISTER),
        error_code=error_code,
        error_text=meaning(error_code, expected.error_codes(node_id)).text if error_code else "",
        fitting_profile=fitting_profile(vendor, name, profile_number, expected.profiles),
    )


def fitting_profile(
    vendor: str, device_name: str, profile_number: int | None, profiles: Sequence[ProfileFile]
) -> str:
    """Profile for a device, by vendor and name; `NAME?` where the name does not match."""
    if profile_number != scan.DRIVE_PROFILE:
        return ""
    words = device_name.casefold()
    of_vendor = [
        file for file in profiles if vendor and file.vendor.casefold() in vendor.casefold()
    ]
    for file in of_vendor:
        if file.family.casefold() in words:
            return file.name
    general = [file for file in profiles if file.vendor == ANY_VENDOR]
    return next((f"{file.name}?" for file in (*of_vendor, *general)), "")


def _text(data: bytes | None) -> str:
    text = "" if data is None else data.split(b"\0")[0].decode("latin-1")
    return "".join(letter if letter.isprintable() else "?" for letter in text).strip()


def member_text(name: str) -> str:
    """Name of an enum's member as text."""
    return name.lower().replace("_", " ")
