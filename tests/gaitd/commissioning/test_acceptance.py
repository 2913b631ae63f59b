"""`gaitd commission --report` on virtual drives in lock-step: the record finds what is wrong."""

import math

import msgspec
import pytest
from command_line import gaitd
from gaitd_client import wire
from gaitd_names import Mode, RequestKind
from gaitd_texts import LANGUAGES, Reader, catalogue
from records import HEADER
from records import record as cycle_record
from second_station import SecondStation, finished
from sessions import CONFIGS, changed_configs, new_session

from analysis.acceptance.record import FindingCode, Judgement, Reason, ReasonCode, Section, read
from analysis.acceptance.words import finding_texts
from daemon.config.drive_plan import plan_of
from daemon.ipc.decoding import RefusedError
from daemon.ipc.record import ModeRequest
from daemon.ipc.transport import RING_NAME, RingWriter
from daemon.preflight.load import load
from daemon.report_messages import refusal_message
from drives.bringup.configurator import Configurator
from drives.errors import BringUpRefused
from drives.signals import PowerState
from gaitd.commissioning.local_service import CoreRestartedError, LocalService, observed
from gaitd.commissioning.messages import Answer, Instruction, InstructionCode
from gaitd.commissioning.objects import read_findings
from gaitd.commissioning.plans import NOT_SHOWN, Gait, acceptance
from gaitd.commissioning.procedure import BEGIN, State
from gaitd.commissioning.report import record_path, write
from gaitd.commissioning.run import Run
from gaitd.commissioning.stops import STOPS

