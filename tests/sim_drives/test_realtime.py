"""By the computer's clock: on a bus whose clients come, go and die; commands on a socket."""

import contextlib
import math
import socket
import subprocess
import sys
import threading
import time

import can
import pytest
from drive_bench import Bench, booted_bench

from drives.canopen.frame import Frame
from sim_drives.control import control_socket
from sim_drives.time.bus_server import bus_server
from sim_drives.time.wall_clock import STEADY_NS, Arrivals, RealTime, ServedBus, now_ns, open_bus
from simtime.page import PageWriter, page_path

TIMEOUT_S = 30.0
IDENTITY = bytes.fromhex("4018100100000000")
ANSWER = bytes.fromhex("43181001fb000000")


@contextlib.contextmanager
def running(bench, bus, control=None):
    over = threading.Event()
    thread = threading.Thread(target=RealTime(bench.world, bus, control).run, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextlib.contextmanager
def on_a_socket(folder):
    """The bus of `gaitd sim --wall-clock`; and who serves it."""
    with bus_server(folder / "bus") as server:
        yield ServedBus(server, PageWriter(page_path(folder / "bus")), str), server


@pytest.fixture(params=["gaitd", "virtual"])
def served(request, tmp_path):
    """Interface and channel of a bus with booted drives on it: ours, and another one."""
    with contextlib.ExitStack() as ending:
        bench = booted_bench()
        if request.param == "gaitd":
            channel, (bus, _) = str(tmp_path / "bus"), ending.enter_context(on_a_socket(tmp_path))
        else:
            channel = str(tmp_path)
            bus = ending.enter_context(open_bus("virtual", channel, 1_000_000))
        ending.enter_context(running(bench, bus))
        yield request.param, channel


@contextlib.contextmanager
def client(served):
    interface, channel = served
    with can.Bus(interface=interface, channel=channel, bitrate=1_000_000) as bus:
        yield bus


def ask(bus, can_id, data, answer_id, timeout_s=TIMEOUT_S):
    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
    return hear(bus, answer_id, timeout_s)


def hear(bus, can_id, timeout_s=TIMEOUT_S):
    until = time.monotonic() + timeout_s
    while time.monotonic() < until:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == can_id:
            return bytes(message.data)
    return None


def test_a_client_talks_to_the_drives(served):
    with client(served) as bus:
        assert ask(bus, 0x605, IDENTITY, 0x585) == ANSWER


def test_two_clients_hear_the_drives_and_each_other(served):
    with client(served) as one, client(served) as other:
        assert ask(one, 0x605, IDENTITY, 0x585) == ANSWER
        assert hear(other, 0x605) == IDENTITY
        assert hear(other, 0x585) == ANSWER


def test_a_client_may_come_back(served):
    for _ in range(3):
        with client(served) as bus:
            assert ask(bus, 0x605, IDENTITY, 0x585) == ANSWER


def test_a_client_that_was_killed_leaves_no_station_behind(tmp_path):
    with on_a_socket(tmp_path) as (bus, server):
        words = f"import can, os; can.Bus(interface='gaitd', channel='{tmp_path}/bus'); os._exit(9)"
        with running(booted_bench(), bus):
            survivor = can.Bus(interface="gaitd", channel=str(tmp_path / "bus"))
            killed = subprocess.run([sys.executable, "-c", words], check=False)
            assert ask(survivor, 0x605, IDENTITY, 0x585) == ANSWER

        assert killed.returncode == 9
        assert len(server.connections) == 1
        survivor.shutdown()


def test_what_is_no_client_is_sent_away_and_does_no_harm(tmp_path, capfd):
    with on_a_socket(tmp_path) as (bus, _), running(booted_bench(), bus):
        for said in (b"GET / HTTP/1.1\r\n\r\n", b"\x00\xff" * 100):
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as stranger:
                stranger.connect(str(tmp_path / "bus"))
                stranger.send(said)
        with client(("gaitd", str(tmp_path / "bus"))) as friend:
            assert ask(friend, 0x605, IDENTITY, 0x585) == ANSWER

    assert capfd.readouterr().err.count("is disconnected") == 2


def test_extended_and_remote_frames_mean_nothing_to_the_drives(served):
    with client(served) as bus:
        for odd in ({"is_extended_id": True}, {"is_extended_id": False, "is_remote_frame": True}):
            with contextlib.suppress(can.CanOperationError):  # ours does not take them
                bus.send(can.Message(arbitration_id=0x605, data=IDENTITY, **odd))
        assert hear(bus, 0x585, 0.2) is None
        assert ask(bus, 0x605, IDENTITY, 0x585) == ANSWER


def test_a_node_that_is_started_sends_its_event_driven_tpdo(served):
    with client(served) as bus:
        started = ask(bus, 0x000, b"\x01\x05", 0x185)
        assert started == b"\x40\x82"


# --- commands ---------------------------------------------------------------------------------


@pytest.fixture
def asking(tmp_path):
    """A socket beside the drives', and what they have been told."""
    told = []

    def obey(line):
        told.append(line)
        return bench.world.command(line)

    bench = Bench()
    bench.boot()
    with (
        control_socket(tmp_path / "control", obey) as control,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender,
    ):
        sender.bind(str(tmp_path / "sender"))
        sender.settimeout(TIMEOUT_S)

        def ask(text):
            sender.sendto(text.encode(), str(tmp_path / "control"))
            control.serve()
            return sender.recv(4096).decode()

        yield ask, bench, tmp_path, control


def test_a_command_is_obeyed_and_answered(asking):
    ask, bench, *_ = asking

    assert ask("emcy right/hip 0.5 0x2310") == "ok: began emcy on right/hip"
    assert bench.read(0x603F) == 0x2310
    assert ask("clear emcy right/hip") == "ok: cleared emcy on right/hip"


def test_a_bad_command_gets_its_reason_and_the_others_of_the_datagram_are_obeyed(asking):
    ask, bench, *_ = asking

    first, second = ask("nonsense\nhand_switch_open *").splitlines()

    assert first.startswith("error: ")
    assert "expected KIND DRIVE" in first
    assert second == "ok: began hand_switch_open on *"
    assert not bench.read(0x60FD) >> 16 & 1


def test_bytes_that_are_no_text_get_an_error(asking):
    ask, *_ = asking
    assert ask("\x00\xff").startswith("error: ")


def test_whoever_has_no_name_is_obeyed_without_an_answer(asking):
    _, bench, folder, control = asking
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as nameless:
        nameless.sendto(b"hand_switch_open *", str(folder / "control"))
        control.serve()

    assert not bench.read(0x60FD) >> 16 & 1


def test_a_socket_left_by_an_earlier_run_is_replaced_and_a_file_is_not(tmp_path):
    left = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    left.bind(str(tmp_path / "left"))
    left.close()
    with control_socket(tmp_path / "left", str):
        pass
    assert not (tmp_path / "left").exists()

    (tmp_path / "file").write_text("another program's")
    with pytest.raises(OSError, match="in use"), control_socket(tmp_path / "file", str):
        pass
    assert (tmp_path / "file").read_text() == "another program's"


HELD_UP_S = 0.04


class Recorder:
    """A world that keeps when what happened to it."""

    def __init__(self, now_ns: int) -> None:
        self.now_ns, self.sync_count = now_ns, 0
        self.received_ns: list[int] = []

    def advance_to(self, time_ns: int) -> list[Frame]:
        assert time_ns >= self.now_ns
        self.now_ns = time_ns
        return []

    def receive(self, frame: Frame) -> None:
        self.received_ns.append(self.now_ns)

    def next_event_ns(self) -> int:
        return self.now_ns + 1_000_000_000


def test_a_sync_that_came_while_the_process_was_held_up_reaches_the_drives_when_it_was_sent():
    with (
        can.Bus(interface="virtual", channel="held-up", preserve_timestamps=True) as master,
        can.Bus(interface="virtual", channel="held-up") as ours,
    ):
        world = Recorder(now_ns())
        loop = RealTime(world, ours)  # type: ignore[arg-type]
        sent_ns: list[int] = []

        def ended() -> bool:
            sent_ns.append(now_ns())
            master.send(
                can.Message(arbitration_id=0x080, timestamp=time.time(), is_extended_id=False)
            )
            time.sleep(HELD_UP_S)  # nothing is read, and the world would go on to the present
            return len(sent_ns) > 5

        loop.run(ended)

    late_ns = [came - sent for came, sent in zip(world.received_ns, sent_ns, strict=False)]
    # At the very first frame it is unknown how far the two clocks are apart; and a test that is
    # itself held up between two readings of a clock says nothing.
    assert min(late_ns[1:]) < HELD_UP_S / 4 * 1e9


@pytest.mark.parametrize("stamp_s", [math.inf, 1e305, -1e305, math.nan])
def test_a_stamp_that_is_no_time_is_read_as_now(stamp_s):
    with (
        can.Bus(interface="virtual", channel="no-time", preserve_timestamps=True) as master,
        can.Bus(interface="virtual", channel="no-time") as ours,
    ):
        world = Recorder(now_ns())
        turns = iter((False, True))
        master.send(can.Message(arbitration_id=0x080, timestamp=stamp_s, is_extended_id=False))

        RealTime(world, ours).run(lambda: next(turns))  # type: ignore[arg-type]

    assert len(world.received_ns) == 1


AHEAD_NS = 1_767_225_600 * 1_000_000_000
"""What the wall clock is ahead of the monotonic one by."""
READ_NS, CAME_NS, LAST_NS = 50_000_000, 48_500_000, 45_000_000


def arrivals_of(first_ahead_ns):
    """After a frame that was read at LAST_NS."""
    arrivals = Arrivals()
    arrivals.time_of_ns(LAST_NS + first_ahead_ns, LAST_NS, LAST_NS, LAST_NS + first_ahead_ns)
    return arrivals


def test_a_frame_reaches_the_drives_when_it_came_and_not_when_it_was_read():
    arrivals = arrivals_of(AHEAD_NS)

    came_ns = arrivals.time_of_ns(CAME_NS + AHEAD_NS, LAST_NS, READ_NS, READ_NS + AHEAD_NS)

    assert came_ns == CAME_NS


@pytest.mark.parametrize("stepped_ns", [2 * STEADY_NS, -2 * STEADY_NS, 3600 * 10**9])
def test_where_the_wall_clock_was_set_a_frame_comes_when_it_is_read(stepped_ns):
    arrivals = arrivals_of(AHEAD_NS - stepped_ns)

    came_ns = arrivals.time_of_ns(
        CAME_NS + AHEAD_NS - stepped_ns, LAST_NS, READ_NS, READ_NS + AHEAD_NS
    )

    assert came_ns == READ_NS


def test_time_never_goes_back_for_a_stamp_and_never_beyond_now():
    arrivals = arrivals_of(AHEAD_NS)
    utc_ns = READ_NS + AHEAD_NS

    assert arrivals.time_of_ns(LAST_NS - 1 + AHEAD_NS, LAST_NS, READ_NS, utc_ns) == LAST_NS
    assert arrivals.time_of_ns(READ_NS + 1 + AHEAD_NS, LAST_NS, READ_NS, utc_ns) == READ_NS
