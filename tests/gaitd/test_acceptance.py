"""`gaitd commission --report` on virtual drives in lock-step: the record finds what is wrong."""

import math

import msgspec
import pytest
from command_line import gaitd
from records import HEADER
from records import record as cycle_record
from second_station import SecondStation, finished
from sessions import CONFIGS, changed_configs, new_session

from analysis.acceptance.record import Judgement, StopTrace, read
from analysis.acceptance.stops import MeasuredStop, StopRules, judge
from daemon.config.drive_plan import plan_of
from daemon.gateway.translate import refusal_message
from daemon.ipc.decoding import RefusedError
from daemon.ipc.record import Cause, Mode, ModeRequest, Outcome, RequestKind, StopCategory
from daemon.ipc.transport import RING_NAME, RingWriter
from daemon.preflight.load import load
from daemon.wire.report_texts import refusal_text
from drives.bringup.configurator import Configurator
from drives.errors import BringUpRefused
from drives.signals import PowerState
from gaitd.acceptance import BOUND, LOAD, NOT_SHOWN, Acceptance, Answer, Gait, Stops
from gaitd.acceptance_service import (
    CoreRestartedError,
    ServiceBench,
    object_sections,
    unread,
    write_records,
)
from gaitd_lab.lockstep import NotReachedError

HIP, SLIDE = "right/hip", "right/slide"
EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("demo.toml", 'signs = "assumed"', 'signs = "proven"'),
    ("demo.toml", 'required = "never"', 'required = "daily"'),
)
BEFORE = "[[patient.programme]]                  # pushes against a leg that is held still"
LED = """[[patient.programme]]
name = "{name}"

[[patient.programme.effort]]
kind = "steady"
at_s = 0.0
until_s = 0.6
rise_s = 0.2
fall_s = 0.2
hip.torque_nm = {hip_nm}
slide.force_n = {slide_n}

"""
PROGRAMMES = (
    LED.format(name="hip", hip_nm=13.0, slide_n=0.0)
    + LED.format(name="slide", hip_nm=0.0, slide_n=130.0)
    + BEFORE
)
HANDS = ("plant.toml", BEFORE, PROGRAMMES)
"""What the operator's hands do to a leg without power."""
GAIT = Gait(0.25, 1.0)
MILLISECOND = 1_000_000
BEGUN = "2026-01-01T00:00:00+00:00"
SECONDS_OF_HANDS = 1.5
INPUTS = {
    "Let go of the hand switch": "hand_switch_open * 0.3",
    "Press the emergency stop": "sto_open * 0.3",
    "NOW let go": "hand_switch_open *",
    "Hold the hand switch": "clear hand_switch_open *",
    "NOW press": "sto_open *",
    "Release the emergency stop": "clear sto_open *",
}


def answer_of(refusal):
    """As the service answers: None is done."""
    if refusal is None:
        return Answer("")
    return Answer(refusal_text(refusal), refusal_message(refusal))


class LockstepBench:
    """The bench of the procedure, on a lock-step session."""

    def __init__(self, session, turn=None):
        self.session, self.turn = session, turn

    def request(self, name, **arguments):
        if name == "stop":
            self.session.gateway.stop()
            return Answer("")
        kind = RequestKind[name.upper()]
        wanted = (
            ModeRequest(Mode[arguments.pop("mode").upper()], **arguments) if arguments else None
        )
        answer = self.session.request(kind, wanted)
        return answer_of(answer.refusal)

    def until(self, reached, within_s):
        try:
            return self.session.run_until(reached, within_s)
        except NotReachedError:
            return None

    def since(self, seq):
        return [record for record in self.session.records if record.seq > seq]

    def newest(self):
        return self.session.record if self.session.records else None

    def objects(self, drive, *, is_set_up):
        station = SecondStation(self.session, self.turn)
        try:
            port = Configurator(station, station.clock)
            plan = plan_of(drive, self.session.settings)
            return finished(object_sections(plan, port, is_set_up=is_set_up))
        finally:
            station.leave()


