"""What happens to the service in the small world with SocketCAN, and what is kept of it.

Each function is one scenario; `rig_service.py` calls it by name. Nothing is asserted here but that
a scenario came to its end: facts, records and candump's lines go into a folder, and tests/rigs/
judges them by name. `candump` is the witness that is not ours.
"""

import contextlib
import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench_motor import bench
from config_files import CONFIGS, Change, changed, copied
from gaitd_names import Mode
from rig_service import TEMPLATE, WINDOW_MS, Forked, Inside, Report
from usb_adapters import Wire

from daemon.ipc.record import CycleRecord
from drives.canopen.bus_state import BusCondition

MEMORY = Path("/run/gaitd-tests")
GAIT = {"mode": "gait", "cadence_hz": 0.5, "amplitude_ratio": 1.0, "duration_s": 600.0}
WALK_S = 2.0
TRIES = 3
STEP_PAUSE_S = 0.3
EMERGENCY = 0x2310
"""Continuous over-current, device output side (CiA 402 and 301's table)."""
BUS_OFF, RESTARTED = "20000040#0000000000000000", "20000100#0000000000000000"
PASSIVE, WARNING = "20000004#0030000000000000", "20000004#000C000000000000"
ACTIVE_AGAIN = "20000004#0040000000000000"
PASSIVE_CONDITION, ACTIVE_CONDITION = BusCondition.PASSIVE.value, BusCondition.ACTIVE.value
OFF_CONDITION = BusCondition.OFF.value


def shell(line: str) -> str:
    """A command of this world's tools; what it said."""
    ran = subprocess.run(line, shell=True, capture_output=True, text=True, check=False)
    if ran.returncode:
        raise AssertionError(f"{line}: {ran.returncode}\n{ran.stdout}{ran.stderr}")
    return ran.stdout


@contextlib.contextmanager
def witnessed(report: Report, name: str, interface: str = "vcan0") -> Iterator[None]:
    """candump over what happens, in memory while it does; `NAME.candump` afterwards."""
    MEMORY.mkdir(exist_ok=True)
    path = MEMORY / f"{name}.candump"
    with path.open("wb") as file:
        # Error frames too (#FFFFFFFF); by the kernel's stamps.
        dump = subprocess.Popen(["candump", "-L", f"{interface},0:0,#FFFFFFFF"], stdout=file)
    try:
        time.sleep(STEP_PAUSE_S)
        yield
        time.sleep(STEP_PAUSE_S)
    finally:
        dump.send_signal(signal.SIGTERM)
        dump.wait()
        (report.folder / path.name).write_bytes(path.read_bytes())


@contextlib.contextmanager
def inside(
    report: Report, name: str, template: Path = CONFIGS / TEMPLATE, **channels: str
) -> Iterator[Inside]:
    """The service of one scenario; what its parts have said, in `NAME_PART.log` afterwards."""
    service = Inside(MEMORY / name, template, **channels)
    try:
        yield service
    finally:
        for part in service.parts:
            (report.folder / f"{name}_{part}.log").write_text(service.log(part))
        service.end()


def set_up(interface: str, options: str = "") -> None:
    """A CAN interface at 1 Mbit/s with a queue for some cycles."""
    shell(f"ip link set {interface} txqueuelen 100")
    shell(f"ip link set {interface} type can bitrate 1000000 {options}")
    shell(f"ip link set {interface} up")


def walks(record: CycleRecord) -> bool:
    return record.mode == Mode.GAIT and record.gait_phase >= 0


def up(service: Inside) -> None:
    """All three processes, to READY."""
    service.start_all()
    service.until(lambda record: record.mode == Mode.READY)


def walking(service: Inside, gait: dict[str, Any] = GAIT) -> CycleRecord:
    """A gait; what stops it on the way is tried again, and told if it goes on."""
    for _ in range(TRIES):
        for name, wanted in (("enable", {}), ("mode", gait)):
            service.wait(lambda n=name, w=wanted: done_or_stopped(service, n, w))
        record = service.until(lambda one: walks(one) or one.mode == Mode.FAULT)
        if walks(record):
            return record
        ready_again(service)
    raise AssertionError(f"never walks: {record.verdict}")


def done_or_stopped(service: Inside, name: str, wanted: dict[str, object]) -> bool:
    done = service.request(name, **wanted)["outcome"] == "done"
    return done or service.newest().mode == Mode.FAULT


def ready_again(service: Inside) -> None:
    service.done("reset")
    service.until(lambda record: record.mode == Mode.READY)


