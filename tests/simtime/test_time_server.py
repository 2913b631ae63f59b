"""Time passes while every seat in step waits, and only then: over the socket, in one process."""

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import can
import pytest

from drives.canopen.frame import Frame
from sim_drives.faults.script import FaultCommandError
from sim_drives.time import server as time_server
from sim_drives.time.bus_server import bus_server
from sim_drives.time.conductor import COST_MAX_NS, COST_MIN_NS
from sim_drives.time.server import AHEAD_MAX_NS, PACE_MAX, TimeServer
from simtime import wire
from simtime.clock import PageClock
from simtime.link import LinkLostError, SocketLink
from simtime.page import MAGIC, PageError, PageWriter, SimulatedTime, page_path
from simtime.processes import STOPPED, process_state
from simtime.wire import Role

MS = 1_000_000
START_NS = 10**15
BEAT_NS = 50 * MS


class Beating:
    """A world that sends a heartbeat every 50 ms, and keeps what it receives."""

    def __init__(self):
        self.now_ns = START_NS
        self.received = []

    def receive(self, frame):
        self.received.append((self.now_ns, frame.can_id))

    def advance_to(self, time_ns):
        first = self.now_ns // BEAT_NS + 1
        beats = range(first, time_ns // BEAT_NS + 1)
        self.now_ns = time_ns
        return [Frame(0x705, b"\x05", beat * BEAT_NS) for beat in beats]

    def next_event_ns(self):
        return (self.now_ns // BEAT_NS + 1) * BEAT_NS


class Served:
    def __init__(self, path, world):
        self.path, self.world, self.obeyed = path, world, []
        self._ended = threading.Event()
        self._begun = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        assert self._begun.wait(60)

    def _serve(self):
        with bus_server(self.path) as served:
            page = PageWriter(page_path(self.path))
            server = TimeServer(self.world, served, page, pace_ratio=PACE_MAX, obey=self._obey)
            self._begun.set()
            server.run(self._ended.is_set)

    def _obey(self, line):
        if line == "nonsense":
            raise FaultCommandError("no such fault")
        self.obeyed.append((self.world.now_ns, line))
        return f"did {line}"

    def seat(self, role=Role.IN_STEP, name="core"):
        made = SocketLink(self.path, role, name)
        made.open()
        return made

    def end(self):
        self._ended.set()
        self._thread.join(60)
        assert not self._thread.is_alive()


@pytest.fixture
def served(tmp_path):
    made = Served(tmp_path / "bus", Beating())
    yield made
    made.end()


def begun_ns(seat):
    """The present, in which it waits: nothing passes any more without it."""
    seat.wait(0, for_frame=False)
    return seat.now_ns()


def test_a_wait_ends_at_its_instant_or_with_the_first_frame(served):
    core = served.seat()
    now_ns = begun_ns(core)

    core.wait(now_ns + 7 * MS, for_frame=False)
    assert core.now_ns() == now_ns + 7 * MS

    core.take()
    core.wait(core.now_ns() + 10_000 * MS, for_frame=True)
    (beat,) = core.take()
    assert core.now_ns() % BEAT_NS == 0
    assert beat.time_ns == core.utc_ns()


def test_time_waits_for_every_seat_in_step_and_frames_reach_the_others_at_their_instant(served):
    core = served.seat()
    node = served.seat(name="node")
    now_ns = begun_ns(core)
    waits = threading.Thread(target=node.wait, args=(now_ns + 20 * MS,), kwargs={"for_frame": True})
    waits.start()

    core.send([Frame(0x123, b"\x01")])
    core.wait(now_ns, for_frame=False)  # until then it computes, and nothing is granted
    waits.join(60)

    assert node.now_ns() == now_ns
    assert [frame.can_id for frame in node.take()] == [0x123]
    assert served.world.received == [(now_ns, 0x123)]
    assert served.world.now_ns == now_ns


def test_a_seat_that_has_gone_is_not_waited_for(served):
    core, other = served.seat(), served.seat(name="other")
    now_ns = begun_ns(core)

    other.close()
    core.wait(now_ns + 1000 * MS, for_frame=False)

    assert core.now_ns() == now_ns + 1000 * MS


def test_a_process_that_is_stopped_is_not_waited_for_until_it_goes_on(served):
    program = (
        "import sys, pathlib; from simtime.link import SocketLink; from simtime.wire import Role\n"
        "seat = SocketLink(pathlib.Path(sys.argv[1]), Role.IN_STEP, 'other'); seat.open()\n"
        "print('here', flush=True)\n"
        "while True: seat.wait(seat.now_ns() + 1000000, for_frame=False)"
    )
    core = served.seat()
    words = [sys.executable, "-c", program, str(served.path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]) as other:
        assert other.stdout.readline() == b"here\n"
        os.kill(other.pid, signal.SIGSTOP)
        while process_state(other.pid) != STOPPED:
            pass
        now_ns = begun_ns(core)

        core.wait(now_ns + 1000 * MS, for_frame=False)

        assert core.now_ns() == now_ns + 1000 * MS
        other.kill()


def test_a_hand_holds_time_lets_it_run_and_does_things_at_an_instant(served):
    hand = served.seat(Role.HAND, "test")
    core = served.seat()
    now_ns = begun_ns(core)
    ended = []
    long_wait = threading.Thread(
        target=lambda: ended.append(core.wait(now_ns + 100 * MS, for_frame=False))
    )
    hand.command("hold")
    long_wait.start()

    assert hand.command("at 0.025 silent right/hip 0.5") == "in 0.025 s: silent right/hip 0.5"
    hand.command("run 0.06")
    assert served.world.now_ns == now_ns + 60 * MS
    assert served.obeyed == [(now_ns + 25 * MS, "silent right/hip 0.5")]

    hand.close()  # a hold ends with its connection
    long_wait.join(60)
    assert served.world.now_ns == now_ns + 100 * MS


def test_a_stall_passes_without_a_seat_exactly(served):
    hand, core = served.seat(Role.HAND, "test"), served.seat()
    now_ns = begun_ns(core)

    hand.command("stall core 0.035")
    core.wait(now_ns + 10 * MS, for_frame=False)

    assert core.now_ns() == now_ns + 35 * MS


def test_seats_compute_at_the_same_time_before_they_answer_for_as_long_as_a_seed_says(served):
    hand = served.seat(Role.HAND, "test")
    seats = {0x205: served.seat(), 0x206: served.seat(name="node")}

    def both(*, for_frame):
        until_ns = hand.now_ns() + (2 * BEAT_NS if for_frame else 5 * MS)
        waits = [
            threading.Thread(target=seat.wait, args=(until_ns,), kwargs={"for_frame": for_frame})
            for seat in seats.values()
        ]
        for wait in waits:
            wait.start()
        for wait in waits:
            wait.join(60)
        for seat in seats.values():
            seat.take()

    def costs(*order):
        hand.command("cost 5")
        found = []
        for _ in range(3):
            both(for_frame=True)
            beat_ns = hand.now_ns()
            served.world.received.clear()
            for can_id in order:
                seats[can_id].send([Frame(can_id, b"")])
            both(for_frame=False)  # until they have computed
            found.append({can_id: at_ns - beat_ns for at_ns, can_id in served.world.received})
        return found

    first = costs(0x205, 0x206)
    drawn_ns = [cost_ns for one in first for cost_ns in one.values()]
    assert len(set(drawn_ns)) == 6
    assert all(COST_MIN_NS <= cost_ns <= COST_MAX_NS for cost_ns in drawn_ns)
    assert costs(0x206, 0x205) == first


def test_a_hung_program_is_excused_loudly_and_time_passes_no_faster_than_real(
    served, monkeypatch, capsys
):
    monkeypatch.setattr(time_server, "HUNG_CHECKS", 5)
    hung = served.seat(name="hung")
    core = served.seat()

    core.wait(begun_ns(core) + MS, for_frame=False)
    assert "hung (pid" in (said := capsys.readouterr().err)
    assert "no request for 0.1 s; time continues without it" in said

    core.close()  # at this server's pace, as fast as it can, an hour would pass
    begun_wall_ns, alone_ns = time.monotonic_ns(), served.world.now_ns
    time.sleep(0.1)
    passed_ns, passed_wall_ns = served.world.now_ns - alone_ns, time.monotonic_ns() - begun_wall_ns
    assert 0 < passed_ns <= passed_wall_ns + 2 * AHEAD_MAX_NS
    hung.close()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("nonsense", "no such fault"),
        ("pace 0", "a pace is max, or 0.01 to 1000; not '0'"),
        ("run -1", "seconds are 0 to 86400"),
        ("at 1", "there is no line"),
        ("stall gateway 1", "no seat 'gateway'; there are: test"),
        ("cost more", "cost SEED or cost off"),
    ],
)
def test_a_command_that_makes_no_sense_is_refused_with_what_is_allowed(served, line, said):
    hand = served.seat(Role.HAND, "test")

    with pytest.raises(ValueError, match=said):
        hand.command(line)


