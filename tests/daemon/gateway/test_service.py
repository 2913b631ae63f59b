"""The gateway's turns, in simulated time on a real seam."""

import math
import os
from unittest import mock

import msgspec
import pytest
from gaitd_names import (
    Cause,
    CyclePart,
    EventCode,
    Mode,
    Outcome,
    RefusalCode,
    RequestKind,
    Stage,
    StopCategory,
)

from daemon.gateway.core_view import SILENCE_NS
from daemon.gateway.events import MARKS_MAX, MARKS_WINDOW_NS
from daemon.gateway.health import HealthWindow
from daemon.gateway.setpoints import NOTHING
from daemon.gateway.translate import Stamp
from daemon.ipc.cycle_timing import CycleTiming
from daemon.ipc.record import (
    AxisRecord,
    BusRecord,
    EmergencyRecord,
    LegRecord,
    RequestResult,
    Verdict,
)
from daemon.ipc.report import Event, Refusal

MS = 1_000_000
SILENT_MS = SILENCE_NS // MS + 1


def test_each_record_becomes_one_estimate_one_activity_and_one_friction(bench):
    for _ in range(5):
        bench.cycle()

    for name in ("estimate", "activity", "friction"):
        said = bench.outlet.on(f"right/{name}")
        assert [message.cycle for message in said] == [1, 2, 3, 4, 5]
        assert [message.seq for message in said] == [1, 2, 3, 4, 5]


def test_drives_are_said_ten_times_and_health_once_a_second(bench):
    for _ in range(200):
        bench.cycle()

    assert len(bench.outlet.on("drives/right/hip")) == 20
    assert len(bench.outlet.on("drives/right/slide")) == 20
    assert len(bench.outlet.on("health")) == 2


def test_health_says_which_part_of_the_cycle_cost_the_missed_grid_points(bench):
    by_part = {CyclePart.WAKE_UP: 3, CyclePart.WORK: 2}
    timing = CycleTiming(0, 0, 0, 5, publish_ns=30_000, overrun_by_part=by_part)

    for _ in range(100):
        bench.cycle(timing=timing)

    said = bench.outlet.on("health")[-1]
    assert said.overrun_by_part == {"wake_up": 3, "window": 0, "work": 2, "publish": 0}
    assert said.publish_max_us == 30


def test_estimates_leave_first_and_the_rest_of_their_records_with_the_turn(bench):
    bench.cycle()
    bench.outlet.said.clear()
    bench.write()
    bench.write()

    assert bench.gateway.publish_estimates(bench.clock.ns)
    first = list(bench.outlet.said)
    assert not bench.gateway.publish_estimates(bench.clock.ns)
    bench.turn()

    assert [(key, message.cycle) for key, message in first] == [
        ("right/estimate", 2),
        ("right/estimate", 3),
    ]
    assert len(bench.outlet.on("right/estimate")) == 2
    assert [said.cycle for said in bench.outlet.on("right/activity")] == [2, 3]
    assert [said.cycle for said in bench.outlet.on("right/friction")] == [2, 3]


def test_health_says_how_long_the_gateway_makes_an_estimate_and_none_where_it_made_none():
    window = HealthWindow()
    for work_ns in (900_000, 100_000, 300_000):
        window.add_estimate(work_ns)

    assert window.close(Stamp(), 1).gateway_estimate_p50_us == 300
    assert window.close(Stamp(), 2).gateway_estimate_p50_us is None


def test_the_time_of_an_estimate_is_that_from_the_wake_on(bench):
    woken_ns = bench.clock.ns
    for _ in range(150):
        bench.write()
        bench.clock.ns += 10 * MS
        bench.gateway.publish_estimates(bench.clock.ns - 2 * MS)  # woken 2 ms ago
        bench.gateway.turn(bench.clock.ns, ())

    assert bench.clock.ns > woken_ns + 1000 * MS
    assert bench.outlet.on("health")[-1].gateway_estimate_p50_us == 2000


