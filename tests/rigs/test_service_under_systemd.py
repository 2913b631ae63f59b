"""The shipped units under a real systemd, on a machine as `make install` leaves it.

One container and one story for all tests (`trainer_on_a_simulated_bus.sh` sets it up,
`trainer_under_systemd.py` plays it step by step, `take_it_off.sh` ends it); each test looks at what
one step has seen. The bus is `gaitd sim --wall-clock`'s: SocketCAN is the matter of `rig_vcan`.
"""

import json
from pathlib import Path

import pytest
from whole_machine import whole_machine

HERE = Path(__file__).parent
PROJECT = HERE.parents[1]
PLAY = '/opt/gaitd/bin/python /opt/source/tests/rigs/trainer_under_systemd.py "$PWD/seen.json"'
TIMEOUT_S = 2400
"""For a machine on which much else runs; three minutes on one that is free."""
NOT_FOR_YOU = {"Permission denied", "Read-only file system", "Operation not permitted"}
NO_SUCH_FAMILY = "Address family not supported by protocol"
NO_POWER = {"OFF", "BRINGING_UP", "READY", "FAULT"}
QUICK_STOP_ACTIVE = 6
pytestmark = [pytest.mark.rig_systemd, pytest.mark.timeout(TIMEOUT_S + 100)]


@pytest.fixture(scope="module")
def played(systemd_rig, tmp_path_factory):
    """The story, once for all tests: how it ended, and the folder with all that was seen."""
    folder = tmp_path_factory.mktemp("trainer")
    setup, end = (
        (HERE / name).read_text() for name in ("trainer_on_a_simulated_bus.sh", "take_it_off.sh")
    )
    rig = whole_machine(type(systemd_rig))
    return rig.run("\n".join((setup, PLAY, end)), folder, TIMEOUT_S), folder


@pytest.fixture
def story(played):
    """The folder, once the story came to its end."""
    finished, folder = played
    assert finished.exit_code == 0, finished.output[-4000:]
    return folder


def seen(story, step):
    """What a step has seen."""
    told = json.loads((story / "seen.json").read_text())[step]
    assert "failed" not in told, told["failed"]
    return told


def lines(story, name):
    return (story / name).read_text().splitlines()


# --- installed ----------------------------------------------------------------------------------


def test_an_installation_leaves_everything_stopped_and_disabled(story):
    assert lines(story, "after_install") == ["disabled"] * 3 + ["inactive"] * 3
    assert "not compiled yet" not in (story / "install").read_text()


def test_an_upgrade_keeps_the_configuration_and_lays_its_own_beside_it(story):
    assert lines(story, "upgrade")[-1] == "kept"


def test_nothing_is_installed_under_a_service_that_runs(story):
    assert "gaitd-core runs: `systemctl stop gaitd.target" in (story / "while_it_runs").read_text()
    assert "gaitd-therapist runs: `systemctl stop" in (story / "while_a_page_runs").read_text()


def test_an_uninstall_leaves_configuration_state_and_users_alone(story):
    assert len(lines(story, "kept")) == 3
    assert [line for line in lines(story, "loaded") if line] == ["not-found"] * 3
    left = [
        line for line in lines(story, "left_by_uninstall") if not line.startswith("/etc/systemd")
    ]
    assert left == ["/etc/gaitd", "/etc/gaitd-display", "/var/lib/gaitd", "/var/lib/gaitd-patient"]


def test_a_purge_leaves_nothing(story):
    assert lines(story, "left_by_purge") == []


# --- the pages ----------------------------------------------------------------------------------


def test_both_pages_answer_and_the_therapist_s_reads_the_history_of_the_patient_s(story):
    step = seen(story, "pages")
    assert step["alive"] == {"patient": "ok", "therapist": "ok"}
    assert step["users"] == {"patient": "gaitd-patient", "therapist": "gaitd-therapist"}
    assert step["progress"]["troubles"] == []
    assert step["progress"]["profile"]["id"] == "7f3k9m2q"
    assert step["results"] == {"patient": "success", "therapist": "success"}


# --- started ------------------------------------------------------------------------------------


