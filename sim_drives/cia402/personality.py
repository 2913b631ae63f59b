"""Differences between the makes of virtual drive, where CiA 402 leaves the choice open.

| | EPOS4-like | Elmo-like | plain CiA 402 |
|---|---|---|---|
| 6071h, 6072h, 6077h | per mille of 6076h | per mille of 6075h | per mille of 6076h |
| 6076h | µN·m, 3001h:01 x 3001h:05 | mN·m, unused as a reference | mN·m |
| current actual | 30D1h:02 in mA | 6078h, per mille of 6075h | 6078h, per mille of 6075h |
| torque limit | 3001h:02 in mA | 6072h, 6073h in per mille | 6072h, 6073h in per mille |
| speeds, decelerations | rpm, rpm/s of the motor | counts/s, counts/s² | counts/s, counts/s² |
| configurable units | none | 607Eh, 608Fh, 6091h, 6092h | none |
| home reads | 30B0h | 607Ch | 607Ch |
| mode at power-on | 1: holds | none | none |
| temperature | 3201h:01, 0.1 °C | 22A2h, °C | 2100h:01, °C |
| 0Fh in ready to switch on | transitions 3 and 4 | 3; 4 by the next 0Fh | 3; 4 by the next 0Fh |
| an invalid controlword | ignored | 06090030, EMCY 6300h, bit 7 | ignored |
| update of 6041h | at once | every 3 ms | at once |
| lost connection, 6007h | slow-down, then Fault | its command; 1: Fault | as Elmo |
| end of 8130h, 8120h | by NMT reset communication | when the heartbeat is back | as Elmo |
| COB-ID of a valid PDO | locked: 06010000 | if it stays valid: 06090030 | as Elmo |
| error register | the class's bit alone | bit 0 beside the class's | as Elmo |
| STO | 8A88h | 5441h | 9000h, external error |
| 60FDh bit 3, interlock | always 0 | always 0 | STO not released |
| quick stop, 605Ah | 6 | 0 to 8 | 0 to 8 |
| halt, 605Dh | none: slow ramp | 1, 2 | 1 to 4 |
| fault reaction, 605Eh | 0 to 2 | 0 to 2 | 0 to 4 |
| CSP without a new target | 8250h after 1.5 times 60C2h | goes on | goes on |
| 60C2h = 0 | steps of 0.4 ms | 06090032 | a step |

605Bh and 605Ch are 0 and 1, 6007h 0 to 3, 1029h 0 to 2 everywhere; any other code is 06090030.
Defaults and absent objects stand in the EDS files alone. An EPOS4 has 605Dh from firmware 0180h on;
the one here is 0170h.

Sources: EPOS4 application facts as collected from public EDS/DCF files and manuals. Elmo: public
device configuration ipa320/cob_robots, Elmo.dcf, for objects, limits and identity; per mille of the
rated current as in leggedrobotics/elmo_ethercat_sdk; EMCY codes as leducp/KickCAT lists them
(5441h is its code of an open inhibit input, taken for the STO here).
CiA 402-2.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final

from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.dictionary import Address, ObjectDictionary, Value
from sim_drives.canopen.objects import Object
from sim_drives.canopen.timers import MILLISECOND
from sim_drives.cia402.power_state import (
    DISABLE_OPTION,
    FAULT_REACTION_OPTION,
    HALT_OPTION,
    QUICK_STOP_OPTION,
    AbortConnection,
)
from sim_drives.settings import DriveSettings, EncoderKind, PersonalityName


class SpeedUnit(Enum):
    """Unit of 606Ch and 6080h; 6084h and 6085h use the same per second. All refer to the motor."""

    RPM = "rpm"
    COUNTS_PER_S = "counts/s"


@dataclass(frozen=True, slots=True)
class Personality:
    """One column of the table above; the defaults are those of plain CiA 402."""

    temperature_address: Address
    sto_error_code: int
    speed_unit: SpeedUnit = SpeedUnit.COUNTS_PER_S
    torque_base_nm: float = 1e-3
    """One unit of 6076h."""
    torque_counts_current: bool = False
    """True if 6071h and 6077h are per mille of the rated current, regardless of 6076h."""
    temperature_step_degc: float = 1.0
    automatic_enable: bool = False
    connection_loss_is_fault: bool = False
    cob_id_locked_while_valid: bool = False
    generic_error_bit: bool = True
    statusword_period_ns: int = 0
    """Update period of 6041h; 0 is at once."""
    refuses_misplaced_controlword: bool = False
    interlock_input: bool = True
    misses_targets: bool = False
    """True if cyclic position without a new target by PDO is a lost connection."""
    smallest_interpolation_s: float = 0.0
    quick_stop_codes: frozenset[int] = frozenset(QUICK_STOP_OPTION)
    halt_codes: frozenset[int] = frozenset(HALT_OPTION)
    fault_reaction_codes: frozenset[int] = frozenset(FAULT_REACTION_OPTION)


PERSONALITIES: Final[Mapping[PersonalityName, Personality]] = MappingProxyType(
    {
        PersonalityName.EPOS4: Personality(
            speed_unit=SpeedUnit.RPM,
            torque_base_nm=1e-6,
            temperature_address=(0x3201, 1),
            temperature_step_degc=0.1,
            automatic_enable=True,
            connection_loss_is_fault=True,
            cob_id_locked_while_valid=True,
            generic_error_bit=False,
            interlock_input=False,
            sto_error_code=0x8A88,
            misses_targets=True,
            smallest_interpolation_s=0.0004,
            quick_stop_codes=frozenset({6}),
            fault_reaction_codes=frozenset({0, 1, 2}),
        ),
        PersonalityName.ELMO_GOLD: Personality(
            torque_counts_current=True,
            temperature_address=(0x22A2, 0),
            sto_error_code=0x5441,
            statusword_period_ns=3 * MILLISECOND,
            refuses_misplaced_controlword=True,
            interlock_input=False,
            halt_codes=frozenset({1, 2}),
            fault_reaction_codes=frozenset({0, 1, 2}),
        ),
        PersonalityName.GENERIC: Personality(
            temperature_address=(0x2100, 1), sto_error_code=0x9000
        ),
    }
)


_MEASURED: Final = ((Object.CURRENT, 0), (Object.POSITION_DEMAND, 0), (Object.FOLLOWING_ERROR, 0))
EPOS4_MODULES: Final = (
    (5.0, 15.0, 0x61500000),
    (8.0, 30.0, 0x65510000),
    (15.0, 30.0, 0x65520000),
)
"""Nominal current and current limit in A, and 1018h:02, of the Modules 50/5, 50/8 and 50/15, from
their public EDS and DCF files."""
HOMING_MODE_BIT: Final = 1 << 5
CYCLIC_MODE_BITS: Final = 1 << 7 | 1 << 8 | 1 << 9
"""6502h: cyclic synchronous position, velocity and torque."""


def standard(settings: DriveSettings) -> dict[Address, Value]:
    """Return what a drive holds although its maker's EDS may leave it out, or its value."""
    values: dict[Address, Value] = {
        (Object.DEVICE_TYPE, 0): 402,
        (Object.SYNC_COB_ID, 0): 0x080,
        (Object.EMCY_COB_ID, 0): 0x080 + settings.node_id,
    }
    if settings.personality is PersonalityName.GENERIC:
        temperature = PERSONALITIES[settings.personality].temperature_address
        values |= dict.fromkeys((*commissioned(settings), *_MEASURED, temperature), 0)
    return values


