"""Measured values of a drive as its objects show them: position, speed, torque, current, inputs.

Rules:
1. Position 6064h = encoder counts - origin, as 32 bits that wrap. An absolute encoder has origin
   0 and is referenced. An incremental one takes its power-on position as origin and is not
   referenced; homing sets the origin so that 6064h reads 607Ch or 30B0h, and references it.
2. Counts and mA are whole numbers: the sensors' values are quantised here.
3. A frozen encoder repeats its last count; the drive's own loops are not affected. A glitch adds
   counts to the reported value only.
4. 60FDh: bit 0 negative and bit 1 positive limit switch in the drive's direction, bit 2 home
   switch, bit 3 interlock (STO not released), bit 16 hand switch closed, bit 17 STO released.
"""

import math
from typing import Final, NamedTuple

from sim_drives.canopen.dictionary import ObjectDictionary
from sim_drives.canopen.objects import Object
from sim_drives.cia402.personality import PERSONALITIES
from sim_drives.cia402.scaling import Scaling
from sim_drives.plant.actuation import AxisFlag, AxisSample
from sim_drives.plant.port import Axis
from sim_drives.settings import DriveSettings, EncoderKind

NEGATIVE_SWITCH: Final = 1 << 0
POSITIVE_SWITCH: Final = 1 << 1
HOME_SWITCH: Final = 1 << 2
INTERLOCK: Final = 1 << 3
HAND_SWITCH_CLOSED: Final = 1 << 16
STO_RELEASED: Final = 1 << 17
TIMESTAMP: Final = (0x2041, 0)
"""Object with the sample's time in µs, where the drive has it."""
AVERAGING_S: Final = 0.05
"""Time constant of 30D1h:01."""
_INT16_MAX: Final = 2**15 - 1
_END_STOPS: Final = AxisFlag.END_STOP_NEGATIVE | AxisFlag.END_STOP_POSITIVE


class Reading(NamedTuple):
    """Values that the drive's firmware sees between two SYNCs, in its direction."""

    counts: int
    """Encoder counts."""
    current_ma: int