def test_a_client_that_talks_nonsense_is_sent_away_and_no_other_notices(served, capsys):
    core, bad = served.seat(), served.seat(name="bad")

    bad._socket.send(b"\xff nonsense")
    with pytest.raises(LinkLostError, match="begins with its kind"):
        bad.wait(0, for_frame=False)
    core.wait(core.now_ns() + MS, for_frame=False)


def test_python_can_joins_as_a_listener_and_as_a_seat_in_step(served):
    core = served.seat()
    with can.Bus(interface="gaitd", channel=str(served.path)) as logger:
        core.wait(begun_ns(core) + BEAT_NS, for_frame=False)
        assert logger.recv(10).arbitration_id == 0x705
        logger.send(can.Message(arbitration_id=0x181, data=b"\x01", is_extended_id=False))
        core.take()
        while not any(frame.can_id == 0x181 for frame in core.take()):
            core.wait(core.now_ns() + MS, for_frame=False)
        with pytest.raises(can.CanOperationError, match="11-bit"):
            logger.send(can.Message(arbitration_id=0x18000000, is_extended_id=True))
    core.close()
    with can.Bus(interface="gaitd", channel=str(served.path), in_step=True) as node:
        stamps = [node.recv(1.0).timestamp for _ in range(3)]
    assert stamps[2] - stamps[0] == pytest.approx(2 * BEAT_NS * 1e-9, abs=1e-6)


