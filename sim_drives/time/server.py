"""Server of simulated time: clients of the bus's socket become seats of a `Conductor`.

Rules:
1.  Time passes only while every seat in step waits, no controlling client holds it, and the pace
    permits. It then advances to the first instant at which a seat may continue.
2.  The pace: simulated time is at most `pace` times as fast as the computer's. A delay above
    BEHIND_MAX_NS is not made up for: a stall of the computer stretches time, nothing else.
    Time may run AHEAD_MAX_NS ahead, so this process sleeps once a cycle and not at every event.
3.  A client that has disconnected is no longer a seat. One whose process is stopped (state T, as
    after SIGSTOP) is not waited for until it continues, nor is one that has sent nothing for HUNG_S
    until its next message. One that a debugger has stopped (state t) is waited for.
4.  While no seat is in step, time passes at the pace of the computer's, at most.
5.  A hold belongs to the connection of the controlling client ("hand") and ends with it. A server
    that begins held (`gaitd sim --hold`) lets no time pass until such a client sends `go` or `run`.

Commands of a hand, or of the command socket, in addition to those of the virtual drives:

    pace 1 | N | max            how fast time passes, relative to the computer's
    at SECONDS LINE             execute LINE after exactly this time
    stall NAME SECONDS          this time passes without the seat NAME
    cost SEED | off             every seat in step computes 0.3 to 3 ms before it answers
    seats                       the names of the seats in step
    hold, go                    stop time, resume it (hands only)
    run SECONDS                 advance time by this much as fast as possible, then answer, once
                                every seat in step waits again (hands only)
"""

import contextlib
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sim_drives.control import ControlSocket
from sim_drives.faults.script import FaultCommandError
from sim_drives.time.bus_server import BusServer, Connection
from sim_drives.time.conductor import Conductor, Seat, World, computing_cost
from simtime import wire
from simtime.page import PageWriter
from simtime.processes import IN_A_DEBUGGER, STOPPED, process_state
from simtime.wire import Role

NS_PER_S: Final = 1_000_000_000
AHEAD_MAX_NS: Final = 10_000_000
BEHIND_MAX_NS: Final = 20_000_000
CHECK_S: Final = 0.02
"""Interval between checks of a process that is waited for."""
STOPPED_CHECKS: Final = 3
"""Tolerance: a signal to a process group reaches its members, this process included, in turn."""
HUNG_CHECKS: Final = 500
"""10 s, counted in checks of this process: a stall of the whole computer counts as one."""
IDLE_STEP_NS: Final = 5_000_000
"""Time step while no seat is in step."""
QUIET_ROW_NS: Final = 10_000_000
SYNC_SILENCE_NS: Final = 20_000_000
PACE_MAX: Final = 0.0
"""Pace without a limit."""
PACE_RATIO_MIN, PACE_RATIO_MAX = 0.01, 1000.0
DELAY_MAX_S: Final = 86_400.0


def parse_pace(text: str) -> float:
    """Parse a pace: `max`, or a multiple of the computer's time.

    Raises:
        ValueError: it is neither; the message names the allowed forms.
    """
    if text == "max":
        return PACE_MAX
    with contextlib.suppress(ValueError):
        pace_ratio = float(text)
        if PACE_RATIO_MIN <= pace_ratio <= PACE_RATIO_MAX:
            return pace_ratio
    raise ValueError(f"a pace is max, or {PACE_RATIO_MIN:g} to {PACE_RATIO_MAX:g}; not {text!r}")


@dataclass
class _Client:
    """A connection and its role for time."""

    connection: Connection
    role: Role
    seat: Seat
    checks: int = 0
    """Consecutive checks while it was waited for."""
    stopped_checks: int = 0
    """Consecutive checks at which its process was stopped."""
    is_stopped: bool = False
    """True if it is not waited for because of its state."""


@dataclass
class _Run:
    """A pending `run` of a hand."""

    client: _Client
    until_ns: int


