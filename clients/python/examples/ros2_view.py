"""Role display: a trainer in ROS 2, as rmw_zenoh has it; needs the package rosbags, and no ROS.

| topic | type | content |
|---|---|---|
| /joint_states | sensor_msgs/JointState | LEG_hip (rad, rad/s, N·m), LEG_slide (m, m/s, N) |
| /LEG_hip/patient | geometry_msgs/WrenchStamped | torque.z: the patient, about the joint |
| /LEG_slide/patient | geometry_msgs/WrenchStamped | force.x: the patient, along the rail |
| /diagnostics | diagnostic_msgs/DiagnosticArray | why a number is missing, stops, drives; 1 Hz |

What is not valid is not published, neither as 0 nor as NaN: a joint is left out, a wrench not sent.
Keys, tokens and attachment: docs/design.md of github.com/ros2/rmw_zenoh; type hashes: REP 2016.
"""

import argparse
import itertools
import struct
import threading
import uuid
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import zenoh
from gaitd_client import (
    Cause,
    Clock,
    DriveState,
    Estimate,
    NotValid,
    Safety,
    Target,
    Trainer,
    Trouble,
    Validity,
)
from gaitd_client.connection import PLACE_IN_ZENOH, client_settings, config_of
from gaitd_client.trainer import LEGS
from gaitd_client.wire import JOINTS
from gaitd_texts import Reader, catalogue
from rosbags.typesys import Stores, get_typestore

ROS: Final = get_typestore(Stores.ROS2_JAZZY)
NODE: Final = "gaitd"
TEXTS: Final = catalogue(Reader.OPERATOR, "en")
QOS: Final = "::,10:,:,:,,"
"""Reliable, volatile, the newest ten; the rest as by default."""
PERIOD_S = 1.0
OK, WARN, ERROR, STALE = range(4)
FIELDS: Final = ("position", "velocity", "effort")
"""Names of a joint's values, in ROS and in an estimate."""
VALIDITY: Final[dict[str, tuple[int, str]]] = {
    Validity.OK: (OK, "the patient's effort is known"),
    Validity.SPLIT_UNOBSERVABLE: (WARN, "at rest patient and friction cannot be separated"),
    Validity.BAD: (ERROR, "the estimate is not valid"),
}


def ros(kind: str, **fields: object) -> object:
    """Make a message of ROS."""
    made: Any = ROS.types[kind]
    return made(**fields)


