"""Role display: a trainer in ROS 2, as rmw_zenoh has it; needs the package rosbags, and no ROS.

| topic | type | content |
|---|---|---|
| /joint_states | sensor_msgs/JointState | LEG_hip (rad, rad/s, N·m), LEG_slide (m, m/s, N) |
| /LEG_hip/patient | geometry_msgs/WrenchStamped | torque.z: the patient, about the joint |
| /LEG_slide/patient | geometry_msgs/WrenchStamped | force.x: the patient, along the rail |
| /LEG/stride | diagnostic_msgs/DiagnosticArray | each stride: its fields by their names with unit |
| /safety | diagnostic_msgs/DiagnosticArray | mode, verdict, lease: on change, and once a second |
| /diagnostics | diagnostic_msgs/DiagnosticArray | why a number is missing, stops, drives; 1 Hz |
| /robot_description | std_msgs/String | URDF of the driven links; a late reader gets it |
| /clock | rosgraph_msgs/Clock | only in simulated time: of the newest estimate |

What is not valid is not published, neither as 0 nor as NaN: a joint is left out, a wrench not sent.
All stamps are UTC of the trainer. SIGINT or SIGTERM ends the view.
Keys, tokens and attachment: docs/design.md of github.com/ros2/rmw_zenoh; type hashes: REP 2016.
"""

