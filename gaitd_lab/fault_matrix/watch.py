"""Observations of one cell: from the plant's truth, the wire, and the records.

Time counts in cycles of 10 ms from the begin of the fault, which may be anywhere in a cycle.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from gaitd_names import Mode

from daemon.ipc.record import CycleRecord
from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_ID, NmtCommand
from gaitd_lab.lockstep import LockstepSession
from sim_drives.cia402.power_state import POWER_STAGE_ON, PowerState

CYCLE_NS: Final = 10_000_000
SAMPLE_NS: Final = 5_000_000
REST_NS: Final = 100_000_000
"""Time without motion after which a leg is at rest."""
ENABLE_WORD: Final = 0x0F
QUICK_STOP: Final = 0b010
"""Bits 1 and 2 of the controlword of a quick stop."""
PUSHING: Final = PowerState.OPERATION_ENABLED
AXES: Final = ("right/hip", "right/slide")
"""Axes of the shipped trainer with one leg."""
HIP, SLIDE = slice(0, None, 2), slice(1, None, 2)
"""Places of all hips and of all slides among the axes."""

Pair = tuple[float, float]


class Sample(NamedTuple):
    """State of the plant and its drives at one moment; axes in the order of the trainer file."""

    time_ns: int
    position: tuple[float, ...]
    """Angle or position of each axis: rad, m."""
    velocity: tuple[float, ...]
    states: tuple[PowerState, ...]


class Watch:
    """Samples the world every 5 ms, independent of the service."""

    def __init__(self, session: LockstepSession) -> None:
        self._session = session
        machine, settings = session.machine, session.settings
        self.axes = tuple(drive.name for drive in settings.drives)
        """Name of each axis: hip and slide of each leg, in the order of the trainer file."""
        self._plants = [machine.trainers[leg.name] for leg in settings.legs]
        self._nodes = [machine.world.node(axis) for axis in self.axes]
        self.samples: list[Sample] = []
        self._sample()

    def _sample(self) -> None:
        truths = [plant.truth() for plant in self._plants]
        position = tuple(value for truth in truths for value in truth.position)
        velocity = tuple(value for truth in truths for value in truth.velocity)
        states = tuple(node.drive.state for node in self._nodes)
        now_ns = self._session.world_ns
        self.samples.append(Sample(now_ns, position, velocity, states))
        self._session.bus.at(now_ns + SAMPLE_NS, self._sample)


class Motion(NamedTuple):
    """Motion from a moment until rest of all legs."""

    rest_ns: int | None
    """Time since that moment; None: it has not come to rest."""
    hip_deg: float
    slide_mm: float
    """Largest distance of a hip and of a slide from its first position, until then."""


def motion(samples: Sequence[Sample], begun_ns: int, standstill: Pair) -> Motion:
    """Measure from the first sample at or after a moment to rest."""
    after = [one for one in samples if one.time_ns >= begun_ns]
    rest_ns = _rest(after, standstill)
    first = after[0].position
    moving = [one for one in after if rest_ns is None or one.time_ns <= rest_ns]
    far = [
        max(abs(one.position[axis] - start) for one in moving) for axis, start in enumerate(first)
    ]
    hip, slide = max(far[HIP]), max(far[SLIDE])
    since_ns = None if rest_ns is None else max(rest_ns - begun_ns, 0)
    return Motion(since_ns, math.degrees(hip), slide * 1e3)


def _rest(samples: Sequence[Sample], standstill: Pair) -> int | None:
    """Return when the first sufficiently long rest begins."""
    since_ns: int | None = None
    for one in samples:
        still = all(
            abs(velocity) < standstill[axis % 2] for axis, velocity in enumerate(one.velocity)
        )
        since_ns = (since_ns if since_ns is not None else one.time_ns) if still else None
        if since_ns is not None and one.time_ns - since_ns >= REST_NS:
            return since_ns
    return None


def outside(samples: Sequence[Sample], low: Pair, high: Pair) -> Pair:
    """Largest excess of a hip and of a slide over its range: rad, m; 0 inside."""
    hip, slide = (
        max(
            max(low[axis] - position, position - high[axis], 0.0)
            for one in samples
            for position in one.position[places]
        )
        for axis, places in enumerate((HIP, SLIDE))
    )
    return hip, slide


def enabled_again(samples: Sequence[Sample], axes: Sequence[str]) -> tuple[str, ...]:
    """Drives that newly entered operation enabled."""
    return _entered(samples, axes, frozenset({PUSHING}))


def lost_power(samples: Sequence[Sample], axes: Sequence[str]) -> tuple[str, ...]:
    """Drives whose power stage was on and was switched off."""
    return _entered(samples, axes, frozenset(PowerState) - POWER_STAGE_ON)


def _entered(
    samples: Sequence[Sample], axes: Sequence[str], states: frozenset[PowerState]
) -> tuple[str, ...]:
    """Drives that entered one of these states from another one."""
    return tuple(
        axis
        for number, axis in enumerate(axes)
        if any(
            before.states[number] not in states and after.states[number] in states
            for before, after in pairwise(samples)
        )
    )


def left_enabled(samples: Sequence[Sample], begun_ns: int) -> tuple[int | None, ...]:
    """Time at which each drive was first seen without operation enabled, from a moment on."""
    return tuple(
        next(
            (
                one.time_ns
                for one in samples
                if one.time_ns >= begun_ns and one.states[number] is not PUSHING
            ),
            None,
        )
        for number in range(len(samples[0].states))
    )


class StopFrames(NamedTuple):
    """When each drive was commanded to stop, on the wire."""

    told_ns: tuple[int | None, ...]
    """World time for each axis; None: it was not."""
    together: bool
    """True if between the same two SYNCs."""
    powerless: tuple[str, ...]
    """Drives whose first stopping frame switched the power stage off."""


def stop_frames(
    sent: Sequence[Frame], nodes: Mapping[str, int], begun_ns: int, stopped_ns: int | None
) -> StopFrames:
    """Find the frames that stop.

    Args:
        sent: frames of the master, with the world's time.
        nodes: node id of each axis.
        begun_ns: when the fault began.
        stopped_ns: SYNC of the first record of a stop: commands after it brake, also those that
            leave a drive enabled (S2); None: there was no such record.
    """
    stops = [
        list(_stops(sent, node, begun_ns, stopped_ns))
        if _enabled_before(sent, node, begun_ns)
        else []
        for node in nodes.values()
    ]
    return StopFrames(
        tuple(of_axis[0].time_ns if of_axis else None for of_axis in stops),
        together=len({of_axis[0].sync_count for of_axis in stops if of_axis}) <= 1,
        powerless=tuple(
            axis
            for axis, of_axis in zip(nodes, stops, strict=True)
            if of_axis and _is_powerless(of_axis)
        ),
    )


def _enabled_before(sent: Sequence[Frame], node: int, begun_ns: int) -> bool:
    words = (one for one in reversed(sent) if one.can_id == 0x200 + node)
    last = next((one for one in words if one.time_ns < begun_ns), None)
    return last is not None and _enables(last)


def _enables(frame: Frame) -> bool:
    return frame.data[0] & ENABLE_WORD == ENABLE_WORD


class _Stop(NamedTuple):
    """A frame that stops a drive."""

    time_ns: int
    sync_count: int
    """Number of SYNCs before it."""
    word: int | None
    """Low byte of the controlword; None: NMT stop."""


def _is_powerless(stops: Sequence[_Stop]) -> bool:
    """True if the first frame is shutdown or disable voltage (CiA 402-2, table 28).

    That is each controlword but quick stop and those with bits 0 to 2 set. It is not in effect
    where an NMT stop follows before the next SYNC: the drive then stops by itself.
    """
    first = stops[0]
    if any(one.word is None and one.sync_count == first.sync_count for one in stops):
        return False
    word = first.word or 0
    return word & 0b110 != QUICK_STOP and word & 0b111 != 0b111


def _stops(
    sent: Sequence[Frame], node: int, begun_ns: int, stopped_ns: int | None
) -> Iterator[_Stop]:
    """Each frame that stops this node."""
    sync_count = 0
    for one in sent:
        if one.can_id == SYNC_ID:
            sync_count += 1
        if one.time_ns < begun_ns:
            continue
        if one.can_id == 0 and one.data[0] == NmtCommand.STOP and one.data[1] in (0, node):
            yield _Stop(one.time_ns, sync_count, None)
        elif one.can_id == 0x200 + node:
            braking = stopped_ns is not None and one.time_ns >= stopped_ns
            if braking or not _enables(one):
                yield _Stop(one.time_ns, sync_count, one.data[0])


def first_stop(records: Sequence[CycleRecord]) -> CycleRecord | None:
    """Return the first record in which the machine is being stopped, or is in fault."""
    stopped = (Mode.STOPPING, Mode.FAULT)
    return next((one for one in records if one.mode in stopped), None)