class Hands:
    """An operator who sees the truth; `later` is a text and a fault that begins with it."""

    def __init__(self, session, later, *, saw):
        self.session, self.later, self.seen = session, later, saw
        self.axis, self.held = "", []

    def tell(self, text):
        for words, command in INPUTS.items():
            if text.startswith(words):
                self.session.command(command)
        if self.later and self.later[0] in text:
            self.later[1](self.session)

    def agrees(self, text):
        self.tell(text)
        return True

    def acts(self, text):
        if "second" in text:
            self.session.command(f"patient {self.axis}")
            self.session.run(SECONDS_OF_HANDS)
            self.session.command("patient passive")
        else:
            self.axis = text.partition(" ")[0].partition("/")[2]
        row = self.session.truth.rows[-1]
        self.held.append((row.hip_angle_rad, row.slide_position_m))
        return True

    def saw(self, text):
        return self.seen

    def number(self, text):
        (hip_rad, slide_m), (hip_later_rad, slide_later_m) = self.held[-2:]
        if self.axis == "hip":
            return math.degrees(hip_later_rad - hip_rad)
        return 1e3 * (slide_later_m - slide_m)


def accepted(configs, *, begin=lambda _: None, later=(), saw=True):
    """The procedure on a session, with a fault from the start, or one that begins with a text."""
    session = new_session(configs).until_ready()
    begin(session)
    return run_on(session, later, saw=saw), session


def run_on(session, later=(), *, saw=True):
    hands = Hands(session, later, saw=saw)
    acceptance = Acceptance(session.settings, LockstepBench(session), hands, GAIT)
    acceptance.run()
    return acceptance


def found(acceptance, judged, name):
    return {
        f"{section.title}: {line.asked}": line.measured
        for section in acceptance.sections[name]
        for line in section.lines
        if line.judgement is judged
    }


def was_enabled(session):
    return any(
        drive.power_state == PowerState.OPERATION_ENABLED
        for record in session.records
        for drive in record.drives
    )


def assert_true(stop, name, session):
    """Time and way until rest are those of the plant, within an encoder's noise and a cycle."""
    place, speed = {
        HIP: ("hip_angle_rad", "hip_velocity_rad_per_s"),
        SLIDE: ("slide_position_m", "slide_velocity_m_per_s"),
    }[name]
    cause = stop.title.partition(", ")[2]
    begin_ns = next(
        record.sync_mono_ns
        for record in session.records
        if record.verdict.category and record.verdict.cause.name.lower() == cause
    )
    rest_ns = begin_ns + round(1e9 * stop.rest_s)
    rows = [row for row in session.truth.rows if begin_ns <= row.sync_mono_ns <= rest_ns]
    ways = [abs(getattr(row, place) - getattr(rows[0], place)) for row in rows]
    assert stop.distance_si == pytest.approx(max(ways), abs=1e-3)
    limits = session.settings.limits.stop
    standstill = (limits.hip.standstill_rad_per_s, limits.slide.standstill_m_per_s)
    assert abs(getattr(rows[-1], speed)) < 1.5 * standstill[name == SLIDE]
    # A held leg swings: one row may be that of a turning point.
    assert max(abs(getattr(row, speed)) for row in rows[-8:-3]) > 0.5 * standstill[name == SLIDE]


@pytest.fixture(scope="module")
def configs(tmp_path_factory):
    return changed_configs(tmp_path_factory.mktemp("empty"), *EMPTY, HANDS)


