"""Interface between the protocol side and one leg's mechanics; `plant.Trainer` implements it."""

from typing import NamedTuple, Protocol

from sim_drives.plant.actuation import AxisActuation, AxisSample


class Plant(Protocol):
    """Two axes with motors and a patient: 0 is the hip, 1 the slide."""

    def set_axis(self, axis: int, actuation: AxisActuation) -> None:
        """Give one axis its order; the same order again changes nothing."""
        ...

    def advance(self, to_ns: int) -> int:
        """Advance to `to_ns`, or until a flag newly rises; return the time reached."""
        ...

    def sample(self, axis: int) -> AxisSample:
        """Sample the sensors now; draws noise, so call it once per use."""
        ...

    def flags(self, axis: int) -> int:
        """Return the present flags, bits of `AxisFlag`."""
        ...

    def block_rotor(self, axis: int, blocked: bool) -> None:
        """Block the joint, or free it."""
        ...

    def lead(self, axis: int, period_s: float) -> None:
        """Move an axis by the positions that `follow` gets, once a cycle; until then it rests."""
        ...

    def follow(self, axis: int, sampled_ns: int, position: float) -> None:
        """Take the position of a led axis, sampled by its drive at a SYNC."""
        ...

    def wire_motor(self, axis: int, sense: int) -> None:
        """Connect the motor: +1 with the right sign, -1 inverted."""
        ...

    def wire_encoder(self, axis: int, sense: int) -> None:
        """Connect the encoder: +1 with the right sign, -1 inverted."""
        ...

    def offset_current(self, axis: int, offset_a: float) -> None:
        """Add an offset to the current sensor's value, joint sign."""
        ...


class Axis(NamedTuple):
    """One axis of one plant."""

    plant: Plant
    number: int

    def order(self, actuation: AxisActuation) -> None:
        """As `Plant.set_axis`."""
        self.plant.set_axis(self.number, actuation)

    def sample(self) -> AxisSample:
        """As `Plant.sample`."""
        return self.plant.sample(self.number)

    def flags(self) -> int:
        """As `Plant.flags`."""
        return self.plant.flags(self.number)

    def block(self, *, blocked: bool) -> None:
        """As `Plant.block_rotor`."""
        self.plant.block_rotor(self.number, blocked)

    def wire_motor(self, sense: int) -> None:
        """As `Plant.wire_motor`."""
        self.plant.wire_motor(self.number, sense)

    def wire_encoder(self, sense: int) -> None:
        """As `Plant.wire_encoder`."""
        self.plant.wire_encoder(self.number, sense)

    def offset_current(self, offset_a: float) -> None:
        """As `Plant.offset_current`."""
        self.plant.offset_current(self.number, offset_a)
