"""Setpoints on their way in: kept few, read strictly, refused by reason, and told sparingly."""

import itertools
import json
import os
import select
import threading

import msgspec
import pytest
from gaitd_client import wire
from gaitd_names import Lapse, Mode, Outcome, SetpointRefusal

from daemon.config.settings import Lease
from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.lease import LeaseManager
from daemon.gateway.lease_control import REPORTED_MAX, LeaseControl
from daemon.gateway.setpoints import (
    Arrival,
    Batch,
    SetpointBox,
    SetpointStore,
)
from daemon.ipc.record import AssistRecord

LEGS = ("right", "left")
LEASE = 123_456_789
MS = 1_000_000


def payload(**changes):
    fields = {"lease": LEASE, "seq": 5, "for_cycle": 40}
    fields |= {"hip": {"assist": 3.5}, "slide": {"assist": -20.0}}
    return json.dumps({**fields, **changes}).encode()


def arrival(leg="right", **changes):
    return Arrival(leg, payload(**changes))


# --- the desk ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        (payload(), None),
        (payload().ljust(1024), None),
        (payload().ljust(1025), SetpointRefusal.TOO_LARGE),
        (b"", SetpointRefusal.MALFORMED),
        (b"{", SetpointRefusal.MALFORMED),
        (b"\xff\xfe", SetpointRefusal.MALFORMED),
        (b"[" * 1000, SetpointRefusal.MALFORMED),
        (b"null", SetpointRefusal.MALFORMED),
        (payload(torque=1), SetpointRefusal.MALFORMED),
        (payload(hip_assist_nm=3.5), SetpointRefusal.MALFORMED),
        (payload(hip={"assist": "3"}), SetpointRefusal.MALFORMED),
        (payload(hip={"assist": None}), SetpointRefusal.MALFORMED),
        (payload(seq=1.5), SetpointRefusal.MALFORMED),
        (payload(hip={"assist": float("nan")}), SetpointRefusal.NON_FINITE),
        (payload(slide={"assist": float("-inf")}), SetpointRefusal.NON_FINITE),
        (payload(hip={"assist": 1500.1}), SetpointRefusal.OUT_OF_RANGE),
        (payload(slide={"assist": -1500.1}), SetpointRefusal.OUT_OF_RANGE),
        (payload(stiffness_ratio=1.01), SetpointRefusal.OUT_OF_RANGE),
        (payload(seq=2**53), SetpointRefusal.OUT_OF_RANGE),
        (payload(seq=-1), SetpointRefusal.OUT_OF_RANGE),
        (payload(seq=10**40), SetpointRefusal.OUT_OF_RANGE),
        (payload().replace(b"3.5", b"1e999"), SetpointRefusal.OUT_OF_RANGE),
        (payload(lease=LEASE + 1), SetpointRefusal.WRONG_LEASE),
        (payload(lease=LEASE - 1), SetpointRefusal.WRONG_LEASE),
    ],
)
def test_a_payload_is_read_strictly_and_what_is_wrong_is_named(data, refusal):
    desk = SetpointStore()

    assert desk.receive(Arrival("right", data), LEGS, LEASE) is refusal
    assert bool(desk.newest) == (refusal is None)


def test_what_is_refused_leaves_the_one_before_in_place():
    desk = SetpointStore()
    desk.receive(arrival(), LEGS, LEASE)

    assert desk.receive(arrival(), LEGS, LEASE) is SetpointRefusal.REPEATED
    assert desk.receive(arrival(seq=4), LEGS, LEASE) is SetpointRefusal.REORDERED
    assert desk.receive(arrival("middle", seq=6), LEGS, LEASE) is SetpointRefusal.UNKNOWN_LEG
    assert [one.seq for one in desk.newest] == [5]


def test_each_leg_counts_by_itself_and_the_newest_of_each_is_forwarded():
    desk = SetpointStore()
    for seq, leg in ((5, "right"), (1, "left"), (6, "right")):
        assert desk.receive(arrival(leg, seq=seq), LEGS, LEASE) is None

    assert {(one.leg, one.seq) for one in desk.newest} == {("right", 6), ("left", 1)}