def test_a_machine_as_configured_passes_all_but_what_is_not_approached(configs, tmp_path):
    acceptance, session = accepted(configs)

    files = write_records(acceptance, session.settings, BEGUN, "boot", tmp_path)

    # These axes move before the bound of the sign test is reached.
    not_shown = {f"Limits shown to act: {what}" for what in (BOUND, *dict(NOT_SHOWN))}
    for record, (json_file, page_file), blocked in files:
        assert not blocked
        assert not found(acceptance, Judgement.FAILED, record.drive)
        assert set(found(acceptance, Judgement.NOT_MEASURED, record.drive)) == not_shown
        assert read(json_file) == record
        text = page_file.read_text()
        assert text.count("<svg") == len(record.stops) == len(Stops)
        assert "http" not in text
        for stop in record.stops:
            assert_true(stop, record.drive, session)
    json_file.write_text(json_file.read_text().replace("gaitd.acceptance.v1", "gaitd.other.v1"))
    with pytest.raises(RefusedError, match=r"right_slide\.json: no record gaitd\.acceptance\.v1"):
        read(json_file)
    hip = found(acceptance, Judgement.PASSED, HIP)
    assert hip["Limits shown to act: stop by STO acts"] == "S0 by sto_active"
    noted = found(acceptance, Judgement.NOTED, HIP)
    assert noted["Identity: device name (1008h:00)"] == "Virtual EPOS4"
    assert "Identity: firmware (100Ah:00)" not in noted
    (revision,) = [value for asked, value in hip.items() if asked.startswith("Identity: 1018h:03")]
    assert revision == "01700000h"
    assert noted["Identity: serial number (1018h:04)"] == "305000005"
    assert not [
        (line.asked, line.measured, line.allowed)
        for section in acceptance.sections[HIP]
        for line in section.lines
        if "TPDO" in line.asked and line.judgement is Judgement.PASSED
        if line.measured != line.allowed and "(bit 31)" not in line.allowed
    ]


def test_an_option_code_that_has_changed_is_found_and_nothing_moves(configs):
    def changed(session):
        session.machine.world.node(SLIDE).dictionary.put(0x605E, 0, 0)

    acceptance, session = accepted(configs, begin=changed)

    assert [key[24:29] for key in found(acceptance, Judgement.FAILED, SLIDE)] == ["605Eh"]
    assert not found(acceptance, Judgement.FAILED, HIP)
    assert "does not hold" in found(acceptance, Judgement.NOT_MEASURED, HIP)["Sign: sign"]
    assert not was_enabled(session)


def test_another_firmware_than_that_of_the_file_is_found_although_bring_up_refuses_it(tmp_path):
    other = ("drives/hip_epos4.toml", "revision = 0x01700000", "revision = 0x01730000")
    session = new_session(changed_configs(tmp_path, *EMPTY, other))
    with pytest.raises(BringUpRefused, match="wrong revision"):
        session.run(1.0)  # so the service ends
    bench = LockstepBench(session, lambda: session.bus.let_pass(session.bus.now_ns + MILLISECOND))
    acceptance = Acceptance(session.settings, bench, Hands(session, (), saw=True), GAIT)

    acceptance.run(blocked="no service")

    ((asked, measured),) = found(acceptance, Judgement.FAILED, HIP).items()
    assert asked.startswith("Identity: 1018h:03")
    assert measured == "01700000h"
    assert not found(acceptance, Judgement.FAILED, SLIDE)
    assert found(acceptance, Judgement.NOT_MEASURED, SLIDE)["Self-test: " + LOAD] == "no service"


@pytest.mark.parametrize("fault", ["wrong_sign", "encoder_reversed"])
def test_a_motor_or_an_encoder_the_wrong_way_round_is_found(configs, fault):
    acceptance, _ = accepted(configs, begin=lambda session: session.command(f"{fault} {SLIDE}"))

    failed = found(acceptance, Judgement.FAILED, SLIDE)

    assert any(asked.startswith("Sign: torque ") for asked in failed)
    assert all(asked.startswith("Sign: ") for asked in failed)
    assert "is not proven" in found(acceptance, Judgement.NOT_MEASURED, HIP)["Position: position"]


def test_a_sign_of_the_file_that_the_operator_sees_to_be_wrong_is_found(configs):
    acceptance, _ = accepted(configs, saw=False)

    assert set(found(acceptance, Judgement.FAILED, HIP)) == {"Sign: direction seen by the operator"}


def test_twice_the_increments_are_found_by_the_motion_that_the_operator_measured(tmp_path):
    twice = ("plant.toml", "counts_per_rev = 1024", "counts_per_rev = 2048")
    acceptance, _ = accepted(changed_configs(tmp_path, *EMPTY, HANDS, twice))

    (measured,) = found(acceptance, Judgement.FAILED, HIP).values()

    assert 1.9 < float(measured.split()[-3]) < 2.1


