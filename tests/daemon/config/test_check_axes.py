"""`gaitd check` of each axis: where its numbers come from, and what a drive may not be."""

import pytest
from config_files import CONFIGS, Change, changed, copied
from gaitd_texts import Reader, catalogue

from daemon.preflight.load import ConfigError, load
from daemon.preflight.report import examine, refusals
from daemon.preflight.report_tables import sections

GENERIC = (
    Change("demo.toml", "drives/hip_epos4.toml", "drives/hip_generic.toml"),
    Change("demo.toml", "drives/slide_epos4.toml", "drives/slide_generic.toml"),
)
PROFILE = "drives/profiles/generic.toml"
QUICK_STOP_2 = (
    Change(PROFILE, "value = 6\nlegal = [0, 1,", "value = 2\nlegal = [0, 1,"),
    Change(PROFILE, "resume_from_quick_stop = true", "resume_from_quick_stop = false"),
)
HIP_BRAKE = Change("limits.toml", "brake = false\n\n[slide]", "brake = true\n\n[slide]")
SLIDE_BRAKE = Change(
    "limits.toml", "brake = false\n\n[singularity]", "brake = true\n\n[singularity]"
)
COAST = Change(PROFILE, "value = 3\nlegal = [0, 1, 2, 3]", "value = 2\nlegal = [0, 1, 2, 3]")

TEXTS = catalogue(Reader.OPERATOR, "en")


@pytest.fixture(scope="module")
def epos4():
    return examine(load(CONFIGS / "demo.toml"))


@pytest.fixture(scope="module")
def generic(tmp_path_factory):
    configs = copied(tmp_path_factory.mktemp("generic"))
    return examine(load(changed(configs, *GENERIC)))


def table(report, name):
    title = f"Where the numbers of {name} come from"
    (section,) = [section for section in sections(report, TEXTS) if section.title == title]
    return [" ".join(row) for row in section.rows]


def test_the_source_of_torque_is_told_with_unit_base_factor_sign_gear_and_sampling(epos4, generic):
    assert (
        "torque is read from 30D1h:02, signed 32 bits, milliampere, by k_t of 3001h:05: "
        "one is 0.02708 N; gear 6, lead 150 mm, sign +1 in the drive, -1 of the axis, "
        "sampling: instant"
    ) in table(epos4, "right/slide")
    assert (
        "torque is read from 6077h:00, signed 16 bits, permille of rated torque, "
        "by rated torque of 6076h:00 in milli_newton_metre: one is 0.0279 N m; gear 100, "
        "sign +1 in the drive, +1 of the axis, sampling: instant"
    ) in table(generic, "right/hip")


def test_the_limit_is_told_with_its_object_and_its_raw_value(epos4, generic):
    hip, _ = epos4.axes
    nm = hip.torque_limit_raw * hip.torque_limit.effort_per_count_si

    assert nm == pytest.approx(62.0, abs=0.01)
    assert any(
        row.startswith("torque is limited by 11123 in 3001h:02") for row in table(epos4, hip.name)
    )
    assert any(
        row.startswith("torque is limited by 2222 in 6072h:00") for row in table(generic, hip.name)
    )


def test_what_the_drive_must_hold_is_told_with_its_unit(epos4):
    assert [row for row in table(epos4, "right/hip") if row.startswith("must hold")] == [
        "must hold, within 1 % 6076h:00 = 278680, rated torque in micro_newton_metre",
        "must hold, within 1 % 3001h:01 = 5000, rated current in milliampere",
        "must hold, within 1 % 3001h:05 = 55736, torque constant in micro_newton_metre per ampere",
    ]


def test_option_codes_are_told_in_words(epos4):
    assert epos4.axes[0].option_codes == (
        "quick stop (605Ah = 6): slow down on the quick-stop ramp and stay in quick stop",
        "fault (605Eh = 2): slow down on the quick-stop ramp, then switch off",
        "master gone (6007h = 3): quick stop, then as defined by 605Ah",
    )


def test_how_a_drive_notices_silence_is_told_with_its_times(epos4, generic):
    assert "notices silence after 100 ms without our heartbeat (1016h:01)" in table(
        epos4, "right/hip"
    )
    assert (
        "notices silence after 100 ms without our heartbeat (1016h:01), "
        "after 30 ms without RPDO1 (1400h:05)"
    ) in table(generic, "right/hip")
    assert (generic.axes[0].silence_detection_ms, epos4.axes[0].silence_detection_ms) == (30, 100)