def test_safety_is_said_at_once_when_it_changes_and_once_a_second(bench):
    for _ in range(50):
        bench.cycle()
    count = len(bench.outlet.on("safety"))

    bench.cycle(verdict=Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN), mode=Mode.STOPPING)

    said = bench.outlet.on("safety")[-1]
    assert (said.mode, said.verdict.cause, said.valid) == ("stopping", "hand_switch_open", True)
    assert count == 1
    for _ in range(100):
        bench.cycle(verdict=Verdict(StopCategory.S1, Cause.HAND_SWITCH_OPEN), mode=Mode.STOPPING)
    assert len(bench.outlet.on("safety")) == 3


def test_a_new_stage_of_an_exercise_is_said_at_once_and_by_its_name(bench):
    bench.cycle(mode=Mode.GAIT, stage=Stage.ANNOUNCING)
    bench.cycle(mode=Mode.GAIT, stage=Stage.APPROACHING)
    bench.cycle(mode=Mode.HOLD)

    assert [said.stage for said in bench.outlet.on("safety")] == ["announcing", "approaching", None]


def test_a_silent_core_is_alive_no_more_and_safety_says_not_valid(bench):
    bench.cycle()
    assert bench.outlet.alive

    bench.turn(after_ms=SILENT_MS - 1)
    assert bench.outlet.alive
    bench.turn(after_ms=1)

    assert not bench.outlet.alive
    assert bench.outlet.on("safety")[-1].valid is False
    assert bench.outlet.on("safety")[-1].mode is None
    lost = bench.outlet.events[-1]
    assert (lost.kind, lost.priority) == ("core", "high")


def test_the_same_core_that_comes_back_is_alive_and_valid_again(bench):
    bench.cycle()
    bench.turn(after_ms=SILENT_MS)

    bench.cycle()

    assert bench.outlet.alive
    assert bench.outlet.on("safety")[-1].valid
    assert bench.outlet.events[-1].code == "core_back"


def test_a_level_goes_out_with_each_record_and_every_20_ms_without(bench):
    bench.cycle()
    bench.cycle()
    assert [level.for_cycle for level in bench.levels] == [1, 2]

    for _ in range(10):
        bench.turn(after_ms=5)

    assert [level.for_cycle for level in bench.levels[2:]] == [2, 2]
    assert bench.levels[-1].core_boot_id == "boot-a"
    seqs = [level.seq for level in bench.levels]
    assert seqs == sorted(set(seqs))


def test_the_levels_of_a_new_gateway_count_on_from_those_of_the_one_before(bench):
    bench.cycle()
    bench.replace_gateway()
    bench.cycle()

    assert bench.levels[-1].seq > bench.levels[0].seq


def test_a_new_gateway_tells_the_stop_that_was_made_while_there_was_none(bench):
    bench.cycle()
    bench.write(verdict=Verdict(StopCategory.S1, Cause.GATEWAY_SILENT))

    bench.replace_gateway()
    bench.cycle(verdict=Verdict(StopCategory.S1, Cause.GATEWAY_SILENT))

    assert [event.cause for event in bench.outlet.events] == [None, "gateway_silent"]


def test_after_a_stall_only_young_records_are_published_and_every_event_is(bench):
    bench.cycle()
    for _ in range(60):
        bench.write(events=(Event(EventCode.DRIVES_UP),))
    bench.turn(after_ms=600)

    assert len(bench.outlet.on("right/activity")) == 1 + 20
    assert len(bench.outlet.events) == 1 + 60
    for _ in range(100):
        bench.cycle()
    health = bench.outlet.on("health")[-1]
    assert (health.record_skipped_count, health.record_missed_count) == (40, 0)


def test_records_that_were_overwritten_before_they_were_read_are_counted(bench):
    bench.cycle()
    for _ in range(3500):
        bench.write()
    bench.turn(after_ms=35_000)
    bench.turn(after_ms=1000)

    assert bench.outlet.on("right/activity")[-1].cycle == 3501
    assert bench.outlet.on("health")[-1].record_missed_count > 500


