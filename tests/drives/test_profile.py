import copy
import re

import msgspec
import pytest
from drive_files import (
    AXES,
    CYCLE,
    FOLDER,
    HIP_LIMITS,
    PROFILES,
    SLIDE_LIMITS,
    axis_for,
    drive,
    drive_of,
    join,
    table,
)

from drives.bringup.plan import plan
from drives.bringup.steps import StepKind
from drives.canopen.emcy_codes import Reaction, meaning
from drives.cia402.axis_file import AxisFile
from drives.cia402.homing import HomingObjects
from drives.cia402.pdo import layouts
from drives.cia402.profile import DecelerationUnit, DriveProfile, Keeps, SpeedUnit, contradictions
from drives.errors import DescriptionError
from drives.service import eds

NAMES = [name for name in AXES if (FOLDER / table(f"{name}.toml")["eds"]).is_file()]


def broken(name, part, path, value):
    """The tables of a drive with one value changed; None removes the key."""
    axis = copy.deepcopy(table(f"{name}.toml"))
    profile = copy.deepcopy(table(axis["profile"]))
    place = {"axis": axis, "profile": profile}[part]
    *folders, key = path
    for folder in folders:
        place = place[folder]
    if value is None:
        del place[key]
    else:
        place[key] = value
    return axis, profile


def at_a_stop(stop_current_a):
    """Settings of the hip's homing by a mechanical stop."""
    return table("hip_epos4.toml")["homing"] | {"method": -4, "stop_current_a": stop_current_a}


@pytest.mark.parametrize("name", AXES)
def test_every_drive_file_of_the_project_is_consistent(name):
    description = drive(name)

    assert description.name == f"right/{name.split('_')[0]}"
    assert not description.profile.verified_on_hardware


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("joint", ["hip", "slide"])
def test_every_profile_describes_a_drive_that_can_be_brought_up(profile, joint):
    description = drive_of(profile, joint)
    limits = HIP_LIMITS if joint == "hip" else SLIDE_LIMITS

    steps = plan(description, limits, CYCLE).steps

    places = {(step.kind, step.index, step.sub) for step in steps}
    limit = description.profile.torque_limit
    assert (StepKind.WRITE, limit.index, limit.sub) in places  # written, and read back
    for base in description.torque_bases:
        assert (StepKind.COMPARE, base.ref.index, base.ref.sub) in places
    for entry in description.profile.checked:
        assert (StepKind.CHECK, entry.index, entry.sub) in places


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_names_its_sources_and_no_one_has_verified_it(profile):
    kind = drive_of(profile).profile

    assert not kind.verified_on_hardware
    told = " ".join(source.what for source in kind.sources)
    if profile != "generic":
        assert re.search("EDS|DCF", told)
    assert not set(kind.open_facts) & {"torque_limit.index", "target_torque.index"}
    assert "fault_reaction_max_ms" in kind.open_facts
    assert meaning(0x8130, kind.emergency_codes).text


@pytest.mark.parametrize("profile", PROFILES)
def test_every_profile_notices_that_its_master_is_gone(profile):
    kind = drive_of(profile).profile

    assert kind.heartbeat.consumer_entries or kind.pdo.rpdo_timeout


OPTIONAL = {
    "interpolation_time": 0x60C2,
    "position_limits": 0x607D,
    "speed_limit": 0x6080,
    "following_error": 0x6065,
    "polarity": 0x607E,
}


@pytest.mark.parametrize("has", [True, False])
@pytest.mark.parametrize("name", OPTIONAL)
def test_an_optional_object_is_touched_where_the_profile_says_that_there_is_one(name, has):
    profile = table("profiles/generic.toml")
    profile["optional_objects"][name] = has

    steps = plan(join(axis_for(profile), profile, "hip"), HIP_LIMITS, CYCLE).steps

    assert (OPTIONAL[name] in {step.index for step in steps}) is has


@pytest.mark.parametrize("name", [*OPTIONAL, "halt_option", "sync_counter", "sync_window"])
def test_no_optional_object_may_be_left_unsaid(name):
    profile = table("profiles/generic.toml")
    del profile["optional_objects"][name]

    with pytest.raises(msgspec.ValidationError, match=name):
        join(axis_for(profile), profile, "hip")


