"""The environment of an act: its folder, virtual drives and service as processes, its time.

An act runs in simulated time, in which the demonstration has a seat like the core: time passes
only while it waits. With `--wall-clock` time is the computer's. The service is `gaitd run`.
"""

import contextlib
import math
import shutil
import tempfile
import time
import tomllib
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec
from gaitd_client import read_credentials

from daemon.config.edits import Edits
from daemon.config.settings import Robot
from daemon.keys import issuing
from daemon.keys.folder import ISSUED
from gaitd_lab.demonstration.clients import start_client
from gaitd_lab.demonstration.script import READY_WITHIN_S
from gaitd_lab.demonstration.turns import pass_turn
from gaitd_lab.processes import (
    ManagedProcess,
    ServiceError,
    ServiceProcesses,
    Tempo,
    memory_folder,
)
from gaitd_lab.trials import balanced
from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.page import PageWriter, page_path
from simtime.wire import Role

TURN_S: Final = 0.1
HAND_NAME, SEAT_NAME, CORE_SEAT = "demo", "demo", "core"
OWN: Final = "demo"
"""The demonstration's own client, where each client has keys."""
KEYS_DAYS: Final = 1


class ActTime(PageClock):
    """The time of an act.

    Simulated time is held until core and gateway are connected, so that an act begins at the same
    instant for both on each run; then the demonstration takes a seat in step.
    """

    def __init__(self, channel: Path, begin_ns: int, tempo: Tempo) -> None:
        """Begin no earlier than the end of the previous act.

        Args:
            channel: socket of the act's simulated bus.
            begin_ns: end of the previous act.
            tempo: pace of the time.
        """
        page = PageWriter(page_path(channel))
        page.begin(max(begin_ns, page.left_ns), time.time_ns() - begin_ns, wall_clock=False)
        page.leave()
        super().__init__(channel)
        self._is_wall_clock = tempo.wall_clock
        self._hand = SocketLink(channel, Role.HAND, HAND_NAME)
        self._link = SocketLink(channel, Role.IN_STEP, SEAT_NAME)
        self._threads = ThreadPoolExecutor(1, "time")
        self._made_wall_s = time.monotonic()
        self.began_ns: int | None = None
        """Time at which core and gateway were connected; None: they are not."""
        self._began_wall_s = 0.0

    @property
    def speed_ratio(self) -> float | None:
        """Ratio of the act's time to the computer's; None before it is known."""
        wall_s = time.monotonic() - self._began_wall_s
        if self.began_ns is None or wall_s < 1:
            return None
        return (self.now_ns() - self.began_ns) * 1e-9 / wall_s

    def turn(
        self,
        meanwhile: Callable[[], None],
        newest_ns: Callable[[], int | None],
        *,
        gateway_is_there: bool,
    ) -> None:
        """Let a turn pass: by the computer's time until the act begins, then in the act's.

        Args:
            meanwhile: is called while it passes: a live view takes as long to draw as half a turn.
            newest_ns: as of `pass_turn`.
            gateway_is_there: the gateway is connected.

        Raises:
            ServiceError: core and gateway have not come in time.
        """
        passing = self._threads.submit(self._turn, newest_ns, gateway_is_there=gateway_is_there)
        meanwhile()
        passing.result()

    def _turn(self, newest_ns: Callable[[], int | None], *, gateway_is_there: bool) -> None:
        try:
            if self.began_ns is None and gateway_is_there and self._core_is_there():
                self._begin()
            if self.began_ns is not None:
                pass_turn(self._link, round(TURN_S * 1e9), newest_ns)
                return
        except LinkLostError:
            pass  # the ended process is detected by its exit code
        if self.began_ns is None and time.monotonic() - self._made_wall_s > READY_WITHIN_S:
            raise ServiceError(f"core and gateway are not there within {READY_WITHIN_S:g} s")
        time.sleep(TURN_S)

    def close(self) -> None:
        """Give up the seat; a turn that still passes ends with it, or with the virtual drives."""
        self._threads.shutdown(wait=False)
        self._link.close()
        self._hand.close()

    def _core_is_there(self) -> bool:
        if self._is_wall_clock:
            return True
        self._hand.open()
        return CORE_SEAT in self._hand.command("seats").split()

    def _begin(self) -> None:
        self._link.open()
        if not self._is_wall_clock:
            self._hand.command("go")
            self._hand.close()
        self.began_ns, self._began_wall_s = self._link.now_ns(), time.monotonic()


