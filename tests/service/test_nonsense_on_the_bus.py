"""CAN fuzz of the running service as processes: a station on the bus that talks nonsense in a gait.

Nonsense in other modes is that of tests/conformance, in lock-step.

`pytest --fuzz-minutes=N` lets it talk for N minutes each, from a seed of its own, which is in the
names of the tests.
"""

import random
import tempfile
from pathlib import Path

import can
import pytest
from gaitd_names import Mode
from processes import Service
from random_frames import KINDS, controller_error, is_command

from gaitd_lab.processes import memory_folder

PERIOD_S = 0.01
BURST_MAX = 9
"""Frames at once; 500 in a second on average."""
TALK_S = 2.0
TIMEOUT_S = 300.0
REFUSED = 3
GAIT = ("mode", "gait", "--cadence", "0.25", "--amplitude", "1", "--duration", "600")
SPOKEN = tuple(kind for kind in KINDS if kind is not controller_error)
"""An error frame is the controller's, not a station's."""


@pytest.fixture
def service():
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        service = Service(Path(folder))
        try:
            yield service.start_all()
        finally:
            service.end()


def pytest_generate_tests(metafunc):
    minutes = metafunc.config.option.fuzz_minutes
    seed = 1 if minutes is None else random.SystemRandom().randrange(1_000_000)
    talk_s = TALK_S if minutes is None else minutes * 60
    limit = pytest.mark.timeout(talk_s + TIMEOUT_S)
    metafunc.parametrize(("seed", "talk_s"), [pytest.param(seed, talk_s, marks=limit)])


@pytest.fixture
def talk(service, seed, talk_s):
    def run():
        rng = random.Random(seed)
        with service.listener() as bus, service.held():
            for _ in range(round(talk_s / PERIOD_S)):
                for frame in (rng.choice(SPOKEN)(rng) for _ in range(rng.randint(1, BURST_MAX))):
                    if not is_command(frame):
                        bus.send(message(frame))
                service.run(rng.uniform(0.5, 1.5) * PERIOD_S)
                while bus.recv(0) is not None:
                    pass
                if not service.runs("core"):
                    break

    return run


def message(frame):
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)


def judge(service):
    """No process has died of it: a core may only end by refusing a drive, with its reason."""
    assert service.parts["sim"].poll() is None
    assert service.parts["gateway"].poll() is None
    code = service.parts["core"].poll()
    assert code in (None, REFUSED)
    assert code is None or "right/" in service.log("core")
    for part in service.parts:
        assert "Traceback" not in service.log(part), service.log(part)


def test_nonsense_while_walking_stops_the_machine_and_ends_no_process(service, talk):
    service.until(lambda record: record.mode == Mode.READY, 40)
    assert service.ask("enable").code == 0
    assert service.ask(*GAIT).code == 0

    talk()

    judge(service)
    service.until(lambda record: not record.mode.active, 10)
    service.run(1.0)
    row = service.truth()[-1]
    assert abs(float(row["hip_velocity_rad_per_s"])) < 0.1
    assert abs(float(row["slide_velocity_m_per_s"])) < 0.1
    modes = [record.mode for record in service.records()]  # of the last half a minute
    began = modes.index(Mode.STOPPING) if Mode.STOPPING in modes else 0
    assert not any(mode.active for mode in modes[began:])