def test_wakes_of_the_core_before_do_not_hide_the_records_of_the_new_one(bench):
    for _ in range(40):
        bench.cycle()
    for _ in range(8):
        bench.write()
    bench.replace_core("boot-b")
    bench.cycle()

    said = bench.outlet.on("right/activity")[-1]
    assert (said.core_boot_id, said.cycle) == ("boot-b", 1)
    bench.cycle()
    assert bench.outlet.on("right/activity")[-1].cycle == 2


def test_a_request_of_the_core_before_never_reaches_the_new_one(bench, ask):
    enable = ask("enable")
    bench.cycle()
    bench.cycle(enable)
    assert bench.levels[-1].request.kind is RequestKind.ENABLE

    bench.replace_core("boot-b")
    bench.cycle()

    assert bench.levels[-1].core_boot_id == "boot-b"
    assert bench.levels[-1].request.kind is RequestKind.NONE
    assert [reply.outcome for reply in enable.replies] == ["refused"]


def test_a_stop_is_in_the_level_of_the_same_turn_and_stands_in_the_events(bench, ask):
    stop = ask("stop", b'{"client": "display"}')
    bench.cycle()

    bench.turn(stop, after_ms=1)

    assert bench.levels[-1].stop_count == 1
    assert not stop.replies
    bench.cycle(stop_count=1)
    assert [reply.outcome for reply in stop.replies] == ["done"]
    assert bench.outlet.events[-1].values == {
        "request": "stop",
        "client": "display",
        "outcome": "done",
    }


def test_in_the_last_turn_a_stop_counts_and_nothing_else_reaches_the_core(bench, ask):
    enable, stop = ask("enable"), ask("stop")
    bench.cycle()

    bench.gateway.last_turn(bench.clock.now_ns(), [enable, stop], NOTHING)

    bench.levels += bench.core.receive()
    assert bench.levels[-1].stop_count == 1
    assert bench.levels[-1].request.kind is RequestKind.NONE
    assert [reply.refusal.code for reply in enable.replies] == ["gateway_ends"]


def test_a_stop_is_a_stop_whatever_is_sent_along_with_it(bench, ask):
    stop = ask("stop", b"{garbage")
    bench.cycle()

    bench.turn(stop, after_ms=1)

    assert bench.levels[-1].stop_count == 1


def test_a_plan_that_the_disk_does_not_take_is_done_with_that_reason(bench, ask, monkeypatch):
    full = mock.Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr(os, "fsync", full)
    limits = b'{"cadence_max_hz": 0.5, "amplitude_max_ratio": 0.8, "duration_max_s": 600}'
    released, status = ask("plan", b'{"client": "me", "plan": ' + limits + b"}"), ask("status")
    bench.disk_is_slow = True
    bench.cycle(released, status)

    (reply,), (now,) = released.replies, status.replies
    assert reply.outcome == "done"
    why = reply.refusal
    assert (why.code, why.said) == ("plan_may_return", "No space left on device")
    assert now.plan.cadence_max_hz == 0.5
    note, outcome = bench.outlet.events[-2:]
    assert note.code == "plan_released"
    assert note.values == {
        "client": "me",
        "cadence_max_hz": 0.5,
        "amplitude_max_ratio": 0.8,
        "duration_max_s": 600.0,
        "hip_assist_max": None,
        "slide_assist_max": None,
    }
    assert (outcome.code, outcome.said) == ("request_answered", why.said)
    assert outcome.values["refusal"] == why.code