def test_without_a_lease_nothing_is_forwarded():
    desk = SetpointStore()

    assert desk.receive(arrival(), LEGS, 0) is SetpointRefusal.UNLEASED
    assert not desk.newest


# --- the box ----------------------------------------------------------------------------------


@pytest.fixture
def box():
    made = SetpointBox()
    yield made
    made.close()


def is_readable(box):
    poller = select.poll()
    poller.register(box.fileno(), select.POLLIN)
    return bool(poller.poll(0))


def test_the_box_keeps_the_newest_few_and_counts_the_rest(box):
    box.expect(LEASE)
    for seq in range(1000):
        box.put("right", payload(seq=seq))

    batch = box.drain(0)

    assert len(batch.arrivals) == 8
    assert json.loads(batch.arrivals[-1].payload)["seq"] == 999
    assert batch.dropped_count == 992
    assert box.drain(0) == Batch()


def test_strangers_cannot_crowd_out_the_holder_and_do_not_wake_the_loop(box):
    box.expect(LEASE)
    for seq in range(10_000):
        box.put("right", payload(lease=4711, seq=seq))
    assert not is_readable(box)
    box.put("right", payload(seq=7))
    assert is_readable(box)
    for _ in range(10_000):
        box.put("right", b"x" * 100)

    batch = box.drain(0)

    assert json.loads(batch.arrivals[0].payload)["seq"] == 7
    assert len(batch.arrivals) == 1 + 4
    assert not is_readable(box)


def test_the_descriptor_never_blocks_the_loop_and_stays_in_its_process(box):
    assert not os.get_blocking(box.fileno())
    assert not os.get_inheritable(box.fileno())


def woken(box, now_ns):
    """How often ten messages of the holder wake the loop, which drains the box after each."""
    count = 0
    for _ in range(10):
        box.put("right", payload())
        count += is_readable(box)
        box.drain(now_ns)
    return count


def test_even_the_holder_wakes_the_loop_four_times_only_in_ten_milliseconds(box):
    box.expect(LEASE)

    assert woken(box, 10 * MS - 1) == 4
    assert woken(box, 10 * MS - 1) == 0
    for now_ns in (10 * MS, 35 * MS):
        box.drain(now_ns)
        assert woken(box, now_ns) == 4
        assert woken(box, now_ns + 10 * MS - 1) == 0


def test_after_a_lease_its_number_is_like_any_other(box):
    box.expect(LEASE)
    box.expect(0)
    for seq in range(9):
        box.put("right", payload(seq=seq))

    assert not is_readable(box)
    assert len(box.drain(0).arrivals) == 4
    assert box.drain(0) == Batch()


