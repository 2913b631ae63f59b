"""`gaitd core` compared with python-canopen as a master: same bus, same virtual drives, one run.

Each cell restarts drives and master, in turn, so that disturbances of this computer affect all
alike. Both masters hold both axes with the same spring and damper. A third station listens
(`bus_times.py`). Processor time is the master process' own, from /proc; for `gaitd core` it is the
core with its observer, safety and records, while the gateway runs beside it.

The peer is `gaitd_lab/peers/python_canopen_peer.py`, whose module docstring describes it.
"""

import contextlib
import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import can
from gaitd_client import ClientError, Mode, Trainer

from daemon.config.edits import edit
from gaitd_lab.benchmark.burning import burners
from gaitd_lab.benchmark.bus_times import (
    PERIOD_US,
    Reaction,
    Syncs,
    TimedFrame,
    held,
    reaction,
    syncs,
)
from gaitd_lab.benchmark.figures import Figure
from gaitd_lab.process_memory import sample
from gaitd_lab.processes import ManagedProcess, ServiceError, Tempo, memory_folder
from gaitd_lab.timed_service import TimedService

PEER: Final = "gaitd_lab.peers.python_canopen_peer"
STARTED_WITHIN_S: Final = 120.0
"""Time limit: the first start compiles the observer's kernels."""
HELD_WITHIN_S: Final = 20.0
"""Time limit to hold again after a stop."""
SETTLE_S: Final = 1.0
EMERGENCY_COUNT: Final = 8
"""Number in each cell and round."""
ROUND_COUNT: Final = 2
LATE_S: Final = 2.0
"""Largest delay from a frame's arrival to its reception."""
REACTION_S: Final = 0.4
EMERGENCY: Final = "emcy_warning right/hip 0.2 0x2310"
"""The drive reports an overcurrent, and leaves the stop to the master."""
FAILING: Final = 0
US_PER_S: Final = 1e6
NAN: Final = float("nan")
PEER_START_S: Final = 30.0
"""Longest time to import, connect and map."""


class Master(NamedTuple):
    """A master, one column of the table."""

    name: str
    ours: bool
    realtime: bool


MASTERS: Final = (
    Master("gaitd, SCHED_FIFO", ours=True, realtime=True),
    Master("gaitd, plain", ours=True, realtime=False),
    Master("python-canopen, SCHED_FIFO", ours=False, realtime=True),
    Master("python-canopen, plain", ours=False, realtime=False),
)


@dataclass(slots=True)
class Cell:
    """All rounds of one master, with or without load."""

    master: str
    loaded: bool
    syncs: list[Syncs] = field(default_factory=list[Syncs])
    cpu_ratio: list[float] = field(default_factory=list[float])
    """Share of one processor."""
    reactions: list[Reaction] = field(default_factory=list[Reaction])
    unanswered_count: int = 0
    """EMCYs after which the other drive was not stopped within REACTION_S."""
    stopped_count: int = 0
    """Number of times that the master stopped holding by itself."""


def measure(configs: Path, seconds: float) -> list[Figure]:
    """Measure all cells in turn, each in each round for so many seconds."""
    cells = {
        (master.name, loaded): Cell(master.name, loaded)
        for loaded in (False, True)
        for master in MASTERS
        if not master.realtime or _fifo_is_granted()
    }
    for number in range(ROUND_COUNT):
        for (name, loaded), cell in cells.items():
            load = ", under load" if loaded else ""
            print(f"measuring: {name}{load}, {number + 1} of {ROUND_COUNT}", file=sys.stderr)
            master = next(one for one in MASTERS if one.name == name)
            try:
                measure_cell(cell, master, configs, seconds, EMERGENCY_COUNT)
            except (ServiceError, TimeoutError, ValueError) as error:
                print(f"not measured: {name}: {error}", file=sys.stderr)
    return figures(list(cells.values()))


def _fifo_is_granted() -> bool:
    before = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        return False
    os.sched_setscheduler(0, before, os.sched_param(0))
    return True


