"""Homing (CiA 402-2, mode 6): what a drive type needs, and the settings of an axis."""

from typing import Annotated, Final, Literal

from msgspec import Meta

from drives.cia402.torque import ObjectRef, Table
from drives.errors import DescriptionError

Method = Annotated[int, Meta(ge=-128, le=127)]
"""6098h; negative values are vendor-specific."""
POSITION_BITS: Final = 32
"""Width of 6064h."""
MA_PER_A: Final = 1000


class HomingObjects(Table, frozen=True, kw_only=True):
    """Objects that this drive type needs besides 6098h, 6099h and 609Ah."""

    methods: Annotated[tuple[Method, ...], Meta(min_length=1)]
    """Methods that this drive supports."""
    home: ObjectRef
    """Object that sets the position at home: 607Ch, or a vendor-specific one."""
    home_sign: Literal[-1, 1]
    """+1: 6064h reads this object's value at home; -1: its negative (vendors differ on 607Ch)."""
    current_threshold: ObjectRef | None = None
    """mA; for the methods that detect a mechanical stop."""
    stall_methods: tuple[Method, ...] = ()
    """The methods that detect a mechanical stop by `current_threshold`."""
    zeros: tuple[ObjectRef, ...] = ()
    """Objects that shift the home further, and are cleared where the drive has them: an earlier
    commissioning may have stored another value in them."""


class Homing(Table, frozen=True, kw_only=True):
    """Homing settings of an axis; SI units at the joint (rad and N·m, or m and N)."""

    method: Method
    """6098h: one that the drive has; negative numbers are the maker's own."""
    home_si: Annotated[float, Meta(ge=-10, le=10)]
    """Joint position at home."""
    search_speed_si_per_s: Annotated[float, Meta(ge=1e-4, le=1)]
    """6099h:01, towards the switch or the stop."""
    zero_speed_si_per_s: Annotated[float, Meta(ge=1e-4, le=1)]
    """6099h:02, for the final approach."""
    acceleration_si_per_s2: Annotated[float, Meta(ge=1e-3, le=20)]
    """609Ah, in the joint's units."""
    effort_max_si: Annotated[float, Meta(ge=0.1, le=1500)]
    """Written into the drive as its limit for the duration of the homing."""
    stop_current_a: Annotated[float, Meta(ge=0.01, le=100)] | None = None
    """Current that counts as the mechanical stop, for the methods that detect one."""
    timeout_s: Annotated[float, Meta(ge=0.1, le=300)]
    """Longest homing; after it the motion is stopped."""


def check_homing(objects: HomingObjects | None, homing: Homing | None) -> None:
    """Refuse a homing that this drive type does not support.

    Raises:
        DescriptionError: names key, value and what is allowed.
    """
    if homing is None:
        return
    if objects is None:
        raise DescriptionError("axis", "homing", homing.method, "absent: the profile has no homing")
    if homing.method not in objects.methods:
        allowed = f"one of {', '.join(map(str, objects.methods))}"
        raise DescriptionError("axis", "homing.method", homing.method, allowed)
    detects_stop = homing.method in objects.stall_methods
    if detects_stop and homing.stop_current_a is None:
        allowed = f"given: method {homing.method} detects the stop by this current"
        raise DescriptionError("axis", "homing.stop_current_a", None, allowed)
    if not detects_stop and homing.stop_current_a is not None:
        allowed = f"absent: method {homing.method} detects no stop by its current"
        raise DescriptionError("axis", "homing.stop_current_a", homing.stop_current_a, allowed)
    threshold = objects.current_threshold
    if homing.stop_current_a is not None and threshold is not None:
        most_a = threshold.values[-1] / MA_PER_A
        if homing.stop_current_a > most_a:
            allowed = f"at most {most_a:g}: {threshold.place} counts it in mA"
            raise DescriptionError("axis", "homing.stop_current_a", homing.stop_current_a, allowed)


def check_homing_objects(objects: HomingObjects | None) -> None:
    """Refuse a profile whose methods and objects of a homing contradict each other.

    Raises:
        DescriptionError: names key, value and what is allowed.
    """
    if objects is None:
        return
    if objects.home.bits < POSITION_BITS or not objects.home.signed:
        allowed = f"an object of {POSITION_BITS} bits with sign, as the position that it sets"
        raise DescriptionError("profile", "homing.home", objects.home.place, allowed)
    if unknown := set(objects.stall_methods) - set(objects.methods):
        raise DescriptionError("profile", "homing.stall_methods", sorted(unknown), "of `methods`")
    if bool(objects.stall_methods) != (objects.current_threshold is not None):
        allowed = "given together with stall_methods"
        shown = objects.current_threshold and objects.current_threshold.place
        raise DescriptionError("profile", "homing.current_threshold", shown, allowed)
