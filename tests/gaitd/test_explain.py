"""`gaitd explain`: every name has its sentence, and every cause the limits that decide it."""

import json

import pytest
from command_line import gaitd
from config_files import CONFIGS
from gaitd_names import Cause, RefusalCode, SetpointRefusal

from daemon.wire.causes import CHOSEN_CATEGORY, FIXED_CATEGORY

WITHOUT_A_LIMIT = {
    *("stop_requested", "shutdown", "command_not_finite", "last_end_unknown", "bus_down"),
    *("hand_switch_open", "sto_active", "inputs_impossible", "drive_rebooted", "drive_fault"),
    *("drive_not_operational", "emergency", "drive_left_enabled", "bring_up_failed", "bus_off"),
    *("transmit_queue_full", "drive_powered", "unexpected_enable", "unreferenced"),
    *("observer_invalid", "self_test_failed"),
}
"""Causes that are found by a message, a switch, or a number of the program."""


@pytest.fixture(scope="module")
def answers():
    ended = gaitd("explain", "--json", "--config", CONFIGS / "trainer.toml")
    assert (ended.code, ended.err) == (0, "")
    return json.loads(ended.out)


def test_every_cause_and_refusal_is_explained(answers):
    names = {(one["kind"], one["name"]) for one in answers if one["kind"] != "event"}

    assert names == {
        *(("cause", cause) for cause in Cause if cause is not Cause.NONE),
        *(("refusal", code) for code in RefusalCode),
        *(("setpoint_refusal", code) for code in SetpointRefusal),
    }
    assert all(one["text"] for one in answers)
    assert all(one["remedy"] for one in answers if one["kind"] != "refusal")


def test_a_cause_has_its_category_and_the_values_of_its_limits(answers):
    causes = {one["name"]: one for one in answers if one["kind"] == "cause"}

    limited = {
        name
        for name, one in causes.items()
        if any(not key.startswith("stop_category.") for key in one["limits"])
    }
    assert causes.keys() - limited == WITHOUT_A_LIMIT
    assert all(None not in one["limits"].values() for one in causes.values())
    for name, one in causes.items():
        assert bool(one["category"]) == (name in {*FIXED_CATEGORY, *CHOSEN_CATEGORY})
    assert causes["velocity_limit"]["limits"]["hip.velocity_max_rad_per_s"] == 4.0


def test_without_a_file_the_keys_are_named_and_each_kind_of_a_name_is_told(monkeypatch):
    monkeypatch.delenv("GAITD_CONFIG", raising=False)

    lines = gaitd("explain", "GATEWAY_SILENT").out.splitlines()

    assert lines[0] == "stop               A part of the control program has fallen silent"
    assert lines[2] == "decided by         limits.toml: communication.gateway_silence_ms"
    assert lines[-1] == "refused request    the gateway is not alive"
    assert "`gaitd reference AXIS`" in gaitd("explain", "not_referenced").out


def test_an_unknown_name_names_the_nearest():
    ended = gaitd("explain", "velocity_limits")

    assert (ended.code, "one of velocity_limit, " in ended.err) == (2, True)