def test_a_polarity_is_checked_in_all_three_signs_and_never_written():
    description = drive_of("elmo_gold")

    steps = [s for s in plan(description, HIP_LIMITS, CYCLE).steps if s.index == 0x607E]

    assert [(step.kind, step.value, step.mask) for step in steps] == [(StepKind.CHECK, 0, 0xE0)]


@pytest.mark.parametrize(
    ("temperature", "error_code"), [(True, True), (True, False), (False, True)]
)
def test_tpdo3_carries_what_the_drive_has(temperature, error_code):
    profile = table("profiles/generic.toml")
    profile["pdo"]["error_code"] = error_code
    if not temperature:
        del profile["temperature"]

    slow = layouts(join(axis_for(profile), profile, "hip").profile, 5).slow

    carried = [item.index for item in slow.objects]
    assert carried == [0x2100] * temperature + [0x603F] * error_code
    assert slow.size == 2 * (temperature + error_code)


def test_a_target_of_32_bits_fills_rpdo2():
    profile = table("profiles/generic.toml")
    profile["target_torque"] |= {"bits": 32}
    description = join(axis_for(profile), profile, "hip")

    seed = [s for s in plan(description, HIP_LIMITS, CYCLE).steps if s.index == 0x6071]

    assert layouts(description.profile, 5).target_torque.size == 4
    assert [step.bits for step in seed] == [32]


@pytest.mark.parametrize("name", NAMES)
def test_the_eds_knows_every_object_that_bring_up_touches(name):
    description = drive(name)
    limits = HIP_LIMITS if "hip" in name else SLIDE_LIMITS

    dictionary = eds.load_eds(description.eds, description.node_id)

    assert eds.objections(plan(description, limits, CYCLE), dictionary) == []


def test_an_object_that_the_eds_does_not_have_is_named():
    dictionary = eds.load_eds(str(FOLDER / "epos4.eds"), 5)

    found = eds.objections(plan(drive("hip_generic"), HIP_LIMITS, CYCLE), dictionary)

    places = {line.split()[0] for line in found}
    assert {"1018h:01", "1018h:03"} < places  # and it is another maker's
    assert places - {"1018h:01", "1018h:03"} == {
        "6075h:00",
        "6072h:00",
        "605Dh:00",
        "1400h:05",
        "2100h:01",
    }


@pytest.mark.parametrize(
    ("key", "old", "new", "words"),
    [
        ("6077", "PDOMapping=1", "PDOMapping=0", "6077h:00 cannot be mapped by the EDS (TPDO2"),
        ("6077", "DataType=0x0003", "DataType=0x0004", "6077h:00 has 32 bits in the EDS, not 16"),
        ("6077", "DataType=0x0003", "DataType=0x0006", "6077h:00 has no sign in the EDS (TPDO2"),
        ("6072", "AccessType=rw", "AccessType=ro", "6072h:00 cannot be written by the EDS"),
        ("6085", "DataType=0x0007", "DataType=0x0006", "6085h:00 has 16 bits in the EDS, not 32"),
        ("6502", "DefaultValue=0x00000380", "DefaultValue=0x0011044B", "6502h:00 is 0011044Bh in"),
        ("1018sub2", "0x00040201", "0x00040202", "1018h:02 is 00040202h in the EDS, expected 0004"),
        (
            "605A",
            "DefaultValue=2",
            "LowLimit=0\nHighLimit=2",
            "605Ah:00 = 6 is outside 0 .. 2 of the EDS",
        ),
    ],
)
def test_what_the_eds_says_against_a_plan_is_told(tmp_path, key, old, new, words):
    found = objections_to_generic(tmp_path, key, old, new)

    assert [line for line in found if words in line], found


def objections_to_generic(tmp_path, key, old, new):
    """Objections to an EDS with one line of one object changed."""
    text = (FOLDER / "generic402.eds").read_text(encoding="utf-8")
    head, object_, tail = text.partition(f"[{key}]\n")
    body, blank, rest = tail.partition("\n\n")
    assert old in body, body
    changed = tmp_path / "changed.eds"
    changed.write_text(head + object_ + body.replace(old, new) + blank + rest, encoding="utf-8")
    return eds.objections(
        plan(drive("hip_generic"), HIP_LIMITS, CYCLE), eds.load_eds(str(changed), 5)
    )


