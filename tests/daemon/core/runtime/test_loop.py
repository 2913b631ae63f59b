"""The turns of the loop: what is sent, counted and published, and how the end is reached.

What a cycle decides is tested elsewhere: here it is a function that returns frames and a record.
"""

from types import SimpleNamespace

import pytest
from fresh_core import fresh, show
from gaitd_names import Cause, CyclePart, EventCode, ExitCode, Mode
from records import record
from safety_inputs import FEEDBACK, JOINT

from daemon.core.runtime import loop as loop_module
from daemon.core.runtime.loop import Loop
from daemon.core.runtime.loop_settings import LoopSettings
from daemon.core.safety.stop_sequence import Step
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.report import Event
from drives.canopen.bus import Frame
from drives.canopen.nmt import SYNC_FRAME
from drives.errors import BootFailure, BringUpRefused, BusError
from drives.signals import PowerState

MS = 1_000_000
COMMAND, QUICK, STATUS = Frame(0x201, b"\1"), Frame(0x201, b"\2"), Frame(0x185, b"\3")
RESETS = [Frame(0, bytes((0x82, 5))), Frame(0, bytes((0x82, 6)))]
NMT_STOP = Frame(0, bytes((0x02, 5)))
STATE, NOTICE = object(), Event(EventCode.STATES_CROWDED, values=(1,))
UNPOWERED, POWERED = PowerState.SWITCH_ON_DISABLED, PowerState.OPERATION_ENABLED


class World:
    """Clock, bus, channel, systemd and state file of one loop, and the cycles that it runs."""

    is_simulated = False

    def __init__(self, monkeypatch):
        self.now, self.calls, self.ticks = 1000 * MS, [], []
        self.coming, self.down, self.full, self.reported_count = [], set(), False, 0
        self.delay_ns = {}
        """What passes in a call, by its name."""
        built = fresh()
        self.core, self.record = built.core, record(1)
        self.outgoing, self.answer = [COMMAND], []
        self.core.drives = SimpleNamespace(
            cyclic_ids=frozenset({STATUS.can_id}),
            stray_count=9,
            feed_between=lambda frames, now_ns: False,
            frames=lambda commands: [QUICK],
        )
        self.core.mode = Mode.HOLD
        for axis in self.core.axes:
            feedback = FEEDBACK._replace(node_id=axis.node_id, power_state=UNPOWERED)
            show(axis, feedback=feedback, joint=JOINT._replace(velocity_si=0.0))
        for name in ("step", "rest", "react"):
            monkeypatch.setattr(loop_module.cycle, name, getattr(self, name))
        monkeypatch.setattr(loop_module.realtime, "tidy", lambda: self.called("tidy"))
        settings = LoopSettings(
            plans=built.plans,
            cycle=built.cycle,
            period_ns=10 * MS,
            window_ns=4 * MS,
            heartbeat_cycles=1000,
            master_node_id=1,
            bus_load_ratio=0.4,
            bitrate_bit_per_s=10**6,
            open_bus=lambda: self,
            state_file=SimpleNamespace(write=lambda *one: self.called("store", *one)),
        )
        self.loop = Loop(self.core, settings, self, self, self)
        self.loop._line.open()
        self.calls.clear()

    def called(self, name, *values):
        self.calls.append((name, *values))
        self.now += self.delay_ns.get(name, 0)

    # --- clock ------------------------------------------------------------------------------

    def now_ns(self):
        return self.now

    def utc_ns(self):
        return 10**18 + self.now

    def sleep_until(self, deadline_ns):
        self.called("sleep", deadline_ns)
        self.now = max(self.now, deadline_ns)

    # --- bus --------------------------------------------------------------------------------

    def send(self, frames):
        self.called("send", *frames)
        if "send" in self.down and SYNC_FRAME not in frames:
            raise BusError("can0", "it is down")
        return len(frames) if self.full and SYNC_FRAME not in frames else 0

    def send_urgent(self, frames, deadline_ns, clock):
        self.called("urgent", *frames, deadline_ns)
        assert clock is self
        if "urgent" in self.down:
            raise BusError("can0", "it is down")
        return 0

    def drain(self):
        return []

    def receive_until(self, deadline_ns, clock):
        assert clock is self
        if "receive" in self.down:
            raise BusError("can0", "it is down")
        if self.coming and self.coming[0] <= deadline_ns:
            self.now = max(self.now, self.coming.pop(0))
            return [STATUS]
        self.now = max(self.now, deadline_ns)
        return []

    def close(self):
        self.called("close")

    # --- channel, systemd -------------------------------------------------------------------

    def publish(self, one):
        self.called("publish", one)

    def receive(self):
        return [STATE]

    def take_notices(self):
        return [NOTICE]

    def feed(self):
        self.called("feed")

    def report(self, one):
        assert one is self.record
        self.reported_count += 1

    def begin_end(self):
        self.called("begin_end")

    def end(self, core, code):
        assert core is self.core
        self.called("end", code)

    # --- cycles -----------------------------------------------------------------------------

    def step(self, core, frames, states, tick):
        assert core is self.core
        self.ticks.append(tick)
        self.called("step", tuple(frames), tuple(states))
        return self.outgoing, self.record

    def rest(self, core, states, tick):
        assert core is self.core
        self.ticks.append(tick)
        self.called("rest", tuple(states))
        return self.record

    def react(self, core, frames, tick, next_cycle):
        assert core is self.core
        self.called("react", tuple(frames), next_cycle)
        return self.answer

    def names(self):
        return [call[0] for call in self.calls]


