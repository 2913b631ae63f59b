"""Golden traces of whole sessions: every frame of service and drives, with its time, byte for byte.

Each scenario runs in lock-step from power-on. The traces in tests/traces/sessions were read against
the standards frame by frame before they were fixed; their comments name the clauses.
`make golden` writes them anew: read the difference before you keep it.
"""

from pathlib import Path

import pytest
from bus_recorder import Wiretap
from gaitd_names import Mode, Outcome, RequestKind
from sessions import CONFIGS, changed_configs, new_session
from trace_comments import explained

from daemon.ipc.record import ModeRequest
from daemon.preflight.load import load
from drives.signals import PowerState
from gaitd_lab.lockstep import LockstepSession

FOLDER = Path(__file__).parents[1] / "traces" / "sessions"
SETTLED_S = 0.05
SDO = (0x580, 0x600)


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