def cycles(service: Inside, count: int) -> None:
    """Let so many cycles of the core pass."""
    first = service.newest().seq
    service.until(lambda record: record.seq >= first + count)


def service_on_vcan(report: Report) -> None:
    """The whole service walks; faults, cable, wall clock; SIGTERM."""
    with inside(report, "vcan") as service:
        with witnessed(report, "up"):
            up(service)
        report["core_log"] = service.log("core")
        walking(service)
        _quiet(report, service)
        _wall_clock(report, service)
        _fault(report, service)
        _error_frames(report, service)
        _queue_full(report, service)
        _cable(report, service)
        _end(report, service)


def _quiet(report: Report, service: Inside) -> None:
    """Nothing but walking, with canbusload beside candump."""
    load = MEMORY / "canbusload"
    seq = service.newest().seq
    with witnessed(report, "quiet"):
        with load.open("wb") as file:
            measuring = subprocess.Popen(
                ["canbusload", "-e", "vcan0@1000000"], stdin=subprocess.DEVNULL, stdout=file
            )
        time.sleep(WALK_S)
        measuring.terminate()
        measuring.wait()
    report.keep_records("quiet", service, seq)
    report["canbusload"] = load.read_text()
    report["health"] = service.request("status")


def _wall_clock(report: Report, service: Inside) -> None:
    """An operator and an NTP daemon set the clock, far and near, while the leg walks."""
    seq = service.newest().seq
    for step in ("+1 hour", "-2 hours", "+1 hour"):
        shell(f"date -s '{step}' > /dev/null")
        time.sleep(STEP_PAUSE_S)
    for step_s in (0.007, -0.007, 0.0004, -0.0004, -0.003, 0.003):
        time.clock_settime(time.CLOCK_REALTIME, time.time() + step_s)
        time.sleep(STEP_PAUSE_S)
    report.keep_records("wall_clock", service, seq)
    report["drives_after_steps"] = service.truth()[-1]


def _fault(report: Report, service: Inside) -> None:
    """One drive reports a fault by EMCY, in the middle of the gait."""
    seq = service.newest().seq
    with witnessed(report, "fault"):
        report["injected"] = service.inject(f"emcy right/hip - {EMERGENCY}")
        service.until(lambda record: record.mode == Mode.FAULT)
        cycles(service, 20)
    report.keep_records("fault", service, seq)
    service.inject("clear emcy right/hip")
    ready_again(service)


def _error_frames(report: Report, service: Inside) -> None:
    """What a controller's driver would report, put on the interface as kernel error frames."""
    walking(service)
    seq = service.newest().seq
    with witnessed(report, "error_frames"):
        for frame in (WARNING, PASSIVE, ACTIVE_AGAIN):
            shell(f"cansend vcan0 {frame}")
            cycles(service, 10)
        shell(f"cansend vcan0 {BUS_OFF}")
        cycles(service, 30)
        shell(f"cansend vcan0 {RESTARTED}")
        service.until(lambda record: record.mode == Mode.FAULT)
        cycles(service, 10)
    report.keep_records("error_frames", service, seq)
    ready_again(service)
    report["bus_after_reset"] = service.newest().bus.condition


def _queue_full(report: Report, service: Inside) -> None:
    """The interface's transmit queue takes nothing for a while: ENOBUFS of a real kernel."""
    walking(service)
    seq = service.newest().seq
    shell("tc qdisc replace dev vcan0 root netem delay 10s limit 1")
    service.until(lambda record: record.tx_dropped_count > 0)
    service.until(lambda record: record.mode in {Mode.STOPPING, Mode.FAULT})
    shell("tc qdisc del dev vcan0 root")
    service.until(lambda record: record.mode == Mode.FAULT)
    report.keep_records("queue_full", service, seq)
    ready_again(service)


def _cable(report: Report, service: Inside) -> None:
    """The interface goes down while the leg walks, and comes back with new drives on it."""
    walking(service)
    core = service.parts["core"].pid
    seq = service.newest().seq
    shell("ip link set vcan0 down")
    service.until(lambda record: record.mode == Mode.FAULT)
    cycles(service, 20)
    report.keep_records("cable", service, seq)
    service.parts["sim"].wait()
    report["sim_without_bus"] = service.parts["sim"].returncode
    shell("ip link set vcan0 up")
    service.start_drives()
    ready_again(service)
    report["same_core"] = service.runs("core") and service.parts["core"].pid == core


def _end(report: Report, service: Inside) -> None:
    """SIGTERM while the leg walks."""
    walking(service)
    seq = service.newest().seq
    with witnessed(report, "end"):
        service.kill("core", signal.SIGTERM)
        report["core_exit"] = service.parts["core"].wait()
    report.keep_records("end", service, seq)