class Stage(ServiceProcesses):
    """Files, processes and time of one act."""

    def __init__(
        self,
        folder: Path,
        trainer: Path,
        edits: Edits,
        roles: Mapping[str, str],
        *,
        tempo: Tempo,
        begin_ns: int,
    ) -> None:
        """Write the configuration of the act; see `stage`."""
        super().__init__(
            folder, trainer.parent, trainer_file=trainer.name, edits=edits, tempo=tempo
        )
        self.credentials: dict[str, Path] = {}
        """Folder of each client's credentials; empty: the service has no keys."""
        if roles:
            self._issue_keys(roles)
        self._clients: list[ManagedProcess] = []
        self._needed: list[ManagedProcess] = []
        self.time = ActTime(self.channel, begin_ns, tempo)

    def _issue_keys(self, roles: Mapping[str, str]) -> None:
        """Make the service's keys, and those of its clients, as `gaitd keys` does."""
        text = self.config.read_text(encoding="utf-8")
        self.config.write_text(text.replace("[zenoh]\n", '[zenoh]\nkeys = "keys"\n'), "utf-8")
        keys, now = self.config.parent / "keys", datetime.now(UTC)
        issuing.init(keys, self.target.trainer, [], now, KEYS_DAYS)
        for role in roles.values():
            endpoints = self.target.endpoints
            issuing.issue(keys, role, endpoints, self.target.trainer, now, KEYS_DAYS, remote=False)
        self.credentials = {client: keys / ISSUED / role for client, role in roles.items()}
        self.target = self.target._replace(credentials=read_credentials(self.credentials[OWN]))

    def start_all(self) -> None:
        """Start the virtual drives, with time held if it is simulated, and the service."""
        held = () if self.tempo.wall_clock else ("--hold",)
        self.start("sim", *self.output_arguments, *self.time_arguments, *held)
        self.start("run")

    def start_client(self, kind: str, settings: str, *, is_needed: bool = True) -> None:
        """Start a client; `check` does not miss one that is not needed."""
        client = start_client(kind, self, settings)
        self._clients.append(client)
        if is_needed:
            self._needed.append(client)

    def check(self) -> None:
        """As `ServiceProcesses.check`, also of the clients that are needed."""
        super().check()
        for client in self._needed:
            client.check()

    def end_clients(self) -> None:
        """Give up the seat, then end the clients in the act's time."""
        self.time.close()
        for client in self._clients:
            client.end()

    def end(self) -> None:
        """End all processes; the clients first."""
        self.end_clients()
        super().end()


@contextlib.contextmanager
def stage(
    trainer: Path,
    edits: Edits,
    roles: Mapping[str, str],
    *,
    tempo: Tempo,
    begin_ns: int,
) -> Generator[Stage]:
    """Start all of one act; it is ended in every case.

    The folder of a successful act is removed; after an error it is kept, and the error names it.

    Args:
        trainer: trainer file among the project's configurations.
        edits: what is different in the act's own configuration.
        roles: of the clients that get keys, OWN among them; empty: the service has no keys.
        tempo: pace of its time.
        begin_ns: its time begins no earlier.
    """
    folder = Path(tempfile.mkdtemp(prefix="gaitd-demo-", dir=memory_folder()))
    kept = False
    try:
        with Stage(folder, trainer, edits, roles, tempo=tempo, begin_ns=begin_ns) as made:
            made.start_all()
            yield made
    except ServiceError as error:
        error.folder, kept = folder, True
        raise
    finally:
        if not kept:
            shutil.rmtree(folder, ignore_errors=True)


def empty_edits(trainer: Path) -> Edits:
    """Return the edits for an empty machine that its springs carry in the start pose of all legs.

    Springs set for a patient push the empty machine up to its stop, as its file states; an
    operator reduces them before an experiment on it.
    """
    name = "robot_empty.toml"
    text = (trainer.parent / name).read_text(encoding="utf-8")
    robot = msgspec.toml.decode(text, type=Robot)
    plant = tomllib.loads(trainer.read_text(encoding="utf-8"))["sim"]
    start = tomllib.loads((trainer.parent / plant).read_text(encoding="utf-8"))["start"]
    pose = math.radians(start["hip"]["position_deg"]), start["slide"]["position_m"]
    springs = balanced(robot, pose).springs
    return {
        trainer.name: {"robot": name},
        plant: {"robot": name},
        name: {
            "springs.hip.rest_rad": round(springs.hip.rest_rad, 6),
            "springs.slide.rest_m": round(springs.slide.rest_m, 6),
        },
    }