@pytest.fixture
def world(monkeypatch):
    return World(monkeypatch)


FOREIGN = Event(EventCode.CAN_FOREIGN_MASTER, values=(1,))


def test_a_turn_sends_sync_runs_a_cycle_sends_its_commands_and_publishes(world):
    line, counted = world.loop._line, []
    line.load.count, line.foreign_count = counted.append, 1

    world.loop.turn()

    assert world.calls == [
        ("send", SYNC_FRAME),
        ("step", (), (STATE,)),
        ("send", COMMAND),
        ("publish", world.record),
        ("feed",),
    ]
    (tick,) = world.ticks
    assert (tick.cycle, tick.sync_ns, tick.sync_utc_ns) == (0, 1010 * MS, 10**18 + 1010 * MS)
    assert (tick.dt_s, tick.late, tick.shutdown, tick.time_is_simulated) == (
        *(pytest.approx(0.01), False, False, False),
    )
    assert (tick.bus_load_ratio, tick.bus.stray_count) == (0.4, 9)
    assert tick.timing == CycleTiming(0, 4 * MS, 0, 0)
    assert world.core.events == [NOTICE, FOREIGN]
    assert (world.reported_count, counted) == (1, [1014 * MS])


def test_the_next_turn_knows_how_long_the_parts_of_this_one_took(world):
    world.delay_ns = {"step": 2 * MS, "publish": 1 * MS}
    for _ in range(2):
        world.loop.turn()

    assert world.ticks[1].timing == CycleTiming(0, 4 * MS, 2 * MS, 0, publish_ns=1 * MS)
    assert world.ticks[1].dt_s == pytest.approx(0.01)
    assert world.ticks[1].cycle == 1


def test_the_time_between_two_cycles_is_that_between_their_syncs(world):
    world.loop.turn()
    world.now = 1023 * MS

    world.loop.turn()

    assert world.ticks[1].dt_s == pytest.approx(0.013)


def test_samples_that_come_in_the_window_are_those_of_the_cycle(world):
    world.coming = [1011 * MS]

    world.loop.turn()

    assert ("step", (STATUS,), (STATE,)) in world.calls


@pytest.mark.parametrize("answer", [[], [QUICK]])
def test_between_grid_points_an_alarm_is_answered_at_once(world, answer):
    world.coming, world.answer = [1003 * MS, 1010 * MS], answer

    world.loop.turn()

    urgent = [("urgent", QUICK, 1010 * MS)] * bool(answer)
    react = ("react", (STATUS,), 0)
    assert world.calls[: 2 * (1 + len(urgent))] == [react, *urgent, react, *urgent]
    assert world.names()[2 * (1 + len(urgent))] == "send"  # SYNC does not wait for a busy bus


@pytest.mark.parametrize(
    ("coming_ms", "delay_ms", "reacted_count"), [((1010, 1010), 0, 1), ((1003, 1004), 8, 1)]
)
def test_a_frame_at_the_grid_point_waits_for_the_sync(world, coming_ms, delay_ms, reacted_count):
    world.coming = [came_ms * MS for came_ms in coming_ms]
    world.delay_ns = {"react": delay_ms * MS}

    world.loop.turn()

    assert world.names().count("react") == reacted_count