def test_the_upper_end_of_a_range_is_judged_as_the_lower_one_is(tmp_path):
    found = objections_to_generic(tmp_path, "607Dsub2", "AccessType=rw", "AccessType=ro")

    assert found == ["607Dh:02 cannot be written by the EDS (software position limits in counts)"]


def test_the_time_range_of_a_heartbeat_entry_is_no_objection(tmp_path):
    # Elmo's own EDS: 1016h:01 has HighLimit=65535, the range of the time in it.
    found = objections_to_generic(tmp_path, "1016sub1", "HighLimit=0x007FFFFF", "HighLimit=65535")

    assert found == []


def test_a_polarity_that_the_profile_denies_and_the_eds_has_is_an_objection(tmp_path):
    text = (FOLDER / "generic402.eds").read_text(encoding="utf-8").partition("[607E]")[0]
    entry = "ObjectType=0x7\nDataType=0x0005\nAccessType=rw\nPDOMapping=0\n"
    path = tmp_path / "turned.eds"
    path.write_text(f"{text}\n[607E]\nParameterName=Polarity\n{entry}", encoding="utf-8")
    profile = table("profiles/generic.toml")
    profile["optional_objects"]["polarity"] = False
    description = join(axis_for(profile), profile, "hip")

    found = eds.objections(plan(description, HIP_LIMITS, CYCLE), eds.load_eds(str(path), 5))

    assert "607Eh:00 is in the EDS, but optional_objects.polarity is false" in found


def test_a_protection_that_the_profile_denies_and_the_eds_has_is_told():
    has = msgspec.structs.replace(
        drive("hip_generic").profile.optional_objects, speed_limit=False, position_limits=False
    )

    found = eds.unused(has, eds.load_eds(str(FOLDER / "generic402.eds"), 5))

    assert found == ["position_limits", "speed_limit"]


def test_a_mapping_of_objects_is_not_compared_with_the_eds_s_own_default():
    broken_plan = plan(drive("hip_epos4"), HIP_LIMITS, CYCLE)

    assert "60410010h" in str(broken_plan)


def test_an_eds_in_the_windows_code_page_is_read(tmp_path):
    text = (FOLDER / "generic402.eds").read_text(encoding="utf-8")
    path = tmp_path / "windows.eds"
    path.write_bytes(text.replace("Device type", "Device type \u00b0C").encode("cp1252"))

    assert eds.load_eds(str(path), 5).get(0x1000).name == "Device type \u00b0C"


@pytest.mark.parametrize("path", ["absent.eds", "hip_epos4.toml"])
def test_a_file_that_is_no_eds_is_the_operator_s_matter(path):
    with pytest.raises(DescriptionError, match="readable EDS"):
        eds.load_eds(str(FOLDER / path), 5)


