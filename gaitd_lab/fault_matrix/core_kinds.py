"""Begin and end of faults inside the core: NaN values, memory, a full disk.

The replaced parts of the core are replaced in a fork that ends with its cell.
"""

from collections.abc import Callable
from typing import Final, NoReturn

from daemon.core import cycle_record
from daemon.core.exercises.exercise import LegSample, Reference
from daemon.core.modes.persistent_state import PersistentState
from daemon.core.state import Leg
from daemon.core.steps import exercises
from drives.cia402.units import AxisScaling
from gaitd_lab.fault_matrix.kinds import MS, NAN, FaultAction, Scene, nothing, undo


def nan_in_guidance() -> FaultAction:
    """The planned position of one axis becomes NaN."""

    def begin(scene: Scene, axis: str) -> None:
        original = exercises.reference_of
        index = 0 if axis.endswith("hip") else 1

        def broken(leg: Leg, sample: LegSample) -> Reference | None:
            wanted = original(leg, sample)
            if wanted is None:
                return None
            position = list(wanted.position)
            position[index] = NAN
            return wanted._replace(position=(position[0], position[1]))

        exercises.reference_of = broken
        scene.undo.append(lambda: setattr(exercises, "reference_of", original))

    return FaultAction(begin, undo)


def wrong_scaling(broken: Callable[[AxisScaling], AxisScaling]) -> FaultAction:
    """A conversion factor between a drive's units and SI becomes NaN."""

    def begin(scene: Scene, axis: str) -> None:
        one = scene.axis(axis)
        before = one.scaling
        one.scaling = broken(before)
        scene.undo.append(lambda: setattr(one, "scaling", before))

    return FaultAction(begin, undo)


def observer_state(value: float) -> FaultAction:
    """The observer's state is overwritten with NaN, once."""

    def begin(scene: Scene, _axis: str) -> None:
        for leg in scene.core.legs:
            memory, _ = leg.observers.observer.buffers
            memory["mean"][:] = value

    return FaultAction(begin, nothing)


RUIN_NS: Final = 5 * MS


def observer_lost() -> FaultAction:
    """The observer's state is overwritten again before every cycle, so a restart does not help."""

    def begin(scene: Scene, axis: str) -> None:
        ruin = observer_state(NAN)
        ruined = True

        def again() -> None:
            if ruined:
                ruin.begin(scene, axis)
                scene.session.bus.at(scene.session.world_ns + RUIN_NS, again)

        def leave() -> None:
            nonlocal ruined
            ruined = False

        scene.undo.append(leave)
        again()

    return FaultAction(begin, undo)


def out_of_memory() -> FaultAction:
    """One allocation fails in the next cycle, also if the core stands still until then."""

    def begin(_scene: Scene, _axis: str) -> None:
        original = cycle_record.record

        def failing(*_args: object, **_named: object) -> NoReturn:
            cycle_record.record = original
            raise MemoryError

        cycle_record.record = failing

    return FaultAction(begin, nothing)


# --- files ------------------------------------------------------------------------------------


def notebook_full() -> FaultAction:
    """The state file cannot be written, and there is something to write."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.state_file.is_full = True
        scene.core.persistent = PersistentState(scene.core.persistent.axes)

    return FaultAction(begin, nothing)


def ring_full() -> FaultAction:
    """A record cannot be written into the ring."""

    def begin(scene: Scene, _axis: str) -> None:
        scene.session.gateway.ring_is_full = True

    return FaultAction(begin, nothing)