class _Pace:
    """Limits how far time may have passed by now."""

    def __init__(self, ratio: float, now_ns: int) -> None:
        self.ratio = ratio
        self._anchor_ns, self._anchor_wall_ns = now_ns, time.monotonic_ns()
        self._pauses = False

    def ahead_ns(self, now_ns: int, ratio: float) -> int:
        """Time ahead of the allowed one; the anchor is set anew where time is behind."""
        if ratio == PACE_MAX:
            self.anchor(now_ns)
            return 0
        wall_ns = time.monotonic_ns() - self._anchor_wall_ns
        ahead_ns = now_ns - self._anchor_ns - round(ratio * wall_ns)
        if ahead_ns < -BEHIND_MAX_NS:
            self.anchor(now_ns)
            return 0
        return ahead_ns

    def pause_s(self, now_ns: int, ratio: float) -> float:
        """Time to sleep before simulated time may pass again; 0: it may."""
        ahead_ns = self.ahead_ns(now_ns, ratio)
        self._pauses = ahead_ns > (0 if self._pauses else AHEAD_MAX_NS)
        return ahead_ns / ratio * 1e-9 if self._pauses else 0.0

    def anchor(self, now_ns: int) -> None:
        """Set the anchor to now."""
        self._anchor_ns, self._anchor_wall_ns = now_ns, time.monotonic_ns()


