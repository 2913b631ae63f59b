"""A text that is missing: the patient gets the most cautious sentence, others code and values."""

import display_bench as bench
import pytest
from gaitd_client import Event, Kind, Priority, Safety
from gaitd_client.wire import Judgement, Progress, Refusal
from gaitd_display.drives import together
from gaitd_display.patient import PatientServer
from gaitd_display.progress import interruption
from gaitd_display.settings import PatientSettings
from gaitd_display.therapist_view import event_item, stop_view
from gaitd_display.words import UNBROKEN
from gaitd_texts import CAUTIOUS, STOPS, Reader, catalogue
from starlette.testclient import TestClient

LATER = "of_a_later_version"


def not_utf_8(file):
    file.write_bytes(b'[label]\nstop = "\xff"\n')


def cut_off(file):
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.rindex('"')], encoding="utf-8")


def no_group(file):
    file.write_text('label = "a text where a group is needed"\n', encoding="utf-8")


def no_text(file):
    file.write_text("[label]\nstop = 5\n", encoding="utf-8")


def missing(file):
    file.unlink()


def a_folder(file):
    file.unlink()
    file.mkdir()


@pytest.fixture
def folder(tmp_path):
    with bench.catalogues(tmp_path) as copied:
        yield copied


unreadable = pytest.mark.parametrize(
    "damage", [not_utf_8, cut_off, no_group, no_text, missing, a_folder]
)


@unreadable
def test_without_a_catalogue_the_patient_s_page_has_only_the_most_cautious_sentence(
    folder, tmp_path, damage, caplog
):
    damage(folder / "patient.de.toml")
    trainer = bench.MessageTrainer()
    settings = bench.settings_of(tmp_path, bench.patient_table(tmp_path), PatientSettings)
    server = PatientServer(settings, trainer, trainer.clock)
    with TestClient(server.app, base_url=bench.ORIGIN) as client:
        texts = client.get("/texts.json").json()

    patient = catalogue(Reader.PATIENT, "en").texts
    assert {key.removeprefix("label.") for key in patient} & texts["de"].keys() == set()
    assert texts["cautious"]["de"] == CAUTIOUS["de"].replace("Not-Halt", UNBROKEN)
    assert texts["en"]["stop.spasm"] == "Your leg got stiff"  # its other language is whole
    for key in ("happened.spasm", "advice.walk", "a key that there is none of"):
        assert catalogue(Reader.PATIENT, "de").text(key, count=3) == CAUTIOUS["de"]
    assert "patient.de.toml: the texts cannot be read" in caplog.text


@unreadable
def test_without_a_catalogue_the_therapist_s_page_has_code_and_values(folder, damage, caplog):
    damage(folder / "operator.de.toml")
    values = {"friction_error_si": 1.25, "correlation": 0.5}
    given = {"id": "1", "time_ns": bench.BEGAN_NS, "kind": Kind.NOTE, "priority": Priority.LOW}
    event = bench.filled(
        Event, code="calibration_advised", subject="right/hip", values=values, **given
    )
    said = event_item(event).said
    assert (
        said["de"] == "calibration_advised friction_error_si=1.25 correlation=0.5 subject=right/hip"
    )
    assert said["en"].startswith("right, hip: friction is +1.25 N·m")

    texts = catalogue(Reader.OPERATOR, "de")
    refusal = Refusal(code="busy", subject=None, values={"request": "enable"}, said="")
    assert texts.refusal(refusal) == "busy request=enable"
    progress = Progress(code="exercising", subject=None, values={"elapsed_s": 2.0})
    assert texts.progress(progress) == "exercising elapsed_s=2.0"
    verdict = bench.filled(Judgement, cause="spasm", finding="swings", value=3.5, limit=3.0)
    assert "spasm" in texts.verdict(verdict)
    assert "value=3.5" in texts.verdict(verdict)
    assert interruption("late_here")["de"] == "late_here"
    assert "operator.de.toml: the texts cannot be read" in caplog.text


@unreadable
def test_without_a_catalogue_a_stop_on_the_therapist_s_page_has_no_empty_text(folder, damage):
    damage(folder / "operator.de.toml")
    for cause in {*STOPS, LATER}:
        safety = bench.filled(
            Safety, valid=True, verdict=bench.filled(Judgement, cause=cause, drive="right/hip")
        )
        stop = stop_view(safety, together(()))
        assert all((stop.stopped["de"], stop.then["de"], stop.again["de"], stop.subject["de"]))
        known = cause if cause in STOPS else "unknown"
        assert stop.stopped["de"] == f"{known} cause={cause}"
