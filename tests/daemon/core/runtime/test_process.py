"""The process of the core: directories, what is built before the loop, signals, last lines."""

import signal
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from config_files import CONFIGS
from fresh_core import fresh
from gaitd_names import Cause, EventCode, ExitCode
from gaitd_toml import ConfigError
from numba.core import event

from daemon.core.runtime import process
from daemon.core.runtime.process import ShutdownSignals, loop_settings, run_core
from daemon.core.runtime.systemd import ERROR, INFORMATIONAL, WARNING
from daemon.core.runtime.texts import event_text, verdict_text
from daemon.ipc.record import Verdict
from daemon.ipc.report import Event
from daemon.ipc.transport import RING_NAME, RingReader
from daemon.preflight.load import load
from drives.bringup.bus_load import bus_load
from drives.errors import BusError
from observer import jit

SETTINGS = load(CONFIGS / "demo.toml")
REFUSED = Event(EventCode.PRIORITY_REFUSED, values=(10, 0))


@pytest.fixture
def handlers():
    """Leaves the handlers of signals as they were."""
    kept = {one: signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    yield
    for one, handler in kept.items():
        signal.signal(one, handler)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_request_to_end_ends_at_once_until_drives_may_move(handlers, number):
    signals = ShutdownSignals()
    assert (signals.end(), signals.reload()) == (False, False)
    with pytest.raises(SystemExit) as ended:
        signal.raise_signal(number)
    assert ended.value.code == 0
    signals = ShutdownSignals()
    signals.wait()

    signal.raise_signal(number)

    assert (signals.end(), signals.reload()) == (True, False)


def test_a_request_to_reload_is_told_once(handlers):
    signals = ShutdownSignals()

    signal.raise_signal(signal.SIGHUP)

    assert [signals.reload(), signals.reload(), signals.end()] == [True, False, False]


class World:
    """Everything outside of the core, and the order in which it is used."""

    def __init__(self, monkeypatch, tmp_path, interface="virtual"):
        bus = replace_struct(SETTINGS.trainer.bus, interface=interface)
        trainer = replace_struct(SETTINGS.trainer, bus=bus)
        runtime, state = tmp_path / "run", tmp_path / "state"
        runtime.mkdir()
        state.mkdir()
        file = replace(SETTINGS.file, trainer=trainer, runtime=runtime, state=state)
        self.settings = replace(SETTINGS, file=file)
        self.calls, self.built, self.code, self.bug = [], fresh(), ExitCode.DONE, None
        self.cached, self.is_open, self.opens = True, True, True
        self.verdict = Verdict()
        self.clock = SimpleNamespace(utc_ns=lambda: 123, is_simulated=True)
        monkeypatch.setattr(process, "choose_bus", self.choose_bus)
        monkeypatch.setattr(process, "build", self.build)
        monkeypatch.setattr(process, "warm_up", lambda built: self.calls.append("warm_up"))
        monkeypatch.setattr(process, "is_cached", lambda *folders: self.cached)
        monkeypatch.setattr(process.realtime, "prepare", self.prepare)
        monkeypatch.setattr(process, "Loop", self.loop)
        monkeypatch.setattr(process, "Notifier", self.notifier)

    def choose_bus(self, place, *, name, is_core, wall_clock_only):
        assert (place, name, is_core) == (process.bus_of(self.settings.file), "core", True)
        self.calls.append(("bus", wall_clock_only))
        return SimpleNamespace(open_bus=self.open_bus, clock=self.clock, in_step=self.in_step)

    def open_bus(self):
        self.calls.append("open_bus")
        if not self.opens:
            raise BusError("can0", "no such device")

    def in_step(self, channel, boot_id, lock):
        assert lock == self.settings.runtime / "gateway.lock"
        self.channel, self.boot_id = channel, boot_id
        return "in step"

    def build(self, settings, boot_id, persistent):
        assert settings is self.settings
        self.calls.append("build")
        return self.built

    def prepare(self, priority, processors):
        cycle = self.settings.trainer.cycle
        assert (priority, processors) == (cycle.realtime_priority, cycle.realtime_cpus)
        self.calls.append("prepare")
        return [REFUSED]

    def notifier(self, address):
        assert address == "@notify"
        return SimpleNamespace(close=lambda: self.calls.append("notifier closed"))

    def loop(self, core, settings, ipc, clock, supervision):
        assert (core, ipc, clock) == (self.built.core, "in step", self.clock)
        self.state_file = settings.state_file
        assert supervision._shutdown_effect == self.settings.trainer.shutdown.effect

        def run(end, reload):
            self.calls.append("run")
            assert (end(), reload()) == (False, False)
            signal.raise_signal(signal.SIGTERM)
            assert end()
            core.verdict = self.verdict
            return self.code

        return SimpleNamespace(run=run, bug=self.bug)

    # --- the journal ------------------------------------------------------------------------

    def write(self, text, priority, fields):
        assert fields == {"GAITD_EVENT": "core"}
        self.calls.append((text, priority))

    def run(self, *, has_watchdog=False):
        return run_core(
            *(self.settings, "@notify", self, lambda: self.calls.append("begun")),
            has_watchdog=has_watchdog,
        )


def replace_struct(struct, **changes):
    return type(struct)(**{n: getattr(struct, n) for n in struct.__struct_fields__} | changes)


@pytest.fixture
def world(monkeypatch, tmp_path, handlers):
    return World(monkeypatch, tmp_path)


def load_event(world):
    return process.bus_load_event(world.settings, world.built)


def test_everything_is_built_and_warm_before_the_loop_begins(world):
    assert world.run() is ExitCode.DONE

    loaded = load_event(world)
    assert world.calls == [
        *(("bus", False), "build", "build", "warm_up", "prepare"),
        *((event_text(loaded), INFORMATIONAL), (event_text(REFUSED), WARNING)),
        *("begun", "run", "notifier closed"),
    ]
    assert world.built.core.events == [loaded, REFUSED]
    header = RingReader(world.settings.runtime / RING_NAME).header
    assert (header.core_boot_id, header.start_utc_ns) == (world.boot_id, 123)
    assert len(world.boot_id) == 32
    assert (world.settings.state / "axes.json").exists()
    with pytest.raises(ValueError, match="closed"):
        world.channel._ring._map[0]
    with pytest.raises(ValueError, match="closed"):
        world.state_file.write(world.state_file.persistent, 0)


@pytest.mark.parametrize(
    ("interface", "has_watchdog", "opens", "is_simulated", "is_opened", "is_prepared"),
    [
        ("virtual", False, True, False, False, True),
        ("pcan", True, True, False, False, True),
        ("simulated", False, True, True, True, False),
        ("simulated", False, False, False, True, False),  # without a server no time is simulated
        ("simulated", False, True, False, True, True),
        ("simulated", True, True, True, True, True),
        ("simulated", True, False, False, True, True),
    ],
)
def test_virtual_drives_are_opened_first_and_priority_is_asked_for_unless_time_is_simulated(
    monkeypatch,
    tmp_path,
    handlers,
    interface,
    has_watchdog,
    opens,
    is_simulated,
    is_opened,
    is_prepared,
):
    world = World(monkeypatch, tmp_path, interface)
    world.opens, world.clock.is_simulated = opens, is_simulated

    assert world.run(has_watchdog=has_watchdog) is ExitCode.DONE

    assert world.calls[0] == ("bus", has_watchdog)
    assert ("open_bus" in world.calls) is is_opened
    assert ("prepare" in world.calls) is is_prepared
    assert (REFUSED in world.built.core.events) is is_prepared


def test_a_first_start_says_that_it_compiles_and_how_far_it_is(world, capfd, monkeypatch):
    world.cached = False

    def warm_up(_built):
        for _ in range(45):
            with event.trigger_event("numba:compile"):
                pass

    monkeypatch.setattr(process, "warm_up", warm_up)
    monkeypatch.setattr(jit, "_KNOWN", 30 * ["function"])

    world.run()

    assert world.calls[2:6] == [
        ("compiling what a cycle computes, once on this machine: a minute or two", INFORMATIONAL),
        "build",
        ("compiled 20 of about 30 functions", INFORMATIONAL),
        ("compiled 40 of about 40 functions", INFORMATIONAL),
    ]
    assert capfd.readouterr().err == ""


def test_a_bug_and_a_refusal_are_logged_after_the_end(world):
    world.bug, world.code = ZeroDivisionError("ours"), ExitCode.UNAVAILABLE
    world.bug.add_note("of one turn")
    assert world.run() is ExitCode.UNAVAILABLE
    assert world.calls[-1] == ("ZeroDivisionError: ours\nof one turn\n", ERROR)

    world.bug, world.code = None, ExitCode.DRIVE
    world.verdict = Verdict(cause=Cause.DRIVE_SILENT, drive="right/hip")
    assert world.run() is ExitCode.DRIVE
    assert world.calls[-1] == (verdict_text(world.verdict), ERROR)


@pytest.mark.parametrize("closed", [False, True])
def test_without_a_journal_lines_go_to_the_log_and_one_that_is_closed_costs_nothing(
    world, capfd, monkeypatch, closed
):
    world.is_open = False
    with Path("/dev/full").open("w") as full:
        if closed:
            monkeypatch.setattr("daemon.system.journal.STDERR", full.fileno())
        assert world.run() is ExitCode.DONE

    told = capfd.readouterr().err
    assert told == (
        ""
        if closed
        else f"gaitd core: {event_text(load_event(world))}\ngaitd core: {event_text(REFUSED)}\n"
    )


def test_a_file_that_cannot_be_made_is_an_error_of_the_configuration(world, tmp_path):
    (tmp_path / "state" / "axes.json").mkdir()
    with pytest.raises(ConfigError, match=r"paths\.state"):
        world.run()
    (tmp_path / "state" / "axes.json").rmdir()
    (tmp_path / "run" / "records.new").mkdir()
    with pytest.raises(ConfigError, match=r"paths\.runtime"):
        world.run()


@pytest.mark.parametrize(("heartbeat_ms", "cycles"), [(50, 5), (45, 4), (10, 1), (5, 1)])
def test_the_loop_has_the_settings_of_the_trainer_file(world, heartbeat_ms, cycles):
    cycle = replace_struct(world.settings.trainer.cycle, master_heartbeat_ms=heartbeat_ms)
    trainer = replace_struct(world.settings.trainer, cycle=cycle)
    settings = replace(world.settings, file=replace(world.settings.file, trainer=trainer))
    built, store = world.built, nullcontext()

    made = loop_settings(settings, built, store, world.open_bus)

    assert (made.plans, made.cycle, made.state_file) == (built.plans, built.cycle, store)
    assert (made.period_ns, made.window_ns) == (*(10_000_000, int(cycle.window_ms * 1e6)),)
    assert (made.heartbeat_cycles, made.master_node_id) == (cycles, cycle.master_node_id)
    assert made.open_bus == world.open_bus
    bitrate_bit_per_s = trainer.bus.bitrate_bit_per_s
    load = bus_load(settings.drives, built.cycle, heartbeat_ms, bitrate_bit_per_s)
    assert (made.bitrate_bit_per_s, made.bus_load_ratio) == (bitrate_bit_per_s, load.busy_ratio)
    assert process.bus_load_event(settings, built) == Event(
        EventCode.BUS_LOAD, "", (load.busy_ratio, trainer.bus.load_max_ratio, load.burst_s)
    )
