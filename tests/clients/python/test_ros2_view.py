"""The view for ROS 2: a gateway plays a recording, a Zenoh router receives, rosbags decodes."""

import importlib.util
import math
import signal
import subprocess
import sys
import tempfile
import threading
from collections import defaultdict
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import pytest
import zenoh
from gaitd_client import Estimate, Stride
from gaitd_client.connection import config_of
from published import Published
from rosbags.typesys import Stores, get_typestore
from zenoh.ext import HistoryConfig, Int64, declare_advanced_subscriber, z_deserialize

from analysis.stop_recording import opened
from daemon.gateway.playback import play

ROOT: Final = Path(__file__).parents[3]
EXAMPLE: Final = ROOT / "clients" / "python" / "examples" / "ros2_view.py"
ROS: Final = get_typestore(Stores.ROS2_JAZZY)
WRENCH: Final = (
    "geometry_msgs::msg::dds_::WrenchStamped_/"
    "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"
)
ARRAY: Final = (
    "diagnostic_msgs::msg::dds_::DiagnosticArray_/"
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
)
TOPICS: Final = {
    "joint_states": "sensor_msgs::msg::dds_::JointState_/"
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "right_hip/patient": WRENCH,
    "right_slide/patient": WRENCH,
    "diagnostics": ARRAY,
    "safety": ARRAY,
    "right/stride": ARRAY,
    "robot_description": "std_msgs::msg::dds_::String_/"
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "clock": "rosgraph_msgs::msg::dds_::Clock_/"
    "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
}
"""Type and hash of JointState as `ros2 topic info --verbose` prints them; hashes by REP 2016."""
KINDS: Final = {
    "joint_states": "sensor_msgs/msg/JointState",
    **dict.fromkeys(
        ("diagnostics", "safety", "right/stride"), "diagnostic_msgs/msg/DiagnosticArray"
    ),
    "robot_description": "std_msgs/msg/String",
    "clock": "rosgraph_msgs/msg/Clock",
}
RARE: Final = ("safety", "right/stride", "robot_description")
"""Some in a recording: the others come in every cycle, or period of the view."""
OK, WARN, ERROR, STALE = range(4)