def test_a_notifier_of_python_can_hands_on_all_frames_of_one_message(served):
    core = served.seat()

    async def received_ids():
        with can.Bus(interface="gaitd", channel=str(served.path)) as bus:
            reader = can.AsyncBufferedReader()
            with can.Notifier(bus, [reader], loop=asyncio.get_running_loop()):
                core.send([Frame(number, b"") for number in (0x201, 0x202, 0x203)])
                core.wait(begun_ns(core) + MS, for_frame=False)
                return [
                    (await asyncio.wait_for(reader.get_message(), 10)).arbitration_id
                    for _ in range(3)
                ]

    assert asyncio.run(received_ids()) == [0x201, 0x202, 0x203]


def test_a_second_server_finds_the_bus_taken_and_a_left_over_socket_does_not_matter(served):
    with pytest.raises(OSError, match="another `gaitd sim`"), bus_server(served.path):
        pass
    served.end()
    with bus_server(served.path):
        pass


def test_the_time_page_goes_on_without_its_writer_and_never_back(tmp_path):
    path = tmp_path / "page"
    first = PageWriter(path)
    first.begin(5_000 * MS, 0, wall_clock=False)
    reader = SimulatedTime(path)
    assert reader.now_ns() == 5_000 * MS
    assert reader.now_ns() == 5_000 * MS  # its writer lives, and time stands

    first.leave()
    gone_ns = PageWriter(path).left_ns
    assert gone_ns >= 5_000 * MS
    again = PageWriter(path)
    again.begin(again.left_ns, 0, wall_clock=False)

    assert reader.now_ns() >= gone_ns