def test_a_mark_is_one_event_with_who_and_what_and_too_many_are_refused(bench, ask):
    asks = [ask("mark", b'{"client": "me", "text": "remark %d"}' % n) for n in range(MARKS_MAX + 1)]
    bench.cycle(*asks)

    marks = [one for one in bench.outlet.events if one.code == "mark"]
    assert [one.said for one in marks] == [f"remark {n}" for n in range(MARKS_MAX)]
    assert {(one.kind, one.priority, one.values["client"]) for one in marks} == {
        ("note", "info", "me")
    }
    assert [one.replies[0].outcome for one in asks] == ["done"] * MARKS_MAX + ["refused"]
    refusal = asks[-1].replies[0].refusal
    assert (refusal.code, refusal.values) == ("too_many_marks", {"highest": 10, "window_s": 10})
    later = ask("mark", b'{"text": "%s"}' % ("ü" * 80).encode())
    bench.turn(later, after_ms=MARKS_WINDOW_NS // MS)
    assert later.replies[0].outcome == "done"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "Expected `str` of length >= 1"),
        ("x" * 81, "Expected `str` of length <= 80"),
        ("a\\nb", "without control characters"),
        ("a\\u202eb", "without control characters"),
    ],
)
def test_a_mark_that_is_no_line_is_refused_with_what_is_allowed(bench, ask, text, why):
    mark = ask("mark", f'{{"text": "{text}"}}'.encode())
    bench.cycle(mark)

    refusal = mark.replies[0].refusal
    assert refusal.code == "bad_payload"
    assert why in refusal.said
    assert "$.text" in refusal.said
    assert [one for one in bench.outlet.events if one.code == "mark"] == []


def test_an_event_of_a_refused_acquire_names_who_has_asked_and_who_holds_the_lease(bench, ask):
    bench.cycle()
    bench.cycle(ask("acquire", b'{"client": "law"}'))
    bench.cycle(ask("acquire", b'{"client": "other"}'))

    refused = bench.outlet.events[-1]
    assert refused.values == {
        **{"request": "acquire", "client": "other", "outcome": "refused"},
        **{"refusal": "lease_taken", "holder": "law"},
    }


def test_an_enable_that_the_core_refuses_gets_its_reason(bench, ask):
    enable = ask("enable")
    bench.cycle()
    bench.cycle(enable)
    request = bench.levels[-1].request

    why = Refusal(RefusalCode.STO_ACTIVE)
    told = Event(EventCode.REQUEST_REFUSED, "", (RequestKind.ENABLE, Mode.HOLD, why.code))
    bench.cycle(request=RequestResult(request.id, Outcome.REFUSED, why), events=(told,))

    (reply,) = enable.replies
    assert (reply.outcome, reply.refusal.code) == ("refused", "sto_active")
    asked, refused = bench.outlet.events[-2:]
    assert (asked.code, asked.values["client"]) == ("request_sent", "unnamed")
    assert (refused.code, refused.values["refusal"]) == ("request_refused", "sto_active")


def test_the_gateways_end_answers_who_still_waits(bench, ask):
    enable = ask("enable")
    bench.cycle()
    bench.cycle(enable)

    bench.gateway.close()

    assert [reply.outcome for reply in enable.replies] == ["pending"]


def test_a_status_says_safety_drives_legs_and_the_newest_events(bench, ask):
    status = ask("status")
    bench.cycle()

    bench.turn(status, after_ms=1)

    (said,) = status.replies
    assert said.safety.mode == "hold"
    assert [drive.name for drive in said.drives] == ["right/hip", "right/slide"]
    assert [leg.leg for leg in said.legs] == ["right"]
    assert said.events[-1].code == "core_running"
    assert said.version == "0.1.0"
    assert [message.seq for message in bench.outlet.on("safety")] == [1]


def test_a_ring_that_is_none_is_told_once_and_is_no_core(bench, caplog):
    bench.cycle()
    ring = bench.runtime / "records.ring"
    ring.unlink()
    ring.write_bytes(b"no ring at all")
    bench.replace_gateway()

    for _ in range(30):
        bench.turn()
    bench.replace_core("boot-b")
    bench.cycle()

    assert len([line for line in caplog.messages if "records.ring" in line]) == 1
    assert bench.outlet.on("right/activity")[-1].core_boot_id == "boot-b"


def test_lateness_is_counted_in_classes_since_the_start_of_the_core(bench, make_record):
    timing = make_record().timing
    for lateness_us in (10, 50, 51, 700, 20_000):
        late = type(timing)(lateness_us * 1000, 900_000, 250_000, 0)
        bench.cycle(timing=late)
    bench.turn(after_ms=1000)

    health = bench.outlet.on("health")[-1]
    assert health.lateness_count == (2, 1, 0, 0, 1, 0, 0, 0, 1)
    assert health.lateness_max_us == 20_000
    assert health.record_count == 5