def measure_cell(
    cell: Cell, master: Master, configs: Path, seconds: float, emergency_count: int
) -> None:
    """Measure one round of one cell, with its own drives.

    Raises:
        ServiceError: a process has ended.
        TimeoutError: the master does not hold the drives.
    """
    with (
        _drives(configs, realtime=master.realtime) as made,
        _listening(made) as listener,
        _subject(master, made) as subject,
    ):
        _hold(listener, subject, cell, first=True)
        with burners(os.cpu_count() or 1 if cell.loaded else 0):
            _measure_stretch(cell, listener, subject, seconds)
            for _ in range(emergency_count):
                _hold(listener, subject, cell)
                _measure_reaction(cell, listener, made)


def _measure_stretch(cell: Cell, listener: "Listener", subject: "Subject", seconds: float) -> None:
    listener.listen(SETTLE_S)
    before = sample(subject.process.pid, time.monotonic())
    frames = listener.listen(seconds)
    after = sample(subject.process.pid, time.monotonic())
    if before is None or after is None:
        raise ValueError(f"{cell.master} has ended")
    cell.syncs.append(syncs(frames))
    cell.cpu_ratio.append((after.cpu_s - before.cpu_s) / (after.time_s - before.time_s))
    cell.stopped_count += not held(frames)


def _measure_reaction(cell: Cell, listener: "Listener", made: TimedService) -> None:
    listener.listen(0.05)
    made.time.command_drives(EMERGENCY)
    result = reaction(listener.listen(REACTION_S), FAILING)
    if result is None:
        cell.unanswered_count += 1
    else:
        cell.reactions.append(result)


def _hold(listener: "Listener", subject: "Subject", cell: Cell, *, first: bool = False) -> None:
    """Bring both drives to hold, from any state.

    Raises:
        TimeoutError: they are not held in time.
    """
    end_s = time.monotonic() + (STARTED_WITHIN_S if first else HELD_WITHIN_S)
    asked_s = time.monotonic() + (subject.start_s if first else -subject.retry_s)
    while not held(listener.listen(0.3)):
        if time.monotonic() > end_s:
            words = subject.process.last_output()
            raise TimeoutError(f"{cell.master} does not hold the drives: {words}")
        subject.process.check()
        if time.monotonic() > asked_s + subject.retry_s:
            subject.recover()
            asked_s = time.monotonic()


# --- measured masters ---------------------------------------------------------------------------


class Subject(NamedTuple):
    """The control interface of a measured master."""

    process: ManagedProcess
    recover: Callable[[], None]
    """Requests the next step towards both drives held."""
    retry_s: float
    """Delay between two steps."""
    start_s: float
    """Delay before the first step."""


@contextlib.contextmanager
def _drives(configs: Path, *, realtime: bool) -> Generator[TimedService]:
    """Run virtual drives alone, and write a configuration for a core on their bus."""
    with (
        tempfile.TemporaryDirectory(prefix="gaitd-bench-", dir=memory_folder()) as folder,
        TimedService(configs, Path(folder), Tempo(wall_clock=True)) as made,
    ):
        if not realtime:
            edit(made.config.parent, {made.config.name: {"cycle.realtime_priority": 0}})
        made.start("sim")
        made.time.hold()
        yield made


@contextlib.contextmanager
def _subject(master: Master, made: TimedService) -> Generator[Subject]:
    if master.ours:
        core = made.start("core")
        made.start("gateway")
        yield Subject(core, lambda: _operate(made), retry_s=0.5, start_s=0.0)
        return
    eds = made.config.parent / "drives" / "epos4.eds"
    arguments = ["-m", PEER, "--channel", str(made.channel), "--eds", str(eds)]
    arguments += ["--fifo"] if master.realtime else []
    peer = ManagedProcess(master.name, arguments, made.folder / "peer.log")
    try:
        recover = partial(peer.send_signal, signal.SIGUSR1)
        yield Subject(peer, recover, retry_s=3.0, start_s=PEER_START_S)
    finally:
        peer.end()