@pytest.mark.parametrize(
    ("name", "part", "path", "value", "key"),
    [
        ("hip_epos4", "axis", ("transmission", "lead_m"), 0.1, "transmission.lead_m"),
        ("slide_epos4", "axis", ("transmission", "lead_m"), None, "transmission.lead_m"),
        ("slide_epos4", "axis", ("transmission", "offset_m"), None, "transmission.offset_m"),
        ("slide_epos4", "axis", ("transmission", "offset_rad"), 0.0, "transmission.offset_rad"),
        ("hip_epos4", "axis", ("motor", "rated_torque_raw"), 279, "motor.rated_torque_raw"),
        ("hip_generic", "axis", ("motor", "rated_torque_raw"), 278_680, "motor.rated_torque_raw"),
        ("hip_epos4", "axis", ("motor", "rated_current_raw"), 9520, "motor.rated_current_raw"),
        ("hip_epos4", "axis", ("motor", "torque_constant_raw"), None, "motor.torque_constant_raw"),
        ("hip_generic", "axis", ("motor", "torque_constant_raw"), 55736, "torque_constant_raw"),
        ("hip_epos4", "axis", ("motor", "current_limit_a"), 1.0, "motor.current_limit_a"),
        ("hip_epos4", "profile", ("written", 0, "value"), 2, "605A"),
        ("hip_generic", "profile", ("written", 0, "value"), 0, "605A"),
        ("hip_generic", "profile", ("written", 1, "value"), 0, "605E"),
        ("hip_generic", "profile", ("written", 2, "value"), 0, "6007"),
        ("hip_generic", "profile", ("written",), [], "written"),
        ("hip_generic", "profile", ("optional_objects", "halt_option"), False, "written"),
        ("hip_epos4", "profile", ("optional_objects", "halt_option"), True, "written"),
        ("hip_generic", "profile", ("target_torque", "index"), 0x6072, "target_torque"),
        ("hip_generic", "profile", ("target_torque", "bits"), 8, "target_torque"),
        ("hip_generic", "profile", ("target_torque", "signed"), False, "target_torque"),
        ("hip_generic", "profile", ("torque_base", "rated_torque"), None, "rated_torque"),
        ("hip_generic", "profile", ("torque_base", "rated_torque_unit"), None, "rated_torque_unit"),
        ("hip_elmo", "profile", ("torque_base", "rated_current"), None, "rated_current"),
        ("hip_elmo", "axis", ("motor", "rated_current_raw"), None, "motor.rated_current_raw"),
        ("hip_elmo", "axis", ("motor", "rated_torque_raw"), 279, "motor.rated_torque_raw"),
        ("hip_epos4", "profile", ("heartbeat", "consumer_entries"), 0, "consumer_entries"),
        ("hip_epos4", "axis", ("inputs", "sto_released", "bit"), 16, "inputs"),
    ],
)
def test_files_that_cannot_be_true_together_are_refused_by_key(name, part, path, value, key):
    axis, profile = broken(name, part, path, value)

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, name)

    assert key in caught.value.key
    assert caught.value.part == part
    assert caught.value.allowed


RESUMES = "false where 605Ah is below 5: transition 16 needs a drive that holds"
ONLY_TARGET = "6071h:00, signed, of 16 or 32 bits: CiA 402 defines no other target"


@pytest.mark.parametrize(
    ("name", "part", "path", "value", "told"),
    [
        (
            *("slide_epos4", "axis", ("transmission", "offset_m"), None),
            "axis: transmission.offset_m = None: needed for kind = linear",
        ),
        (
            *("hip_epos4", "axis", ("transmission", "lead_m"), 0.1),
            "axis: transmission.lead_m = 0.1: must be absent for kind = rotary",
        ),
        (
            *("hip_epos4", "axis", ("motor", "torque_constant_raw"), None),
            "axis: motor.torque_constant_raw = None: the profile has a torque_constant object",
        ),
        (
            *("hip_elmo", "axis", ("motor", "rated_torque_raw"), 279),
            "axis: motor.rated_torque_raw = 279: the profile has no rated_torque object",
        ),
        (
            *("hip_generic", "profile", ("written", 0, "value"), 2),
            f"profile: resume_from_quick_stop = True: {RESUMES}",
        ),
        (
            *("hip_epos4", "profile", ("heartbeat", "consumer_entries"), 0),
            "profile: heartbeat.consumer_entries = 0: at least 1, or pdo.rpdo_timeout: a drive must"
            " detect the loss of its master",
        ),
        *(
            (
                *("hip_generic", "profile", ("target_torque", key), value),
                f"profile: target_torque = '{place}': {ONLY_TARGET}",
            )
            for key, value, place in (
                *(("index", 0x6070, "6070h:00"), ("index", 0x6072, "6072h:00")),
                *(("sub", 1, "6071h:01"), ("signed", False, "6071h:00"), ("bits", 8, "6071h:00")),
            )
        ),
        (
            *("hip_generic", "profile", ("torque_source", "index"), 0x6071),
            "profile: torque_source = '6071h:00': another object than the target torque: it shows"
            " what was commanded, not what the motor gives",
        ),
        (
            *("hip_generic", "profile", ("torque_limit", "index"), 0x6071),
            "profile: torque_limit = '6071h:00': another object than the target torque: a command"
            " limits nothing",
        ),
        (
            *("hip_epos4", "axis", ("motor", "peak_current_a"), 11.5),
            "axis: motor.current_limit_a = 12.0: at most peak_current_a = 11.5, the motor's own",
        ),
        *(
            (
                *("hip_epos4", "axis", ("homing",), at_a_stop(stop_current_a)),
                f"axis: homing.stop_current_a = {stop_current_a}: below motor.current_limit_a = 12:"
                " the motor never gets it, and pushes on",
            )
            for stop_current_a in (12.0, 12.5)
        ),
        *(
            (
                *("hip_epos4", "profile", (key, "unit"), "permille_of_rated_torque"),
                f"profile: torque_base.rated_torque = None: the object that {key}.unit ="
                " permille_of_rated_torque refers to",
            )
            for key in ("torque_source", "torque_limit", "target_torque")
        ),
    ],
)
def test_a_contradiction_is_told_with_what_would_be_right(name, part, path, value, told):
    axis, profile = broken(name, part, path, value)
    if "permille" in told:
        others = {"torque_source", "torque_limit", "target_torque"} - {path[0]}
        for other in others:
            profile[other]["unit"] = "milliampere"
        del profile["torque_base"]["rated_torque"], profile["torque_base"]["rated_torque_unit"]

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, name)

    assert str(caught.value) == told


