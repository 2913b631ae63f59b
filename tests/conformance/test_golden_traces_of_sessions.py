"""Golden traces of whole sessions: every frame of service and drives, with its time, byte for byte.

Each scenario runs in lock-step from power-on. The traces in tests/traces/sessions were read against
the standards frame by frame before they were fixed; their comments name the clauses.
`make golden` writes them anew: read the difference before you keep it.
"""

from pathlib import Path

import pytest
from explained import explained
from sessions import Session
from wiretap import Wiretap

from daemon.record import Mode, Outcome, RequestKind

FOLDER = Path(__file__).parents[1] / "traces" / "sessions"
SETTLED_S = 0.05


def boot():
    """Boot of both drives: the service resets communication, compares identity and motor data,
    writes limits, option codes, heartbeats and PDO mappings with read-back, starts the nodes and
    sees their first samples. Nothing is energised."""
    session = Session()
    wire = Wiretap(session.machine.world)
    session.lockstep.run_until(lambda record: record.mode == Mode.READY, within_s=10)
    session.lockstep.run(SETTLED_S)
    return wire


def enable():
    """Enable on request: one transition for each statusword that was seen, both drives alike; the
    target position is the position shown, the target torque 0 until the drives follow."""
    session = Session().until_ready()
    wire = Wiretap(session.machine.world)
    answer = session.lockstep.request(RequestKind.ENABLE)
    assert answer.outcome == Outcome.DONE
    session.lockstep.run(SETTLED_S)
    wire.lines = wire.lines[:SHORT]
    return wire


def stop():
    """A client's stop while holding (S2): the core brakes and holds with the drives enabled."""
    session = Session().enabled()
    wire = Wiretap(session.machine.world)
    session.lockstep.gateway.stop()
    session.lockstep.run_until(lambda record: not record.mode.active, within_s=2)
    session.lockstep.run(SETTLED_S)
    return wire


def quick_stop():
    """The hand switch opens while walking (S1): quick stop of both drives in the same cycle, their
    ramps by 605Ah, then they hold in quick stop active."""
    session = Session().walking(warm_s=0.5)
    wire = Wiretap(session.machine.world)
    session.machine.command("hand_switch_open *")
    session.lockstep.run(0.3)
    return wire


def fault_and_reset():
    """The hip faults (EMCY 2310h) while holding: its own fault reaction, quick stop of the slide.
    The cause goes; a reset is asked for: one rising edge of bit 7, and it ends in switch on
    disabled."""
    session = Session().enabled()
    wire = Wiretap(session.machine.world)
    session.machine.command("emcy right/hip - 0x2310")
    session.lockstep.run(0.1)
    session.machine.command("clear emcy right/hip")
    session.lockstep.run(0.02)
    session.lockstep.gateway.ask(RequestKind.RESET)
    session.lockstep.run_until(lambda record: record.mode == Mode.OFF, within_s=2)
    return wire


def reboot_in_operation():
    """The hip drive browns out while holding: its boot-up message is answered at once by a quick
    stop of the slide; the hip is stopped by NMT and not started again by itself."""
    session = Session().enabled()
    wire = Wiretap(session.machine.world)
    session.machine.command("reboot right/hip")
    session.lockstep.run(0.4)
    return wire


def drive_silent():
    """The slide drive falls silent while holding: after the allowed cycles without a sample the
    hip is stopped, and the silent one is told NMT stop, should it still hear."""
    session = Session().enabled()
    wire = Wiretap(session.machine.world)
    session.machine.command("silent right/slide")
    session.lockstep.run(0.2)
    return wire


def master_silent():
    """The service dies while holding: SYNC and heartbeat cease. Each drive notices by itself (1016h
    or its RPDO timer), says so, and stops by 6007h."""
    session = Session().enabled()
    wire = Wiretap(session.machine.world)
    session.lockstep.run(0.02)
    world = session.machine.world
    for _ in range(30):
        world.advance_to(world.now_ns + 10_000_000)
    return wire


SHORT = 200
SCENARIOS = (
    boot,
    enable,
    stop,
    quick_stop,
    fault_and_reset,
    reboot_in_operation,
    drive_silent,
    master_silent,
)


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_a_session_puts_the_same_bytes_on_the_bus_as_when_it_was_reviewed(scenario, request):
    path = FOLDER / f"{scenario.__name__}.candump"
    found = explained(" ".join(scenario.__doc__.split()), scenario().lines)
    if request.config.option.write_traces:
        path.write_text(found, encoding="utf-8")

    kept = path.read_text(encoding="utf-8").splitlines()

    assert found.splitlines() == kept