def test_a_start_ends_when_both_halves_are_ready(story):
    step = seen(story, "start")
    assert step["at_once"] == "active"
    assert step["active"] == ["active"] * 3
    assert step["users"] == {"gaitd-core": "gaitd-core", "gaitd-gateway": "gaitd-gateway"}


def test_the_status_of_each_half_says_how_the_machine_is(story):
    step = seen(story, "start")
    assert step["core"].endswith("[ready]")
    assert step["gateway"].endswith("[ready]")


def test_a_typo_in_the_configuration_is_told_once_and_not_tried_again(story):
    step = seen(story, "a_typo")
    for half in ("gaitd-core", "gaitd-gateway"):
        assert step[half] == {"ExecMainStatus": "2", "NRestarts": "0", "ActiveState": "failed"}
    assert "trainer.toml: cycle.perod_ms = 10: unknown key" in step["said"]


def test_a_wrong_drive_is_told_once_and_not_tried_again(story):
    step = seen(story, "wrong_drive")
    ended = {key: step[key] for key in ("ExecMainStatus", "NRestarts", "ActiveState")}
    assert ended == {"ExecMainStatus": "3", "NRestarts": "0", "ActiveState": "failed"}
    assert "right/hip" in step["said"]


def test_the_shipped_core_refuses_a_simulated_bus_and_says_what_a_desk_needs(story):
    step = seen(story, "simulated_time")
    assert step["refused"] == {"ExecMainStatus": "2", "NRestarts": "0"}
    assert 'bus.interface = "simulated": a real bus: a watchdog goes by' in step["said"]
    assert "bus-simulated.conf" in step["said"]


def test_with_the_drop_in_of_a_desk_the_core_still_takes_no_simulated_time(story):
    step = seen(story, "simulated_time")
    assert "--wall-clock" in step["waits"]
    assert step["restarts"] == "0"


# --- hardened -----------------------------------------------------------------------------------


def test_the_core_that_runs_has_no_privileges_and_one_thread(story):
    step = seen(story, "start")
    process = step["process"]

    assert process["NoNewPrivs"] == "1"
    assert process["Seccomp"] == "2"
    assert {process[name].strip("0") for name in ("CapEff", "CapPrm", "CapBnd", "CapAmb")} == {""}
    assert "0" not in process["Uid"].split()
    assert process["Threads"] == "1"


def test_from_inside_the_core_there_is_no_network(story):
    step = seen(story, "probes")
    sockets = step["gaitd-core"]["sockets"]

    granted = {family for family, answer in sockets.items() if answer == "granted"}
    assert granted - {"AF_CAN"} == {"AF_UNIX"}  # a container has no AF_CAN to grant


def test_from_inside_the_gateway_there_is_no_can_bus(story):
    step = seen(story, "probes")
    sockets = step["gaitd-gateway"]["sockets"]

    granted = {family for family, answer in sockets.items() if answer == "granted"}
    assert granted == {"AF_UNIX", "AF_INET", "AF_INET6"}


def test_any_other_service_is_kept_off_the_can_bus(story):
    step = seen(story, "probes")
    assert step["any_unit"] == "~AF_CAN"
    assert step["other"]["sockets"]["AF_CAN"] == NO_SUCH_FAMILY
    assert step["other"]["sockets"]["AF_INET"] == "granted"


def test_neither_half_writes_what_is_not_its_own(story):
    step = seen(story, "probes")
    core, gateway = step["gaitd-core"]["files"], step["gaitd-gateway"]["files"]
    for name in ("/usr/probe", "/etc/gaitd/trainer.toml", "/run/user/probe"):
        assert core[name] in NOT_FOR_YOU
        assert gateway[name] in NOT_FOR_YOU
    assert {core["/var/lib/gaitd/axes.json"], core["/run/gaitd/records.ring"]} == {"granted"}
    assert gateway["/var/lib/gaitd/axes.json"] in NOT_FOR_YOU
    assert gateway["/run/gaitd/records.ring"] in NOT_FOR_YOU
    assert gateway["/var/cache/gaitd/probe"] in NOT_FOR_YOU
    assert gateway["/var/lib/gaitd/requests.jsonl"] == "granted"
    assert core["/var/lib/gaitd/requests.jsonl"] in NOT_FOR_YOU