@pytest.mark.parametrize(
    ("profile", "motor", "key", "fits"),
    [
        ("elmo_gold", (0.1, 10.0, {}), "rated_current_raw", range(9900, 10101)),
        (
            *("epos4", (0.01, 10.0, {"rated_torque_raw": 100_000, "rated_current_raw": 10_000})),
            *("torque_constant_raw", range(9900, 10101)),
        ),
        (
            *("generic", (0.0999, 1.0, {"rated_current_raw": 1000})),
            *("rated_torque_raw", range(99, 101)),
        ),
    ],
)
def test_a_base_is_within_one_percent_of_the_motor_s(profile, motor, key, fits):
    kind = table(f"profiles/{profile}.toml")
    axis = axis_for(kind)
    constant_nm_per_a, nominal_a, others = motor
    axis["motor"] |= {
        "torque_constant_nm_per_a": constant_nm_per_a,
        "nominal_current_a": nominal_a,
        "current_limit_a": nominal_a,
    } | others
    for raw in (fits[0], fits[-1]):
        axis["motor"][key] = raw
        assert getattr(join(axis, kind, "hip").axis.motor, key) == raw
    for raw in (fits[0] - 1, fits[-1] + 1):
        axis["motor"][key] = raw
        with pytest.raises(DescriptionError, match=key):
            join(axis, kind, "hip")


@pytest.mark.parametrize(
    ("part", "path", "least", "most"),
    [
        ("axis", ("node_id",), 1, 127),
        ("axis", ("identity", "revision"), 0, 0xFFFFFFFF),
        ("axis", ("motor", "rated_torque_raw"), 1, 0xFFFFFFFF),
        ("axis", ("inputs", "sto_released", "bit"), 0, 31),
        ("profile", ("checked", 0, "mask"), 0, 0xFFFFFFFF),
    ],
)
def test_a_number_of_the_files_has_the_range_of_its_object(part, path, least, most):
    kind = {"axis": AxisFile, "profile": DriveProfile}[part]
    number = {"axis": 0, "profile": 1}[part]
    for value in (least, most):
        msgspec.convert(broken("hip_elmo", part, path, value)[number], kind)
    for value in (least - 1, most + 1):
        with pytest.raises(msgspec.ValidationError, match=path[-1]):
            msgspec.convert(broken("hip_elmo", part, path, value)[number], kind)


def test_the_words_of_a_profile_are_these_and_no_others():
    words = {kind: [one.value for one in kind] for kind in (SpeedUnit, DecelerationUnit, Keeps)}

    assert words == {
        SpeedUnit: ["rpm", "counts_per_s", "tenth_counts_per_s"],
        DecelerationUnit: ["rpm_per_s", "counts_per_s2", "ten_counts_per_s2"],
        Keeps: ["kept", "not_kept", "unknown"],
    }


