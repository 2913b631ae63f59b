"""`gaitd drive profile`: what it proposes of an EDS, and that check and virtual drives run it."""

import json
import tomllib

import msgspec
import pytest
from command_line import gaitd
from config_files import copied
from drive_bench import Bench
from drive_files import CYCLE, FOLDER, HIP_LIMITS, SLIDE_LIMITS, axis_for, table

from daemon.preflight.load import load
from daemon.preflight.report import examine, refusals
from drives.bringup.bringup import bring_up
from drives.bringup.configurator import Configurator
from drives.bringup.plan import plan
from drives.canopen.data_sheet import parse
from drives.cia402.axis_file import AxisFile
from drives.cia402.profile import DriveProfile, describe
from drives.service.proposal import as_toml, propose
from drives.signals import PowerState
from gaitd_lab.lockstep import WorldBus, WorldClock

GENERIC = (FOLDER / "generic402.eds").read_text(encoding="utf-8")


def proposed(text, name="maker.eds"):
    return propose(parse(text, 5), name, 5)


def tables_of(text):
    return tomllib.loads(as_toml(proposed(text), "maker.eds"))


def replaced(*changes):
    """The EDS of the plain CiA 402 drive with changes in sections: section, old line, new line."""
    text = GENERIC
    for section, old, new in changes:
        head, mark, tail = text.partition(f"[{section}]\n")
        body, end, rest = tail.partition("\n\n")
        assert old in body, (section, body)
        text = head + mark + body.replace(old, new) + end + rest
    return text


def without(index):
    parts = GENERIC.split("\n\n")
    return "\n\n".join(
        part for part in parts if not part.startswith((f"[{index}]", f"[{index}sub"))
    )


# what the file says, changed -> a key of the proposal, its value, and whether it is a question
KEYS = [
    (GENERIC, "torque_source.unit", "permille_of_rated_torque", False),
    (GENERIC, "torque_base.rated_torque_unit", "milli_newton_metre", True),
    (GENERIC, "torque_source.sampling", "unknown", True),
    (GENERIC, "velocity_unit", "counts_per_s", True),
    (GENERIC, "pdo.rpdo_timeout", True, False),
    (GENERIC, "optional_objects.speed_limit", True, False),
    (without("6080"), "optional_objects.speed_limit", False, False),
    (
        replaced(("6080", "AccessType=rw", "AccessType=ro")),
        "optional_objects.speed_limit",
        False,
        False,
    ),
    (without("6076"), "torque_source.unit", "permille_of_rated_current", False),
    (replaced(("6077", "PDOMapping=1", "PDOMapping=0")), "torque_source.index", 0x6078, False),
    (without("6072"), "torque_limit.index", 0x6073, False),
    (replaced(("603F", "PDOMapping=1", "PDOMapping=0")), "temperature.index", 0x2100, False),
    (replaced(("603F", "PDOMapping=1", "PDOMapping=0")), "temperature.degc_per_count", 1.0, True),
    (
        GENERIC + "\n[60A9]\nParameterName=x\nDataType=7\nAccessType=rw\nDefaultValue=0x00B44700\n",
        "velocity_unit",
        "rpm",
        False,
    ),
]


@pytest.mark.parametrize(("text", "key", "value", "is_question"), KEYS)
def test_each_key_follows_from_the_file_or_is_a_question(text, key, value, is_question):
    tables = tables_of(text)

    found = tables
    for part in key.split("."):
        found = found[part]
    assert found == value
    assert (key in tables["must_show"]) == is_question
    assert msgspec.convert(tables, DriveProfile).verified_on_hardware is False


def test_an_option_code_is_one_that_the_file_allows_and_else_a_question():
    bounded = replaced(("605A", "DefaultValue=2", "DefaultValue=2\nLowLimit=0\nHighLimit=2"))
    codes = {
        text: next(row for row in tables_of(text)["written"] if row["index"] == 0x605A)
        for text in (GENERIC, bounded)
    }

    assert (codes[GENERIC]["value"], codes[GENERIC]["legal"]) == (6, [6])
    assert "written.605Ah:00" in tables_of(GENERIC)["must_show"]
    assert (codes[bounded]["value"], codes[bounded]["legal"]) == (2, [1, 2])
    assert "written.605Ah:00" not in tables_of(bounded)["must_show"]
    assert tables_of(bounded)["resume_from_quick_stop"] is False


