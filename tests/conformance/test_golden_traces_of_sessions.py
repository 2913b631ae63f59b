"""Golden traces of whole sessions: every frame of service and drives, with its time, byte for byte.

Each scenario runs in lock-step from power-on. The traces in tests/traces/sessions were read against
the standards frame by frame before they were fixed; their comments name the clauses.
`make golden` writes them anew: read the difference before you keep it.
"""

import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path

import canopen
import pytest
from bus_recorder import Wiretap
from candump import TraceLine
from gaitd_names import Mode, Outcome, RequestKind
from sessions import CONFIGS, changed_configs, new_session

from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

FOLDER = Path(__file__).parents[1] / "traces" / "sessions"
SETTLED_S = 0.05
SDO = (0x580, 0x600)


# --- the comments of a trace ----------------------------------------------------------------------
#
# They say what the frames are and which clause they follow, by a reader of its own, from the
# standards: it shares no decoding with master or drives. A comment stands before the first frame of
# a group, and where what a node shows or is told changes.

OBJECTS = canopen.import_od(str(Path(__file__).parents[2] / "configs/drives/epos4.eds"), node_id=0)
"""For names only."""
CLAUSES = (
    # CiA 301 7.5.2 describes the communication objects one by one
    (0x1000, "7.5.2.1"),
    (0x1001, "7.5.2.2"),
    (0x1003, "7.5.2.4"),
    (0x1005, "7.5.2.5"),
    (0x1006, "7.5.2.6"),
    (0x1007, "7.5.2.7"),
    (0x1010, "7.5.2.13"),
    (0x1011, "7.5.2.14"),
    (0x1014, "7.5.2.17"),
    (0x1016, "7.5.2.19"),
    (0x1017, "7.5.2.20"),
    (0x1018, "7.5.2.21"),
    (0x1019, "7.5.2.22"),
    (0x1029, "7.5.2.32"),
    *((0x1400 + n, "7.5.2.35") for n in range(4)),
    *((0x1600 + n, "7.5.2.36") for n in range(4)),
    *((0x1800 + n, "7.5.2.37") for n in range(4)),
    *((0x1A00 + n, "7.5.2.38") for n in range(4)),
)
NMT_COMMANDS = {
    0x01: "start",
    0x02: "stop",
    0x80: "enter pre-operational",
    0x81: "reset node",
    0x82: "reset communication",
}
NMT_STATES = {0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational"}
STATES = {
    (0x4F, 0x00): "not ready to switch on",
    (0x4F, 0x40): "switch on disabled",
    (0x6F, 0x21): "ready to switch on",
    (0x6F, 0x23): "switched on",
    (0x6F, 0x27): "operation enabled",
    (0x6F, 0x07): "quick stop active",
    (0x4F, 0x0F): "fault reaction active",
    (0x4F, 0x08): "fault",
}
HOMING_MODE = 6
HOMING = {
    (0, 0, 0): "in progress",
    (0, 0, 1): "not started, or interrupted",
    (0, 1, 0): "attained, target not reached",
    (0, 1, 1): "done",
    (1, 0, 0): "error, still moving",
    (1, 0, 1): "error, at rest",
    (1, 1, 0): "?",
    (1, 1, 1): "?",
}
COMMANDS = (
    (0x80, 0x80, "fault reset (transition 15)"),
    (0x02, 0x00, "disable voltage (7, 9, 10, 12)"),
    (0x06, 0x02, "quick stop (7, 10, 11)"),
    (0x07, 0x06, "shutdown (2, 6, 8)"),
    (0x0F, 0x07, "switch on (3), or disable operation (5)"),
    (0x0F, 0x0F, "enable operation (4, 16)"),
)


def explained(title: str, lines: Iterable[TraceLine]) -> str:
    """A whole trace as text: what it shows, then its frames between their comments."""
    head = [f"# {line}" for line in textwrap.wrap(title, 96)]
    return "\n".join([*head, *_body(lines)]) + "\n"


def _body(lines: Iterable[TraceLine]) -> Iterator[str]:
    told: dict[object, str] = {}
    for line in lines:
        subject, words = _meaning(line)
        if words and (subject is None or told.get(subject) != words):
            yield from (f"# {part}" for part in textwrap.wrap(words, 96))
        if subject is not None:
            told[subject] = words
        yield str(line)


def _meaning(line: TraceLine) -> tuple[object, str]:
    """What the frame is about, and what it says about that; no subject: say it each time."""
    can_id, data = line.frame.can_id, line.frame.data
    service, node = can_id & 0x780, can_id & 0x07F
    match service:
        case 0x000:
            return None, _nmt(data)
        case 0x080 if node:
            code, register = int.from_bytes(data[:2], "little"), data[2]
            what = f"EMCY {code:04X}h" if code else "EMCY 0000h, no error any more"
            return None, f"node {node}: {what}, error register {register:02X}h: CiA 301 7.2.7"
        case 0x080:
            return "sync", "SYNC, CiA 301 7.2.5: synchronous PDOs, 7.2.2"
        case 0x580 | 0x600:
            return _sdo(node, data)
        case 0x700 if data == b"\x00":
            return None, f"node {node}: boot-up, CiA 301 7.2.8.3.3"
        case 0x700:
            state = NMT_STATES.get(data[0], "?")
            return (service, node), f"node {node}: heartbeat, {state}: CiA 301 7.2.8.3.2"
        case 0x180:
            return (service, node), f"node {node} shows {_state(data)}: CiA 402-2, 6041h"
        case 0x200:
            return (service, node), f"node {node} is told {_command(data)}: CiA 402-2, 6040h"
        case _:
            return None, ""


def _nmt(data: bytes) -> str:
    whom = f"node {data[1]}" if data[1] else "all nodes"
    return f"NMT {NMT_COMMANDS.get(data[0], '?')}, to {whom}: CiA 301 7.2.8.3.1, states 7.3.2"


def _sdo(node: int, data: bytes) -> tuple[object, str]:
    index, sub = int.from_bytes(data[1:3], "little"), data[3]
    if data[0] == 0x80:
        code = int.from_bytes(data[4:8], "little")
        return None, f"node {node}: abort {code:08X}h of {index:04X}h:{sub:02X}: CiA 301 7.2.4.3.17"
    clause = dict(CLAUSES).get(index)
    source = (
        f"CiA 301 {clause}" if clause else "CiA 402-2" if index >= 0x6000 else "the drive's own"
    )
    name = OBJECTS[index].name if index in OBJECTS else "?"
    return "sdo", f"node {node}: SDO (CiA 301 7.2.4), {index:04X}h {name}: {source}"


def _state(data: bytes) -> str:
    word, mode = int.from_bytes(data[:2], "little"), data[6]
    state = next((name for (mask, bits), name in STATES.items() if word & mask == bits), "?")
    if mode == HOMING_MODE and state == "operation enabled":
        bits = tuple(word >> number & 1 for number in (13, 12, 10))
        return f"{state}, homing {HOMING[bits]} (bits 13, 12, 10)"
    return state


def _command(data: bytes) -> str:
    word, mode = int.from_bytes(data[:2], "little"), data[2]
    command = next((name for mask, bits, name in COMMANDS if word & mask == bits), "?")
    if mode != HOMING_MODE:
        return command
    return f"{command}, mode homing{', start (bit 4)' if word & 0x10 else ''}"


# --- the scenarios --------------------------------------------------------------------------------


def boot():
    """Boot of both drives: the service resets communication, compares identity and motor data,
    writes limits, option codes, heartbeats and PDO mappings with read-back, starts the nodes and
    sees their first samples. Nothing is energised."""
    session = new_session()
    wire = Wiretap(session.machine.world)
    session.run_until(lambda record: record.mode == Mode.READY, within_s=10)
    session.run(SETTLED_S)
    return wire


def enable():
    """Enable on request: one transition for each statusword that was seen, both drives alike. The
    target position is the position shown, the target torque what holds the leg; each takes effect
    in operation enabled alone."""
    session = new_session().until_ready()
    wire = Wiretap(session.machine.world)
    session.gateway.request(RequestKind.ENABLE)
    session.run_until(all_enabled, within_s=2)
    session.run(SETTLED_S)
    return wire


def all_enabled(record):
    return {drive.power_state for drive in record.drives} == {PowerState.OPERATION_ENABLED}


def stop(session):
    """A client's stop while holding (S2): the core brakes and holds with the drives enabled."""
    wire = Wiretap(session.machine.world)
    session.gateway.stop()
    session.run_until(lambda record: not record.mode.active, within_s=2)
    session.run(SETTLED_S)
    return wire


def quick_stop():
    """The hand switch (60FDh bit 16) opens while walking (S1): quick stop of both drives in the
    same cycle, their ramps by 605Ah = 6, then they hold in quick stop active, bit 10 set."""
    session = LockstepSession(load(CONFIGS / "demo.toml")).walk(duration_s=2.0)
    wire = Wiretap(session.machine.world)
    session.command("hand_switch_open *")
    session.run(0.3)
    return wire


def fault_and_reset(session):
    """The hip faults (EMCY 2310h) while holding: its own fault reaction; the slide is told to stop
    at once, before the next SYNC. The cause goes; a client asks for a reset: the drives are brought
    up anew (SDO is left out here, see the boot), then comes one rising edge of bit 7, which ends in
    switch on disabled with EMCY 0000h. Nothing is enabled."""
    wire = Wiretap(session.machine.world)
    session.command("emcy right/hip - 0x2310")
    session.run_until(lambda record: record.mode == Mode.FAULT, within_s=2)
    session.command("clear emcy right/hip")
    answer = session.request(RequestKind.RESET)
    assert answer.outcome == Outcome.DONE
    session.run(SETTLED_S)
    wire.lines = [line for line in wire.lines if line.frame.can_id & 0x780 not in SDO]
    return wire


def reboot_in_operation(session):
    """The hip drive browns out while holding. After four cycles without its sample the slide is
    stopped and the hip told NMT stop; its boot-up message comes later, and starts nothing."""
    wire = Wiretap(session.machine.world)
    session.command("reboot right/hip")
    session.run(0.3)
    return wire


def drive_silent(session):
    """The slide drive falls silent while holding: after four cycles without its sample the hip is
    stopped, and the silent one is told disable voltage and NMT stop, should it still hear."""
    wire = Wiretap(session.machine.world)
    session.command("silent right/slide")
    session.run(0.2)
    return wire


def master_silent(session):
    """The service dies while holding: SYNC and heartbeat cease. 100 ms after the last heartbeat
    each drive notices by itself (1016h), says 8130h, stops by 6007h, and leaves operational by
    1029h."""
    wire = Wiretap(session.machine.world)
    session.run(0.02)
    world = session.machine.world
    for _ in range(30):
        world.advance_to(world.now_ns + 10_000_000)
    return wire


def referencing(folder):
    """Homing of the hip of the empty machine with an incremental encoder, on request: the slide
    stays without power. Only what changes is kept: RPDO1 and TPDO1 of the hip where controlword,
    mode or statusword differ from those before. One edge of bit 4 starts the stroke in mode 6."""
    session = new_session(changed_configs(folder, *EMPTY, *INCREMENTAL)).until_ready()
    wire = Wiretap(session.machine.world)
    wanted = ModeRequest(Mode.REFERENCE, axis="right/hip")
    answer = session.request(RequestKind.MODE, wanted)
    assert answer.outcome == Outcome.DONE, answer.refusal
    session.run_until(lambda record: record.mode == Mode.OFF, within_s=60)
    wire.lines = list(changes_only(wire.lines))
    return wire


def changes_only(lines):
    newest = {}
    for line in lines:
        can_id, data = line.frame.can_id, line.frame.data
        if can_id in (0x185, 0x205):
            shown = data[:2] + data[6:7] if can_id == 0x185 else data[:3]
            if newest.get(can_id) != shown:
                yield line
            newest[can_id] = shown


EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
)
INCREMENTAL = (
    ("drives/hip_epos4.toml", "absolute = true", "absolute = false"),
    ("drives/slide_epos4.toml", "absolute = true", "absolute = false"),
    ("plant.toml", 'encoder = "absolute"', 'encoder = "incremental"'),
)
FROM_POWER_ON = (boot, enable, quick_stop)
FROM_HOLD = (stop, fault_and_reset, reboot_in_operation, drive_silent, master_silent)


@pytest.fixture(scope="module")
def warm_hold():
    """Both axes are enabled and hold."""
    return new_session().enable()


@pytest.mark.parametrize(
    "scenario",
    [*FROM_POWER_ON, *FROM_HOLD, referencing],
    ids=lambda scenario: scenario.__name__,
)
def test_a_session_puts_the_same_bytes_on_the_bus_as_when_it_was_reviewed(
    scenario, request, warm_hold, tmp_path
):
    path = FOLDER / f"{scenario.__name__}.candump"
    given = {referencing: (tmp_path,)} | dict.fromkeys(FROM_HOLD, (warm_hold,))
    wire = scenario(*given.get(scenario, ()))
    found = explained(" ".join(scenario.__doc__.split()), wire.lines)
    if request.config.option.write_traces:
        path.write_text(found, encoding="utf-8")

    kept = path.read_text(encoding="utf-8").splitlines()

    assert found.splitlines() == kept, "review what changed, then `make golden`"