def test_an_axis_that_does_not_say_how_long_it_takes_to_enable_has_a_quarter_of_a_second():
    assert drive("hip_epos4").axis.enable_max_ms == 250


def test_the_bases_of_torque_are_told_with_their_units():
    told = [(base.what, base.ref.place) for base in drive("hip_epos4").torque_bases]

    assert told == [
        ("rated torque in micro_newton_metre", "6076h:00"),
        ("rated current in milliampere", "3001h:01"),
        ("torque constant in micro_newton_metre per ampere", "3001h:05"),
    ]


@pytest.mark.parametrize(
    ("part", "path", "value"),
    [
        ("axis", ("transmission", "sign"), 0),
        ("axis", ("node_id",), 128),
        ("axis", ("brand",), "maxon"),
        ("profile", ("torque_source", "unit"), "newton_metre"),
        ("profile", ("torque_limit", "bits"), 24),
        ("profile", ("velocity_unit",), "rad_per_s"),
        ("profile", ("torque_source", "sign"), 0),
        ("profile", ("torque_source", "sampling"), "mean"),
        ("profile", ("emergencies",), [{"code": 0x2310, "text": "current", "reaction": "stop"}]),
        ("profile", ("emergencies",), [{"code": 0, "text": "no error"}]),
        ("profile", ("emergencies",), [{"code": 0x10000, "text": "no code"}]),
        ("profile", ("emergencies",), [{"code": 0x2310, "text": 61 * "x"}]),
    ],
)
def test_values_that_no_drive_has_are_refused_by_the_structs(part, path, value):
    axis, profile = broken("hip_epos4", part, path, value)

    with pytest.raises(msgspec.ValidationError):
        join(axis, profile, "hip_epos4")


def test_leaving_quick_stop_by_transition_16_needs_a_drive_that_holds():
    axis, profile = broken("hip_generic", "profile", ("written", 0, "value"), 2)

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, "hip_generic")

    assert caught.value.key == "resume_from_quick_stop"
    join(axis, profile | {"resume_from_quick_stop": False}, "hip_generic")


@pytest.mark.parametrize("name", ["hand_switch_closed", "sto_released", "positive_limit"])
@pytest.mark.parametrize(("bit", "fits"), [(2, True), (3, False), (15, False), (28, True)])
def test_an_input_is_at_a_bit_that_the_drive_can_set(name, bit, fits):
    axis, profile = copy.deepcopy(table("hip_epos4.toml")), table("profiles/epos4.toml")
    axis["inputs"][name] = {"bit": bit, "level": 1}

    if fits:
        join(axis, profile, "hip_epos4")
        return
    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, "hip_epos4")
    said = caught.value
    assert (said.part, said.key, bit in said.value) == ("axis", "inputs", True)
    assert "E000FFF8h" in caught.value.allowed


def test_a_temperature_that_is_not_mapped_is_what_the_service_reads_by_sdo():
    uploaded = {
        name: drive(f"hip_{name}").profile.uploaded_in_cycle for name in ("epos4", "generic")
    }

    assert uploaded == {"epos4": (0x3201, 1), "generic": None}


def test_a_slow_pdo_without_anything_in_it_is_refused():
    axis, profile = broken("hip_generic", "profile", ("temperature",), None)
    profile["pdo"]["error_code"] = False

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, "hip_generic")

    allowed = "true where no temperature is mapped: TPDO3 would be empty"
    assert str(caught.value) == f"profile: pdo.error_code = False: {allowed}"


@pytest.mark.parametrize("profile", PROFILES)
def test_the_page_about_drives_tells_each_profile_with_its_objects(profile):
    page = (FOLDER.parents[1] / "docs/drives.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{profile}` |")]
    kind = drive_of(profile).profile

    places = [ref.place.removesuffix(":00") for ref in (kind.torque_source, kind.torque_limit)]
    assert all(place in row for place in places)
    quick_stop = next(entry.value for entry in kind.written if entry.index == 0x605A)
    assert f"605Ah = {quick_stop}" in row
    assert ("1400h:05" in row) is kind.pdo.rpdo_timeout
    assert ("1016h" in row) is bool(kind.heartbeat.consumer_entries)