def bench_on_vcan(report: Report) -> None:
    """One drive that is not ours beside one of `gaitd sim`: durand's process is the bench's."""
    template = bench(MEMORY / "bench_files", Change("hil.toml", '"can0"', '"vcan0"'))
    slow = GAIT | {"cadence_hz": 0.25, "amplitude_ratio": 0.7}
    with inside(report, "bench", template) as service:
        service.start("bench_motor")
        service.wait(lambda: "a drive on the bench" in service.log("bench_motor"))
        with witnessed(report, "bench_up"):
            up(service)
        for drive in ("right/hip", "right/slide"):
            _proven(service, drive)
        walking(service, slow)
        seq = service.newest().seq
        cycles(service, 400)  # a stride
        service.request("stop")
        service.until(lambda record: record.mode == Mode.FAULT)
        cycles(service, 20)
        report.keep_records("bench", service, seq)
        ready_again(service)
        walking(service, slow)
        seq = service.newest().seq
        service.kill("bench_motor")
        service.until(lambda record: record.mode == Mode.FAULT)
        cycles(service, 40)
        report.keep_records("bench_lost", service, seq)
        (report.folder / "bench_truth.csv").write_bytes(service.truth_path.read_bytes())


def _proven(service: Inside, drive: str) -> None:
    """The sign of one axis: measured, then as by a person who has watched it."""
    service.done("mode", mode="commission", axis=drive)
    service.until(lambda record: record.mode == Mode.COMMISSION)
    service.until(lambda record: record.mode == Mode.READY)
    service.done("mode", mode="commission", axis=drive, witnessed=True)


def service_on_two_controllers(report: Report) -> None:
    """The core on one emulated controller (SJA1000 on a Kvaser card), the drives on the other.

    The emulation carries frames and has registers and interrupts; it makes no errors: what is sent
    counts as acknowledged, whoever hears it and at whatever bit rate, so no error counter rises.
    """
    shell("modprobe kvaser_pci")
    for interface in ("can0", "can1"):
        set_up(interface, "restart-ms 100")
    with inside(report, "controllers", core="can0", sim="can1") as service:
        up(service)
        report["controller"] = link("can0")
        walking(service)
        _between_controllers(report, service)
        _other_controller_down(report, service)
        _own_controller_down(report, service)
        service.kill("core", signal.SIGTERM)
        report["controllers_exit"] = service.parts["core"].wait()


def verified_on_two_controllers(report: Report) -> None:
    """`gaitd drive verify` of a virtual drive without a load, through both controllers."""
    changes = (
        Change("vcan.toml", '"robot.toml"', '"robot_bench.toml"'),
        Change("vcan.toml", '"limits.toml"', '"limits_bench.toml"'),
        Change("vcan.toml", '"plant.toml"', '"plant_bench.toml"'),
        Change("vcan.toml", "window_ms = 4.0", f"window_ms = {WINDOW_MS}"),
    )
    configs = copied(MEMORY / "verified")
    changed(configs, *changes)
    trainer = configs / "vcan.toml"
    drives = configs / "drives.toml"
    text = trainer.read_text()
    trainer.write_text(text.replace('"vcan0"', '"can0"'))
    drives.write_text(text.replace('"vcan0"', '"can1"\nvirtual_drives = true'))
    said = configs / "sim.log"
    said.touch()
    sim = Forked(["sim", "--config", str(drives)], said)
    while "virtual drives" not in sim.output():
        sim.check()
        time.sleep(STEP_PAUSE_S)
    evidence, log = configs / "hip.zip", configs / "verify.log"
    files = ("--output", str(evidence), "--key", str(configs / "key.pem"))
    words = ["drive", "verify", "right/hip", "--config", str(trainer), *files]
    report["verify_exit"] = Forked([*words, "--inertia", "0.35", "--yes"], log).wait()
    sim.end()
    for file in (evidence, log):
        if file.exists():
            (report.folder / file.name).write_bytes(file.read_bytes())


def _between_controllers(report: Report, service: Inside) -> None:
    seq = service.newest().seq
    with witnessed(report, "controllers", "can1"):
        time.sleep(WALK_S / 2)
    report.keep_records("controllers", service, seq)
    # Nothing to restart: the driver refuses unless the controller is bus-off.
    tried = subprocess.run(
        ["ip", "link", "set", "can0", "type", "can", "restart"], capture_output=True, check=False
    )
    report["restart_refused"] = tried.returncode != 0