def test_a_late_sample_is_late_and_one_that_never_came_is_lost(bench, make_drive):
    good = make_drive()
    missed = make_drive(fresh=False, sample_age_cycles=1)
    late = make_drive(late_count=1)
    for drive in (good, missed, late, make_drive(fresh=False, late_count=1), late):
        bench.cycle(drives=(drive,))
    bench.turn(after_ms=1000)

    (health,) = bench.outlet.on("health")[-1].drives
    assert (health.missed_count, health.late_count, health.lost_count) == (2, 1, 1)


def test_what_the_core_does_not_know_is_null_in_every_message(bench, make_drive):
    unknown = AxisRecord(measured_position=math.nan, effort=0.0, reference_position=math.nan)
    leg = LegRecord("right", unknown, unknown, status=2)
    bench.cycle(legs=(leg,), drives=(make_drive(position=None, heartbeat_age_ms=math.inf),))

    activity = bench.outlet.on("right/activity")[0]
    assert activity.hip.patient is activity.slide.net is None
    assert activity.status == ("warm_up",)
    assert bench.outlet.on("drives/right/hip")[0].heartbeat_age_ms is None


def test_health_tells_what_the_can_controller_counted(bench):
    bus = BusRecord("error passive", 1, 2, 3, 4, 5, 6, 7, 8, 0.25)
    bench.cycle(bus=bus)
    bench.turn(after_ms=1000)

    told = bench.outlet.on("health")[-1].bus
    assert msgspec.structs.astuple(told) == msgspec.structs.astuple(bus)


def test_the_newest_emergencies_of_a_drive_are_kept_for_whoever_comes_late(bench, make_drive):
    for code in range(1, 101):
        came = EmergencyRecord(code, 0x01, "00" * 5, "text", "reaction", True, False, False)
        bench.cycle(drives=(make_drive(emergencies=(came,)), make_drive(name="right/slide")))
    for _ in range(20):
        bench.cycle()

    told = bench.outlet.on("drives/right/hip")[-1].emergencies
    assert [entry.code for entry in told] == [f"0x{code:04X}" for code in range(69, 101)]
    assert bench.outlet.on("drives/right/slide")[-1].emergencies == ()
    bench.replace_core("boot-b")
    for _ in range(20):
        bench.cycle()
    assert bench.outlet.on("drives/right/hip")[-1].emergencies == ()


def test_the_state_of_the_holder_of_the_lease_is_published_and_of_no_other(bench, ask):
    bench.cycle()
    acquired = ask("acquire", b'{"client": "law"}')
    bench.cycle(acquired)
    lease = acquired.replies[0].lease

    def report(**changes):
        values = {"stiffness_ratio": 0.4}
        payload = {"client": "law", "lease": lease, "leg": "right", "for_cycle": 7}
        payload |= {"hip": {"assist": [1.0, None]}}
        asked = ask("report", msgspec.json.encode(payload | {"values": values} | changes))
        bench.cycle(asked)
        reply = asked.replies[0]
        return reply.outcome, reply.refusal and reply.refusal.code

    assert report() == ("done", None)
    assert report(client="other") == ("refused", "lease_taken")
    assert report(lease=lease % 2**52 + 1)[0] == "refused"
    assert report(leg="left") == ("refused", "unknown_leg")
    for values in ({"no unit": 1.0}, {"a_nm": [0.0] * 65}, {f"a{i}_nm": 0.0 for i in range(33)}):
        assert report(values=values)[0] == "refused"
    bench.cycle(ask("stop"))
    assert report() == ("refused", "lease_not_held")

    (published,) = bench.outlet.on("right/controller")
    assert (published.client, published.for_cycle, published.cycle) == ("law", 7, 3)
    assert published.values == {"stiffness_ratio": 0.4}
    assert (published.hip, published.slide) == ({"assist": (1.0, None)}, {})