@pytest.mark.parametrize(
    ("changes", "objects", "key", "allowed"),
    [
        ({}, None, "homing", "absent: the profile has no homing"),
        ({"method": 36}, {}, "homing.method", "one of "),
        (
            {"method": -4},
            {},
            "homing.stop_current_a",
            "given: method -4 detects the stop by this current",
        ),
        (
            {"stop_current_a": 4.5},
            {},
            "homing.stop_current_a",
            "absent: method 17 detects no stop by its current",
        ),
    ],
)
def test_a_homing_that_the_drive_does_not_support_is_refused(changes, objects, key, allowed):
    axis = copy.deepcopy(table("hip_epos4.toml"))
    profile = copy.deepcopy(table(axis["profile"]))
    join(axis, profile, "hip")
    axis["homing"] |= changes
    if objects is None:
        del profile["homing"]

    with pytest.raises(DescriptionError) as caught:
        join(axis, profile, "hip")

    said = caught.value
    assert (said.part, said.key) == ("axis", key)
    assert said.allowed.startswith(allowed)
    assert said.allowed == allowed or str(profile["homing"]["methods"][0]) in said.allowed


def test_a_homing_by_a_switch_needs_no_object_for_a_current():
    profile = copy.deepcopy(table("profiles/epos4.toml"))
    del profile["homing"]["current_threshold"], profile["homing"]["stall_methods"]

    join(table("hip_epos4.toml"), profile, "hip")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stall_methods": []}, "homing.current_threshold = '30B2h:00': given together with"),
        ({"current_threshold": None}, "homing.current_threshold = None: given together with"),
        ({"stall_methods": [-4, -5, -6]}, r"homing.stall_methods = \[-6, -5\]: of `methods`"),
    ],
)
def test_methods_that_detect_a_stop_and_their_object_go_together(changes, said):
    profile = copy.deepcopy(table("profiles/epos4.toml"))
    profile["homing"] |= changes

    with pytest.raises(DescriptionError, match=f"profile: {said}"):
        join(table("hip_epos4.toml"), profile, "hip")


def test_a_current_that_the_object_of_the_threshold_cannot_hold_is_refused():
    axis, profile = broken("hip_epos4", "axis", ("homing",), at_a_stop(65.6))
    axis["motor"] |= {"current_limit_a": 90.0}
    words = r"axis: homing.stop_current_a = 65\.6: at most 65\.535: 30B2h:00 counts it in mA"

    with pytest.raises(DescriptionError, match=words):
        join(axis, profile, "hip")
    axis["homing"] = at_a_stop(65.535)
    assert join(axis, profile, "hip").axis.homing.stop_current_a == 65.535


@pytest.mark.parametrize("narrow", [{"bits": 16}, {"signed": False}])
def test_a_home_has_the_width_of_a_position(narrow):
    profile = copy.deepcopy(table("profiles/epos4.toml"))
    profile["homing"]["home"] |= narrow

    with pytest.raises(
        DescriptionError, match=r"profile: homing.home = '30B0h:00': an object of 32"
    ):
        join(table("hip_epos4.toml"), profile, "hip")


@pytest.mark.parametrize(
    ("part", "place", "change", "said"),
    [
        ("written", 3, {"value": -1, "legal": [-1]}, r"written\[1029h\].value = -1: 0 to 255"),
        ("written", 3, {"value": 256, "legal": [256]}, r"written\[1029h\].value = 256: 0 to 255"),
        ("written", 0, {"value": 40_000, "legal": [40_000]}, "-32768 to 32767, which 605Ah:00"),
        ("checked", 0, {"bits": 16}, r"profile: checked\[60A9h\].value = 11814656: 0 to 65535"),
    ],
)
def test_a_value_that_its_object_cannot_hold_is_refused(part, place, change, said):
    profile = copy.deepcopy(table("profiles/epos4.toml"))
    profile[part][place] |= change

    with pytest.raises(DescriptionError, match=said):
        join(table("hip_epos4.toml"), profile, "hip")