def test_a_profile_that_is_not_verified_says_so_with_its_sources(epos4):
    (section,) = [
        s for s in sections(epos4, TEXTS) if s.title == "Where the drives' facts come from"
    ]

    (drive, verified), *sources, (_, open_facts) = section.rows
    assert (drive, verified) == ("maxon EPOS4", "NOT verified on hardware")
    assert any("EDS of the EPOS4 Module 50/5" in what for _, what in sources)
    assert "fault_reaction_max_ms" in open_facts
    assert (
        "right/hip: the profile of maxon EPOS4 has not been verified on hardware" in epos4.warnings
    )


def test_a_temperature_that_cannot_be_read_is_told_and_warned_of(tmp_path):
    configs = copied(tmp_path)
    text = (configs / PROFILE).read_text()
    start = text.index("[temperature]")
    end = text.index("# Optional objects")
    (configs / PROFILE).write_text(text[:start] + text[end:])

    report = examine(load(changed(configs, *GENERIC)))

    assert "temperature cannot be read: its limit is not watched" in table(report, "right/hip")
    assert (
        "right/hip: its temperature cannot be read: temperature_max_degc is not monitored"
    ) in report.warnings


def test_a_protection_that_is_not_written_is_a_warning(tmp_path):
    change = Change(PROFILE, "speed_limit = true ", "speed_limit = false")

    report = examine(load(changed(copied(tmp_path), *GENERIC, change)))

    assert report.axes[0].speed_limit_raw is None
    assert (
        "right/hip: 6080h is not written: only gaitd keeps its speed limit, "
        "though its EDS has the object"
    ) in report.warnings


def test_a_drive_whose_eds_lacks_what_bring_up_needs_is_refused(tmp_path):
    change = Change("drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "generic402.eds"')
    settings = load(changed(copied(tmp_path), change))
    report = examine(settings)

    (refused,) = refusals(settings, report)

    assert refused.file == str(tmp_path / "configs/drives/hip_epos4.toml")
    assert (refused.key, refused.value) == ("eds", '"generic402.eds"')
    assert refused.allowed.startswith(
        "a drive with all objects that its profile needs: 1018h:01 is 0000029Ah in the EDS, "
        "expected 000000FBh (vendor of this axis) (and "
    )
    assert len(report.axes[0].objections) > 1
    assert report.axes[1].objections == ()


def test_an_eds_that_is_none_is_refused_by_its_axis_file(tmp_path):
    change = Change("drives/hip_epos4.toml", 'eds = "epos4.eds"', 'eds = "hip_epos4.toml"')
    settings = load(changed(copied(tmp_path), change))

    with pytest.raises(ConfigError, match="a readable EDS file") as refused:
        examine(settings)

    assert (refused.value.file, refused.value.key) == (
        str(tmp_path / "configs/drives/hip_epos4.toml"),
        "eds",
    )


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        (
            QUICK_STOP_2,
            "hip.brake",
            "true, or another value in profiles/generic.toml (it may be 5 to 8, which hold): "
            "right/hip would lose its torque, quick stop (605Ah = 2): slow down on the "
            "quick-stop ramp, then switch off",
        ),
        ((*QUICK_STOP_2, HIP_BRAKE), "slide.brake", "right/slide would lose its torque"),
        (
            (COAST,),
            "hip.brake",
            "(it may be 1 or 3, which slow down first): right/hip would lose its torque, "
            "master gone (6007h = 2): disable voltage and coast",
        ),
    ],
)
def test_an_axis_that_would_lose_its_torque_needs_a_brake(tmp_path, changes, key, words):
    demo = changed(copied(tmp_path), *GENERIC, *changes)

    with pytest.raises(ConfigError) as refused:
        load(demo)

    assert refused.value.file == str(tmp_path / "configs/limits.toml")
    assert (refused.value.key, refused.value.value) == (key, "false")
    assert words in refused.value.allowed


def test_with_brakes_a_quick_stop_may_end_without_torque(tmp_path):
    settings = load(changed(copied(tmp_path), *GENERIC, *QUICK_STOP_2, HIP_BRAKE, SLIDE_BRAKE))

    assert {drive.profile.resume_from_quick_stop for drive in settings.drives} == {False}


def test_a_slide_may_coast_when_its_master_is_gone_and_that_is_a_warning(tmp_path):
    report = examine(load(changed(copied(tmp_path), *GENERIC, COAST, HIP_BRAKE)))

    coasting = "master gone (6007h = 2): disable voltage and coast, and it has no brake"
    assert [line for line in report.warnings if coasting in line] == [f"right/slide: {coasting}"]
