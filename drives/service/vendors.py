"""Names of vendor ids (1018h:01), which CAN in Automation assigns.

Only ids with a source. Sources: EDS and DCF files of EPOS4 (repository YamamotoSoya/
maxon_epos4compact50-5can_ros2), Elmo Gold (ipa320/cob_robots) and Faulhaber (KITmedical/kacanopen);
Beckhoff's object reference (1018:01 of AX8000); Moog's DS2100 manual, page 246; the others from
etg.c of Glowbuzzer's EtherCAT master, since vendors use one id on both buses.
"""

from typing import Final

VENDORS: Final = {
    0x02: "Beckhoff",
    0x1D: "Festo",
    0x24: "Bosch Rexroth",
    0x28: "Moog",
    0x3B: "Lenze",
    0x59: "SEW-Eurodrive",
    0x6A: "Kollmorgen",
    0x83: "Omron",
    0x9A: "Elmo",
    0xAB: "Copley Controls",
    0xBD: "Advanced Motion Controls",
    0xFB: "maxon",
    0x117: "JVL",
    0x147: "Faulhaber",
    0x1DD: "Delta Electronics",
    0x247: "Harmonic Drive",
    0x26C: "Nanotec",
    0x286: "Trinamic",
    0x2BE: "Oriental Motor",
    0x404: "Applied Motion Products",
    0x22D2: "Synapticon",
    0x0800_005A: "Schneider Electric",
}


def vendor_name(vendor_id: int) -> str:
    """The vendor's name, or an empty string where it is unknown."""
    return VENDORS.get(vendor_id, "")
