"""A virtual trainer: the whole service, with the physics of the trainer behind virtual drives.

    with virtual_trainer() as trainer:      ready; `trainer.endpoint` is where Zenoh clients connect
        trainer.gait()                      the leg walks
        trainer.inject("silent right/hip 0.5")
        trainer.wait_for(Mode.FAULT)

The service does not know that the drives are virtual. Time is simulated, so a stall of the computer
stops nothing: a stop while a mode is requested is an error at once, with its cause.
"""

import contextlib
import signal
import tempfile
import weakref
from collections.abc import Generator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self

from gaitd_names import Mode

from daemon.config.edits import Edits
from daemon.ipc.record import CycleRecord
from gaitd_lab.processes import ServiceError, memory_folder
from gaitd_lab.testing.service import REAL_TIME, Service

TIMEOUT_S: Final = 90.0
START_S: Final = 300.0
"""The first start on a machine compiles the observer, for a minute or so."""
SETTLED: Final = frozenset({Mode.READY, Mode.FAULT, Mode.HOLD, Mode.GAIT})
STANDSTILL: Final = (0.05, 0.03)
"""Speeds of a leg at rest, rad/s and m/s, as in limits.toml."""
REST_CYCLES: Final = 30
"""Consecutive records at rest: a leg at a reversal is at rest in one only."""
HOLD: Final[dict[str, object]] = {"mode": "hold"}
GAIT: Final[dict[str, object]] = {
    "mode": "gait",
    "cadence_hz": 0.4,
    "amplitude_ratio": 1.0,
    "duration_s": 600.0,
}
RUNNING: Final["weakref.WeakSet[VirtualTrainer]"] = weakref.WeakSet()
"""Running trainers, for the report of a failing test."""