def _operate(made: TimedService) -> None:
    """Send the operator's next request towards hold."""
    with contextlib.suppress(ClientError), Trainer.of(made.target, client="gaitd bench") as trainer:
        mode = trainer.status().safety.mode
        if mode == Mode.FAULT:
            trainer.request("reset")
        elif mode == Mode.READY:
            trainer.request("enable")


class Listener:
    """A listener on the bus."""

    def __init__(self, bus: can.BusABC) -> None:
        """Listen on `bus`."""
        self._bus = bus

    def listen(self, seconds: float) -> list[TimedFrame]:
        """Return all frames since the last call, and those of a further period from now.

        Beside load processes the reception is late, so the arrival time counts.
        """
        frames: list[TimedFrame] = []
        end_us = (time.time() + seconds) * US_PER_S
        patient_s = time.monotonic() + seconds + LATE_S
        while (left_s := patient_s - time.monotonic()) > 0:
            message = self._bus.recv(left_s)
            if message is not None:
                time_us = message.timestamp * US_PER_S
                frames.append(TimedFrame(time_us, message.arbitration_id, bytes(message.data)))
                if time_us > end_us:
                    break
        return frames


@contextlib.contextmanager
def _listening(made: TimedService) -> Generator[Listener]:
    end_s = time.monotonic() + STARTED_WITHIN_S
    while True:
        try:
            bus = can.Bus(interface="gaitd", channel=str(made.channel))
            break
        except (OSError, can.CanError):
            if time.monotonic() > end_s:
                raise
            time.sleep(0.2)
    with bus:
        yield Listener(bus)


# --- figures --------------------------------------------------------------------------------------


def _of_syncs(name: str) -> Callable[[Cell], float]:
    """Median over the rounds of one figure of `Syncs`; NaN if there is none."""
    return lambda cell: statistics.median([getattr(one, name) for one in cell.syncs] or [NAN])


ROWS: Final[tuple[tuple[str, str, Callable[[Cell], float]], ...]] = (
    ("SYNC interval, standard deviation", "µs", _of_syncs("jitter_std_us")),
    ("SYNC off 10 ms, 99 %", "µs", _of_syncs("jitter_p99_us")),
    ("SYNC off 10 ms, worst", "µs", _of_syncs("jitter_worst_us")),
    ("cycles without new commands", "of 1", _of_syncs("without_command_ratio")),
    ("last TPDO to last command, median", "µs", _of_syncs("answer_median_us")),
    (
        "computing in a cycle",
        "µs",
        lambda cell: statistics.median(cell.cpu_ratio or [NAN]) * PERIOD_US,
    ),
    (
        "EMCY to the other's quick stop on the bus, median",
        "µs",
        lambda cell: statistics.median([one.commanded_us for one in cell.reactions] or [NAN]),
    ),
    (
        "EMCY until the other drive shows it, worst",
        "µs",
        lambda cell: max([one.shown_us for one in cell.reactions] or [NAN]),
    ),
    ("EMCYs without a quick stop", "", lambda cell: float(cell.unanswered_count)),
)
"""What is measured, its unit, and how it is found."""


def figures(cells: Sequence[Cell]) -> list[Figure]:
    """Each figure of ours beside that of python-canopen, by scheduling and load."""
    found = {(cell.master, cell.loaded): cell for cell in cells}
    return [
        Figure(
            what=f"{what}, {scheduling}{', under load' if loaded else ''}",
            value=figure(found[f"gaitd, {scheduling}", loaded]),
            unit=unit,
            peer="python-canopen",
            peer_value=figure(found[f"python-canopen, {scheduling}", loaded]),
        )
        for loaded in (False, True)
        for scheduling in ("SCHED_FIFO", "plain")
        if (f"gaitd, {scheduling}", loaded) in found
        for what, unit, figure in ROWS
    ]