def example():
    spec = importlib.util.spec_from_file_location("ros2_view", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Router:
    """The router of ROS, with a subscriber to all topics of domain 7."""

    def __init__(self, endpoint):
        self.session = zenoh.open(
            config_of(
                {
                    "mode": "router",
                    "listen/endpoints": [endpoint],
                    "scouting/multicast/enabled": False,
                }
            )
        )
        self.samples = defaultdict(list)
        self._decoded = defaultdict(list)
        self.arrived = threading.Event()
        self._subscriber = self.session.declare_subscriber("7/**", self._receive)
        self._watch = self.session.liveliness().declare_subscriber(
            "@ros2_lv/7/**", lambda _: self.arrived.set()
        )

    def _receive(self, sample):
        self.samples[str(sample.key_expr)].append(
            (sample.payload.to_bytes(), sample.attachment.to_bytes())
        )
        self.arrived.set()

    def messages(self, topic):
        """All so far; each is decoded once."""
        kind = KINDS.get(topic, "geometry_msgs/msg/WrenchStamped")
        decoded = self._decoded[topic]
        for payload, _ in self.samples[f"7/{topic}/{TOPICS[topic]}"][len(decoded) :]:
            decoded.append(ROS.deserialize_cdr(payload, kind))
        return decoded

    def levels(self, name):
        said = [one for array in self.messages("diagnostics") for one in array.status]
        return {one.level: one.message for one in said if one.name == f"gaitd: {name}"}

    def until(self, condition):
        while not condition():
            self.arrived.clear()
            assert self.arrived.wait(60)

    def kept(self, topic):
        """What a reader of a transient local topic gets that comes now."""
        arrived = threading.Event()
        samples = []

        def take(sample):
            samples.append(ROS.deserialize_cdr(sample.payload.to_bytes(), KINDS[topic]))
            arrived.set()

        key = f"7/{topic}/{TOPICS[topic]}"
        with declare_advanced_subscriber(self.session, key, take, history=HistoryConfig()):
            assert arrived.wait(60)
        return samples[0]

    def tokens(self):
        return [str(one.ok.key_expr) for one in self.session.liveliness().get("@ros2_lv/7/**")]


def qos_of(topic):
    return ":1:,1:,:,:,," if topic == "robot_description" else "::,10:,:,:,,"


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_ros_gets_what_is_valid_in_each_estimate_and_the_reason_for_what_is_not(monkeypatch):
    view, over = example(), threading.Event()
    monkeypatch.setattr(view, "PERIOD_S", 0.02)
    with (
        tempfile.TemporaryDirectory(prefix="ros") as folder,
        opened(ROOT / "gaitd" / "sample.ring.xz") as ring,
    ):
        gaitd, ros = (f"unixsock-stream/{folder}/{name}" for name in ("gaitd", "ros"))
        header, records = ring.header, ring.since(0)
        router = Router(ros)
        showing = threading.Thread(target=view.main, args=([gaitd, ros, "--domain=7"], over))
        showing.start()
        try:
            while (
                not {OK, ERROR} <= router.levels("machine").keys()
                or not {OK, WARN} <= router.levels("right_hip patient").keys()
                or min(len(router.messages(topic)) for topic in TOPICS if topic not in RARE) < 50
                or not all(router.messages(topic) for topic in RARE)
                or all(one.status[0].level != ERROR for one in router.messages("safety"))
            ):
                assert showing.is_alive()
                play(header, records, (gaitd,), 8.0)
            router.until(lambda: STALE in router.levels("right_slide drive"))
            tokens = router.tokens()
            late = router.kept("robot_description")
        finally:
            over.set()
            showing.join()
            router.until(lambda: not router.tokens())
            router.session.close()

    published = Published(header, records).of("right/estimate", Estimate)
    estimates = {one.sample_time_ns: one for one in published}
    joints = router.messages("joint_states")
    for message in joints:
        one = estimates[stamp_ns(message)]
        assert message.name == ["right_hip", "right_slide"]
        assert list(message.position) == [one.hip.position, one.slide.position]
        assert list(message.velocity) == [one.hip.velocity, one.slide.velocity]
        assert list(message.effort) == [one.hip.effort, one.slide.effort]
    for message in router.messages("right_hip/patient"):
        assert message.wrench.torque.z == estimates[stamp_ns(message)].hip.patient
        assert message.header.frame_id == "right_hip"
    for message in router.messages("right_slide/patient"):
        assert message.wrench.force.x == estimates[stamp_ns(message)].slide.patient
    at_rest = {time_ns for time_ns, one in estimates.items() if one.hip.patient is None}
    assert at_rest & {stamp_ns(message) for message in joints}
    times_ns = [stamp_ns(one) for one in router.messages("diagnostics") if stamp_ns(one)]
    assert min(estimates) <= min(times_ns)
    assert max(times_ns) <= max(estimates) + 60 * 10**9  # and not the time of this computer
    assert view.TEXTS.remedy("stop_requested") in router.levels("machine")[ERROR]
    assert "at rest" in router.levels("right_hip patient")[WARN]
    assert not math.isnan(sum(message.position.sum() for message in joints))

    clocks = {one.clock.sec * 10**9 + one.clock.nanosec for one in router.messages("clock")}
    assert clocks <= estimates.keys()
    strides = {
        one.sample_time_ns: one for one in Published(header, records).of("right/stride", Stride)
    }
    for message in router.messages("right/stride"):
        values = {one.key: one.value for one in message.status[0].values}
        one = strides[stamp_ns(message)]
        assert float(values["hip.work_positive_j"]) == one.hip.work_positive_j
        assert int(values["number"]) == one.number
    stops = [
        {value.key: value.value for value in message.status[0].values}
        for message in router.messages("safety")
        if message.status[0].level == ERROR
    ]
    assert "stop_requested" in {stop["verdict.cause"] for stop in stops}
    robot = ElementTree.fromstring(late.data)
    joints = {joint.get("name"): joint for joint in robot.iter("joint")}
    assert joints["right_hip"].find("limit").get("effort") == str(
        header.limits["hip"]["torque_max_nm"]
    )
    assert (
        float(joints["right_slide"].find("origin").get("xyz").split()[0])
        == (header.robot["geometry"]["rail_x_m"])
    )
    assert {link.get("name") for link in robot.iter("link")} == {"trainer", *joints}

    for topic, kind in TOPICS.items():
        sent = [
            z_deserialize(tuple[Int64, Int64, bytes], zenoh.ZBytes(attachment))
            for _, attachment in router.samples[f"7/{topic}/{kind}"]
        ]
        assert [number for number, _, _ in sent] == list(range(1, len(sent) + 1))
        assert len({gid for _, _, gid in sent}) == 1
        assert len(sent[0][2]) == 16
    zid = tokens[0].split("/")[2]
    ends = [token.removeprefix(f"@ros2_lv/7/{zid}/0/").partition("/")[2] for token in tokens]
    assert sorted(ends) == sorted(
        ["NN/%/%/gaitd"]
        + [
            f"MP/%/%/gaitd/%{topic.replace('/', '%')}/{kind}/{qos_of(topic)}"
            for topic, kind in TOPICS.items()
        ]
    )


def test_a_router_that_is_not_there_is_named():
    ended = subprocess.run(
        [sys.executable, EXAMPLE, "tcp/127.0.0.1:9", "tcp/127.0.0.1:9"],
        capture_output=True,
        text=True,
        check=False,
    )

    assert ended.returncode == 2
    assert "tcp/127.0.0.1:9: no router of ROS listens there" in ended.stderr


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_a_signal_ends_the_view_without_a_word(tmp_path, number):
    router = Router(f"unixsock-stream/{tmp_path}/ros")
    shown = subprocess.Popen(
        [
            sys.executable,
            EXAMPLE,
            "tcp/127.0.0.1:9",
            f"unixsock-stream/{tmp_path}/ros",
            "--domain=7",
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    router.until(lambda: router.messages("diagnostics"))
    shown.send_signal(number)
    _, said = shown.communicate(timeout=60)
    router.session.close()

    assert (shown.returncode, said) == (0, "")