def test_a_page_that_is_cut_short_ends_no_reader_and_is_whole_at_the_next_advance(tmp_path):
    path = tmp_path / "page"
    writer = PageWriter(path)
    writer.begin(5 * MS, 0, wall_clock=False)
    reader = SimulatedTime(path)

    for size in (0, 20):
        os.truncate(path, size)
        assert reader.now_ns() == 5 * MS
        with pytest.raises(PageError, match=f"{path}: "):
            SimulatedTime(path)
    writer.write(6 * MS)

    assert reader.now_ns() == SimulatedTime(path).now_ns() == 6 * MS


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"another program's notes", "does not begin as a time page does"),
        (MAGIC[:-1] + b"2" + bytes(48), "is a time page of version 2; this gaitd reads 1"),
        (MAGIC, "is cut short: 8 of 56 bytes"),
    ],
)
def test_a_page_that_cannot_be_read_is_named_with_what_is_wrong(tmp_path, content, said):
    path = tmp_path / "page"
    path.write_bytes(content)

    with pytest.raises(PageError, match=said):
        SimulatedTime(path)


def test_a_page_that_cannot_be_opened_ends_no_program_before_it_asks_for_its_seat(tmp_path):
    page_path(tmp_path / "bus").mkdir()
    link = SocketLink(tmp_path / "bus", Role.IN_STEP, "core")

    assert link.now_ns() > 0
    assert PageClock(tmp_path / "bus").now_ns() > 0
    with pytest.raises(LinkLostError):
        link.open()


def test_a_foreign_file_in_the_place_of_the_page_is_left_as_it_is(tmp_path):
    path = tmp_path / "page"
    path.write_text("another program's notes")

    with pytest.raises(OSError, match="is no time page, and is not changed"):
        PageWriter(path)
    assert path.read_text() == "another program's notes"


def test_by_the_computer_s_clock_a_server_that_hangs_stops_no_client(tmp_path):
    path = tmp_path / "bus"
    PageWriter(page_path(path)).begin(0, 0, wall_clock=True)
    link = SocketLink(path, Role.IN_STEP, "core", wall_clock_only=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(path))
        listening.listen()
        with pytest.raises(LinkLostError, match="timed out"):
            link.open()
        listening.accept()[0].close()
        opens = threading.Thread(target=link.open)
        opens.start()
        server, _ = listening.accept()
        with server:
            server.send(wire.pack_welcome(wire.Welcome(0, 0, True)))
            opens.join(60)

            while link.send([Frame(0x80, b"")] * 2) == 0:
                pass
            assert link.send([Frame(0x80, b"")] * 2) == 2
            link.check()


def test_a_program_that_a_watchdog_watches_does_without_simulated_time(served):
    link = SocketLink(served.path, Role.IN_STEP, "core", wall_clock_only=True)

    with pytest.raises(LinkLostError, match="start `gaitd sim` with --wall-clock"):
        link.open()


def test_a_message_before_hello_is_refused(served):
    link = SocketLink(served.path, Role.IN_STEP, "core")
    link.open()
    link._socket.send(wire.pack_hello(Role.IN_STEP, 0, "again"))

    with contextlib.suppress(LinkLostError):
        link.wait(0, for_frame=False)
    assert not link.is_in_step


def test_time_passes_for_a_seat_that_cannot_be_taken_though_that_of_the_page_stands(
    tmp_path, monkeypatch
):
    """Virtual drives that compile have a page some seconds before they listen."""
    wall_ns = 7_000_000_000
    monkeypatch.setattr("simtime.link.time.monotonic_ns", lambda: wall_ns)
    PageWriter(page_path(tmp_path / "bus")).begin(1_000, 0, wall_clock=False)
    link = SocketLink(tmp_path / "bus", Role.IN_STEP, "core")
    assert link.now_ns() == 1_000

    with pytest.raises(LinkLostError, match="does not answer"):
        link.open()
    wall_ns += 1_500_000_000

    assert link.now_ns() == 1_500_001_000