def header(time_ns: int, frame: str = "") -> object:
    """Make the header of a stamped message."""
    stamp = ros("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)
    return ros("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


class TrainerTime:
    """UTC of the trainer, the one clock of all stamps: that of its newest message, going on."""

    def __init__(self, clock: Clock) -> None:
        """Begin without a message: the time is 0."""
        self._clock, self._ahead_ns = clock, None

    def take(self, sample_time_ns: int | None) -> None:
        """Take the time of a message that has just come."""
        if sample_time_ns is not None:
            self._ahead_ns = sample_time_ns - self._clock.now_ns()

    @property
    def now_ns(self) -> int:
        """The time now; 0 before the first message."""
        return 0 if self._ahead_ns is None else self._clock.now_ns() + self._ahead_ns


class Topic:
    """A publisher of the node; its token shows it to `ros2 topic list`."""

    def __init__(
        self,
        session: zenoh.Session,
        time: TrainerTime,
        domain: int,
        number: int,
        name: str,
        kind: str,
    ) -> None:
        """Declare it; `number` is its own among the entities of the node."""
        self._time = time
        package, _, short = kind.split("/")
        typed = f"{package}::msg::dds_::{short}_/{ROS.hash_rihs01(kind)}"
        entity = f"@ros2_lv/{domain}/{session.zid()}/0/{number}/MP/%/%/{NODE}"
        token = f"{entity}/{name.replace('/', '%')}/{typed}/{QOS}"
        self._token = session.liveliness().declare_token(token)
        self._publisher = session.declare_publisher(f"{domain}{name}/{typed}")
        self._kind, self._gid, self._count = kind, uuid.uuid4().bytes, 0

    def publish(self, **fields: object) -> None:
        """Send a message as CDR, with its number, time and sender."""
        self._count += 1
        attachment = struct.pack("<qqB16s", self._count, self._time.now_ns, 16, self._gid)
        message = ROS.serialize_cdr(ros(self._kind, **fields), self._kind)
        self._publisher.put(bytes(message), attachment=attachment)


class View:
    """A node with all topics of one trainer."""

    def __init__(
        self, trainer: Trainer, session: zenoh.Session, legs: Sequence[str], domain: int
    ) -> None:
        """Declare the node, and publish joints and patient from now on."""
        token = f"@ros2_lv/{domain}/{session.zid()}/0/0/NN/%/%/{NODE}"
        self._token = session.liveliness().declare_token(token)
        self._time = TrainerTime(trainer.clock)
        numbers, names = itertools.count(1), [f"{leg}_{axis}" for leg in legs for axis in JOINTS]

        def topic(name: str, kind: str) -> Topic:
            return Topic(session, self._time, domain, next(numbers), name, kind)

        wrench = "geometry_msgs/msg/WrenchStamped"
        self._joints = {leg: topic("/joint_states", "sensor_msgs/msg/JointState") for leg in legs}
        self._patient = {name: topic(f"/{name}/patient", wrench) for name in names}
        self._diagnostics = topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self._safety = trainer.safety()
        self._drives = {name: trainer.drive(name.replace("_", "/")) for name in names}
        self._estimates = {leg: trainer.estimate(leg) for leg in legs}
        for stream in self._estimates.values():
            stream.call(self._show)

    def _show(self, item: Estimate | NotValid) -> None:
        """Publish what is valid in one estimate."""
        if isinstance(item, NotValid):
            return
        self._time.take(item.sample_time_ns)
        axes = {axis: getattr(item, axis) for axis in JOINTS}
        rows = {name: [getattr(one, field) for field in FIELDS] for name, one in axes.items()}
        valid = {f"{item.leg}_{axis}": row for axis, row in rows.items() if None not in row}
        if valid:
            columns = np.array(list(valid.values())).T.copy()
            self._joints[item.leg].publish(
                header=header(item.sample_time_ns),
                name=list(valid),
                **dict(zip(FIELDS, columns, strict=True)),
            )
        for axis, force_n, torque_nm in (
            ("hip", 0.0, item.hip.patient),
            ("slide", item.slide.patient, 0.0),
        ):
            if force_n is None or torque_nm is None:
                continue
            force = ros("geometry_msgs/msg/Vector3", x=force_n, y=0.0, z=0.0)
            torque = ros("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=torque_nm)
            name = f"{item.leg}_{axis}"
            self._patient[name].publish(
                header=header(item.sample_time_ns, name),
                wrench=ros("geometry_msgs/msg/Wrench", force=force, torque=torque),
            )

    def diagnose(self) -> None:
        """Publish why what is missing is missing, now."""
        judged = {"machine": judge(self._safety.newest())}
        for name, drive in self._drives.items():
            leg, axis = name.split("_")
            judged[f"{name} patient"] = judge(self._estimates[leg].newest(), axis)
            judged[f"{name} drive"] = judge(drive.newest())
        self._diagnostics.publish(
            header=header(self._time.now_ns),
            status=[
                ros(
                    "diagnostic_msgs/msg/DiagnosticStatus",
                    level=level,
                    name=f"{NODE}: {name}",
                    message=text,
                    hardware_id=NODE,
                    values=[],
                )
                for name, (level, text) in judged.items()
            ],
        )


def judge(item: Safety | DriveState | Estimate | NotValid, axis: str = "") -> tuple[int, str]:
    """Return level and text of a machine, of a drive, or of the patient at an axis."""
    match item:
        case NotValid():
            return (STALE if item.trouble is Trouble.SILENT else ERROR), item.text
        case Safety(verdict=None):
            return STALE, "no records from the core"
        case Safety(verdict=stop) if stop is not None and stop.cause != Cause.NONE:
            return ERROR, f"{TEXTS.verdict(stop)}: {TEXTS.remedy(stop.cause)}"
        case Safety():
            return OK, str(item.mode)
        case DriveState():
            is_failed = item.power_state.startswith("fault") or item.emergency_code is not None
            level = ERROR if is_failed else OK if item.fresh else STALE
            return level, item.emergency_text or item.power_state
        case Estimate():
            validity = getattr(item, axis).validity
            return VALIDITY.get(validity, (ERROR, validity))


def main(arguments: Sequence[str] | None = None, over: threading.Event | None = None) -> None:
    """Publish until the program is ended."""
    parser = argparse.ArgumentParser(
        description="Show a trainer of gaitd in ROS 2.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    here = "tcp/127.0.0.1:"
    parser.add_argument("gaitd", nargs="?", default=f"{here}7447", help="endpoint of the service")
    parser.add_argument("ros", nargs="?", default=f"{here}7448", help="that of ROS's Zenoh router")
    parser.add_argument("--leg", action="append", choices=LEGS, help="repeatable; right if none")
    parser.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID")
    parser.add_argument("--credentials", help="folder of `gaitd keys issue`, role display")
    asked = parser.parse_args(arguments)
    over = over or threading.Event()
    try:
        session = zenoh.open(config_of(client_settings(Target((asked.ros,)))))
    except zenoh.ZError as error:
        reason = PLACE_IN_ZENOH.sub("", str(error))
        parser.exit(2, f"{asked.ros}: no router of ROS listens there: {reason}\n")
    trainer = Trainer(asked.gaitd, asked.credentials, client=NODE, keep_trying=True)
    with session, trainer:
        view = View(trainer, session, list(dict.fromkeys(asked.leg or ["right"])), asked.domain)
        while not over.wait(PERIOD_S):
            view.diagnose()


if __name__ == "__main__":
    main()
