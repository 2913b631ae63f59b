"""A virtual trainer: the whole service, with the physics of the trainer behind virtual drives.

    with virtual_trainer() as trainer:      ready; `trainer.endpoint` is where Zenoh clients connect
        trainer.gait()                      the leg walks
        trainer.inject("silent right/hip 0.5")
        trainer.wait_for(Mode.FAULT)

Nothing in the service knows that the drives are virtual. They are a process on this computer: when
it stalls for 100 ms the service stops, rightly, as if a drive had been silent. So a method that
brings the machine into a mode resets a stop and asks again: a few times, and for minutes where the
records show that the computer was held up.
"""

import contextlib
import signal
import tempfile
import time
import weakref
from collections.abc import Generator
from pathlib import Path
from typing import Any, Final, Self

from daemon.record import CycleRecord, Mode
from gaitd.children import memory_folder
from gaitd.held_up import LOOK_BACK_CYCLES, OBSERVER_LOOK_BACK_CYCLES, held_up
from gaitd.testing.edits import Edits
from gaitd.testing.service import Service, ServiceError

TRIES: Final = 4
HELD_UP_S: Final = 300.0
"""So long is it tried on a computer that others have for themselves."""
CALM_S: Final = 60.0
"""So long is waited for such a computer to be calm for a second, before the next try."""
PATIENCE_S: Final = 90.0
"""Of a machine on which much else runs, for a start that takes three seconds of computing."""
START_S: Final = 300.0
"""The first start on a machine compiles the observer, for a minute or so."""
SETTLED: Final = frozenset({Mode.READY, Mode.FAULT, Mode.HOLD, Mode.GAIT})
STANDSTILL: Final = (0.05, 0.03)
"""rad/s and m/s, as limits.toml has it."""
HOLD: Final[dict[str, object]] = {"mode": "hold"}
GAIT: Final[dict[str, object]] = {
    "mode": "gait",
    "cadence_hz": 0.4,
    "amplitude_ratio": 1.0,
    "duration_s": 600.0,
}
RUNNING: Final["weakref.WeakSet[VirtualTrainer]"] = weakref.WeakSet()
"""Those that have been started and not ended, for the report of a test that fails."""