@pytest.mark.parametrize(
    ("step", "calls"),
    [
        (Step.HOLD, [("send", SYNC_FRAME), ("send", COMMAND)]),
        (Step.QUICK_STOP, [("send", SYNC_FRAME), ("urgent", COMMAND, 1019.5 * MS)]),
        (
            Step.NMT_STOP,
            [
                *[("send", SYNC_FRAME), ("urgent", COMMAND, 1019.5 * MS)],
                ("urgent", NMT_STOP, 1019.5 * MS),
            ],
        ),
        (Step.SILENCE, []),
    ],
)
def test_what_stops_a_drive_is_urgent_and_silence_sends_nothing(world, step, calls):
    world.core.axes[0].stop = SimpleNamespace(step=step)

    world.loop.turn()

    assert [call for call in world.calls if call[0] in {"send", "urgent"}] == calls
    assert "step" in world.names()


def test_a_drive_that_becomes_silent_in_a_cycle_gets_no_commands_of_it(world):
    def step(*_given):
        world.core.axes[0].stop = SimpleNamespace(step=Step.SILENCE)
        return world.outgoing, world.record

    loop_module.cycle.step = step

    world.loop.turn()

    assert ("send", COMMAND) not in world.calls


def test_commands_that_are_dropped_are_counted_in_a_row(world):
    found = []
    for full in (True, True, False, True):
        world.full = full
        world.loop.turn()
        found.append((world.ticks[-1].tx_dropped_in_a_row, world.ticks[-1].tx_dropped_count))
    world.loop.turn()

    assert found == [(0, 0), (1, 1), (2, 2), (0, 2)]
    assert world.ticks[-1].tx_dropped_in_a_row == 1


def test_drives_that_are_lost_in_a_cycle_are_no_longer_watched(world):
    def step(*_given):
        world.core.drives = None
        return world.outgoing, world.record

    loop_module.cycle.step = step

    world.loop.turn()

    assert ("urgent", *RESETS, 1024 * MS) in world.calls
    world.calls.clear()
    world.coming = [1015 * MS]
    world.loop.turn()
    assert world.calls[:2] == [("sleep", 1020 * MS), ("rest", (STATE,))]
    tick = world.ticks[-1]
    assert (tick.timing, tick.bus.stray_count) == (CycleTiming(0, 0, 0, 0), 0)


@pytest.mark.parametrize(
    ("down", "names"),
    [
        ("receive", ["close", "rest", "publish", "feed"]),
        ("send", ["send", "step", "send", "publish", "close", "rest", "publish", "feed"]),
    ],
)
def test_a_bus_that_is_lost_is_closed_and_no_record_is(world, down, names):
    world.down = {down}

    world.loop.turn()

    assert world.names() == names
    states = [call[1] for call in world.calls if call[0] == "rest"]
    assert states == [(STATE,) if down == "send" else ()]
    assert world.core.verdict.cause == Cause.BUS_DOWN
    assert not world.loop._line.is_open


@pytest.mark.parametrize(
    ("late_ms", "sync_ms", "cycle", "missed"),
    [(3, 1013, 0, 0), (4, 1020, 1, 1), (14, 1030, 2, 2), (24, 1040, 3, 3)],
)
def test_a_late_wake_up_leaves_its_grid_points_out(world, late_ms, sync_ms, cycle, missed):
    world.now += (10 + late_ms) * MS

    world.loop.turn()

    (tick,) = world.ticks
    assert (tick.sync_ns, tick.cycle) == (sync_ms * MS, cycle)
    assert (tick.late, tick.overruns_in_a_row) == (missed > 0, missed)
    by_part = {CyclePart.WAKE_UP: missed} if missed else {}
    assert (tick.timing.overrun_count, tick.timing.overrun_by_part) == (missed, by_part)
    events = [event for event in world.core.events if event != NOTICE]
    expected = Event(EventCode.CYCLES_MISSED, "", (missed, CyclePart.WAKE_UP))
    assert events == [expected] * (missed > 1)


def test_after_three_late_wake_ups_in_a_row_the_cycle_runs_however_late(world):
    def receive_until(deadline_ns, _clock):
        world.now = deadline_ns + 5 * MS
        return []

    world.receive_until = receive_until

    world.loop.turn()

    (tick,) = world.ticks
    assert tick.overruns_in_a_row == 3
    assert tick.timing.lateness_ns == 5 * MS