def test_many_threads_lose_no_count(box):
    def put():
        for _ in range(2000):
            box.put("right", b"no setpoint")

    threads = [threading.Thread(target=put) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    batch = box.drain(0)

    assert len(batch.arrivals) + batch.dropped_count == 8000


# --- what is said of it -----------------------------------------------------------------------


@pytest.fixture
def steering(make_record):
    numbers = itertools.count(1001)
    made = LeaseControl(
        LeaseManager(Lease(duration_ms=500, duration_max_ms=500), lambda: next(numbers))
    )
    made.begin_core(LEGS)
    made.receive_record(make_record(1), 0)
    return made


def record_with(make_record, seq, mode=Mode.TORQUE, **assist):
    return msgspec.structs.replace(make_record(seq), mode=mode, assist=AssistRecord(**assist))


def test_the_first_refusal_of_each_reason_is_an_event_and_all_are_counted(steering):
    batch = Batch((arrival(), arrival(), Arrival("right", b"{")), dropped_count=50)

    said = steering.receive_setpoints(batch, 0) + steering.receive_setpoints(batch, 1)

    assert [happening.priority for happening in said] == [Priority.LOW] * 3
    assert len({happening.values["setpoint_refusal"] for happening in said}) == 3
    assert steering.refused_count == {
        SetpointRefusal.FLOOD: 100,
        SetpointRefusal.UNLEASED: 4,
        SetpointRefusal.MALFORMED: 2,
    }


def test_leases_that_come_and_go_do_not_make_a_flood_of_events(steering):
    said = []
    for turn in range(200):
        granted = steering.leases.acquire("pusher", None, None, turn)
        said += steering.receive_setpoints(Batch((arrival(),)), turn)
        assert granted.number == steering.lease
        steering.stop()

    refusals = [one for one in said if one.values.get("setpoint_refusal") == "wrong_lease"]
    assert len(refusals) == REPORTED_MAX


def test_what_the_core_refuses_is_told_too(steering, make_record):
    steering.receive_record(record_with(make_record, 2), 0)
    counts = {SetpointRefusal.STALE: 1}

    said = steering.receive_record(record_with(make_record, 3, refused_count=counts), 0)

    assert [one.values["setpoint_refusal"] for one in said] == ["stale"]


def test_the_lease_lives_on_what_the_core_accepts_and_on_nothing_else(steering, make_record):
    number = steering.leases.acquire("pusher", None, None, 0).number
    for k in range(1, 10):
        steering.receive_setpoints(Batch((arrival(lease=number, seq=k),)), k * 100 * MS)
        steering.receive_record(record_with(make_record, k + 1, accepted_count=k), k * 100 * MS)
        assert not steering.tick(k * 100 * MS)
    assert [one.seq for one in steering.setpoints] == [9]

    for k in range(10, 14):
        steering.receive_setpoints(Batch((arrival(lease=number, seq=k),)), k * 100 * MS)
        steering.receive_record(record_with(make_record, k + 1, accepted_count=9), k * 100 * MS)
    (said,) = steering.tick(1400 * MS)

    assert said.values == {"client": "pusher", "lease_end": "expired"}
    assert (steering.lease, steering.setpoints) == (0, ())


def test_a_lapse_is_of_medium_priority_and_names_the_holder(steering, make_record):
    steering.leases.acquire("pusher", None, None, 0)
    steering.receive_record(record_with(make_record, 2, accepted_count=1), 0)
    lapsed = record_with(
        make_record, 3, Mode.HOLD, accepted_count=1, lapse_count=1, lapse_reason=Lapse.STALE
    )

    (said,) = steering.receive_record(lapsed, 0)

    assert (said.priority, said.kind) == (Priority.MEDIUM, Kind.MODE)
    assert (said.code, said.values) == (
        "assist_lapsed",
        {"client": "pusher", "lapse": "stale"},
    )


@pytest.mark.parametrize("mode", [Mode.STOPPING, Mode.FAULT])
def test_a_machine_that_was_stopped_has_no_holder(steering, make_record, mode):
    steering.leases.acquire("pusher", None, None, 0)

    (said,) = steering.receive_record(record_with(make_record, 2, mode), 0)

    assert said.values["lease_end"] == "machine_stopped"
    assert steering.lease == 0


def test_a_stop_and_another_core_end_the_lease(steering):
    for end in (steering.stop, lambda: steering.begin_core(LEGS)):
        steering.leases.acquire("pusher", None, None, 0)
        (said,) = end()
        assert (said.code, said.values["client"]) == ("lease_ended", "pusher")
        assert steering.lease == 0
        assert end() == []


def test_each_end_of_a_lease_is_one_event_with_its_reason(steering, make_record):
    stopped = record_with(make_record, 2, Mode.FAULT)
    for end, why in (
        (steering.stop, "stop_requested"),
        (lambda: steering.begin_core(LEGS), "core_restarted"),
        (lambda: steering.receive_record(stopped, 0), "machine_stopped"),
    ):
        steering.leases.acquire("pusher", None, None, 0)
        values = {"client": "pusher", "lease_end": why}

        assert end() == [EventDraft(Priority.INFO, Kind.REQUEST, "lease_ended", values)]


@pytest.mark.parametrize(("holder", "refusal"), [(None, "unleased"), ("pusher", "wrong_lease")])
def test_a_refusal_says_what_it_is_and_who_holds_the_lease(steering, holder, refusal):
    if holder is not None:
        steering.leases.acquire(holder, None, None, 0)
    values = {"holder": holder, "setpoint_refusal": refusal}

    assert steering.receive_setpoints(Batch((arrival(),)), 0) == [
        EventDraft(Priority.LOW, Kind.REQUEST, "setpoint_refused", values)
    ]


def test_ten_refusals_in_ten_seconds_are_events(steering):
    def events(now_ns):
        steering.leases.acquire("pusher", None, None, now_ns)
        said = steering.receive_setpoints(Batch((arrival(),)), now_ns)
        steering.stop()
        return len(said)

    assert [events(now_ns) for now_ns in range(12)] == [1] * 10 + [0] * 2
    window_ns = 10_000_000_000
    later = [events(window_ns + ns) for ns in (-1, 0, 0, 1, 9, 10)]
    assert later == [0, 1, 0, 1, 1, 1]


def test_only_counts_that_rise_from_one_record_to_the_next_of_a_core_are_news(
    steering, make_record
):
    def counted(seq, stale, lapses):
        counts = {SetpointRefusal.STALE: stale}
        told = {
            "lapse_count": lapses,
            "lapse_reason": Lapse.STALE,
            "accepted_count": lapses,
        }
        record = record_with(make_record, seq, refused_count=counts, **told)
        return [one.code for one in steering.receive_record(record, 0)]

    assert counted(2, 0, 0) == []
    assert counted(3, 1, 1) == ["assist_lapsed", "setpoint_refused"]
    for seq, stale, lapses in ((4, 1, 1), (5, 0, 0)):
        steering.leases.acquire("pusher", None, None, 0)
        steering.stop()  # what was told is forgotten
        assert counted(seq, stale, lapses) == []
    steering.begin_core(LEGS)
    assert counted(6, 9, 9) == []


def test_a_new_control_has_refused_and_forwards_nothing():
    control = LeaseControl(LeaseManager(Lease(duration_ms=500, duration_max_ms=500), int))

    assert (control.lease, control.setpoints, control.refused_count) == (0, (), {})
    batch = Batch((arrival(),))
    (said,) = control.receive_setpoints(batch, 0)
    assert said.values["setpoint_refusal"] == "unknown_leg"


# --- queries for the lease ------------------------------------------------------------------------


def acquire(client="pusher", **more):
    return wire.AcquireAsk(client=client, **more)


def test_a_lease_is_granted_renewed_and_released_by_queries(steering):
    granted = steering.decide(acquire(), Mode.HOLD, 0)
    assert (granted.outcome, granted.number) == (Outcome.DONE, 1001)
    assert (granted.duration_ms, granted.renewed) == (500, False)

    again = steering.decide(acquire(lease=1001, duration_ms=200), Mode.HOLD, 400 * MS)
    assert (again.number, again.duration_ms, again.renewed) == (1001, 200, True)
    assert steering.tick(600 * MS - 1) == []

    released = steering.decide(wire.ReleaseAsk(client="pusher", lease=1001), None, 500 * MS)
    assert (released.outcome, released.refusal, released.number) == (Outcome.DONE, None, None)
    assert not released.renewed
    assert (steering.lease, steering.leases.holder) == (0, None)


@pytest.mark.parametrize(
    ("client", "mode", "reason"),
    [
        ("", Mode.HOLD, "holder_unnamed"),
        (wire.UNNAMED_CLIENT, Mode.HOLD, "holder_unnamed"),
        ("pusher", None, "core_silent"),
        ("pusher", Mode.FAULT, "machine_stopped"),
        ("pusher", Mode.STOPPING, "machine_stopped"),
        ("pusher", Mode.OFF, None),
        ("pusher", Mode.TORQUE, None),
    ],
)
def test_a_lease_is_refused_without_a_name_a_core_or_a_machine_that_may_move(
    steering, client, mode, reason
):
    decision = steering.decide(acquire(client), mode, 0)

    assert decision.outcome is (Outcome.REFUSED if reason else Outcome.DONE)
    assert (decision.refusal and decision.refusal.code) == reason
    assert bool(steering.lease) == (not reason)


def test_a_refused_query_leaves_lease_and_setpoints_as_they_were(steering):
    number = steering.decide(acquire(), Mode.HOLD, 0).number
    steering.receive_setpoints(Batch((arrival(lease=number),)), 0)

    for query in (acquire("other"), wire.ReleaseAsk(client="other", lease=number)):
        decision = steering.decide(query, Mode.HOLD, 1)
        assert (decision.outcome, decision.number) == (Outcome.REFUSED, None)
        assert (decision.refusal.code, decision.refusal.values) == (
            "lease_taken",
            {"holder": "pusher"},
        )

    assert steering.lease == number
    assert len(steering.setpoints) == 1


def test_a_state_is_published_for_a_known_leg_of_the_holder_of_the_lease_alone(steering):
    def refusal(**wrong):
        asked = {"client": "pusher", "lease": number, "leg": "right", "values": {}} | wrong
        refused = steering.refuse_report(wire.ReportAsk(**asked))
        return refused and (refused.code, refused.said)

    number = LEASE
    assert refusal() == ("lease_not_held", "")

    number = steering.decide(acquire(), Mode.HOLD, 0).number
    assert [refusal(leg=leg) for leg in LEGS] == [None, None]
    assert refusal(leg="middle") == ("unknown_leg", "right, left")
    assert refusal(client="other") == ("lease_taken", "")
    assert refusal(lease=number + 1) == ("lease_number_wrong", "")


def test_setpoints_outlive_a_renewal_and_never_the_lease(steering):
    number = steering.decide(acquire(), Mode.HOLD, 0).number
    steering.receive_setpoints(Batch((arrival(lease=number),)), 0)
    steering.decide(acquire(lease=number), Mode.HOLD, 1)
    assert len(steering.setpoints) == 1

    steering.decide(wire.ReleaseAsk(client="pusher", lease=number), Mode.HOLD, 2)
    assert steering.setpoints == ()


def test_a_core_that_counts_lower_has_accepted_nothing(steering, make_record):
    steering.decide(acquire(), Mode.HOLD, 0)
    steering.receive_record(record_with(make_record, 2, accepted_count=1), 0)
    steering.receive_record(record_with(make_record, 3, accepted_count=0), 400 * MS)

    assert len(steering.tick(500 * MS)) == 1


def test_a_new_holder_is_told_also_what_was_refused_before_it(steering):
    malformed = Batch((Arrival("right", b"{"),))

    assert [len(steering.receive_setpoints(malformed, 0)) for _ in range(2)] == [1, 0]
    steering.decide(acquire(), Mode.HOLD, 0)
    assert len(steering.receive_setpoints(malformed, 0)) == 1


def test_each_holder_is_told_anew_what_is_refused(steering):
    for turn in range(2):
        number = steering.decide(acquire(), Mode.HOLD, turn).number
        said = [
            len(steering.receive_setpoints(Batch((arrival(lease=number + 1),)), turn))
            for _ in range(2)
        ]
        assert said == [1, 0]
        steering.decide(wire.ReleaseAsk(client="pusher", lease=number), Mode.HOLD, turn)


def test_another_query_is_a_programming_error(steering):
    with pytest.raises(TypeError, match="Ask is no request for a lease"):
        steering.decide(wire.Ask(client="pusher"), Mode.HOLD, 0)


def test_a_closed_box_leaves_no_descriptor():
    box = SetpointBox()
    box.close()

    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(box.fileno())
