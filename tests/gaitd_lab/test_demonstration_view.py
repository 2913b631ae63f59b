"""The live view draws at every moment of a performance, on screens of any size."""

import math

import numpy as np
import pytest
from gaitd_client import wire
from gaitd_client.connection import Target
from rich.console import Console
from rich.text import Text

from gaitd_lab.demonstration.clients import PageSpot
from gaitd_lab.demonstration.curves import Chart, Curve
from gaitd_lab.demonstration.feed import RECEIVED, LegTracks, Receiver, Track
from gaitd_lab.demonstration.report import line
from gaitd_lab.demonstration.script import Kind, Scene
from gaitd_lab.demonstration.training import Training
from gaitd_lab.demonstration.view import Moment, picture
from simtime.clock import PageClock

NOW_NS = 20_000_000_000


def tracks(*legs: str, silent: bool = False) -> dict[str, LegTracks]:
    traffic, true = made = LegTracks.new()
    for row in range(1600):
        time_ns = NOW_NS - (1600 - row) * 10_000_000
        hip = 8 * math.sin(row / 64)
        true.add(time_ns, (hip, 5 * hip, 6.0, 65.0))
        values = dict.fromkeys(RECEIVED, 1.0) | {"hip_patient_nm": math.nan if silent else hip}
        traffic.add(time_ns, tuple(values[name] for name in RECEIVED))
    return dict.fromkeys(legs or ("right",), made)


def moment(legs: dict[str, LegTracks], receiver: Receiver | None = None) -> Moment:
    scene = Scene("gait, the patient takes part", Kind.ACTIVE, 20.0)
    return Moment(NOW_NS, 20.0, scene, 5.0, 0.8, receiver, legs)


def health() -> wire.Health:
    return wire.Health(
        seq=1,
        core_boot_id="a",
        cycle=1,
        sample_time_ns=1,
        lateness_bound_us=(100, 1000),
        lateness_count=(990, 9, 1),
        lateness_p50_us=90.0,
        lateness_max_us=1200.0,
        collect_max_us=1500.0,
        work_max_us=600.0,
        overrun_count=0,
        overrun_by_part={},
        publish_max_us=None,
        record_count=100,
        bus_load_ratio=0.1,
        bus=None,
        drives=(),
        tx_dropped_count=0,
        record_missed_count=0,
        record_skipped_count=0,
        gateway_state_dropped_count=0,
        request_dropped_count=0,
        not_kept_count=0,
        gateway_wake_max_us=300.0,
        gateway_estimate_p50_us=200.0,
        setpoint_accepted_count=0,
        setpoint_refused_count={},
        assist_lapse_count=0,
    )


def drawn(shown: Moment, width: int = 140, height: int = 44) -> list[str]:
    console = Console(width=width, height=height, force_terminal=True)
    with console.capture() as captured:
        console.print(picture(shown, width, height), height=height)
    return Text.from_ansi(captured.get()).plain.splitlines()


@pytest.mark.parametrize("size", [(140, 44), (80, 24)])
def test_where_the_pages_are_is_on_the_screen(size):
    training = Training(8080, 8443, is_hands_on=False)
    pages = f"patient 127.0.0.1:8080, therapist 127.0.0.1:8443, password {training.password}"
    for shown, text in (
        (PageSpot(8090, "").shown, "in a browser: http://127.0.0.1:8090/"),
        (training.shown, pages),
    ):
        screen = drawn(moment(tracks())._replace(pages=shown), *size)
        assert text in "\n".join(screen)


def test_estimate_and_truth_of_both_axes_are_on_the_screen():
    screen = "\n".join(drawn(moment(tracks())))

    for words in ("hip: patient torque", "slide: patient force", "hip: friction", "estimate"):
        assert words in screen
    assert "gait, the patient takes part" in screen
    assert "5 of 20 s" in screen


def test_two_legs_are_above_each_other_and_leave_out_friction():
    shown = moment(tracks("right", "left"))
    screen = "\n".join(drawn(shown))

    for leg in ("right", "left"):
        assert f"{leg} hip: patient torque" in screen
        assert f"{leg} slide: patient force" in screen
        assert f"{leg} hip patient" in line(shown)
    assert "friction" not in screen.replace("friction and patient", "")


@pytest.mark.parametrize(("width", "height"), [(140, 44), (80, 24), (60, 16), (220, 60)])
@pytest.mark.parametrize("legs", [("right",), ("right", "left")])
def test_the_picture_fits_its_screen(width, height, legs):
    lines = drawn(moment(tracks(*legs)), width, height)

    assert len(lines) <= height
    assert max(map(len, lines)) <= width


def test_before_anything_is_heard_the_view_says_so():
    screen = "\n".join(drawn(moment({})))

    assert "starting" in screen
    assert "no word yet" in screen
    assert line(moment({"right": LegTracks.new()})).split()[-1] == "starting"


def test_the_service_s_own_state_is_shown(tmp_path):
    receiver = Receiver(
        Target((), "trainer"), {"right": Track(RECEIVED)}, PageClock(tmp_path / "bus")
    )
    receiver.health = health()

    screen = "\n".join(drawn(moment(tracks(), receiver)))

    assert "1200 µs" in screen
    assert "overruns" in screen


def test_an_estimate_that_is_null_is_a_gap_and_not_zero():
    assert "–" in line(moment(tracks(silent=True)))
    assert "hip patient    0.0" not in line(moment(tracks(silent=True)))


def test_a_curve_with_gaps_and_a_curve_without_points_are_drawn():
    time_s = np.linspace(-16, 0, 200)
    values = np.sin(time_s)
    values[50:80] = np.nan
    chart = Chart(
        [
            Curve("gaps", "orange", time_s, values),
            Curve("nothing", "cyan+", np.empty(0), np.empty(0)),
            Curve("unknown", "cyan+", time_s, np.full(200, np.nan)),
        ],
        16.0,
        1.0,
    )

    console = Console(width=60, height=12, force_terminal=True)
    with console.capture() as captured:
        console.print(chart, height=12)

    assert any("⠀" < character <= "⣿" for character in captured.get())