def unit_factors(settings: DriveSettings) -> dict[Address, Value]:
    """Return factors that make a position count one of the encoder: a file may leave them 0."""
    counts = settings.counts_per_rev
    encoder, gear, feed = Object.ENCODER_RESOLUTION, Object.GEAR_RATIO, Object.FEED_CONSTANT
    revolutions = {(index, 2): 1 for index in (encoder, gear, feed)}
    return {(encoder, 1): counts, (gear, 1): 1, (feed, 1): counts, **revolutions}


def commissioned(settings: DriveSettings) -> dict[Address, Value]:
    """Return the motor data set at commissioning, and the drive's identity."""
    nominal_ma = round(settings.nominal_current_a * 1e3)
    rated_mnm = round(settings.nominal_current_a * settings.torque_constant_nm_per_a * 1e3)
    limit_permille = round(settings.current_limit_a / settings.nominal_current_a * 1e3)
    shared: dict[Address, Value] = {
        (Object.IDENTITY, 4): settings.serial_number,
        (Object.SUPPORTED_MODES, 0): supported_modes(settings),
    }
    if settings.personality is PersonalityName.EPOS4:
        constant_unm_per_a = round(settings.torque_constant_nm_per_a * 1e6)
        return shared | {
            (Object.IDENTITY, 2): _epos4_module(settings),
            (Object.EPOS4_MOTOR_DATA, 1): nominal_ma,
            (Object.EPOS4_MOTOR_DATA, 2): round(settings.current_limit_a * 1e3),
            (Object.EPOS4_MOTOR_DATA, 5): constant_unm_per_a,
            (Object.RATED_TORQUE, 0): rated_torque_unm(nominal_ma, constant_unm_per_a),
        }
    return shared | {
        (Object.TORQUE_MAX, 0): limit_permille,
        (Object.CURRENT_MAX, 0): limit_permille,
        (Object.RATED_CURRENT, 0): nominal_ma,
        (Object.RATED_TORQUE, 0): rated_mnm,
    }


def rated_torque_unm(nominal_ma: int, constant_unm_per_a: int) -> int:
    """Return 6076h of an EPOS4-like drive, rounded as in public DCFs."""
    return (nominal_ma * constant_unm_per_a + 500) // 1000


def _epos4_module(settings: DriveSettings) -> int:
    """Product code of the smallest EPOS4 Module that gives these currents, else of the largest."""
    fitting = (
        code
        for nominal_a, limit_a, code in EPOS4_MODULES
        if settings.nominal_current_a <= nominal_a and settings.current_limit_a <= limit_a
    )
    return next(fitting, EPOS4_MODULES[-1][2])


def guard_option_codes(dictionary: ObjectDictionary, personality: Personality) -> None:
    """Restrict each option code to the values that this make of drive supports."""
    legal_codes: Mapping[int, frozenset[int]] = {
        Object.QUICK_STOP: personality.quick_stop_codes,
        Object.SHUTDOWN: frozenset(DISABLE_OPTION),
        Object.DISABLE: frozenset(DISABLE_OPTION),
        Object.HALT: personality.halt_codes,
        Object.FAULT_REACTION: personality.fault_reaction_codes,
        Object.ABORT_CONNECTION: frozenset(AbortConnection),
        Object.ERROR_BEHAVIOUR: frozenset({0, 1, 2}),
    }
    for index, legal in legal_codes.items():
        dictionary.guard(index, lambda _, value, legal=legal: _check_option(value, legal))


def _check_option(value: int, legal: frozenset[int]) -> None:
    if value not in legal:
        raise SdoAbortError(AbortCode.RANGE)


def supported_modes(settings: DriveSettings) -> int:
    """Return 6502h: homing where an origin can be lost, or where the settings enable it."""
    homing = settings.homes or settings.encoder is EncoderKind.INCREMENTAL
    return CYCLIC_MODE_BITS | HOMING_MODE_BIT * homing
