"""A core without a bus: it is turned from cycle to cycle, and its drives show what a test says."""

from fresh_core import fresh, has_received, show
from gaitd_names import Cause, Mode, Outcome, RequestKind, Role, StopCategory
from safety_inputs import FEEDBACK, JOINT

from daemon.core.safety.stop_sequence import Step
from daemon.core.state import Core
from daemon.core.steps import exercises, supervisor
from daemon.ipc.record import ModeRequest, Request, Verdict
from drives.signals import PowerState

AT_REST = JOINT._replace(position_si=0.2, velocity_si=0.0, effort_si=0.0)
OPENED = Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN, "right/hip")
JUMPED = Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/hip")
NO_MODE = ModeRequest()
MANY_CYCLES = 400
"""Longer than any stop takes."""


class Bench:
    """A core that holds its leg; its drives show what a test says."""

    def __init__(self) -> None:
        self.core: Core = fresh().core
        self.core.mode, self.core.load_checked = Mode.HOLD, True
        self.cycle, self.utc_ns, self._request_id = 100, 0, 0
        self.show(PowerState.OPERATION_ENABLED)
        for axis in self.core.axes:
            show(axis, referenced=True, reached_enabled=True)
        exercises.hold_here(self.core)

    def show(self, state: PowerState, velocity_si: float = 0.0) -> None:
        for axis in self.core.axes:
            show(axis, feedback=FEEDBACK._replace(node_id=axis.node_id, power_state=state))
            show(axis, joint=AT_REST._replace(velocity_si=velocity_si))

    def turn(self, *verdicts: Verdict, request: Request | None = None) -> None:
        self.cycle += 1
        has_received(self.core, request=request, gateway_state_cycle=self.cycle)
        supervisor.supervise(self.core, verdicts, self.cycle, self.utc_ns)

    def ask(self, kind: RequestKind, wanted: ModeRequest = NO_MODE) -> Outcome:
        self._request_id += 1
        request = Request(self._request_id, kind, self.cycle, wanted, Role.UNRESTRICTED)
        self.turn(request=request)
        return self.core.result.outcome

    def until_stopped(self) -> Mode:
        for _ in range(MANY_CYCLES):
            if self.core.mode != Mode.STOPPING:
                break
            self.turn()
        return self.core.mode

    def steps(self) -> list[Step]:
        return [axis.stop.step for axis in self.core.axes if axis.stop is not None]
