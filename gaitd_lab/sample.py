"""`python -m gaitd_lab.sample FILE.ring.xz`: the shipped recording, made by the virtual drives.

Hold, a gait of some strides whose patient first does nothing and then helps, and a stop. It is a
file like those of the black box, compressed, so `gaitd replay` reads it; `--publish` plays it to
displays. Floating point numbers are rounded, so that the file is small: covariances to 7 bits, all
others to 14 bits, which is 0.03 mrad at 0.5 rad.
"""

import lzma
import math
import sys
from pathlib import Path
from typing import Any, Final

import msgspec
from gaitd_names import Mode, RequestKind

from daemon.config.shipped import configs_folder
from daemon.core.runtime.build import ring_header
from daemon.ipc.record import CycleRecord, ModeRequest
from daemon.ipc.ring_clip import ClipWriter, trimmed
from daemon.preflight.load import load
from gaitd_lab.lockstep import LockstepSession
from gaitd_lab.lockstep_gateway import Gateway
from gaitd_lab.virtual_machine import load_plant, virtual_machine
from sim_drives.time.conductor import UTC_OF_START_NS

HOLD_S: Final = 0.5
CADENCE_HZ: Final = 0.4
STRIDES: Final = 6.0
PASSIVE_STRIDES: Final = 4.2
STOP_S: Final = 0.7
HELP: Final = (6.0, 45.0)
"""Effort of the patient with the motion: N·m, N."""
FULL_SPEED: Final = (0.5, 0.4)
"""Speed at which the patient gives it: rad/s, m/s."""

BITS: Final = 14
COVARIANCE_BITS: Final = 7
COVARIANCE_COUNT: Final = 36
"""Numbers of a covariance; no other list of a record is as long."""


class Patient:
    """Pushes along with the motion, from the time that is set."""

    def __init__(self) -> None:
        """Begin passive."""
        self.helps = False

    def __call__(self, record: CycleRecord) -> tuple[float, float]:
        """Return the effort for the newest record: N·m, N."""
        if not self.helps:
            return 0.0, 0.0
        hip_nm, slide_n = (
            effort * math.tanh((drive.velocity or 0.0) / speed)
            for effort, speed, drive in zip(HELP, FULL_SPEED, record.drives, strict=True)
        )
        return hip_nm, slide_n


def recorded() -> tuple[LockstepSession, int]:
    """Play the session; returns it, and the number of its first record that is worth keeping."""
    settings = load(configs_folder("configs", "demo.toml") / "demo.toml")
    machine = virtual_machine(settings.file, plant=load_plant(settings.file)[1], seed=1)
    patient, trainer = Patient(), machine.trainers["right"]
    gateway = Gateway(lambda record: trainer.exert(*patient(record)))
    session = LockstepSession(settings, machine, gateway=gateway).enable()
    first_seq = session.record.seq
    session.run(HOLD_S)
    gait = ModeRequest(Mode.GAIT, cadence_hz=CADENCE_HZ, amplitude_ratio=1.0, duration_s=60.0)
    session.execute(RequestKind.MODE, gait)
    session.run_until(lambda record: record.gait_phase >= 0, within_s=30.0)
    session.run(PASSIVE_STRIDES / CADENCE_HZ)
    patient.helps = True
    session.run((STRIDES - PASSIVE_STRIDES) / CADENCE_HZ)
    session.gateway.stop()
    session.run(STOP_S)
    return session, first_seq


def rounded(value: Any, bits: int = BITS) -> Any:  # noqa: ANN401 - msgpack of any type
    """Return a value of msgpack with its floating point numbers rounded to so many bits."""
    if isinstance(value, float) and math.isfinite(value):
        mantissa, exponent = math.frexp(value)
        return math.ldexp(round(mantissa * 2**bits), exponent - bits)
    if isinstance(value, list):
        of_item = COVARIANCE_BITS if len(value) == COVARIANCE_COUNT else bits
        return [rounded(one, of_item) for one in value]
    return value


def write(path: Path) -> None:
    """Record and write the file."""
    session, first_seq = recorded()
    writer = ClipWriter(len(session.records) * 4096)
    for record in session.records:
        if record.seq >= first_seq:
            plain = msgspec.msgpack.decode(msgspec.msgpack.encode(record))
            writer.add(record.seq, msgspec.msgpack.encode(rounded(plain)))
    header = ring_header(session.settings, "sample", UTC_OF_START_NS, "sample")
    # The file is the same on every computer: paths do not belong into it.
    header = msgspec.structs.replace(header, config_hashes={})
    path.write_bytes(lzma.compress(b"".join(trimmed(header, writer)), preset=9))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