class VirtualTrainer(Service):
    """Virtual drives, core and gateway, and what a test asks of them."""

    def __init__(
        self,
        folder: Path,
        configs: Path | None = None,
        *,
        trainer_file: str = "demo.toml",
        edits: Edits | None = None,
    ) -> None:
        """As `Service`."""
        super().__init__(folder, configs, trainer_file=trainer_file, edits=edits)
        self._refused: list[dict[str, Any]] = []

    # --- from start to end --------------------------------------------------------------------

    def start_all(self) -> Self:
        """Start every part and wait until the service is ready to be enabled.

        Raises:
            ServiceError: a part ended, or it was not ready in time; with what all have said.
        """
        RUNNING.add(self)
        super().start_all()
        self.wait(self._is_ready, START_S)
        return self

    def end(self) -> None:
        """End what runs, whatever state it is in."""
        super().end()
        RUNNING.discard(self)

    def _is_ready(self) -> bool:
        self._expect("sim", "core", "gateway")
        return self.newest().mode == Mode.READY and self._is_heard()

    def _expect(self, *parts: str) -> None:
        for part in parts:
            if not self.runs(part):
                code = self.parts[part].returncode if part in self.parts else "no start"
                raise ServiceError(f"gaitd {part} ended with {code}\n{self.logs()}")

    # --- what it does -------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """Of the newest cycle."""
        return self.newest().mode

    def wait_for(self, mode: Mode, within_s: float = 30) -> CycleRecord:
        """Wait until the core is in a mode; the record that says so.

        Raises:
            ServiceError: it did not come within the time, or the core has ended.
        """
        found: list[CycleRecord] = []

        def reached() -> bool:
            self._expect("core")
            found[:] = [self.newest()]
            return found[0].mode == mode

        try:
            self.wait(reached, within_s)
        except ServiceError as error:
            told = found[0] if found else None
            now = f"it is {told.mode.name}, {told.verdict}" if told else "there is no record"
            raise ServiceError(f"mode {mode.name} did not come: {now}\n{error}") from error
        return found[0]

    def enable(self) -> CycleRecord:
        """Enable the drives: the leg is held where it is. A latched stop is reset first."""
        return self.bring(Mode.HOLD).newest()

    def gait(
        self, cadence_hz: float = 0.4, amplitude_ratio: float = 1.0, duration_s: float = 600.0
    ) -> CycleRecord:
        """Enable if need be, and walk; returns when the announcement and the approach are over."""
        wanted = {"cadence_hz": cadence_hz, "amplitude_ratio": amplitude_ratio}
        return self.bring(Mode.GAIT, **wanted, duration_s=duration_s).newest()

    def disable(self) -> CycleRecord:
        """Stop in an orderly way, without power at the end. A latched stop is reset."""
        return self.bring(Mode.READY).newest()

    def stop(self) -> CycleRecord:
        """What anybody may ask at any time: stop now. It is latched until `reset`."""
        self.request("stop")
        return self.wait_for(Mode.FAULT)

    def reset(self) -> CycleRecord:
        """Reset a latched stop, once its cause is gone."""
        self.wait(lambda: self._done("reset"), PATIENCE_S)
        return self.wait_for(Mode.READY, PATIENCE_S)

    def patient(self, programme: str) -> None:
        """Let the virtual patient begin one of plant.toml's programmes, for example `active`."""
        self.tell(f"patient {programme}")

    def tell(self, line: str) -> str:
        """As `inject`, but what the virtual drives do not understand is an error.

        Raises:
            ValueError: with their answer.
        """
        answer = self.inject(line)
        if answer.startswith("error"):
            raise ValueError(f"the virtual drives say to {line!r}: {answer}")
        return answer

    def bring(self, mode: Mode, **wanted: object) -> Self:
        """Into READY, HOLD or GAIT from wherever it is; a part that does not run is started.

        Args:
            mode: where to.
            wanted: more for the request: cadence_hz, amplitude_ratio, duration_s.

        Raises:
            ServiceError: it refuses, or stops each time.
        """
        begun, tries, end_s = len(self._refused), 0, time.monotonic() + HELD_UP_S
        while tries < TRIES:
            if self._tried(mode, wanted):
                return self
            if not self._waited_for_calm():
                tries += 1
            elif time.monotonic() > end_s:
                break
        verdict = self.newest().verdict
        raise ServiceError(
            f"never in {mode.name}: {verdict}; refused: {self._refused[begun:]}\n{self.logs()}"
        )

    def walks(self, record: CycleRecord) -> bool:
        """Whether this cycle is one of a gait under way."""
        return record.mode == Mode.GAIT and record.gait_phase >= 0

    def stands(self, record: CycleRecord) -> bool:
        """Whether this cycle finds the leg held, and at rest."""
        return record.mode == Mode.HOLD and all(
            hip < STANDSTILL[0] and slide < STANDSTILL[1] for hip, slide in speeds_by_leg(record)
        )

    def _tried(self, mode: Mode, wanted: dict[str, object]) -> bool:
        self._revive()
        self.wait(self._is_heard, PATIENCE_S)
        record = self._settled()
        if record.mode == Mode.FAULT:
            self.wait(lambda: self._done("reset"), PATIENCE_S)
            record = self._settled()
        if record.mode != mode and self._ask_for(mode, wanted):
            record = self.newest()
        return record.mode == mode and self._arrived(mode).mode == mode

    def _settled(self) -> CycleRecord:
        return self.until(lambda record: record.mode in SETTLED, PATIENCE_S)

    def _waited_for_calm(self) -> bool:
        """Whether the computer was held up in the last seconds; if so, only once it is calm."""
        if not held_up(self._last(OBSERVER_LOOK_BACK_CYCLES)):
            return False
        with contextlib.suppress(ServiceError):
            self.wait(lambda: not held_up(self._last(LOOK_BACK_CYCLES)), CALM_S, poll_s=0.2)
        return True

    def _last(self, count: int) -> list[CycleRecord]:
        return self.records(self.newest().seq - count)

    def _revive(self) -> None:
        RUNNING.add(self)
        if not self.runs("sim"):
            for part in ("core", "gateway"):
                if self.runs(part):
                    self.kill(part)
            self.start_drives()
        if not self.runs("core"):
            before = self.boot_id()
            self.start("core")
            self.wait(lambda: self.boot_id() not in {before, ""}, PATIENCE_S)
        if not self.runs("gateway"):
            self.start("gateway")
        for part in ("core", "gateway"):
            self.kill(part, signal.SIGCONT)

    def _is_heard(self) -> bool:
        """Whether the gateway that runs now hears the core that runs now."""
        answer = self.request("status")
        valid = answer.get("safety", {}).get("valid", False)
        return valid and answer["core_boot_id"] == self.boot_id()

    def _ask_for(self, mode: Mode, wanted: dict[str, object]) -> bool:
        if mode == Mode.READY:
            return self._done("disable")
        if self.newest().mode == Mode.READY:
            # After a reset the leg falls into its springs first; refused while it moves.
            # A stall of the machine may stop it meanwhile: then all is tried again.
            self.wait(lambda: self._done("enable") or self.mode == Mode.FAULT, PATIENCE_S)
            if self.mode == Mode.FAULT:
                return False
        payload = HOLD if mode == Mode.HOLD else {**GAIT, **wanted}
        return self.newest().mode == mode or self._done("mode", **payload)

    def _arrived(self, mode: Mode) -> CycleRecord:
        """Wait until the mode is under way, or over."""
        reached = {Mode.GAIT: self.walks, Mode.HOLD: self.stands}.get(mode)
        if reached is None:
            return self.newest()
        left = {Mode.FAULT, Mode.READY}
        return self.until(lambda record: reached(record) or record.mode in left, PATIENCE_S)

    def _done(self, name: str, **payload: object) -> bool:
        answer = self.request(name, **payload)
        self._refused += [answer] if answer["outcome"] != "done" else []
        return answer["outcome"] == "done"


def speeds_by_leg(record: CycleRecord) -> list[tuple[float, float]]:
    """How fast the hip and the slide of each leg are, either way; rad/s and m/s."""
    speeds = [abs(drive.velocity_si or 0.0) for drive in record.drives]
    return list(zip(speeds[::2], speeds[1::2], strict=True))


@contextlib.contextmanager
def virtual_trainer(
    edits: Edits | None = None,
    *,
    configs: Path | None = None,
    trainer_file: str = "demo.toml",
) -> Generator[VirtualTrainer]:
    """A virtual trainer that is ready; nothing of it is left afterwards, whatever happens.

    Args:
        edits: keys of the configuration with other values, by file.
        configs: a folder of configurations; None: those that come with gaitd.
        trainer_file: in that folder.

    Raises:
        EditError: a key that is not there.
        ServiceError: it did not start; with what its processes have said.
    """
    with tempfile.TemporaryDirectory(prefix="gaitd-test-", dir=memory_folder()) as folder:
        trainer = VirtualTrainer(Path(folder), configs, trainer_file=trainer_file, edits=edits)
        try:
            yield trainer.start_all()
        finally:
            trainer.end()
