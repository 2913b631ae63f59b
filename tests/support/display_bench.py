"""A trainer of messages alone for the display: real streams of the client, at a manual clock."""

import contextlib
import copy
import itertools
import json
import shutil
import sys
import tomllib
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import msgspec
from config_files import toml
from gaitd_client import (
    Activity,
    Cause,
    DriveState,
    Event,
    Mode,
    NoAnswerError,
    Reply,
    RequestRefusedError,
    Safety,
    StatusBit,
    Stride,
    wire,
)
from gaitd_client.stream import SECOND_SILENCE_NS, SILENCE_NS, Stream, Watch
from gaitd_client.wire.messages import Configuration, Judgement, Refusal, Status
from gaitd_texts import catalogue
from msgspec import inspect

CONFIGS = Path(__file__).parents[2] / "configs"
HASHES = {"trainer.toml": "0a", "robot.toml": "0b"}
CHECK = {
    "drift": {"hip_moved_deg": 0.4, "slide_moved_m": 0.004, "reaches_limit": False},
    "sweeps": [{"hip_deg": [-10.0, 32.0], "slide_m": [0.04, 0.93]}],
    "sha256": HASHES,
}
PAGE = {
    "language": "en",
    "help": {"en": "Telephone: press 1.", "de": "Telefon: Taste 1."},
    "unstrap": {"en": "Open the foot strap first.", "de": "Zuerst den Fußgurt öffnen."},
}
OFF = "switch_on_disabled"
UNPOWERED = {Mode.OFF, Mode.BRINGING_UP, Mode.READY}
BEGAN_NS = 1_800_000_000_000_000_000
ORIGIN = "http://127.0.0.1:8080"
OURS = {"origin": ORIGIN, "host": ORIGIN.partition("://")[2]}


class Clock:
    def __init__(self):
        self.ns = 0

    def now_ns(self):
        return self.ns


EMPTY = {
    inspect.StrType: "",
    inspect.IntType: 0,
    inspect.FloatType: 0.0,
    inspect.BoolType: False,
    inspect.VarTupleType: (),
    inspect.DictType: {},
}


def _empty(kind):
    """The least value of a type; None where that is allowed."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    if isinstance(kind, inspect.StructType):
        return _empty_fields(kind.cls)
    return None if isinstance(kind, inspect.UnionType) else EMPTY[type(kind)]


@cache
def _empty_fields(kind):
    fields = inspect.type_info(kind).fields
    return {field.name: _empty(field.type) for field in fields if field.required}


def filled(kind, /, **given):
    """A message with these fields; all others, in its axes too, are as empty as types allow."""
    empty = _empty_fields(kind)
    for name, one in given.items():
        if isinstance(one, dict) and isinstance(empty.get(name), dict):
            given[name] = empty[name] | one
    return msgspec.convert(empty | given, kind)


def verdict(cause, category="S1"):
    return filled(Judgement, cause=cause, category=category, finding="none")


class Page:
    """The browser's side of the WebSocket."""

    def __init__(self, socket):
        self.socket = socket
        self.items = []

    def frame(self):
        frame = self.socket.receive_json()
        self.socket.send_text(str(frame["seq"]))
        self.items += frame["items"]
        return frame["now"]

    def until(self, condition):
        for _ in range(2000):
            if condition(now := self.frame()):
                return now
        raise AssertionError(f"it did not come: {now}")


@contextlib.contextmanager
def catalogues(folder: Path):
    """Copies of the catalogues, which a test may break; yields their folder."""
    module = sys.modules["gaitd_texts.catalogue"]  # the package has a function of its name
    original, copied = module.FOLDER, folder / "texts"
    shutil.copytree(original, copied)
    try:
        module.FOLDER = copied
        catalogue.cache_clear()
        yield copied
    finally:
        module.FOLDER = original
        catalogue.cache_clear()


def session_table(folder: Path, profile, *, legs=("right",), **given):
    """Settings of a patient's server with a session."""
    table = patient_table(folder, legs=legs, target=False, **given)
    return with_session(table, folder, profile)


def with_session(table, folder: Path, profile):
    """Settings of a server with the files of a session; its profile is written."""
    (folder / "profile.toml").write_text(profile, encoding="utf-8")
    return {**table, "session": {"profile": "profile.toml", "history": "history.sqlite"}}


