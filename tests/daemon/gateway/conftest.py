"""A core without drives, an outlet that is a list, and a clock that stands still."""

import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh
from gaitd_client import wire
from gaitd_names import Mode, Outcome
from processes import CONFIGS

from daemon.config.settings import Lease
from daemon.config.trainer import load_trainer
from daemon.gateway.clients import Clients, PlanStore
from daemon.gateway.process import serve
from daemon.gateway.reload import Reload
from daemon.gateway.service import Gateway
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import (
    AxisRecord,
    CycleRecord,
    DriveRecord,
    GatewayState,
    LegRecord,
    Request,
    RequestResult,
    Verdict,
)
from daemon.ipc.report import Refusal
from daemon.ipc.transport import CoreChannel, GatewayChannel, RingHeader
from daemon.keys.folder import Keys
from daemon.system.clock import MonotonicClock

MS = 1_000_000
NAN = float("nan")
LEASE = Lease(duration_ms=500, duration_max_ms=5000)


def drive(**changes: Any) -> DriveRecord:
    made = DriveRecord(
        name="right/hip",
        nmt_state=0x05,
        power_state=5,
        statusword=0x1637,
        mode_display=10,
        fresh=True,
        sample_age_cycles=0,
        late_count=0,
        heartbeat_age_ms=12.0,
        position=0.25,
        velocity=0.1,
        effort=3.5,
        target_effort=3.6,
        referenced=True,
        hand_switch_closed=True,
        sto_released=True,
        temperature_degc=31.0,
        emergency_code=0,
        emergency_text="",
        emergency_count=0,
        protocol_error_count=0,
    )
    return msgspec.structs.replace(made, **changes)


def diagonal(*variances: float) -> tuple[float, ...]:
    """A covariance without correlation, packed as the record has it."""
    return tuple(variances[i] if i == j else 0.0 for i in range(8) for j in range(i + 1))


HIP = AxisRecord(
    measured_position=0.2501,
    effort=5.0,
    reference_position=0.26,
    validity=0,
    position=0.25,
    position_std=0.001,
    velocity=1.0,
    velocity_std=0.02,
    friction=2.0,
    friction_std=0.3,
    patient=8.0,
    patient_std=0.5,
    net=6.0,
    net_std=0.4,
    innovation=1e-4,
)
SLIDE = AxisRecord(
    measured_position=0.4998,
    effort=-30.0,
    reference_position=0.51,
    validity=0,
    position=0.5,
    position_std=0.0005,
    velocity=-0.5,
    velocity_std=0.01,
    friction=20.0,
    friction_std=2.0,
    patient=40.0,
    patient_std=3.0,
    net=20.0,
    net_std=2.5,
    innovation=-2e-4,
)


def leg(
    hip: dict[str, Any] | None = None, slide: dict[str, Any] | None = None, **changes: Any
) -> LegRecord:
    """A leg whose estimate is valid, with changes of its axes and of itself."""
    made = LegRecord(
        name="right",
        hip=msgspec.structs.replace(HIP, **(hip or {})),
        slide=msgspec.structs.replace(SLIDE, **(slide or {})),
        status=0x1,
        covariance=diagonal(1e-6, 2.5e-7, 4e-4, 1e-4, 0.09, 4.0, 0.25, 9.0),
        nis=1.7,
    )
    return msgspec.structs.replace(made, **changes)


def record(seq: int = 1, **changes: Any) -> CycleRecord:
    made = CycleRecord(
        seq=seq,
        cycle=seq,
        sync_mono_ns=seq * 10 * MS,
        sync_utc_ns=1_760_000_000_000_000_000 + seq * 10 * MS,
        dt_s=0.01,
        mode=Mode.HOLD,
        verdict=Verdict(),
        events=(),
        request=RequestResult(),
        progress=None,
        gateway_age_cycles=1,
        stop_count=0,
        gait_phase=-1.0,
        drives=(drive(), drive(name="right/slide")),
        legs=(leg(),),
        timing=CycleTiming(
            lateness_ns=70_000, collect_ns=900_000, work_ns=250_000, overrun_count=0
        ),
        bus_load_ratio=0.21,
    )
    return msgspec.structs.replace(made, **changes)