class VirtualTrainer(Service):
    """Virtual drives, core and gateway, and the requests of a test."""

    _refusal: Mapping[str, Any] = MappingProxyType({})
    """The last answer to a request, if it was not `done`."""

    # --- from start to end --------------------------------------------------------------------

    def start_all(self) -> Self:
        """Start every part and wait until the service is ready to be enabled.

        Raises:
            ServiceError: a part ended, or it was not ready in time; with the parts' output.
        """
        RUNNING.add(self)
        super().start_all()
        self.wait(self._is_ready, START_S)
        return self

    def end(self) -> None:
        """End all running parts, in any state."""
        super().end()
        RUNNING.discard(self)

    def _is_ready(self) -> bool:
        self.check()
        return self.newest().mode == Mode.READY and self._is_received()

    # --- requests -------------------------------------------------------------------------------

    @property
    def mode(self) -> Mode:
        """Mode of the newest cycle."""
        return self.newest().mode

    def wait_for(self, mode: Mode, within_s: float = 30) -> CycleRecord:
        """Wait until the core is in a mode; return the first record in that mode, or the newest.

        Raises:
            ServiceError: the mode was not reached in time, or the core has ended.
        """
        newest = "there is no record"

        def reached(record: CycleRecord) -> bool:
            nonlocal newest
            newest = f"it is {record.mode.name}, {record.verdict}"
            self.parts["core"].check()
            return record.mode == mode

        try:
            return self.until(reached, within_s)
        except ServiceError as error:
            raise ServiceError(f"mode {mode.name} did not come: {newest}\n{error}") from error

    def enable(self) -> CycleRecord:
        """Enable the drives: the leg is held in place. A latched stop is reset first."""
        return self.bring(Mode.HOLD).newest()

    def gait(
        self, cadence_hz: float = 0.4, amplitude_ratio: float = 1.0, duration_s: float = 600.0
    ) -> CycleRecord:
        """Enable if necessary, and start gait; returns after announcement and approach."""
        wanted = {"cadence_hz": cadence_hz, "amplitude_ratio": amplitude_ratio}
        return self.bring(Mode.GAIT, **wanted, duration_s=duration_s).newest()

    def disable(self) -> CycleRecord:
        """Stop normally, without power at the end. A latched stop is reset."""
        return self.bring(Mode.READY).newest()

    def stop(self) -> CycleRecord:
        """Request a stop, which any client may do at any time. It is latched until `reset`."""
        self.request("stop")
        return self.wait_for(Mode.FAULT)

    def reset(self) -> CycleRecord:
        """Reset a latched stop, once its cause is gone."""
        self.wait(lambda: self._done("reset"), TIMEOUT_S)
        return self.wait_for(Mode.READY, TIMEOUT_S)

    def patient(self, programme: str) -> None:
        """Start one of plant.toml's patient programmes, for example `active`."""
        self.tell(f"patient {programme}")

    def tell(self, line: str) -> str:
        """As `inject`, but a command that the virtual drives refuse is an error.

        Raises:
            ValueError: with their answer.
        """
        answer = self.inject(line)
        if answer.startswith("error"):
            raise ValueError(f"the virtual drives say to {line!r}: {answer}")
        return answer

    def bring(self, mode: Mode, **wanted: object) -> Self:
        """Reach READY, HOLD or GAIT from any state; a part that does not run is started.

        Args:
            mode: the mode to reach.
            wanted: arguments of the request: cadence_hz, amplitude_ratio, duration_s.

        Raises:
            ServiceError: a refusal or a stop; with the cause.
        """
        self._refusal = {}
        self._restart()
        with self._fast():
            try:
                self._request_mode(mode, wanted)
                stopped = self._arrived(mode).mode != mode
            except ServiceError as error:
                raise self._not_in(mode) from error
        if stopped:
            raise self._not_in(mode)
        return self

    def _not_in(self, mode: Mode) -> ServiceError:
        now = self.newest()
        words = f"not in {mode.name} but in {now.mode.name}: {now.verdict}"
        return ServiceError(f"{words}; refused: {self._refusal}\n{self.logs()}")

    def walks(self, record: CycleRecord) -> bool:
        """Return whether the record belongs to a gait in progress."""
        return record.mode == Mode.GAIT and record.gait_phase >= 0

    def stands(self, record: CycleRecord) -> bool:
        """Return whether the leg is held and at rest in the record."""
        return record.mode == Mode.HOLD and all(
            hip < STANDSTILL[0] and slide < STANDSTILL[1] for hip, slide in speeds_by_leg(record)
        )

    def _restart(self) -> None:
        RUNNING.add(self)
        if not self.runs("sim"):
            for part in ("core", "gateway"):
                if self.runs(part):
                    self.kill(part)
            self.start_drives()
        if not self.runs("core"):
            before = self.boot_id()
            self.start("core")
            self.wait(lambda: self.boot_id() not in {before, ""}, TIMEOUT_S)
        if not self.runs("gateway"):
            self.start_gateway()
        for part in ("core", "gateway"):
            self.kill(part, signal.SIGCONT)

    def _is_received(self) -> bool:
        """Return whether the running gateway receives the running core's records."""
        answer = self.request("status")
        valid = answer.get("safety", {}).get("valid", False)
        return valid and answer["core_boot_id"] == self.boot_id()

    def _settled(self) -> Mode:
        return self.until(lambda record: record.mode in SETTLED, TIMEOUT_S).mode

    def _request_mode(self, mode: Mode, wanted: dict[str, object]) -> None:
        """Request a mode from any state; a final refusal is stored."""
        self.wait(self._is_received, TIMEOUT_S)
        if self._settled() == Mode.FAULT:
            self.wait(lambda: self._done("reset") or self.mode != Mode.FAULT, TIMEOUT_S)
        now = self._settled()
        if now == mode:
            return
        if mode == Mode.READY:
            self._must("disable")
            return
        if now == Mode.READY:
            # After a reset the leg sinks into its springs; requests are refused while it moves.
            # A request may be carried out although its answer is late: the mode tells.
            self.wait(lambda: self._done("enable") or self._settled() != Mode.READY, TIMEOUT_S)
        if self.mode not in {mode, Mode.FAULT}:
            self._must("mode", **(HOLD if mode == Mode.HOLD else {**GAIT, **wanted}))

    def _arrived(self, mode: Mode) -> CycleRecord:
        """Wait until the mode is in progress, or over."""
        rest_cycles = 0

        def arrived(record: CycleRecord) -> bool:
            nonlocal rest_cycles
            rest_cycles = rest_cycles + 1 if self.stands(record) else 0
            is_there = self.walks(record) if mode == Mode.GAIT else rest_cycles >= REST_CYCLES
            return is_there or record.mode in {Mode.FAULT, Mode.READY}

        return self.until(arrived, TIMEOUT_S)

    def _done(self, name: str, **payload: object) -> bool:
        answer = self.request(name, **payload)
        is_done = answer["outcome"] == "done"
        self._refusal = {} if is_done else answer
        return is_done

    def _must(self, name: str, **payload: object) -> None:
        if not self._done(name, **payload):
            raise ServiceError(f"{name} is not done")


def speeds_by_leg(record: CycleRecord) -> list[tuple[float, float]]:
    """Return the magnitude of each leg's hip and slide speeds; rad/s and m/s."""
    speeds = [abs(drive.velocity or 0.0) for drive in record.drives]
    return list(zip(speeds[::2], speeds[1::2], strict=True))


@contextlib.contextmanager
def virtual_trainer(
    edits: Edits | None = None,
    *,
    configs: Path | None = None,
    trainer_file: str = "demo.toml",
    pace: float | str = REAL_TIME,
) -> Generator[VirtualTrainer]:
    """Run a virtual trainer that is ready; it is removed completely at the end.

    Args:
        edits: keys of the configuration with other values, by file.
        configs: a folder of configurations; None: those that come with gaitd.
        trainer_file: name of the trainer file in that folder.
        pace: pace of simulated time outside of waits: a multiple of real time, or `max`.

    Raises:
        EditError: a key that does not exist.
        ServiceError: it did not start; with the output of its processes.
    """
    with tempfile.TemporaryDirectory(prefix="gaitd-test-", dir=memory_folder()) as folder:
        made = VirtualTrainer(
            Path(folder), configs, trainer_file=trainer_file, edits=edits, pace=pace
        )
        with made:
            yield made.start_all()