def _other_controller_down(report: Report, service: Inside) -> None:
    """No node is left that could acknowledge; at another bit rate it would be the same."""
    seq = service.newest().seq
    shell("ip link set can1 down")
    service.until(lambda record: record.mode == Mode.FAULT)
    cycles(service, 20)
    report.keep_records("other_down", service, seq)
    report["controller_alone"] = link("can0")
    service.parts["sim"].wait()
    shell("ip link set can1 up")
    service.start_drives()
    ready_again(service)


def _own_controller_down(report: Report, service: Inside) -> None:
    walking(service)
    seq = service.newest().seq
    shell("ip link set can0 down")
    service.until(lambda record: record.mode == Mode.FAULT)
    cycles(service, 20)
    report.keep_records("own_down", service, seq)
    shell("ip link set can0 up")
    ready_again(service)


def service_on_usb_adapters(report: Report) -> None:
    """The core on one USB adapter, the drives on the other: these report what goes wrong.

    Nothing is enabled: the one slow processor has two adapters to serve as well, and the drives
    answer too late to walk, sometimes even to stay found.
    """
    shell("modprobe vhci-hcd")
    shell("modprobe usb_8dev")
    wire = Wire()
    ours, theirs = wire.interfaces
    for interface in (ours, theirs):
        set_up(interface)
    with inside(report, "usb", core=ours, sim=theirs) as service:
        up(service)
        report["usb"] = link(ours)
        _alone_on_the_wire(report, service, ours, theirs)
        _transceiver_breaks(report, service, wire)
        _restarts_by_itself(report, service, wire)
        service.kill("core", signal.SIGTERM)
        report["usb_exit"] = service.parts["core"].wait()


def link(interface: str) -> dict[str, Any]:
    """What the kernel says of an interface."""
    return json.loads(shell(f"ip -details -statistics -json link show {interface}"))[0]


def found_again(service: Inside) -> None:
    """READY; with a reset where the core wants one."""

    def ready() -> bool:
        mode = service.newest().mode
        if mode == Mode.FAULT:
            service.request("reset")
        return mode == Mode.READY

    service.wait(ready)


def _alone_on_the_wire(report: Report, service: Inside, ours: str, theirs: str) -> None:
    """The drives' adapter is closed: no node acknowledges any more."""
    seq = service.newest().seq
    shell(f"ip link set {theirs} down")
    service.until(lambda record: record.bus.condition == PASSIVE_CONDITION)
    cycles(service, 20)
    report.keep_records("usb_alone", service, seq)
    report["usb_alone"] = link(ours)
    service.parts["sim"].wait()
    seq = service.newest().seq
    shell(f"ip link set {theirs} up")
    service.start_drives()
    found_again(service)
    # Each frame that is heard takes one off the counter.
    service.until(lambda record: record.bus.condition == ACTIVE_CONDITION)
    report.keep_records("usb_heard_again", service, seq)
    report["usb_heard_again"] = link(ours)


def _transceiver_breaks(report: Report, service: Inside, wire: Wire) -> None:
    """Whatever our adapter sends is disturbed: bus-off; mended, it is restarted by hand."""
    ours, theirs = wire.interfaces
    seq = service.newest().seq
    wire.order("break 0")
    service.until(lambda record: record.bus.condition == OFF_CONDITION)
    with witnessed(report, "usb_off", theirs):
        cycles(service, 30)
    report.keep_records("usb_off", service, seq)
    report["usb_off"] = link(ours)
    wire.order("mend 0")
    cycles(service, 30)
    report["usb_mended"] = link(ours)
    shell(f"ip link set {ours} type can restart")
    found_again(service)
    report["usb_restarted"] = link(ours)
    report["condition_restarted"] = service.newest().bus.condition


RESTART_MS = 100


def _restarts_by_itself(report: Report, service: Inside, wire: Wire) -> None:
    """The same with `restart-ms`, as the shipped set-up has it; nothing is done by hand."""
    ours, _ = wire.interfaces
    shell(f"ip link set {ours} down")
    set_up(ours, f"restart-ms {RESTART_MS}")
    found_again(service)
    before = service.newest()
    wire.order("break 0")
    service.until(lambda record: record.bus.bus_off_count >= before.bus.bus_off_count + 2)
    report.keep_records("usb_restarting", service, before.seq)
    report["usb_restarting"] = link(ours)
    wire.order("mend 0")
    seq = service.newest().seq
    found_again(service)
    report.keep_records("usb_restarted_by_itself", service, seq)
    report["usb_restarted_by_itself"] = link(ours)