import argparse
import itertools
import math
import signal
import struct
import threading
import uuid
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec
import numpy as np
import zenoh
from gaitd_client import (
    Cause,
    ClientError,
    Clock,
    DriveState,
    Estimate,
    Health,
    NotValid,
    Safety,
    Stride,
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
from zenoh.ext import CacheConfig, declare_advanced_publisher

ROS: Final = get_typestore(Stores.ROS2_JAZZY)
NODE: Final = "gaitd"
TEXTS: Final = catalogue(Reader.OPERATOR, "en")
NEWEST_TEN: Final = "::,10:,:,:,,"
"""Reliable, volatile, the newest ten; the rest as by default."""
KEPT: Final = ":1:,1:,:,:,,"
"""Reliable, transient local, the newest one: a reader that comes later gets it, too."""
ARRAY: Final = "diagnostic_msgs/msg/DiagnosticArray"
PERIOD_S = 1.0
OK, WARN, ERROR, STALE = range(4)
FIELDS: Final = ("position", "velocity", "effort")
"""Names of a joint's values, in ROS and in an estimate."""
URDF_OF_LEG: Final = """\
<link name="{leg}_plane"/>
<link name="{leg}_hip"><visual><origin xyz="{middle_m} 0 0"/><geometry>
  <box size="{thigh_length_m} 0.08 0.08"/></geometry></visual></link>
<link name="{leg}_slide"><visual><geometry><box size="0.1 0.06 0.1"/></geometry></visual></link>
<joint name="{leg}_plane" type="fixed">
  <parent link="trainer"/><child link="{leg}_plane"/><origin rpy="{right_angle_rad} 0 0"/>
</joint>
<joint name="{leg}_hip" type="revolute">
  <parent link="{leg}_plane"/><child link="{leg}_hip"/><origin rpy="0 0 {thigh_rad}"/>
  <axis xyz="0 0 1"/>
  <limit lower="{hip_min_rad}" upper="{hip_max_rad}"
         velocity="{velocity_max_rad_per_s}" effort="{torque_max_nm}"/>
</joint>
<joint name="{leg}_slide" type="prismatic">
  <parent link="{leg}_plane"/><child link="{leg}_slide"/>
  <origin xyz="{rail_x_m} {rail_y_m} 0" rpy="0 0 {rail_rad}"/><axis xyz="1 0 0"/>
  <limit lower="{position_min_m}" upper="{position_max_m}"
         velocity="{velocity_max_m_per_s}" effort="{force_max_n}"/>
</joint>
"""
"""The plane of a leg has x forwards, y upwards, and z along the axis of the hip."""
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
    return ros("std_msgs/msg/Header", stamp=time_of(time_ns), frame_id=frame)


def time_of(time_ns: int) -> object:
    """Make a time."""
    return ros("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)


def status(name: str, level: int, text: str, values: Mapping[str, object] | None = None) -> object:
    """Make one status of a DiagnosticArray; what is None is left out."""
    return ros(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=f"{NODE}: {name}",
        message=text,
        hardware_id=NODE,
        values=[
            ros("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
            for key, value in (values or {}).items()
            if value is not None
        ],
    )


class TrainerTime:
    """UTC of the trainer, the one clock of all stamps: that of its newest estimate.

    It goes on with the computer's clock until the next one, but not where time is simulated.
    """

    def __init__(self, clock: Clock) -> None:
        """Begin without an estimate: the time is 0."""
        self._clock, self._ahead_ns, self._newest_ns = clock, 0, 0
        self.is_simulated = False

    def take(self, sample_time_ns: int) -> None:
        """Take the time of an estimate that has just come."""
        self._newest_ns, self._ahead_ns = sample_time_ns, sample_time_ns - self._clock.now_ns()

    @property
    def now_ns(self) -> int:
        """The time now; 0 before the first estimate."""
        if self.is_simulated or not self._newest_ns:
            return self._newest_ns
        return self._clock.now_ns() + self._ahead_ns


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
        qos: str = NEWEST_TEN,
    ) -> None:
        """Declare it; `number` is its own among the entities of the node."""
        self._time = time
        package, _, short = kind.split("/")
        typed = f"{package}::msg::dds_::{short}_/{ROS.hash_rihs01(kind)}"
        entity = f"@ros2_lv/{domain}/{session.zid()}/0/{number}/MP/%/%/{NODE}"
        token = f"{entity}/{name.replace('/', '%')}/{typed}/{qos}"
        self._token = session.liveliness().declare_token(token)
        key = f"{domain}{name}/{typed}"
        self._publisher = (
            declare_advanced_publisher(session, key, cache=CacheConfig(1), publisher_detection=True)
            if qos == KEPT
            else session.declare_publisher(key)
        )
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

        def topic(name: str, kind: str, qos: str = NEWEST_TEN) -> Topic:
            return Topic(session, self._time, domain, next(numbers), name, kind, qos)

        wrench = "geometry_msgs/msg/WrenchStamped"
        self._joints = {leg: topic("/joint_states", "sensor_msgs/msg/JointState") for leg in legs}
        self._patient = {name: topic(f"/{name}/patient", wrench) for name in names}
        self._diagnostics = topic("/diagnostics", ARRAY)
        self._safeties = topic("/safety", ARRAY)
        self._strides = {leg: topic(f"/{leg}/stride", ARRAY) for leg in legs}
        self._description = topic("/robot_description", "std_msgs/msg/String", KEPT)
        self._clocks = topic("/clock", "rosgraph_msgs/msg/Clock")
        self._trainer, self._is_described = trainer, False
        self._health = trainer.health()
        self._safety = trainer.safety()
        self._drives = {name: trainer.drive(name.replace("_", "/")) for name in names}
        self._estimates = {leg: trainer.estimate(leg) for leg in legs}
        for stream in self._estimates.values():
            stream.call(self._show)
        trainer.safety().call(self._show_safety)
        for leg in legs:
            trainer.stride(leg).call(self._show_stride)

    def _show(self, item: Estimate | NotValid) -> None:
        """Publish what is valid in one estimate."""
        if isinstance(item, NotValid):
            return
        self._time.take(item.sample_time_ns)
        if self._time.is_simulated:
            self._clocks.publish(clock=time_of(item.sample_time_ns))
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

    def _show_safety(self, item: Safety | NotValid) -> None:
        values = {} if isinstance(item, NotValid) else dict(flat(item, ("mode", "verdict")))
        if isinstance(item, Safety):
            values["lease_holder"] = item.lease_holder
        self._safeties.publish(
            header=header(self._time.now_ns), status=[status("safety", *judge(item), values)]
        )

    def _show_stride(self, item: Stride | NotValid) -> None:
        if isinstance(item, Stride):
            name = f"{item.leg} stride"
            self._strides[item.leg].publish(
                header=header(item.sample_time_ns),
                status=[status(name, OK, f"stride {item.number}", dict(flat(item)))],
            )

    def diagnose(self) -> None:
        """Publish why what is missing is missing, now, and what the machine is, if it is new."""
        health = self._health.newest()
        self._time.is_simulated = isinstance(health, Health) and bool(health.time_is_simulated)
        judged = {"machine": judge(self._safety.newest())}
        for name, drive in self._drives.items():
            leg, axis = name.split("_")
            judged[f"{name} patient"] = judge(self._estimates[leg].newest(), axis)
            judged[f"{name} drive"] = judge(drive.newest())
        self._diagnostics.publish(
            header=header(self._time.now_ns),
            status=[status(name, level, text) for name, (level, text) in judged.items()],
        )
        self._describe()

    def _describe(self) -> None:
        """Publish what the machine is, again after a time in which the service was not there."""
        if isinstance(self._safety.newest(), NotValid):
            self._is_described = False
        elif not self._is_described:
            try:
                asked = self._trainer.configuration()
            except ClientError:
                return  # it is asked again a second later
            self._description.publish(data=urdf(asked.robot, asked.limits, asked.leg_names))
            self._is_described = True


def flat(item: msgspec.Struct, names: Sequence[str] = ()) -> Iterator[tuple[str, object]]:
    """Yield the fields of a message, those of its structs as `hip.work_positive_j`."""
    for name in names or item.__struct_fields__:
        value = getattr(item, name)
        if isinstance(value, msgspec.Struct):
            yield from ((f"{name}.{inner}", one) for inner, one in flat(value))
        else:
            yield name, value


def urdf(robot: Mapping[str, Any], limits: Mapping[str, Any], legs: Sequence[str]) -> str:
    """Describe the driven links of each leg: the thigh turns about the hip, the slide on its rail.

    The origin is the hip axis; z points upwards, and x to where the patient looks. Shank and shoe
    close a loop between them, which URDF cannot describe.
    """
    lengths, hip, slide = robot["geometry"], limits["hip"], limits["slide"]
    numbers = {
        "right_angle_rad": math.pi / 2,
        "thigh_rad": math.radians(lengths["recline_deg"] + lengths["thigh_offset_deg"])
        - math.pi / 2,
        "middle_m": lengths["thigh_length_m"] / 2,
        "hip_min_rad": math.radians(hip["position_min_deg"]),
        "hip_max_rad": math.radians(hip["position_max_deg"]),
        "rail_rad": math.radians(lengths["rail_angle_deg"]),
        **{key: lengths[key] for key in ("thigh_length_m", "rail_x_m", "rail_y_m")},
        **{key: hip[key] for key in ("torque_max_nm", "velocity_max_rad_per_s")},
        **{key: slide[key] for key in ("position_min_m", "position_max_m")},
        **{key: slide[key] for key in ("velocity_max_m_per_s", "force_max_n")},
    }
    of_legs = "".join(URDF_OF_LEG.format(leg=leg, **numbers) for leg in legs)
    return f'<robot name="{NODE}">\n<link name="trainer"/>\n{of_legs}</robot>\n'


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
        # What is kept for late readers needs time stamps.
        settings = client_settings(Target((asked.ros,))) | {"timestamping/enabled": True}
        session = zenoh.open(config_of(settings))
    except zenoh.ZError as error:
        reason = PLACE_IN_ZENOH.sub("", str(error))
        parser.exit(2, f"{asked.ros}: no router of ROS listens there: {reason}\n")
    trainer = Trainer(asked.gaitd, asked.credentials, client=NODE, keep_trying=True)
    with session, trainer:
        view = View(trainer, session, list(dict.fromkeys(asked.leg or ["right"])), asked.domain)
        while not over.wait(PERIOD_S):
            view.diagnose()


if __name__ == "__main__":
    told = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: told.set())
    main(over=told)