@pytest.mark.parametrize(
    ("method", "fits"), [(-129, False), (-128, True), (127, True), (128, False)]
)
def test_a_homing_method_has_eight_bits(method, fits):
    objects = table("profiles/epos4.toml")["homing"] | {"methods": [method], "stall_methods": []}

    if fits:
        assert msgspec.convert(objects, HomingObjects).methods == (method,)
    else:
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(objects, HomingObjects)


def test_the_widest_objects_that_a_profile_may_name_fit_a_frame():
    profile = copy.deepcopy(table("profiles/generic.toml"))
    for name in ("torque_source", "target_torque", "temperature"):
        profile[name] |= {"bits": 32}

    pdos = layouts(join(axis_for(profile), profile, "hip").profile, 5)

    assert max(pdo.size for pdo in pdos) == 8


@pytest.mark.parametrize(
    ("part", "path", "value"),
    [
        ("axis", ("motor", "peak_current_a"), 12.0),
        ("axis", ("motor", "peak_current_a"), 20.0),
        ("axis", ("homing",), at_a_stop(11.9)),
        ("axis", ("homing",), None),
    ],
)
def test_currents_up_to_the_motor_s_own_are_accepted(part, path, value):
    assert join(*broken("hip_epos4", part, path, value), "hip_epos4").node_id == 5


def test_all_contradictions_of_two_files_are_found_at_once():
    axis, profile = broken("hip_epos4", "axis", ("transmission", "lead_m"), 0.1)
    profile["heartbeat"]["consumer_entries"] = 0

    errors = contradictions(msgspec.convert(profile, DriveProfile), msgspec.convert(axis, AxisFile))

    assert [error.key for error in errors] == ["heartbeat.consumer_entries", "transmission.lead_m"]


@pytest.mark.parametrize(
    ("entries", "key", "allowed"),
    [
        ([{"code": 0x2310, "text": "hot", "reaction": "warning"}], "reaction", "only FFxxh"),
        (
            [{"code": 0xFEF0, "last_code": 0xFF10, "text": "x", "reaction": "warning"}],
            "reaction",
            "only FFxxh",
        ),
        ([{"code": 0x2310, "text": "a"}, {"code": 0x2310, "text": "b"}], "code", "each code once"),
        (
            [{"code": 1, "last_code": 9, "text": "x"}, {"code": 8, "text": "y"}],
            "code",
            "each code once",
        ),
        ([{"code": 0x5480, "last_code": 0x5470, "text": "x"}], "last_code", "from code on"),
        ([{"code": 1, "last_code": 1001, "text": "x"}], "last_code", "1000 codes at most"),
    ],
)
def test_a_maker_s_codes_are_each_there_once_and_none_milder_than_the_standard_s(
    entries, key, allowed
):
    axis, profile = broken("hip_epos4", "profile", ("emergencies",), entries)

    with pytest.raises(DescriptionError) as refused:
        join(axis, profile, "hip_epos4")

    code = entries[-1]["code"]
    assert str(refused.value).startswith(f"profile: emergencies[{code:04X}h].{key} = ")
    assert allowed in refused.value.allowed


def test_a_maker_s_file_adds_a_code_without_any_code_of_ours():
    entries = [
        {"code": 0xFF42, "text": "fan slow", "reaction": "warning"},
        {"code": 0x7342, "text": "resolver", "reaction": "switched_off"},
        {"code": 0x0001, "last_code": 1000, "text": 60 * "x"},
        {"code": 0xFFFF, "text": "last"},
    ]
    axis, profile = broken("hip_epos4", "profile", ("emergencies",), entries)
    codes = join(axis, profile, "hip_epos4").profile.emergency_codes

    assert meaning(0xFF42, codes) == ("fan slow", Reaction.WARNING, False)
    assert meaning(0x7342, codes) == ("resolver", Reaction.SWITCHED_OFF, True)
    assert meaning(0xFF43, codes).reaction is Reaction.UNKNOWN
    assert not meaning(0x0002, codes).loses_reference
    assert [meaning(code, codes).text for code in (1, 1000, 0xFFFF)] == [60 * "x", 60 * "x", "last"]
