"""A controller in its own process: it steers, and it dies."""

import subprocess
import sys
from pathlib import Path

import pytest
from gaitd_names import Cause, Mode
from long_service import LongService
from records import both

DOCUMENT = Path(__file__).parents[2] / "docs" / "control_by_others.md"


def controller_of_the_document() -> str:
    text = DOCUMENT.read_text().partition("<!-- controller: begin -->\n```python\n")[2]
    return text.partition("```\n<!-- controller: end -->")[0]


class Bench:
    def __init__(self, service: LongService) -> None:
        self.service = service
        self.clients: list[subprocess.Popen[str]] = []

    def run(self, code: str, seconds: float) -> subprocess.Popen[str]:
        endpoint = f"tcp/127.0.0.1:{self.service.zenoh_port}"
        self.clients.append(
            subprocess.Popen(
                [sys.executable, "-I", "-c", code, endpoint, str(seconds)],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return self.clients[-1]

    def steering(self, seconds: float = 60.0) -> subprocess.Popen[str]:
        """The document's controller, its assist in force."""
        self.service.enable()
        client = self.run(controller_of_the_document(), seconds)
        self.service.wait(lambda: client.poll() is not None or self.assist_nm() > 0.1, 120)
        assert client.poll() is None, client.communicate()
        return client

    def assist_nm(self) -> float:
        record = self.service.newest()
        return record.legs[0].hip.assist if record.mode == Mode.TORQUE else 0.0

    def end(self) -> None:
        for client in self.clients:
            client.kill()
            client.communicate()


@pytest.fixture
def bench(long_service):
    made = Bench(long_service)
    yield made
    made.end()


def test_the_controller_of_the_document_steers_and_leaves_a_leg_that_is_held(bench):
    lapses_before = bench.service.enable().assist.lapse_count
    client = bench.steering(2.0)
    steering = bench.service.request("status")
    screen = bench.service.ask("status").out
    said, trouble = client.communicate(timeout=30)

    assert client.returncode == 0, trouble
    assert int(said.partition(" setpoints sent")[0]) > 10
    assert steering["safety"]["lease_holder"] == "example controller"
    assert "held by example controller" in screen
    record = bench.service.until(lambda record: record.mode != Mode.TORQUE)
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert record.assist.lapse_count == lapses_before
    assert bench.service.request("status")["safety"]["lease_holder"] is None


def test_a_controller_that_is_killed_leaves_a_leg_that_is_braked_and_held(bench):
    client = bench.steering()
    known = {event["id"] for event in bench.service.request("status")["events"]}

    client.kill()
    held = bench.service.until(lambda record: record.mode != Mode.TORQUE, 10)
    bench.service.wait(
        lambda: bench.service.request("status")["safety"]["lease_holder"] is None, 10
    )
    bench.service.run(0.5)

    record = bench.service.newest()
    assert (record.mode, record.verdict.cause) == (Mode.HOLD, Cause.NONE)
    assert held.assist.lapse_reason
    assert both(record.legs[0], "assist") == (0.0, 0.0)
    assert all(abs(drive.velocity) < 0.05 for drive in record.drives)
    new = [event for event in bench.service.request("status")["events"] if event["id"] not in known]
    (lapse,) = [event for event in new if event["code"] == "assist_lapsed"]
    assert lapse["priority"] == "medium"
    assert lapse["values"]["client"] == "example controller"


def test_a_stop_is_for_everybody_while_a_controller_steers(bench):
    bench.steering()

    stopped = bench.service.ask("stop")
    record = bench.service.until(lambda record: record.mode == Mode.FAULT, 10)

    assert stopped.code == 0
    assert record.verdict.cause == Cause.STOP_REQUESTED
    assert bench.service.request("status")["safety"]["lease_holder"] is None