class TimeServer:
    """Advances time for the world of the virtual drives and the clients on its bus."""

    def __init__(
        self,
        world: World,
        server: BusServer,
        page: PageWriter,
        *,
        pace_ratio: float,
        begins_held: bool = False,
        obey: Callable[[str], str],
        on_silence: Callable[[int], None] | None = None,
        sync_count: Callable[[], int] = lambda: 0,
    ) -> None:
        """Serve a world on a socket.

        Args:
            world: world of the virtual drives.
            server: server of the socket.
            page: page where time can be read.
            pace_ratio: how fast time may pass relative to the computer's; PACE_MAX: no limit.
            begins_held: no time passes until a hand releases it.
            obey: executes commands to the virtual drives.
            on_silence: called every QUIET_ROW_NS while no SYNC comes, with the last one's number.
            sync_count: number of SYNCs so far.
        """
        self._conductor = Conductor(world)
        self._server, self._page, self._obey = server, page, obey
        self.control: ControlSocket | None = None
        """The command socket, if there is one."""
        self._on_silence, self._sync_count = on_silence, sync_count
        self._recorded = (sync_count(), world.now_ns + SYNC_SILENCE_NS)
        self._clients: dict[Connection, _Client] = {}
        self._holding: set[Connection] = set()
        self._begins_held = begins_held
        self._runs: list[_Run] = []
        self._cost_seed: int | None = None
        self._costed: Counter[str] = Counter()
        """Number of seats that draw from the seed, by name; each has draws of its own."""
        self._utc_ahead_ns = time.time_ns() - time.monotonic_ns()
        self._pace = _Pace(pace_ratio, world.now_ns)
        server.on_leave = self._leave
        page.begin(world.now_ns, self._utc_ahead_ns, wall_clock=False)
        page.write_pace(pace_ratio)

    @property
    def now_ns(self) -> int:
        """Simulated time."""
        return self._conductor.world.now_ns

    def run(self, should_end: Callable[[], bool]) -> None:
        """Run until `should_end` returns true; it is called at least every LOOK_S."""
        try:
            self._run(should_end)
        finally:
            self._page.leave()

    def _run(self, should_end: Callable[[], bool]) -> None:
        while not should_end():
            if self.control is not None:
                self.control.serve()
            timeout_s = self._timeout_s()
            messages = self._server.receive(timeout_s)
            for connection, message in messages:
                client = self._clients.get(connection)
                if client is not None or isinstance(message, wire.Hello):
                    self._take(connection, client, message)
            if self._may_pass(is_quiet=not messages):
                self._step()

    # --- whether time may pass ----------------------------------------------------------------

    def _timeout_s(self) -> float:
        """Return how long to wait for a message."""
        if self._is_held() or self._conductor.missing() is not None:
            return CHECK_S
        return min(self._pace.pause_s(self.now_ns, self._ratio()), CHECK_S)

    def _may_pass(self, *, is_quiet: bool) -> bool:
        for client in self._clients.values():
            if client.is_stopped and process_state(client.connection.pid) != STOPPED:
                self._expect(client)
        missing = self._conductor.missing()
        if missing is not None:
            if is_quiet:
                self._check_seat(missing)
            return False
        self._end_runs()
        return not self._is_held() and self._pace.pause_s(self.now_ns, self._ratio()) == 0

    def _is_held(self) -> bool:
        return (self._begins_held or bool(self._holding)) and not self._runs

    def _ratio(self) -> float:
        if self._runs:
            return PACE_MAX
        seats = self._conductor.seats
        if any(seat.in_step and not seat.is_excused for seat in seats):
            return self._pace.ratio
        return min(self._pace.ratio, 1.0) or 1.0

    def _check_seat(self, seat: Seat) -> None:
        """Check whether the process that time waits for can answer."""
        client = next(one for one in self._clients.values() if one.seat is seat)
        state = process_state(client.connection.pid)
        client.checks = 0 if state == IN_A_DEBUGGER else client.checks + 1
        client.stopped_checks = client.stopped_checks + 1 if state == STOPPED else 0
        client.is_stopped = client.stopped_checks >= STOPPED_CHECKS
        seat.is_excused = client.is_stopped or client.checks > HUNG_CHECKS
        if seat.is_excused:
            self._pace.anchor(self.now_ns)
        if client.checks > HUNG_CHECKS:
            name, hung_s = client.connection.name, HUNG_CHECKS * CHECK_S
            print(
                f"gaitd sim: {name}: no request for {hung_s:g} s; time continues without it",
                file=sys.stderr,
                flush=True,
            )

    @staticmethod
    def _expect(client: _Client) -> None:
        client.checks, client.stopped_checks = 0, 0
        client.is_stopped = client.seat.is_excused = False

    # --- time passes --------------------------------------------------------------------------

    def _step(self) -> None:
        in_step = any(seat.in_step and seat.wait is not None for seat in self._conductor.seats)
        limits = [] if in_step else [self.now_ns + IDLE_STEP_NS]
        limits += [run.until_ns for run in self._runs]
        granted = self._conductor.step(min(limits) if limits else None)
        self._page.write(self.now_ns)
        for client in tuple(self._clients.values()):
            if client.seat in granted:
                self._grant(client)
            elif client.role in {Role.LISTENER, Role.HAND}:
                self._hand_over(client)
        self._record_silence()

    def _grant(self, client: _Client) -> None:
        client.checks = 0
        self._hand_over(client)
        self._server.send(client.connection, wire.pack_grant(self.now_ns))

    def _hand_over(self, client: _Client) -> None:
        if client.seat.waiting:
            frames, client.seat.waiting = client.seat.waiting, []
            if client.role is not Role.HAND:
                self._server.send_frames(client.connection, frames)

    def _end_runs(self) -> None:
        for run in [one for one in self._runs if self.now_ns >= one.until_ns]:
            self._runs.remove(run)
            self._server.send(run.client.connection, wire.pack_reply("", refused=False))
            self._pace.anchor(self.now_ns)

    def _record_silence(self) -> None:
        count, noted_ns = self._recorded
        if self._sync_count() != count:
            self._recorded = (self._sync_count(), self.now_ns + SYNC_SILENCE_NS)
        elif self._on_silence is not None and self.now_ns >= noted_ns + QUIET_ROW_NS:
            self._recorded = (count, self.now_ns)
            self._on_silence(count)

    # --- messages -----------------------------------------------------------------------------

    def _take(self, connection: Connection, client: _Client | None, message: wire.ToServer) -> None:
        if client is not None:
            self._expect(client)
        match message:
            case wire.Hello():
                self._join(connection, message)
            case wire.Send(_, frames) if client:
                self._conductor.send(client.seat, frames)
                self._page.write(self.now_ns)
                self._update_listeners()
            case wire.Wait(until_ns, for_frame) if client:
                self._wait_for_seat(client, until_ns, for_frame=for_frame)
            case wire.Hand(line) if client:
                self._command(client, line)
            case _:
                pass

    def _join(self, connection: Connection, hello: wire.Hello) -> None:
        in_step = hello.role is Role.IN_STEP
        waits = hello.role in {Role.IN_STEP, Role.BESIDE}
        stands = not any(one.in_step for one in self._conductor.seats)
        if waits and stands and hello.now_ns > self.now_ns:
            self._conductor.step(hello.now_ns)  # its time must not go back
            self._pace.anchor(self.now_ns)
            self._page.write(self.now_ns)
        seat = self._conductor.join(hello.name, in_step=in_step)
        seat.utc_ahead_ns, seat.keeps_sent = self._utc_ahead_ns, False
        self._clients[connection] = _Client(connection, hello.role, seat)
        self._set_cost(seat)
        welcome = wire.Welcome(self.now_ns, self._utc_ahead_ns, wall_clock=False)
        self._server.send(connection, wire.pack_welcome(welcome))

    def _leave(self, connection: Connection) -> None:
        client = self._clients.pop(connection, None)
        if client is not None:
            self._conductor.leave(client.seat)
            self._holding.discard(connection)
            self._runs = [run for run in self._runs if run.client is not client]
            self._pace.anchor(self.now_ns)

    def _wait_for_seat(self, client: _Client, until_ns: int, *, for_frame: bool) -> None:
        if client.seat.wait is not None:
            self._server.refuse(client.connection, "it already waits: one WAIT, one GRANT")
            return
        self._conductor.start_wait(client.seat, until_ns, for_frame=for_frame)
        self._page.write(self.now_ns)
        if client.seat.wait is None:
            self._grant(client)

    def _update_listeners(self) -> None:
        for client in tuple(self._clients.values()):
            if client.role in {Role.LISTENER, Role.HAND}:
                self._hand_over(client)

    # --- commands -----------------------------------------------------------------------------

    def command(self, line: str) -> str:
        """Execute one line of a hand or of the command socket; returns what has been done.

        Raises:
            FaultCommandError: the line is invalid; the message gives the reason.
        """
        word, _, rest = line.strip().partition(" ")
        match word:
            case "pace":
                return self._set_pace(rest.strip())
            case "at":
                return self._plan(rest)
            case "stall":
                return self._stall(rest)
            case "cost":
                return self._set_costs(rest.strip())
            case "seats":
                return " ".join(seat.name for seat in self._conductor.seats if seat.in_step)
            case _:
                return self._obey(line)

    def _command(self, client: _Client, line: str) -> None:
        word, _, rest = line.strip().partition(" ")
        try:
            match word:
                case "hold":
                    self._holding.add(client.connection)
                    said = "time stopped"
                case "go":
                    self._holding.discard(client.connection)
                    self._begins_held = False
                    self._pace.anchor(self.now_ns)
                    said = "time continues"
                case "run":
                    until_ns = self.now_ns + round(_seconds(rest) * NS_PER_S)
                    self._runs.append(_Run(client, until_ns))
                    return
                case _:
                    said = self.command(line)
        except FaultCommandError as error:
            self._server.send(client.connection, wire.pack_reply(str(error), refused=True))
            return
        self._server.send(client.connection, wire.pack_reply(said, refused=False))

    def _set_pace(self, text: str) -> str:
        try:
            self._pace.ratio = parse_pace(text)
        except ValueError as error:
            raise FaultCommandError(str(error)) from error
        self._pace.anchor(self.now_ns)
        self._page.write_pace(self._pace.ratio)
        return f"pace {text}"

    def _plan(self, text: str) -> str:
        delay, _, line = text.strip().partition(" ")
        delay_s = _seconds(delay)
        if not line:
            raise FaultCommandError("at SECONDS LINE: there is no line")
        self._conductor.at(self.now_ns + round(delay_s * NS_PER_S), lambda: self._do_later(line))
        return f"in {delay_s:g} s: {line}"

    def _do_later(self, line: str) -> None:
        try:
            self.command(line)
        except FaultCommandError as error:
            print(f"gaitd sim: {line!r}: {error}", file=sys.stderr, flush=True)

    def _stall(self, text: str) -> str:
        name, _, duration = text.strip().partition(" ")
        duration_s = _seconds(duration)
        seats = [client.seat for client in self._clients.values() if client.seat.name == name]
        if not seats:
            known = ", ".join(sorted(seat.name for seat in self._conductor.seats)) or "none"
            raise FaultCommandError(f"no seat {name!r}; there are: {known}")
        for seat in seats:
            seat.hold(round(duration_s * NS_PER_S))
        return f"{name} is stopped for {duration_s:g} s"

    def _set_costs(self, text: str) -> str:
        if text != "off" and not text.isdecimal():
            raise FaultCommandError(f"cost SEED or cost off, not {text!r}")
        self._cost_seed = None if text == "off" else int(text)
        self._costed.clear()
        for seat in self._conductor.seats:
            self._set_cost(seat)
        return f"cost of computing {text}"

    def _set_cost(self, seat: Seat) -> None:
        if self._cost_seed is None or not seat.in_step:
            seat.cost = None
            return
        self._costed[seat.name] += 1
        seat.cost = computing_cost(self._cost_seed, f"{seat.name}/{self._costed[seat.name]}")


def _seconds(text: str) -> float:
    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and 0 <= value <= DELAY_MAX_S:
            return value
    raise FaultCommandError(f"seconds are 0 to {DELAY_MAX_S:g}, not {text.strip()!r}")
