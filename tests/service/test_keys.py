"""A service with keys, from the start to a stop: who may do what, in simulated time."""

import json
import tempfile
import threading
from pathlib import Path

import pytest
from command_line import gaitd
from gaitd_client import Trainer
from gaitd_names import Cause, Mode
from gaitd_record import Begun, Finished, Options, Purpose, Room, record
from keyed_trainer import TrainerWithKeys

from gaitd_lab.processes import memory_folder

PLAN = {"cadence_max_hz": 0.4, "amplitude_max_ratio": 0.8, "duration_max_s": 300.0}
CLIENTS = {"operator.desk": False, "session.desk": False, "display.ward": True}
EDITS = {"demo.toml": {"gait.announce_s": 0.5}}
OLD_S = 1.5
"""A request that is older than this is refused."""


class WithJson(TrainerWithKeys):
    """Core and gateway write a JSON document a line for each event."""

    def start(self, part, *arguments, **given):
        with_json = ("--json",) if part in {"core", "gateway"} else ()
        return super().start(part, *arguments, *with_json, **given)

    def documents(self, part):
        return [json.loads(line) for line in self.log(part).splitlines() if line.startswith("{")]


@pytest.fixture
def trainer():
    with (
        tempfile.TemporaryDirectory(dir=memory_folder()) as folder,
        WithJson(Path(folder), CLIENTS, pace=5.0, edits=EDITS) as made,
    ):
        yield made.start_all()


def recorded_by(name, trainer):
    """Half a second as this client records it."""
    events, over = [], threading.Event()
    options = Options(Purpose.TRAINING, Room(trainer.folder / "recordings", 100))
    with Trainer(credentials=trainer.credentials(name)) as client:
        recorder = threading.Thread(target=record, args=(client, options, events.append, over))
        recorder.start()
        trainer.wait(lambda: any(isinstance(event, Begun) for event in events), 60)
        trainer.run(0.5)
        over.set()
        recorder.join()
    return [event for event in events if isinstance(event, Finished)]


def outcome(answer):
    return answer["outcome"], answer["refusal"]["code"]


def test_a_session_trains_within_its_plan_and_a_display_stops_it(trainer):
    gait = {"mode": "gait", "cadence_hz": 0.4, "amplitude_ratio": 0.8, "duration_s": 300.0}

    trainer.act_as("session.desk")
    enabled = trainer.enable()
    assert outcome(trainer.request("mode", **gait)) == ("refused", "no_plan")
    assert trainer.request("plan", plan=PLAN)["outcome"] == "unanswered"
    trainer.act_as("operator.desk")
    assert trainer.request("plan", plan=PLAN)["outcome"] == "done"

    trainer.act_as("session.desk")
    refusals = [
        trainer.request("mode", **{**gait, "cadence_hz": 0.41}),
        trainer.request("mode", mode="excite", scenario="open_loop", duration_s=25.0),
    ]
    assert [outcome(one) for one in refusals] == [
        ("refused", "cadence_above_plan"),
        ("refused", "role_may_not_mode"),
    ]
    assert refusals[0]["refusal"]["values"] == {"wanted": 0.41, "highest": 0.4}
    trainer.run(OLD_S)
    replayed = trainer.request("mode", **gait, for_cycle=enabled.cycle)
    assert outcome(replayed) == ("refused", "old")
    assert replayed["refusal"]["values"]["for_cycle"] == enabled.cycle
    assert trainer.mode == Mode.HOLD
    trainer.gait(0.4, 0.8, 300.0)

    (recording,) = recorded_by("display.ward", trainer)
    assert recording.message_count > 50
    trainer.act_as("display.ward")
    assert trainer.request("disable")["outcome"] == "unanswered"
    assert trainer.mode == Mode.GAIT
    stopped = trainer.stop()
    assert stopped.verdict.cause == Cause.STOP_REQUESTED
    trainer.act_as("session.desk")
    assert trainer.request("enable")["outcome"] == "refused"
    assert {*trainer.asked()} >= {
        *{("enable", "session.desk"), ("mode", "session.desk")},
        *{("plan", "operator.desk"), ("stop", "display.ward")},
    }
    assert not [name for name, client in trainer.asked() if client == "tester"]

    operator = ("--credentials", trainer.credentials("operator.desk"), "--config", trainer.config)
    applied = json.loads(gaitd("keys", "apply", *operator, "--json").out)
    assert (applied["request"], applied["outcome"]) == ("restart", "done")
    trainer.end()
    started, *_, ended = trainer.documents("core")
    assert (started["event"], started["part"], started["pid"]) == (
        *("started", "core"),
        trainer.parts["core"].pid,
    )
    assert ended == {"event": "ended", "part": "core", "exit_code": 0}
    assert {"stop_requested"} <= {one.get("cause") for one in trainer.documents("gateway")}