OBSTACLES = [
    (without("605A"), "605Ah:00 must be among them"),
    (without("6071"), "6071h:00 is not in the EDS"),
    (without("60FD"), "60FDh:00 is not in the EDS (TPDO2 carries it)"),
    (replaced(("6502", "0x00000380", "0x0011044B")), "6502h:00 is 0011044Bh in the EDS"),
    (replaced(("6064", "PDOMapping=1", "PDOMapping=0")), "6064h:00 cannot be mapped by the EDS"),
    (replaced(("6060", "DataType=0x0002", "DataType=")), "[6060] DataType=: allowed is"),
    ("[1000]\nDataType=7\nAccessType=ro\n", "6041h:00 is not in the EDS"),
]


@pytest.mark.parametrize(("text", "said"), OBSTACLES)
def test_what_keeps_the_service_from_using_the_drive_is_said(text, said):
    proposal = proposed(text)

    assert [line for line in proposal.obstacles if said in line], proposal.obstacles
    assert f"# It cannot be used: {proposal.obstacles[0]}" in as_toml(proposal, "maker.eds")


def test_objects_whose_names_fit_are_named_and_not_taken():
    more = "\n[2345]\nParameterName=Torque constant\nDataType=7\nAccessType=rw\nPDOMapping=0\n"

    proposal = proposed(GENERIC + more)

    assert proposed(GENERIC).tables["torque_base"] == proposal.tables["torque_base"]
    assert [line for line in proposal.questions if "2345h:00 'Torque constant'" in line]


@pytest.mark.parametrize("kind", ["generic", "elmo_gold"])
def test_a_virtual_drive_of_the_same_file_is_brought_up_with_the_proposal(kind):
    eds = {"generic": "generic402.eds"}.get(kind, f"{kind}.eds")
    text = (FOLDER / eds).read_text(encoding="utf-8")
    kept = tables_of(text)
    changes = {"personality": kind, "eds": f"drives/{eds}"}
    bench = Bench(hip=changes, slide=changes)
    bench.boot()
    plans = []
    for joint, limits in (("hip", HIP_LIMITS), ("slide", SLIDE_LIMITS)):
        axis = axis_for(kept, joint) | {"eds": eds}
        axis["identity"] = table(f"{joint}_{kind.partition('_')[0]}.toml")["identity"]
        files = msgspec.convert(kept, DriveProfile), msgspec.convert(axis, AxisFile)
        plans.append(plan(describe(f"right/{joint}", *files, str(FOLDER / eds)), limits, CYCLE))
    bus = WorldBus(bench.world)
    steps = bring_up(plans, Configurator(bus, WorldClock(bus)), CYCLE)

    with pytest.raises(StopIteration) as ended:
        while True:
            next(steps)

    assert {one.power_state for one in ended.value.value} == {PowerState.SWITCH_ON_DISABLED}


def test_check_accepts_a_machine_with_the_proposal(tmp_path):
    configs = copied(tmp_path)
    eds, profile = configs / "drives/generic402.eds", configs / "drives/profiles/generic.toml"
    demo = configs / "demo.toml"
    demo.write_text(demo.read_text().replace("_epos4.toml", "_generic.toml"))

    ended = gaitd("drive", "profile", eds, "--output", profile, "--json")

    assert ended.code == 0, ended.err
    told = json.loads(ended.out)
    assert told["obstacles"] == []
    assert told["profile"] == profile.read_text(encoding="utf-8")
    assert told["identity"]["vendor_id"] == 0x29A
    settings = load(demo)
    assert list(refusals(settings, examine(settings))) == []
    assert told["questions"]


def test_an_obstacle_ends_with_1_and_a_file_that_is_no_eds_with_2(tmp_path):
    eds, empty = tmp_path / "maker.eds", tmp_path / "empty.eds"
    eds.write_text(without("605A"), encoding="utf-8")
    empty.write_text("nothing", encoding="utf-8")

    refused, no_eds = gaitd("drive", "profile", eds), gaitd("drive", "profile", empty)

    assert (refused.code, no_eds.code) == (1, 2)
    assert "# It cannot be used: profile: written" in refused.out
    assert "empty.eds: a readable EDS file: it has no section" in no_eds.err