HIP, SLIDE = "right/hip", "right/slide"
EMPTY = (
    ("demo.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("plant.toml", '"robot.toml"', '"robot_empty.toml"'),
    ("demo.toml", 'signs = "assumed"', 'signs = "proven"'),
    ("demo.toml", 'required = "never"', 'required = "daily"'),
    ("demo.toml", "announce_s = 3.0", "announce_s = 0.5"),
    ("demo.toml", "ramp_strides = 2", "ramp_strides = 1"),
    # Approach, sign test and self-test are quicker than a person would like; no speed is judged.
    ("demo.toml", "approach_rad_per_s = 0.2", "approach_rad_per_s = 0.5"),
    ("demo.toml", "approach_m_per_s = 0.15", "approach_m_per_s = 0.4"),
    ("demo.toml", "torque_rate_nm_per_s = 6.0", "torque_rate_nm_per_s = 12.0"),
    ("demo.toml", "force_rate_n_per_s = 60.0", "force_rate_n_per_s = 120.0"),
    ("demo.toml", "speed_rad_per_s = 0.1 ", "speed_rad_per_s = 0.17 "),
    ("demo.toml", "speed_m_per_s = 0.05", "speed_m_per_s = 0.09"),
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
GAIT = Gait(0.5, 1.0)
MILLISECOND = 1_000_000
BEGUN = "2026-01-01T00:00:00+00:00"
SECONDS_OF_HANDS = 1.5
INPUTS = {
    InstructionCode.RELEASE_HAND_SWITCH: "hand_switch_open * 0.3",
    InstructionCode.PRESS_STO: "sto_open * 0.3",
    InstructionCode.OPEN_HAND_SWITCH_NOW: "hand_switch_open *",
    InstructionCode.HOLD_HAND_SWITCH: "clear hand_switch_open *",
    InstructionCode.PRESS_STO_NOW: "sto_open *",
    InstructionCode.RELEASE_STO: "clear sto_open *",
}


class LockstepService:
    """A lock-step session as the source of observations, one record after the other."""

    def __init__(self, session, turn=None):
        self.session, self.turn = session, turn or session.loop.turn
        self.seen = 0

    def request(self, request):
        if request.name == "stop":
            self.session.gateway.stop()
            return reply_of("stop", None)
        wanted = dict(request.arguments)
        if wanted:
            wanted = ModeRequest(Mode[wanted.pop("mode").upper()], **wanted)
        answer = self.session.request(RequestKind[request.name.upper()], wanted or None)
        return reply_of(request.name, answer.refusal)

    def read(self, wanted):
        station = SecondStation(self.session, self.turn)
        try:
            port = Configurator(station, station.clock)
            plan = plan_of(wanted.drive, self.session.settings)
            return finished(read_findings(plan, port, is_set_up=wanted.is_set_up))
        finally:
            station.leave()

    def newest(self):
        new = self.session.records[self.seen :]
        self.seen += len(new)
        return observed(new, self.session.records)

    def following(self):
        self.session.loop.turn()
        return self.newest()


def reply_of(name, refusal):
    """As the service answers: no refusal is done."""
    return wire.Reply(
        **{"seq": 1, "core_boot_id": None, "cycle": None, "sample_time_ns": None, "mode": None},
        request=name,
        outcome="refused" if refusal else "done",
        refusal=refusal_message(refusal) if refusal else None,
    )


class WaitedError(Exception):
    """The operator waits, instead of doing what was said."""


class Hands:
    """An operator who sees the truth, and waits once before an instruction."""

    def __init__(self, session, waits_at):
        self.session, self.waits_at = session, waits_at
        self.held = []

    def follow(self, instruction):
        code, axis = instruction.code, instruction.subject.partition("/")[2]
        if code is self.waits_at:
            self.waits_at = None
            raise WaitedError
        if code in INPUTS:
            self.session.command(INPUTS[code])
        if code is InstructionCode.MOVE_TO_SECOND_MARK:
            self.session.command(f"patient {axis}")
            self.session.run(SECONDS_OF_HANDS)
            self.session.command("patient passive")
        row = self.session.truth.rows[-1] if self.session.truth.rows else None
        if code in {InstructionCode.MOVE_TO_MARK, InstructionCode.MOVE_TO_SECOND_MARK}:
            self.held.append((row.hip_angle_rad, row.slide_position_m))
        if code is InstructionCode.DISTANCE:
            (hip_rad, slide_m), (hip_later_rad, slide_later_m) = self.held[-2:]
            moved = math.degrees(hip_later_rad - hip_rad), 1e3 * (slide_later_m - slide_m)
            return Answer(moved[axis == "slide"])
        return Answer(True)

    def note(self, progress):
        pass


class Accepted:
    """The procedure on a session."""

    def __init__(self, session, *, service=None, state=BEGIN, waits_at=None):
        self.session = session
        tasks = acceptance(session.settings, GAIT)
        source = service or LockstepService(session)
        self.hands = Hands(session, waits_at)
        self.run = Run(tasks, source, self.hands, state)
        if waits_at is None:
            self.run.play_to_rest()
            return
        with pytest.raises(WaitedError):
            self.run.play()

    def opened(self):
        """Let the operator open the hand switch after all, and go on."""
        self.hands.follow(Instruction(InstructionCode.OPEN_HAND_SWITCH_NOW))
        return self.ended()

    def ended(self):
        self.run.play_to_rest()
        return self

    @property
    def blocked(self):
        return self.run.state.blocked

    def found(self, judged, name):
        return {
            (one.section, one.code): one
            for one in self.run.findings
            if (one.drive, one.judgement) == (name, judged)
        }

    def objects(self, judged, name):
        """What was found in each object."""
        return {
            one.values["place"]: one.values
            for one in self.run.findings
            if (one.drive, one.judgement) == (name, judged)
            if "place" in one.values
        }


def accepted(configs, *, begin=lambda _: None):
    session = new_session(configs).until_ready()
    begin(session)
    return Accepted(session)


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
    begin_ns = next(
        record.sync_mono_ns
        for record in session.records
        if record.verdict.category and record.verdict.cause == stop.cause
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


@pytest.fixture(scope="module")
def warm_walking(configs):
    """An acceptance up to the gait in which the operator is about to open the hand switch."""
    session = new_session(configs).until_ready()
    return Accepted(session, waits_at=InstructionCode.OPEN_HAND_SWITCH_NOW)


def test_a_machine_as_configured_passes_all_but_what_is_not_approached(warm_walking, tmp_path):
    done = warm_walking.opened()

    write(done.run, done.session.settings, BEGUN, "boot", tmp_path)

    assert done.blocked is None
    # These axes move before the bound of the sign test is reached.
    not_shown = {(Section.LIMITS, code) for code in (FindingCode.BOUND, *NOT_SHOWN)}
    for name in (HIP, SLIDE):
        json_file = record_path(tmp_path, name)
        record = read(json_file)
        assert not done.found(Judgement.FAILED, record.drive)
        assert set(done.found(Judgement.NOT_MEASURED, record.drive)) == not_shown
        for texts in (catalogue(Reader.OPERATOR, language) for language in LANGUAGES):
            for finding in record.findings:
                asked, *rest = finding_texts(texts, finding)
                assert asked
                assert "–" not in "".join((asked, *rest)), finding  # a number that is not known
        text = json_file.with_suffix(".html").read_text()
        assert text.count("<svg") == len(record.stops) == len(STOPS)
        assert "http" not in text
        for stop in record.stops:
            assert_true(stop, record.drive, done.session)
    json_file.write_text(json_file.read_text().replace("gaitd.acceptance.v1", "gaitd.other.v1"))
    with pytest.raises(RefusedError, match=r"right_slide\.json: no record gaitd\.acceptance\.v1"):
        read(json_file)
    hip = done.found(Judgement.PASSED, HIP)
    assert hip[Section.LIMITS, FindingCode.STOP_ACTS].values["cause"] == "sto_active"
    noted = done.objects(Judgement.NOTED, HIP)
    assert noted["1008h:00"]["found"] == "Virtual EPOS4"
    assert "100Ah:00" not in noted
    objects = done.objects(Judgement.PASSED, HIP)
    assert objects["1018h:03"]["found"] == "01700000h"
    assert noted["1018h:04"]["found"] == "305000005"
    pdos = [
        one.values
        for one in done.run.findings
        if one.section is Section.PDOS
        if one.judgement is Judgement.PASSED and "TPDO" in one.values["name"] + one.values["why"]
    ]
    assert pdos
    assert all(one["found"] == one["wanted"] or "(bit 31)" in one["wanted"] for one in pdos)


def test_an_option_code_that_has_changed_is_found_and_nothing_moves(configs):
    def changed(session):
        session.machine.world.node(SLIDE).dictionary.put(0x605E, 0, 0)

    done = accepted(configs, begin=changed)

    assert set(done.objects(Judgement.FAILED, SLIDE)) == {"605Eh:00"}
    assert not done.found(Judgement.FAILED, HIP)
    missing = done.found(Judgement.NOT_MEASURED, HIP)[Section.SIGN, FindingCode.STEP]
    assert missing.reason == Reason(ReasonCode.FAILED_BEFORE, SLIDE, {"section": "option_codes"})
    assert not was_enabled(done.session)


def test_another_firmware_than_that_of_the_file_is_found_although_bring_up_refuses_it(tmp_path):
    other = ("drives/hip_epos4.toml", "revision = 0x01700000", "revision = 0x01730000")
    session = new_session(changed_configs(tmp_path, *EMPTY, other))
    with pytest.raises(BringUpRefused, match="wrong revision"):
        session.run(1.0)  # so the service ends
    bus = session.bus
    service = LockstepService(session, lambda: bus.let_pass(bus.now_ns + MILLISECOND))
    ended = Reason(ReasonCode.NO_SERVICE)

    done = Accepted(session, service=service, state=State(blocked=ended))

    assert done.objects(Judgement.FAILED, HIP)["1018h:03"]["found"] == "01700000h"
    assert len(done.found(Judgement.FAILED, HIP)) == 1
    assert not done.found(Judgement.FAILED, SLIDE)
    missing = done.found(Judgement.NOT_MEASURED, SLIDE)
    assert missing[Section.SELF_TEST, FindingCode.LOAD].reason == ended


@pytest.mark.parametrize(
    "fault", ["wrong_sign", pytest.param("encoder_reversed", marks=pytest.mark.thorough)]
)
def test_a_motor_or_an_encoder_the_wrong_way_round_is_found(configs, fault):
    done = accepted(configs, begin=lambda session: session.command(f"{fault} {SLIDE}"))

    failed = set(done.found(Judgement.FAILED, SLIDE))

    assert FindingCode.PUSHED in {code for _, code in failed}
    assert {section for section, _ in failed} == {Section.SIGN}
    missing = done.found(Judgement.NOT_MEASURED, HIP)[Section.POSITION, FindingCode.STEP]
    assert missing.reason == Reason(ReasonCode.FAILED_BEFORE, SLIDE, {"section": "sign"})


def test_twice_the_increments_are_found_by_the_motion_that_the_operator_measured(tmp_path):
    twice = ("plant.toml", "counts_per_rev = 1024", "counts_per_rev = 2048")
    done = accepted(changed_configs(tmp_path, *EMPTY, HANDS, twice))

    ((_, finding),) = done.found(Judgement.FAILED, HIP).items()

    assert 1.9 < finding.values["ratio"] < 2.1


def test_a_motor_with_more_than_twice_the_torque_of_its_data_is_found(tmp_path):
    constant = "torque_constant_nm_per_a = "
    other = ("plant.toml", f"{constant}0.107746", f"{constant}{0.107746 * 2.2:.6f}")
    session = new_session(changed_configs(tmp_path, *EMPTY, HANDS, other))
    for index, sub, value in ((0x3001, 5, 107746), (0x6076, 0, 646476)):
        # The drive holds the data of the file.
        session.machine.world.node(SLIDE).dictionary.put(index, sub, value)

    done = Accepted(session.until_ready())

    assert set(done.found(Judgement.FAILED, SLIDE)) == {(Section.SELF_TEST, FindingCode.LOAD)}


def test_a_quick_stop_that_is_slower_than_the_ramp_read_back_is_found(warm_walking):
    dictionary = warm_walking.session.machine.world.node(SLIDE).dictionary
    dictionary.put(0x6085, 0, dictionary.value(0x6085) // 2)

    done = warm_walking.opened()

    ramp = (Section.STOP_BY_HAND_SWITCH, FindingCode.RAMP)
    assert ramp in done.found(Judgement.FAILED, SLIDE)
    assert not done.found(Judgement.FAILED, HIP)
    missing = done.found(Judgement.NOT_MEASURED, HIP)[Section.STOP_BY_STO, FindingCode.STEP]
    assert missing.reason.code is ReasonCode.FAILED_BEFORE


def test_a_stop_by_another_cause_is_not_that_of_the_hand_switch_and_no_harder_one_follows(
    warm_walking,
):
    warm_walking.session.command(f"emcy {SLIDE} - 0x8611")

    done = warm_walking.ended()

    for name in (HIP, SLIDE):
        acts = (Section.LIMITS, FindingCode.STOP_ACTS)
        assert acts in done.found(Judgement.FAILED, name)
        missing = done.found(Judgement.NOT_MEASURED, name)
        assert (Section.STOP_BY_STO, FindingCode.STEP) in missing


def test_other_files_or_another_core_than_those_of_the_service_are_found(tmp_path):
    here = ("demo.toml", "/dev/shm/gaitd-demo", f"{tmp_path}/run")  # and the bus beside it
    settings = load(changed_configs(tmp_path, *EMPTY, here) / "demo.toml")
    mine, path = dict(settings.hashes), settings.runtime / RING_NAME
    settings.runtime.mkdir()
    other = {name: "0" * 64 for name in mine if name.endswith("limits.toml")}
    service = LocalService(None, settings)
    writer = RingWriter(path, msgspec.structs.replace(HEADER, config_hashes=mine | other))
    writer.write(cycle_record(1))

    assert service.foreign_files() == "limits.toml"

    writer.close()
    RingWriter(path, msgspec.structs.replace(HEADER, config_hashes=mine)).close()
    with pytest.raises(CoreRestartedError):
        service.newest()
    assert not LocalService(None, settings).foreign_files()


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