def header(core_boot_id: str = "boot-a") -> RingHeader:
    return RingHeader(
        core_boot_id=core_boot_id,
        start_utc_ns=1_760_000_000_000_000_000,
        period_ns=10 * MS,
        trainer="trainer",
        drive_names=("right/hip", "right/slide"),
        leg_names=("right",),
        config_hashes={"robot.toml": "ab" * 32},
        version="0.1.0",
        robot={"geometry": {"thigh_length_m": 0.42}},
        limits={"hip": {"torque_max_nm": 60.0}},
    )


@pytest.fixture(scope="session")
def make_drive() -> Callable[..., DriveRecord]:
    return drive


@pytest.fixture(scope="session")
def make_leg() -> Callable[..., LegRecord]:
    return leg


@pytest.fixture(scope="session")
def make_record() -> Callable[..., CycleRecord]:
    return record


@pytest.fixture
def runtime() -> Iterator[Path]:
    # Not tmp_path: a Unix socket's path has room for 107 bytes.
    with tempfile.TemporaryDirectory(prefix="gw") as directory:
        yield Path(directory)


# --- in simulated time, without Zenoh ---------------------------------------------------------


@dataclass
class StillClock:
    ns: int = 1_000 * MS

    def now_ns(self) -> int:
        return self.ns

    def utc_ns(self) -> int:
        return 1_760_000_000_000_000_000 + self.ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.ns = max(self.ns, deadline_ns)


@dataclass
class ListOutlet:
    said: list[tuple[str, msgspec.Struct]] = field(default_factory=list)
    events: list[wire.Event] = field(default_factory=list)
    alive: bool = False
    seqs: dict[tuple[str, ...], int] = field(default_factory=dict)

    def next_seq(self, *parts: str) -> int:
        self.seqs[parts] = self.seqs.get(parts, 0) + 1
        return self.seqs[parts]

    def put(self, message: msgspec.Struct, *parts: str) -> None:
        self.said.append(("/".join(parts), message))

    def put_event(self, event: wire.Event) -> None:
        self.events.append(event)

    def links(self) -> list[tuple[str, str, str | None]]:
        return [("tcp", "127.0.0.1:50000", None)]

    def set_alive(self, alive: bool) -> None:
        self.alive = alive

    def on(self, key: str) -> list[Any]:
        return [message for said_on, message in self.said if said_on == key]


@dataclass
class Ask:
    name: str
    payload: bytes = b""
    identity: str = ""
    replies: list[Any] = field(default_factory=list)
    failed: bool = False

    def answer(self, message: msgspec.Struct, *, failed: bool = False) -> None:
        self.replies.append(message)
        self.failed = failed


class Bench:
    """A gateway on a real seam, in simulated time."""

    def __init__(self, runtime: Path) -> None:
        self.runtime = runtime
        self.clock = StillClock()
        self.outlet = ListOutlet()
        self.core = CoreChannel(runtime, header())
        self.seam = GatewayChannel(runtime)
        self.keys: Keys | None = None
        self.keys_trouble = ""
        self.disk_is_slow = False
        self.gateway = self.new_gateway()
        self.levels: list[GatewayState] = []
        self.seq = 0

    def new_gateway(self) -> Gateway:
        plans = PlanStore(self.runtime / "plan.json", self.submit)
        return Gateway(
            *(self.seam, self.outlet, self.clock, "trainer", ("unixsock-stream//x",), LEASE),
            *(Clients(self.keys), plans, lambda: self.keys_trouble),
        )

    def submit(self, _what: str, run: Callable[[], None]) -> bool:
        return not self.disk_is_slow and run() is None

    def replace_core(self, core_boot_id: str) -> None:
        self.core.close()
        self.core = CoreChannel(self.runtime, header(core_boot_id))
        self.seq = 0

    def replace_gateway(self) -> None:
        self.seam.close()
        self.outlet = ListOutlet()
        self.seam = GatewayChannel(self.runtime)
        self.gateway = self.new_gateway()

    def write(self, **changes: Any) -> CycleRecord:
        self.seq += 1
        written = record(self.seq, **changes)
        self.core.publish(written)
        return written

    def turn(self, *asks: Ask, after_ms: int = 10) -> None:
        self.clock.ns += after_ms * MS
        self.gateway.publish_estimates(self.clock.ns)
        self.gateway.turn(self.clock.ns, asks)
        self.levels += self.core.receive()

    def cycle(self, *asks: Ask, **changes: Any) -> None:
        self.write(**changes)
        self.turn(*asks)

    def close(self) -> None:
        self.gateway.close()
        self.seam.close()
        self.core.close()


