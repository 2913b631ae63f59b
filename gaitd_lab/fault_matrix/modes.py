"""The columns of the matrix: each mode, how a session reaches it, and how it continues.

A session is run once to the start of a column; its cells are forked from it one after the other
while it continues, so each fault comes at another moment of the mode (`window_s`), drawn by the
seed. A step that cannot be shared, because it is over at once, is executed by each cell
(`prelude`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gaitd_names import Mode, RequestKind, Stage

from daemon.ipc.record import ModeRequest
from gaitd_lab.fault_matrix.controller import Swinger
from gaitd_lab.fault_matrix.session import Variant
from gaitd_lab.lockstep import LockstepSession

CADENCE_HZ: Final = 0.4
STRIDE_S: Final = 1.0 / CADENCE_HZ
AS_SHIPPED: Final = Variant()
PREPARED: Final = "right/hip"
"""The axis that is homed, or whose sign is tested; the other has no power."""

Step = Callable[[LockstepSession], object]


@dataclass(frozen=True, slots=True)
class Column:
    """One mode of the matrix."""

    mode: Mode
    text: str
    """Title for the page."""
    begin: Step
    """Runs from power-on to the first moment of a fault."""
    window_s: float
    """Time over which the faults are spread."""
    is_idle: bool = False
    """No drive is enabled: the expected result of a fault depends on it."""
    leads_to: frozenset[Mode] = frozenset()
    """Other modes that it may reach by itself some seconds later, where it drives."""
    variant: Variant = AS_SHIPPED
    label: str = ""
    """Its name, where a mode has more than one column."""
    after_s: float = 0.01
    """Time of the cell over which its fault may come: any moment of a cycle."""
    prelude: Step | None = None
    """The last step, executed by each cell."""
    release: Step | None = None
    """Additional action at the end of the fault: absent drives return."""

    @property
    def name(self) -> str:
        """Its name on the command line and the pages."""
        return self.label or self.mode


def _nothing(_: LockstepSession) -> None:
    """Do nothing: the session starts at power-on."""


def _off(session: LockstepSession) -> None:
    session.command("unplugged *")
    session.run(0.5)


def _plug_in(session: LockstepSession) -> None:
    session.command("clear unplugged *")


def _hold(session: LockstepSession) -> None:
    session.enable()
    session.command("patient leans")
    session.run(0.5)


def _walk(session: LockstepSession) -> None:
    session.walk(cadence_hz=CADENCE_HZ)
    session.command("patient active")
    session.run(2 * STRIDE_S + 1.0)  # its ramps are over, and the patient is with it


def _torque(session: LockstepSession) -> None:
    session.enable()
    Swinger(session.gateway, session.settings.legs[0].name)
    session.run(0.1)
    session.execute(RequestKind.MODE, ModeRequest(Mode.TORQUE))
    session.run(1.0)


def _hand_guiding(session: LockstepSession) -> None:
    session.enable()
    session.execute(RequestKind.MODE, ModeRequest(Mode.HAND_GUIDING))
    session.run_until(lambda record: record.stage is Stage.PLAYING, within_s=2)
    session.command("patient led")
    session.run(2.0)


def _self_test(session: LockstepSession) -> None:
    session.enable()
    session.execute(RequestKind.MODE, ModeRequest(Mode.SELF_TEST))
    session.run(0.8)


def _excite(session: LockstepSession) -> None:
    session.excite("open_loop", 24.0)
    session.run(3.0)


def _prepare(session: LockstepSession, mode: Mode, run_s: float) -> None:
    session.until_ready()
    session.execute(RequestKind.MODE, ModeRequest(mode, axis=PREPARED))
    session.until(mode)
    session.run(run_s)


def _reference(session: LockstepSession) -> None:
    _prepare(session, Mode.REFERENCE, 0.6)


def _commission(session: LockstepSession) -> None:
    _prepare(session, Mode.COMMISSION, 0.5)


def _stop(session: LockstepSession) -> None:
    session.gateway.stop()
    session.until(Mode.STOPPING, within_s=0.1)


def _fault(session: LockstepSession) -> None:
    _walk(session)
    session.command("hand_switch_open right/hip 0.3")
    session.until(Mode.FAULT)
    session.run(0.5)


_ALL: Final = (
    Column(
        Mode.OFF,
        "the drives are not there; they come back with the end of the fault",
        _off,
        1.0,
        is_idle=True,
        release=_plug_in,
    ),
    Column(
        Mode.BRINGING_UP,
        "from power-on: boot-up, identity, limits written and read back",
        _nothing,
        0.0,
        is_idle=True,
        after_s=0.6,
    ),
    Column(Mode.READY, "brought up, without power", LockstepSession.until_ready, 0.5, is_idle=True),
    Column(Mode.HOLD, "enabled, holding the pose; the patient is not quite at rest", _hold, 5.0),
    Column(
        Mode.HOLD,
        "the same, held by the drives' own loops",
        _hold,
        5.0,
        label="hold_position",
        variant=Variant(guidance="position"),
    ),
    Column(
        Mode.GAIT,
        f"walking at {CADENCE_HZ:g} Hz by impedance; the patient works along",
        _walk,
        STRIDE_S,
        label="gait_impedance",
    ),
    Column(
        Mode.GAIT,
        f"walking at {CADENCE_HZ:g} Hz by the drives' own loops",
        _walk,
        STRIDE_S,
        label="gait_position",
        variant=Variant(guidance="position"),
    ),
    Column(
        Mode.TORQUE, "a controller with a lease swings the hip by 7 deg, once in 3 s", _torque, 3.0
    ),
    Column(
        Mode.EXCITE,
        "the paper's open-loop experiment: torque about mid pose",
        _excite,
        5.0,
        leads_to=frozenset({Mode.HOLD}),
    ),
    Column(
        Mode.HAND_GUIDING,
        "hand guiding without stiffness: a person leads thigh and foot slowly",
        _hand_guiding,
        3.3,
    ),
    Column(
        Mode.SELF_TEST,
        "the test of the day: each axis a little forth and back",
        _self_test,
        3.0,
        leads_to=frozenset({Mode.HOLD}),
    ),
    Column(
        Mode.REFERENCE,
        "the hip is being homed in the empty machine",
        _reference,
        1.0,
        leads_to=frozenset({Mode.STOPPING, Mode.READY, Mode.OFF, Mode.BRINGING_UP}),
        variant=Variant(empty=True),
    ),
    Column(
        Mode.COMMISSION,
        "the hip's sign is being tested in the empty machine",
        _commission,
        1.0,
        leads_to=frozenset({Mode.STOPPING, Mode.READY, Mode.OFF, Mode.BRINGING_UP}),
        variant=Variant(empty=True),
    ),
    Column(
        Mode.STOPPING,
        "a client has stopped the gait: the core brakes (S2)",
        _walk,
        STRIDE_S,
        after_s=0.15,
        prelude=_stop,
    ),
    Column(
        Mode.FAULT,
        "after the hand switch was let go while walking: the drives hold, quick stopped",
        _fault,
        1.0,
        is_idle=True,
    ),
)
COLUMNS: Final[Mapping[str, Column]] = MappingProxyType({column.name: column for column in _ALL})
"""Columns by name, in the order of the pages."""