def test_neither_half_puts_a_file_in_the_place_of_the_other_s(story):
    step = seen(story, "probes")
    assert step["gaitd-gateway"]["notes_replaced"] in NOT_FOR_YOU
    assert step["gaitd-core"]["log_replaced"] in NOT_FOR_YOU
    assert (
        step["gaitd-gateway"]["log_replaced"] == step["gaitd-core"]["notes_replaced"] == "granted"
    )


def test_both_halves_have_no_way_to_more_than_they_have(story):
    step = seen(story, "probes")
    for half in ("gaitd-core", "gaitd-gateway"):
        inside = step[half]
        assert (inside["no_new_privileges"], inside["capabilities"]) == ("1", "")
        assert inside["mount"] != "granted"
        assert inside["namespace"] != "granted"
        assert inside["temporary"] == []
        assert "mem" not in inside["devices"]
        assert inside["uid"] != 0
    # numba compiles in the core; nothing does in the gateway.
    assert step["gaitd-core"]["pages_to_run"] == "granted"
    assert step["gaitd-gateway"]["pages_to_run"] in NOT_FOR_YOU


# --- while it runs ------------------------------------------------------------------------------


def test_the_installed_service_walks(story):
    step = seen(story, "walk")
    assert step["walking_cycles"] > 0
    assert step["enabled"]
    assert step["status"].endswith("[gait]")


def test_a_reload_ends_neither_half_and_each_says_what_it_took(story):
    assert seen(story, "reload")["same_processes"]


def test_a_drive_silent_for_a_minute_leaves_the_same_process_and_holds_the_other_axis(story):
    step = seen(story, "silent_drive")
    assert step["answer"].startswith("ok")
    assert step["same_process"]
    assert step["cycles"] > 3000  # of 6000: whatever the machine left of its time
    assert not step["watchdog"]
    assert step["slide_state"] == QUICK_STOP_ACTIVE
    places_m = step["slide_places_m"]
    assert len(places_m) > 5  # of 60, where the machine left it time to hear that axis
    assert max(places_m) - min(places_m) < 0.005


def test_its_cause_is_published_and_stands_in_the_status(story):
    step = seen(story, "silent_drive")
    assert step["published"]["verdict"]["cause"] == "drive_silent"
    assert step["published"]["mode"] == "fault"
    assert step["status"].endswith("[fault drive_silent right/hip]")


def test_the_core_outlives_the_gateway_and_holds_until_a_request(story):
    step = seen(story, "gateway_killed")
    assert step["same_core"]
    assert step["mode"] in {"HOLD", "FAULT"}
    assert step["mode_after"] == step["mode"]


def test_a_core_that_hangs_is_ended_by_the_watchdog_and_comes_back_without_power(story):
    step = seen(story, "watchdog")
    assert "Watchdog timeout" in step["journal"]
    assert "status=6/ABRT" in step["journal"]
    assert step["restarts"] >= 1
    assert step["active"] == "active"
    assert step["modes"][0] in {"OFF", "BRINGING_UP"}
    assert set(step["modes"]) <= NO_POWER
    assert not step["enabled"]


def test_a_core_that_is_killed_comes_back_and_enables_nothing_by_itself(story):
    step = seen(story, "killed")
    assert step["restarts"] >= 1
    assert step["active"] == "active"
    assert step["modes"][0] in {"OFF", "BRINGING_UP"}
    assert set(step["modes"]) <= NO_POWER
    assert not step["enabled"]


# --- stopped ------------------------------------------------------------------------------------


def test_a_stop_brings_both_axes_to_rest_and_then_takes_their_power(story):
    step = seen(story, "stop")
    assert step["modes"][0] == "STOPPING"
    assert step["powered_while_moving"]
    assert step["at_rest"]
    assert not step["enabled"]
    assert step["result"] == ["success", "success"]
    assert step["status"] == ["0", "0"]


def test_a_stop_says_in_its_status_what_remains(story):
    step = seen(story, "stop")
    assert "all axes are at rest and without power" in step["said"][-1], step["said"]


def test_the_core_has_stopped_before_the_gateway_begins_to(story):
    step = seen(story, "stop")
    stamps = step["stamps"]

    assert stamps["gaitd-core InactiveEnter"] <= stamps["gaitd-gateway ActiveExit"]