@pytest.fixture
def bench(runtime: Path) -> Iterator[Bench]:
    with contextlib.closing(Bench(runtime)) as made:
        yield made


@pytest.fixture
def ask() -> type[Ask]:
    return Ask


# --- in real time, over Zenoh -----------------------------------------------------------------


class FakeCore:
    """Writes 100 records a second in a thread and answers requests as it was told to."""

    def __init__(self, runtime: Path, core_boot_id: str = "boot-a") -> None:
        self.changes: dict[str, Any] = {}
        self.silent = False
        """True: no records, as of a core that hangs."""
        self.answers: dict[str, RequestResult] = {}
        self.requests: list[Request] = []
        self.levels: list[GatewayState] = []
        self._ipc = CoreChannel(runtime, header(core_boot_id))
        self._stop_count: int | None = None
        self._result = RequestResult()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        seq, due = 0, time.monotonic()
        while not self._ended.is_set():
            seq += 1
            for level in self._ipc.receive():
                self.levels.append(level)
                self._stop_count = level.stop_count
                self._hear(level.request)
            if not self.silent:
                self._publish(seq)
            due = max(due + 0.01, time.monotonic())
            self._ended.wait(due - time.monotonic())

    def _publish(self, seq: int) -> None:
        self._ipc.publish(
            record(
                seq,
                **{
                    "sync_utc_ns": time.time_ns(),
                    "stop_count": self._stop_count or 0,
                    "request": self._result,
                    **self.changes,
                },
            )
        )

    def _hear(self, request: Request) -> None:
        if request.id in {0, self._result.id}:
            return
        self.requests.append(request)
        told = self.answers.get(request.kind, RequestResult())
        self._result = RequestResult(request.id, told.outcome, told.refusal)

    def answer(self, kind: str, outcome: Outcome, refusal: Refusal | None = None) -> None:
        self.answers[kind] = RequestResult(0, outcome, refusal)

    def end(self) -> None:
        """As kill -9: no word, and the ring stays."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            self._ipc.close()


@pytest.fixture(scope="session")
def fake_core() -> type[FakeCore]:
    return FakeCore


@pytest.fixture
def start_core(runtime: Path) -> Iterator[Callable[..., FakeCore]]:
    cores: list[FakeCore] = []

    def start(core_boot_id: str = "boot-a") -> FakeCore:
        cores.append(FakeCore(runtime, core_boot_id))
        return cores[-1]

    yield start
    for core in cores:
        core.end()


def client(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    # A socket has its name a moment before the gateway listens behind it.
    config.insert_json5("connect/timeout_ms", "60000")
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    return zenoh.open(config)


@pytest.fixture
def endpoint(runtime: Path) -> Iterator[str]:
    """A gateway that listens there, in a thread."""
    where = f"unixsock-stream/{runtime}/zenoh.sock"
    ended = threading.Event()
    thread = threading.Thread(
        target=serve,
        args=(
            *("trainer", (where,), runtime, runtime / "state"),
            *(MonotonicClock(), ended.is_set, LEASE, None),
            Reload(load_trainer(CONFIGS / "demo.toml"), load_trainer),
            lambda: None,
        ),
    )
    thread.start()
    deadline = time.monotonic() + 60
    while not (runtime / "zenoh.sock").exists():
        assert thread.is_alive()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    yield where
    ended.set()
    thread.join(60)
    assert not thread.is_alive()


@pytest.fixture
def session(endpoint: str, eventually: Callable[..., None]) -> Iterator[zenoh.Session]:
    """A client that is answered: a gateway listens before it has declared its queryables."""
    with contextlib.closing(client(endpoint)) as opened:
        eventually(lambda: any(one.ok for one in opened.get("gaitd/trainer/control/status")))
        yield opened


@pytest.fixture
def eventually() -> Callable[..., None]:
    """Wait until something is so, or fail."""

    def wait(is_so: Callable[[], object], within_s: float = 60.0) -> None:
        deadline = time.monotonic() + within_s
        while not is_so():
            assert time.monotonic() < deadline, "did not come true in time"
            time.sleep(0.005)

    return wait