class Measurement:
    """Process values of one drive."""

    def __init__(
        self, settings: DriveSettings, dictionary: ObjectDictionary, scaling: Scaling, axis: Axis
    ) -> None:
        self._dictionary = dictionary
        self._scaling = scaling
        self._axis = axis
        self._absolute = settings.encoder is EncoderKind.ABSOLUTE
        self._sign = settings.sign
        self._home_switch = settings.home_switch
        self._personality = PERSONALITIES[settings.personality]
        self._has_timestamp = TIMESTAMP in dictionary
        self._has_mean_current = (Object.EPOS4_CURRENT, 2) in dictionary
        self._origin_counts = 0
        self._counts = 0
        self.position_counts = 0
        """6064h as last measured."""
        self._average_ma = 0.0
        self._sampled_ns: int | None = None
        self.referenced = False
        self.hand_switch_closed = True
        self.sto_released = True
        self.encoder_frozen = False
        self.home_switch_stuck: bool | None = None
        self.switch_held = 0
        """-1: the negative, 1: the positive limit switch is stuck on; 0: neither."""
        self._glitch_counts = 0
        self._glitch_seen = False
        self._glitch_over = False

    @property
    def origin_counts(self) -> int:
        """Offset from a target in the drive's counts to the encoder's counts."""
        return self._origin_counts

    def power_on(self, now_ns: int) -> None:
        """Set the origin by rule 1."""
        self._average_ma = 0.0
        self._sampled_ns = None
        sample = self._axis.sample()
        self._counts = round(self._scaling.counts(sample.position_si))
        self._origin_counts = 0 if self._absolute else self._counts
        self.referenced = self._absolute
        self._update(sample, now_ns)

    def home(self, reference_counts: int, reads: int) -> None:
        """Move the origin so that 6064h is `reads` where the encoder has `reference_counts`."""
        self._origin_counts = reference_counts - round(self._scaling.units_counts(reads))
        self.referenced = True
        self._update_position()

    def read(self) -> Reading:
        """Sample without updating any object."""
        sample = self._axis.sample()
        if not self.encoder_frozen:
            self._counts = round(self._scaling.counts(sample.position_si))
        current_ma = round(self._scaling.motor_current_a(sample.current_a) * 1e3)
        return Reading(self._counts, current_ma)

    def latch(self, now_ns: int) -> None:
        """Sample everything at this instant."""
        sample = self._axis.sample()
        if not self.encoder_frozen:
            self._counts = round(self._scaling.counts(sample.position_si))
        self._update(sample, now_ns)
        self._glitch_seen = True
        if self._glitch_over:
            self._glitch_counts = 0

    def offset_current(self, offset_ma: float) -> None:
        """Add an offset to the current sensor's value."""
        self._axis.offset_current(self._scaling.motor_current_a(offset_ma * 1e-3))

    def begin_glitch(self, counts: int) -> None:
        """Add counts to the reported position, from the next sample on."""
        self._glitch_counts = counts
        self._glitch_seen = self._glitch_over = False

    def end_glitch(self) -> None:
        """End a glitch, but not before one sample has had it."""
        self._glitch_over = True
        if self._glitch_seen:
            self._glitch_counts = 0

    def flags(self) -> int:
        """The plant's present flags of the axis."""
        return self._axis.flags()

    def inputs(self, flags: int) -> int:
        """The digital inputs by rule 4, with the plant's present flags of the axis."""
        inputs = HAND_SWITCH_CLOSED * self.hand_switch_closed
        if self.sto_released:
            inputs |= STO_RELEASED
        elif self._personality.interlock_input:
            inputs |= INTERLOCK
        inputs |= HOME_SWITCH * self._at_home_switch()
        return inputs | self.switches(flags)

    def _at_home_switch(self) -> bool:
        if self.home_switch_stuck is not None:
            return self.home_switch_stuck
        if self._home_switch is None:
            return False
        position_si = self._scaling.position_si(self._counts)
        return self._home_switch.from_si <= position_si <= self._home_switch.to_si

    def switches(self, flags: int) -> int:
        """Bits of the limit switches: the joint's end stops in the drive's direction."""
        if not flags & _END_STOPS and not self.switch_held:
            return 0
        negative, positive = AxisFlag.END_STOP_NEGATIVE, AxisFlag.END_STOP_POSITIVE
        if self._sign < 0:
            negative, positive = positive, negative
        at_negative = bool(flags & negative) or self.switch_held < 0
        at_positive = bool(flags & positive) or self.switch_held > 0
        return NEGATIVE_SWITCH * at_negative | POSITIVE_SWITCH * at_positive

    def _update(self, sample: AxisSample, now_ns: int) -> None:
        put = self._dictionary.put
        current_a = self._scaling.motor_current_a(sample.current_a)
        current_ma = round(current_a * 1e3)
        self._update_position()
        put(Object.VELOCITY, 0, round(self._scaling.speed_raw(sample.velocity_si)))
        put(Object.TORQUE, 0, _int16(current_ma * 1e-3 * self._scaling.factors.permille_per_a))
        self._update_current(current_ma, now_ns)
        step_degc = self._personality.temperature_step_degc
        put(*self._personality.temperature_address, _int16(sample.temperature_degc / step_degc))
        if self._has_timestamp:
            put(*TIMESTAMP, now_ns // 1000 % 2**32)

    def _update_position(self) -> None:
        counts = self._counts + self._glitch_counts - self._origin_counts
        self.position_counts = wrap_int32(self._scaling.position_units(counts))
        self._dictionary.put(Object.POSITION, 0, self.position_counts)

    def _update_current(self, current_ma: int, now_ns: int) -> None:
        if self._has_mean_current:
            self._average(current_ma, now_ns)
            self._dictionary.put(Object.EPOS4_CURRENT, 1, round(self._average_ma))
            self._dictionary.put(Object.EPOS4_CURRENT, 2, current_ma)
        else:
            rated_ma = self._scaling.factors.rated_current_a * 1e3
            permille = current_ma / rated_ma * 1e3 if rated_ma else 0
            self._dictionary.put(Object.CURRENT, 0, _int16(permille))

    def _average(self, current_ma: int, now_ns: int) -> None:
        elapsed_s = 0.0 if self._sampled_ns is None else (now_ns - self._sampled_ns) * 1e-9
        self._sampled_ns = now_ns
        self._average_ma += (1 - math.exp(-elapsed_s / AVERAGING_S)) * (
            current_ma - self._average_ma
        )


def wrap_int32(counts: int) -> int:
    """Return the lower 32 bits as a signed number, like an overflowing position counter."""
    return (counts + 2**31) % 2**32 - 2**31


def _int16(value: float) -> int:
    return max(-_INT16_MAX - 1, min(_INT16_MAX, round(value)))