@pytest.mark.parametrize(
    ("ratio", "where"),
    [(0.5, "Sign: the service's own judgement"), (2.2, "Self-test: " + LOAD)],
    ids=["half", "more than twice"],
)
def test_a_motor_with_another_torque_than_its_data_is_found(tmp_path, ratio, where):
    constant = "torque_constant_nm_per_a = "
    other = ("plant.toml", f"{constant}0.107746", f"{constant}{0.107746 * ratio:.6f}")
    session = new_session(changed_configs(tmp_path, *EMPTY, HANDS, other))
    for index, sub, value in ((0x3001, 5, 107746), (0x6076, 0, 646476)):
        # The drive holds the data of the file.
        session.machine.world.node(SLIDE).dictionary.put(index, sub, value)

    acceptance = run_on(session.until_ready())

    assert set(found(acceptance, Judgement.FAILED, SLIDE)) == {where}


def test_a_quick_stop_that_is_slower_than_the_ramp_read_back_is_found(configs):
    def slower(session):
        dictionary = session.machine.world.node(SLIDE).dictionary
        dictionary.put(0x6085, 0, dictionary.value(0x6085) // 2)

    acceptance, _ = accepted(configs, later=("NOW let go", slower))

    assert "Stop by the hand switch in gait: quick-stop ramp" in found(
        acceptance, Judgement.FAILED, SLIDE
    )
    assert not found(acceptance, Judgement.FAILED, HIP)
    assert "Stop by STO in gait: stop by STO" in found(acceptance, Judgement.NOT_MEASURED, HIP)


class StoppedBench(LockstepBench):
    """Another client requests a stop as soon as the service is in a mode."""

    def __init__(self, session, mode):
        super().__init__(session)
        self.mode, self.asked = mode, []

    def request(self, name, **arguments):
        self.asked.append(name)
        if self.session.record.mode == Mode.READY and self.mode == Mode.HOLD and name == "enable":
            self.session.gateway.request(RequestKind.ENABLE)
            done = self.session.run_until(
                lambda record: (
                    record.mode == self.mode
                    or self.session.gateway.outcome().outcome != Outcome.PENDING
                ),
                within_s=5.0,
            )
            if done.mode == self.mode:
                self.session.gateway.stop()
            self.session.run(2.0)
            return answer_of(self.session.gateway.outcome().refusal)
        answer = super().request(name, **arguments)
        if self.mode == Mode.SELF_TEST and arguments.get("mode") == "self_test":
            in_it_ns = self.session.world_ns + 2_000_000_000
            self.session.bus.at(in_it_ns, self.session.gateway.stop)
        return answer


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.SELF_TEST])
def test_a_stop_that_was_not_asked_for_is_not_reset_and_nothing_moves_again(configs, mode):
    session = new_session(configs).until_ready()
    bench = StoppedBench(session, mode)
    acceptance = Acceptance(session.settings, bench, Hands(session, (), saw=True), GAIT)

    acceptance.run()

    assert acceptance.blocked == "mode fault, stop_requested"
    held = next(n for n, one in enumerate(session.records) if one.mode == Mode.HOLD)
    modes = [one.mode for one in session.records[held:]]
    assert modes[-1] == Mode.FAULT
    assert Mode.GAIT not in modes
    assert modes.index(Mode.FAULT) > 0
    assert set(modes[modes.index(Mode.FAULT) :]) == {Mode.FAULT}


def test_a_stop_by_another_cause_is_not_that_of_the_hand_switch_and_no_harder_one_follows(configs):
    def fault_instead(session):
        session.command("clear hand_switch_open *")
        session.command(f"emcy {SLIDE} - 0x8611")

    acceptance, _ = accepted(configs, later=("NOW let go", fault_instead))

    for name in (HIP, SLIDE):
        failed = found(acceptance, Judgement.FAILED, name)
        assert "Limits shown to act: stop by the hand switch acts" in failed
        assert "Stop by STO in gait: stop by STO" in found(acceptance, Judgement.NOT_MEASURED, name)


