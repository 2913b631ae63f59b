"""The reference controller's program on a running service, in simulated time."""

import threading
from pathlib import Path

import msgspec
from gaitd_assist import StrideLine
from gaitd_client.wire import ControllerState
from gaitd_names import Mode
from tutorial import example

SHIPPED = Path(__file__).parents[2] / "clients" / "assist" / "configs" / "assist.toml"


def test_the_tutorials_law_walks_a_gait_and_logs_and_publishes_its_strides(long_service, tmp_path):
    """An operator starts the gait; the program holds the lease and requests nothing."""
    long_service.bring(Mode.HOLD)
    file = tmp_path / "assist.toml"
    file.write_bytes(SHIPPED.read_bytes())
    with long_service.client("assist") as trainer, long_service.client("operator") as operator:
        published = []
        operator.controller("right").call(published.append)
        answering = threading.Thread(
            target=example("own_law").main, args=(trainer, file), kwargs={"duration_s": 12.0}
        )
        answering.start()
        long_service.wait(lambda: trainer.status().safety.lease_holder == "gaitd-assist", 30)
        operator.mode("gait", cadence_hz=0.35, amplitude_ratio=1.0, duration_s=600.0)
        with long_service._fast():
            long_service.wait(lambda: not answering.is_alive(), 60)
        answering.join()
        long_service.wait_for(Mode.HOLD)  # braked and held: it has left while it assisted
        ended = trainer.status().safety

    lines = [
        msgspec.json.decode(line, type=StrideLine)
        for line in (tmp_path / "assist.jsonl").read_text().splitlines()
    ]
    assert [line.number for line in lines] == list(range(lines[0].number, lines[-1].number + 1))
    assert len(lines) >= 2
    assert all(line.learned for line in lines)
    assert lines[-1].values["stiffness_ratio"] < lines[0].values["stiffness_ratio"]
    assert (ended.mode, ended.lease_holder) == ("hold", None)
    states = [one for one in published if isinstance(one, ControllerState)]
    # The one of the last half second is logged alone: the lease has ended.
    assert len(states) >= len(lines) - 1 >= 1
    for state, line in zip(states, lines, strict=False):
        assert (state.client, state.for_cycle) == ("gaitd-assist", line.cycle)
        assert state.values["stiffness_ratio"] == line.values["stiffness_ratio"]
        assert state.values["damping_ratio"] == line.values["damping_ratio"]
        assert state.hip["assist"] == tuple(line.hip["assist"])