def test_a_cycle_that_takes_too_long_is_put_down_to_its_part_and_does_not_feed(world):
    world.delay_ns = {"step": 30 * MS}
    world.loop.turn()
    world.delay_ns = {}
    assert "feed" not in world.names()

    world.loop.turn()

    assert world.ticks[-1].timing.overrun_by_part == {CyclePart.WORK: 3}
    assert (world.ticks[-1].cycle, world.names()[-1]) == (4, "feed")


@pytest.mark.parametrize("opened", [True, False])
def test_in_mode_off_a_bring_up_comes_first_and_the_grid_begins_after_it(
    world, monkeypatch, opened
):
    world.core.mode = Mode.OFF

    def run(meanwhile):
        assert meanwhile == world.loop._cycle_without_drives
        world.called("bring_up")
        world.now += 500 * MS
        world.core.mode = Mode.READY
        return opened

    monkeypatch.setattr(world.loop._bring_up, "run", run)
    resets = []
    for part in (world.loop._window, world.loop._commands):
        monkeypatch.setattr(part, "reset", lambda: resets.append(1))

    world.loop.turn()

    assert world.names()[:2] == ["bring_up", "tidy"]
    assert len(resets) == 2 * opened
    assert world.ticks[-1].timing.overrun_count == (0 if opened else 50)
    assert world.ticks[-1].sync_ns == 1510 * MS


@pytest.mark.parametrize(
    ("late_ns", "names"),
    [
        *((-1, []), (0, ["rest", "publish", "feed"]), (10 * MS - 1, ["rest", "publish", "feed"])),
        *((10 * MS, ["rest", "publish"]), (11 * MS, ["rest", "publish"])),
    ],
)
def test_during_a_bring_up_cycles_without_drives_run_on_the_grid(world, late_ns, names):
    world.now += 10 * MS + late_ns
    world.loop._line.foreign_count = 1

    world.loop._cycle_without_drives()

    assert world.names() == names
    if names:
        assert world.calls[0] == ("rest", (STATE,))
        assert world.ticks[-1].sync_ns == 1010 * MS
        assert world.ticks[-1].timing == CycleTiming(0, 0, 0, 0)
        assert world.core.events == [FOREIGN, NOTICE]
        assert world.loop._grid.due_ns > world.now


def test_a_new_persistent_state_is_stored_once(world):
    world.loop.turn()
    world.core.persistent = object()
    for _ in range(2):
        world.loop.turn()

    stored = [call for call in world.calls if call[0] == "store"]
    assert [call[1] for call in stored] == [world.core.persistent]
    assert stored[0][2] == 1024 * MS


def ends(world, mode, *states, **changes):
    """Whether the loop may end in this state."""
    world.core.mode = mode
    for axis, state in zip(world.core.axes, states, strict=False):
        show(axis, feedback=FEEDBACK._replace(node_id=axis.node_id, power_state=state))
    for name, value in changes.items():
        setattr(world.core, name, value)
    return world.loop.may_end()


@pytest.mark.parametrize(
    ("mode", "states", "changes", "may_end", "is_stored"),
    [
        (Mode.OFF, (), {"drives": None}, True, False),
        (Mode.OFF, (), {"drives": None, "reset_cycles_left": 1}, False, False),
        (Mode.HOLD, (POWERED, POWERED), {}, False, False),
        (Mode.STOPPING, (UNPOWERED, UNPOWERED), {}, False, False),
        (Mode.READY, (UNPOWERED, POWERED), {}, False, False),
        (Mode.READY, (UNPOWERED, UNPOWERED), {}, True, True),
    ],
)
def test_it_may_end_when_no_axis_moves_or_has_power_and_stores_the_poses_then(
    world, monkeypatch, mode, states, changes, may_end, is_stored
):
    monkeypatch.setattr(
        loop_module.supervisor, "power_off", lambda core, cycle: world.called("off", cycle)
    )

    def store_poses(core, utc_ns):
        core.persistent = utc_ns

    monkeypatch.setattr(loop_module.persistence, "store_poses", store_poses)

    assert ends(world, mode, *states, **changes) is may_end
    assert (("off", 0) in world.calls) is (mode is Mode.READY)
    assert (("store", 10**18 + world.now, world.now) in world.calls) is is_stored