class MessageTrainer:
    """What the servers use of `gaitd_client.Trainer`."""

    target = SimpleNamespace(trainer="trainer")

    def __init__(self, legs=("right",)):
        self.legs, self.clock, self.requests = legs, Clock(), []
        self.refusal = self.silent = None
        self.refused = {}
        """Values of the refusal."""
        self.pulse = Watch(self.clock)
        self.streams = {}
        self.cycle, self.plan = 0, None
        self.brakes = False
        self.is_connected = False

    def __enter__(self):
        self.is_connected = True
        return self

    def __exit__(self, *_error):
        for stream in itertools.chain(*self.streams.values()):
            stream.close()
        self.is_connected = False

    def _stream(self, key, kind, *, silence_ns=SILENCE_NS, keep=1):
        cyclic = silence_ns is not None
        watch = Watch(self.clock, silence_ns) if cyclic else self.pulse
        stream = Stream(key, kind, watch, keep=keep, is_cyclic=cyclic)
        self.streams.setdefault(key, []).append(stream)
        return stream

    def activity(self, leg):
        return self._stream(f"{leg}/activity", Activity)

    def estimate(self, leg):
        return self._stream(f"{leg}/estimate", wire.Estimate)

    def friction(self, leg):
        return self._stream(f"{leg}/friction", wire.Friction)

    def controller(self, leg):
        return self._stream(f"{leg}/controller", wire.ControllerState, silence_ns=None, keep=64)

    def drive(self, name):
        return self._stream(f"drives/{name}", DriveState)

    def stride(self, leg):
        return self._stream(f"{leg}/stride", Stride, silence_ns=None, keep=64)

    def safety(self):
        return self._stream("safety", Safety, silence_ns=SECOND_SILENCE_NS)

    def health(self):
        return self._stream("health", wire.Health, silence_ns=SECOND_SILENCE_NS)

    def events(self, *, history_count=50):
        assert history_count in {0, 50}
        return self._stream("events", Event, silence_ns=None, keep=256)

    # --- messages ---------------------------------------------------------------------------

    def send(self, key, message):
        if key.startswith("drives/"):
            self.pulse.beat()
        for stream in self.streams.get(key, ()):
            stream.receive(msgspec.json.encode(message))

    def cycles(
        self,
        mode,
        *,
        stage=None,
        cause=Cause.NONE,
        power_w=None,
        phase=None,
        switch=True,
        sto=False,
        power=None,
        pose=(0.2, 0.4),
        validity="ok",
        relative=False,
        fresh=True,
        count=1,
    ):
        """Cycles of 10 ms, each with the messages of its kind; one pose, or one for each leg.

        Estimates are relative to a minute with a passive patient, or there was none yet.
        """
        poses = pose if isinstance(pose[0], tuple) else (pose,) * len(self.legs)
        for _ in range(count):
            self.clock.ns += 10_000_000
            self.cycle += 1
            head = {"core_boot_id": "boot", "cycle": self.cycle, "mode": str(mode)}
            head["sample_time_ns"] = BEGAN_NS + self.clock.ns
            powered = OFF if mode in UNPOWERED else "operation_enabled"
            for leg, of_it in zip(self.legs, poses, strict=True):
                of_leg = {**head, "leg": leg, "gait_phase_ratio": phase}
                hip, slide = {"validity": validity}, {"validity": validity}
                if validity != "bad":
                    hip |= {"net": -1.5, "net_std": 0.3}
                    slide |= {"net": 12.0, "net_std": 3.0}
                if validity == "ok" and power_w is not None:
                    hip |= {"patient": 2 * power_w, "patient_std": 0.4}
                    slide |= {"patient": 16 * power_w, "patient_std": 5.0}
                activity = {"patient_power_w": power_w, "hip": hip, "slide": slide}
                self.send(f"{leg}/activity", filled(Activity, **of_leg, **activity))
                hip, slide = hip | {"position": of_it[0]}, slide | {"position": of_it[1]}
                if validity == "ok" and power_w is not None:
                    hip |= {"friction": 3.0, "friction_std": 0.2}
                    hip |= {"tremor_frequency_hz": 5.0, "tremor_amplitude": 2.5}
                    slide |= {"friction": -40.0, "friction_std": 5.0}
                of_leg["status"] = [StatusBit.BASELINE] if relative else []
                self.send(f"{leg}/estimate", filled(wire.Estimate, **of_leg, hip=hip, slide=slide))
                for axis, position in zip(("hip", "slide"), of_it, strict=True):
                    drive = {"name": f"{leg}/{axis}", "position": position, "fresh": fresh}
                    drive |= {"statusword": "0x1237" if powered != OFF else "0x1250"}
                    drive |= {"hand_switch_closed": switch, "effort": 5.5}
                    drive |= {"referenced": True, "temperature_degc": 41.0}
                    drive |= {"power_state": power or powered, "sto_released": not sto}
                    head_of_drive = {"core_boot_id": "boot", "cycle": self.cycle}
                    self.send(f"drives/{leg}/{axis}", filled(DriveState, **head_of_drive, **drive))
            active = mode not in {Mode.OFF, Mode.BRINGING_UP, Mode.READY, Mode.FAULT}
            self.send(
                "safety",
                filled(
                    Safety,
                    valid=True,
                    **head,
                    active=active,
                    stage=stage,
                    verdict=verdict(str(cause), "none" if cause == Cause.NONE else "S1"),
                ),
            )

    def speak_of_health(self):
        second_ns = BEGAN_NS + self.clock.ns // 10**9 * 10**9
        given = {"bus_load_ratio": 0.31, "overrun_count": 0, "sample_time_ns": second_ns}
        given |= {"lateness_p50_us": 60.0, "lateness_max_us": 420.0}
        given |= {"collect_max_us": 2400.0, "work_max_us": 1900.0}
        bus = filled(wire.health_messages.BusHealth, condition="active")
        self.send("health", filled(wire.Health, **given, bus=msgspec.to_builtins(bus)))

    def step(self, number, share, work, leg="right"):
        given = {"leg": leg, "number": number, "core_boot_id": "boot", "mode": "gait"}
        given |= {"sample_time_ns": BEGAN_NS + self.clock.ns, "share_ratio_std": 0.012}
        works = {"work_positive_j": work, "work_negative_j": 0.0}
        self.send(f"{leg}/stride", filled(Stride, share_ratio=share, **works, **given))

    # --- requests ---------------------------------------------------------------------------

    def _reply(self, name, *given):
        if self.silent:
            raise NoAnswerError("no answer")
        self.requests.append((name, *given))
        outcome = "refused" if self.refusal else "done"
        refusal = self.refusal and filled(Refusal, code=self.refusal, values=self.refused)
        reply = filled(Reply, request=name, outcome=outcome, refusal=refusal)
        if self.refusal:
            raise RequestRefusedError(reply)
        return reply

    def stop(self):
        return self._reply("stop")

    def reset(self):
        return self._reply("reset")

    def enable(self):
        return self._reply("enable")

    def disable(self):
        reply = self._reply("disable")
        self.cycles(Mode.READY)
        return reply

    def mode(self, mode, **given):
        return self._reply("mode", str(mode), *given.values())

    def release_plan(self, limits):
        self.plan = limits
        return self._reply("plan", limits)

    def withdraw_plan(self):
        self.plan = None
        return self._reply("plan", None)

    def mark(self, text):
        return self._reply("mark", text)

    def configuration(self):
        brake = {"brake": self.brakes}
        return filled(
            Configuration,
            config_hashes=HASHES,
            limits={"hip": brake, "slide": tables("limits.toml")["slide"] | brake},
            robot=tables("robot.toml"),
            leg_names=list(self.legs),
        )

    def status(self):
        safety = filled(Safety, valid=False)
        return filled(Status, safety=safety, plan=self.plan)