@pytest.mark.parametrize(
    ("speeds", "judged"),
    [
        # Near a reversal of the gait, 6 rad/s² until the drive acts, then its ramp of 10 rad/s².
        ((0.06, 0.12, 0.18, 0.24, 0.14, 0.04, 0.0), {Judgement.PASSED}),
        ((0.06, 0.12, 0.18, 0.24, 0.24, 0.24, 0.24, 0.24, 0.04), {Judgement.FAILED}),
        ((0.01, 0.02, 0.03, 0.02, 0.01, 0.0, 0.0), {Judgement.NOT_MEASURED}),
    ],
    ids=["brakes", "does not brake", "was at rest"],
)
def test_a_stop_is_judged_by_the_speed_that_the_axis_had_to_brake(speeds, judged):
    rules = StopRules(10.0, 0.05, 3, 0.03, 0.3, 1.5, 5.0, "rad", "N·m")
    times = tuple(0.01 * number for number in range(len(speeds)))
    rest_s = next(t for t, speed in zip(times, speeds, strict=True) if speed in {0.01, 0.04})
    trace = StopTrace("", "rad", "N·m", times, speeds, speeds, speeds, rest_s, 0.01 * sum(speeds))
    stop = MeasuredStop(
        StopCategory.S1, Cause.HAND_SWITCH_OPEN, False, speeds[0], rest_s / 2, trace
    )

    lines = list(judge(stop, StopCategory.S1, rules))

    assert {line.judgement for line in lines if " until rest" in line.asked} == judged


def test_an_interrupted_run_stops_the_machine_and_keeps_what_was_measured(configs):
    session = new_session(configs).until_ready()

    def interrupt(_):
        raise KeyboardInterrupt

    # Asked while the self-test has left the leg held.
    hands = Hands(session, ("a stop is requested", interrupt), saw=True)
    acceptance = Acceptance(session.settings, LockstepBench(session), hands, GAIT)
    with pytest.raises(KeyboardInterrupt):
        acceptance.run()

    assert was_enabled(session)
    assert session.record.mode is Mode.FAULT
    for name in (HIP, SLIDE):
        missing = found(acceptance, Judgement.NOT_MEASURED, name)
        assert missing["Interrupted: all that follows"] == "interrupted"
        assert "Self-test: " + LOAD in found(acceptance, Judgement.PASSED, name)


def test_nothing_moves_if_the_objects_of_a_drive_cannot_be_read(configs):
    session = new_session(configs).until_ready()
    bench = LockstepBench(session)
    bench.objects = lambda _drive, *, is_set_up: unread("no answer")

    acceptance = Acceptance(session.settings, bench, Hands(session, (), saw=True), GAIT)
    acceptance.run()

    assert acceptance.blocked == "the objects of right/hip could not be read"
    assert not was_enabled(session)


def test_other_files_or_another_core_than_those_of_the_service_are_found(tmp_path):
    here = ("demo.toml", "/dev/shm/gaitd-demo", f"{tmp_path}/run")  # and the bus beside it
    settings = load(changed_configs(tmp_path, *EMPTY, here) / "demo.toml")
    mine, path = dict(settings.hashes), settings.runtime / RING_NAME
    settings.runtime.mkdir()
    other = {name: "0" * 64 for name in mine if name.endswith("limits.toml")}
    bench = ServiceBench(None, settings)
    writer = RingWriter(path, msgspec.structs.replace(HEADER, config_hashes=mine | other))
    writer.write(cycle_record(1))

    assert "runs with another limits.toml than this" in bench.foreign_files()

    writer.close()
    RingWriter(path, msgspec.structs.replace(HEADER, config_hashes=mine)).close()
    with pytest.raises(CoreRestartedError):
        bench.newest()
    assert not ServiceBench(None, settings).foreign_files()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--cadence", "nan"), "--cadence = nan: 0.02 to 0.5"),
        (("--amplitude", "1.5"), "--amplitude = 1.5: more than 0, at most 1"),
        ((), "another folder: right_slide.json is in this one, and is not replaced"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_asked(configs, tmp_path, words, said):
    (tmp_path / "right_slide.json").write_text("{}")

    ran = gaitd(
        *("commission", "--report", tmp_path, "--yes", "--config", configs / "demo.toml"), *words
    )

    assert ran.code == 2
    assert said in ran.err


def test_a_machine_with_a_patient_is_not_accepted(tmp_path):
    ran = gaitd("commission", "--report", tmp_path, "--yes", "--config", CONFIGS / "demo.toml")

    assert ran.code == 2
    assert "a robot file without [patient]" in ran.err