def test_after_half_a_second_it_ends_though_a_drive_shows_power_and_stores_nothing(
    world, monkeypatch
):
    monkeypatch.setattr(loop_module.supervisor, "power_off", lambda core, cycle: None)

    answers = [ends(world, Mode.READY, POWERED, UNPOWERED) for _ in range(51)]

    assert answers == [False] * 50 + [True]
    assert "store" not in world.names()


def test_it_runs_until_it_is_asked_to_end_and_may(world, monkeypatch):
    may = iter([False, True])
    monkeypatch.setattr(world.loop, "may_end", lambda: next(may))
    asked, reloads = iter([False, False, True, True, True, True]), iter([True, False])

    code = world.loop.run(lambda: next(asked), lambda: next(reloads))

    assert code is ExitCode.DONE
    assert world.names().count("step") == 2
    assert [tick.shutdown for tick in world.ticks] == [False, True]
    reports = [event for event in world.core.events if event != NOTICE]
    assert reports == [Event(EventCode.RELOAD_REFUSED)]
    assert world.calls[-2:] == [("close",), ("end", ExitCode.DONE)]
    assert world.names().count("begin_end") == 1


def test_without_a_way_to_ask_for_a_reload_there_is_none(world, monkeypatch):
    monkeypatch.setattr(world.loop, "may_end", lambda: True)
    asked = iter([False, False, True])

    assert world.loop.run(lambda: next(asked)) is ExitCode.DONE
    assert world.core.events == [NOTICE]


def test_drives_that_are_refused_end_the_loop_with_a_last_record(world, monkeypatch):
    def refused(**_given):
        raise BringUpRefused("right/hip", BootFailure.WRONG_PRODUCT, "another one")

    monkeypatch.setattr(world.loop, "turn", refused)
    world.core.drives = None

    assert world.loop.run(lambda: False) is ExitCode.DRIVE
    assert world.names() == ["rest", "publish", "close", "end"]
    assert (world.calls[0], world.calls[-1]) == (("rest", ()), ("end", ExitCode.DRIVE))
    assert world.ticks[0].sync_ns == 1010 * MS


def test_a_bug_stops_the_drives_stores_what_is_known_and_ends_the_loop(world, monkeypatch):
    bug = ZeroDivisionError("ours")

    def turn(**_given):
        world.core.persistent = "new"
        raise bug

    monkeypatch.setattr(world.loop, "turn", turn)

    assert world.loop.run(lambda: False) is ExitCode.UNAVAILABLE
    assert world.loop.bug is bug
    names = world.names()
    assert (names[0], names[-3:]) == ("begin_end", ["store", "close", "end"])
    assert names.count("urgent") == 50
    assert world.calls[1][1:3] == (SYNC_FRAME, Frame(0x701, b"\5"))


def test_what_ends_python_itself_still_closes_the_bus_and_is_told_as_a_bug(world, monkeypatch):
    def turn(**_given):
        raise KeyboardInterrupt

    monkeypatch.setattr(world.loop, "turn", turn)

    with pytest.raises(KeyboardInterrupt):
        world.loop.run(lambda: False)
    assert world.calls[-2:] == [("close",), ("end", ExitCode.UNAVAILABLE)]
    assert world.loop.bug is None


@pytest.mark.parametrize(
    ("mode", "states", "down", "resets"),
    [
        (Mode.READY, (UNPOWERED, UNPOWERED), set(), RESETS),
        (Mode.READY, (POWERED, UNPOWERED), set(), RESETS[1:]),
        (Mode.READY, (UNPOWERED, UNPOWERED), {"urgent"}, RESETS),
        (Mode.HOLD, (UNPOWERED, UNPOWERED), set(), None),
    ],
)
def test_at_the_end_the_watch_of_drives_without_power_ends_and_of_no_other(
    world, mode, states, down, resets
):
    world.down = down
    world.core.mode = mode
    for axis, state in zip(world.core.axes, states, strict=True):
        show(axis, feedback=FEEDBACK._replace(node_id=axis.node_id, power_state=state))

    world.loop.leave()

    sent = [] if resets is None else [("urgent", *resets, 1010 * MS)]
    assert world.calls == [*sent, ("close",)]
    world.loop.leave()
    assert world.calls == [*sent, ("close",)]