@cache
def tables(name):
    """A configuration that is shipped."""
    return tomllib.loads((CONFIGS / name).read_text(encoding="utf-8"))


def write_check(folder: Path, **drift) -> Path:
    path = folder / "check.json"
    path.write_text(json.dumps({**CHECK, "drift": {**CHECK["drift"], **drift}}), encoding="utf-8")
    return path


def patient_table(folder: Path, *, legs=("right",), way_out=True, target=True, **drift):
    """The content of a patient's file."""
    table = {
        "web": {"host": "127.0.0.1", "port": 8080},
        "trainer": {},
        "page": copy.deepcopy(PAGE),
        "leg": [{"name": leg, "glow_full_w": 8.0} for leg in legs],
    }
    if target:
        table["target"] = {"share_low_ratio": 0.32, "share_high_ratio": 0.44}
    if way_out:
        check = str(write_check(folder, **drift))
        table["way_out"] = {
            "check": check,
            "hip": {"drift_max_deg": 1.0},
            "slide": {"drift_max_m": 0.01},
        }
    return table


def therapist_table(password_hash, *, legs=("right",)):
    """The content of a therapist's file."""
    return {
        "language": "en",
        "legs": list(legs),
        "web": {"host": "127.0.0.1", "port": 8080},
        "trainer": {},
        "login": {"password_hash": password_hash, "session_max_min": 60},
    }


def engineer_table(**given):
    """The content of an engineer's file."""
    return {**given, "web": {"host": "127.0.0.1", "port": 8080}, "trainer": {}}


def settings_of(folder: Path, table, kind):
    """Read through the file, as the command does."""
    from gaitd_display.settings import read_settings

    path = folder / f"{kind.__name__}.toml"
    path.write_text(toml(table), encoding="utf-8")
    return read_settings(path, kind)
